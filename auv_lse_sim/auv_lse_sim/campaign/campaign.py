"""scripts/campaign: many missions on Dask, a result row for each as it finishes.

Missions are handed to the cluster a few per core ahead. A row is on disk before the next mission is handed out, so
that a campaign killed at any moment and started again flies only what has no row yet. A worker that dies takes its
mission with it, which Dask gives to another; a mission that kills its workers again and again, or raises, becomes
a row of status "failed" with its error, and the others go on.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import fcntl
import functools
import json
import logging
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.params import ParameterError
from auv_lse_sim.campaign import spec as campaign_spec
from auv_lse_sim.campaign.rows import CURVES, Rows, schema
from auv_lse_sim.campaign.spec import CampaignSpec, Job
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.judge.evaluation import Evaluation, evaluate
from auv_lse_sim.judge.report import write_outputs
from auv_lse_sim.record.bag import write_run
from auv_lse_sim.record.run_data import RunData
from auv_lse_sim.settings import Settings
from auv_lse_sim.world.ground_source import ground_of
from auv_lse_sim.world.navigable import fit_to_ground

#: Missions handed out beyond one per thread of the cluster, as a share of them (one at least): none waits for the next.
AHEAD = 0.25

#: Steps at which a mission's bounds are recomputed for its row.
BOUNDS = 11

#: Workers that a mission may take with it before it is recorded as failed.
DEATHS = 2


class CampaignError(RuntimeError):
    """A campaign that cannot go on: its folder is in use, its cluster is gone, a row is not there."""


@dataclasses.dataclass(slots=True, kw_only=True)
class Progress:
    """How a campaign stands.

    Attributes:
        total: Missions of the campaign.
        before: Of them, with a row from before.
        done: Flown now, failed ones included.
        failed: Of these, failed.
        threads: Missions that the cluster flies at once.
        elapsed_s: Wall-clock time since the first was handed out.
        busy_s: Sum of the missions' own wall-clock times.
        left_s: Estimate of the time left, NaN before anything is known.
        last: Row of the mission that ended last.
    """

    total: int
    before: int
    done: int = 0
    failed: int = 0
    threads: int = 1
    elapsed_s: float = 0.0
    busy_s: float = 0.0
    left_s: float = float("nan")
    last: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def efficiency(self) -> float:
        """Share of the cluster's time that missions were flown in."""
        return self.busy_s / (self.elapsed_s * self.threads) if self.elapsed_s > 0.0 else float("nan")


def fly_run(patterns: Mapping[str, Mapping[str, Any]], where: str) -> RunData:
    """Flies a mission in this process; operating area and starts are fitted to the ground, as scripts/mission does."""
    settings = Settings.from_patterns(patterns, where)
    ground = ground_of(settings)
    settings, _ = fit_to_ground(settings, ground)
    return Fleet(settings, ground).run()


def fly(job: Job, bounds: int = BOUNDS) -> dict[str, Any]:
    """Flies and judges one mission: its row. Nothing that goes wrong in it is raised."""
    began = time.perf_counter()
    row = _head(job)
    try:
        evaluation = evaluate(fly_run(job.patterns, f"mission {job.id}"), bounds)
        row.update(_results(evaluation))
        row["status"] = "ok"
        row["error"] = "; ".join(evaluation.run.notes) or None
    except Exception as error:  # whatever it is: it must not stop the other missions
        row["status"] = "failed"
        row["error"] = f"{type(error).__name__}: {error}"
        row["traceback"] = traceback.format_exc()
    row["busy_s"] = time.perf_counter() - began
    row["finished_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
    row["worker"] = f"{socket.gethostname()}:{os.getpid()}"
    return row


def _head(job: Job) -> dict[str, Any]:
    text = yaml.safe_dump(job.patterns, sort_keys=False)
    return {**_names(job), "version": version(), "parameters": text}


def _names(job: Job) -> dict[str, Any]:
    """What a mission is called in its campaign: columns that a changed campaign file changes."""
    varied = {name: _cell(value) for name, value in job.varied.items()}
    return {"id": job.id, "group": job.group, "seed": job.seed, **varied}


@functools.cache
def version() -> str:
    """The code that flies: the commit it was checked out from ("-dirty": changed since), or the package's version."""
    here = Path(__file__).resolve().parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        found = ""
    return found or metadata.version("auv_lse_sim")


def rows_of(spec: CampaignSpec, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of a campaign's missions, in its order, under the names that its file gives them now."""
    by_id = {row["id"]: row for row in rows}
    return [{**by_id[job.id], **_names(job)} for job in spec.jobs() if job.id in by_id]


def _cell(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _results(e: Evaluation) -> dict[str, Any]:
    values = {field.name: getattr(e.summary, field.name) for field in dataclasses.fields(e.summary)}
    return {**values, **{name: getattr(e.curves, name).tolist() for name in CURVES}}


def columns_of(spec: CampaignSpec) -> Any:
    """Columns of a campaign's rows."""
    return schema({name: [_cell(v[name]) for _, v in spec.settings if name in v] for name in spec.varied})


def run_campaign(
    spec: CampaignSpec,
    folder: Path,
    client: Any,
    *,
    retry_failed: bool = False,
    budget_s: float = float("inf"),
    progress: Callable[[Progress], None] | None = None,
) -> Progress:
    """Flies the missions of a campaign that have no row yet.

    Args:
        spec: The campaign.
        folder: Its folder.
        client: `distributed.Client` of the cluster to fly on.
        retry_failed: Whether missions that failed before are flown again.
        budget_s: No mission is handed out that would by experience end later than this.
        progress: Called after each mission.

    Raises:
        ParameterError: if a setting cannot be used; before anything is flown.
        CampaignError: if another process works on the folder, or the cluster is gone.
    """
    from distributed import as_completed

    jobs = spec.jobs()
    with _locked(folder):
        rows = Rows(folder, columns_of(spec))
        have = rows.statuses()
        todo = [job for job in jobs if have.get(job.id) not in (("ok",) if retry_failed else ("ok", "failed"))]
        threads = max(sum(client.nthreads().values()), 1)
        state = Progress(total=len(jobs), before=len(jobs) - len(todo), threads=threads)
        _say_versions(rows_of(spec, rows.read()) if todo and len(todo) < len(jobs) else [])
        waiting = iter(todo)
        began = time.monotonic()
        busy: dict[str, list[float]] = {}
        flying: dict[str, Job] = {}

        def hand_out() -> Any:
            usual = state.busy_s / state.done if state.done else 0.0
            job = next(waiting, None) if time.monotonic() - began + usual < budget_s else None
            if job is None:
                return None
            future = client.submit(fly, job, key=f"mission-{job.id}-{time.time_ns()}", pure=False)
            flying[future.key] = job
            return future

        with _cluster_at_hand():
            first = [f for f in (hand_out() for _ in range(threads + max(1, int(AHEAD * threads)))) if f is not None]
            in_air = as_completed(first)
            for future in in_air:
                job = flying.pop(future.key)
                row = _landed(future, job)
                rows.write(row)
                state.done += 1
                state.failed += row["status"] == "failed"
                state.busy_s += row.get("busy_s") or 0.0
                state.elapsed_s = time.monotonic() - began
                state.last = row
                busy.setdefault(job.group, []).append(row.get("busy_s") or 0.0)
                state.left_s = _left_s(busy, todo, state.done, threads)
                future.release()
                following = hand_out()
                if following is not None:
                    in_air.add(following)
                if progress is not None:
                    progress(state)
    return state


@contextlib.contextmanager
def _cluster_at_hand() -> Iterator[None]:
    """Turns what Dask raises when its scheduler is gone into a CampaignError."""
    from distributed.client import CancelledError, ClosedClientError, CommClosedError

    try:
        yield
    except (CancelledError, ClosedClientError, CommClosedError) as error:
        raise CampaignError(f"the cluster is gone ({error}); the same command goes on from here") from error


def _say_versions(rows: Sequence[Mapping[str, Any]]) -> None:
    others = sorted({str(row.get("version") or "unknown") for row in rows} - {version()})
    if others:
        print(
            f"{len(rows)} rows are kept, of code {', '.join(others)}; what follows is flown by {version()}", flush=True
        )


def _landed(future: Any, job: Job) -> dict[str, Any]:
    """The row of a finished future; a mission that Dask gave up on has failed.

    Raises:
        CampaignError: if the future was cancelled: with the cluster gone, nothing is known of the mission.
    """
    if future.status == "finished":
        row: dict[str, Any] = future.result()
        return row
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise CampaignError(
            f"the cluster is gone (mission {job.id} {future.status}); the same command goes on from here"
        )
    return {
        **_head(job),
        "status": "failed",
        "error": f"{type(error).__name__}: {error}",
        "finished_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _left_s(busy: Mapping[str, list[float]], todo: Sequence[Job], done: int, threads: int) -> float:
    """Time left: each mission takes what the others of its setting took, on average."""
    everything = [value for values in busy.values() for value in values]
    overall = sum(everything) / len(everything)
    means = {group: sum(values) / len(values) for group, values in busy.items()}
    total = sum(means.get(job.group, overall) for job in todo)
    spent = sum(everything)
    return max(total - spent, 0.0) / threads if done < len(todo) else 0.0


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds a campaign's folder for this process."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CampaignError(f"{folder}: another process works on this campaign; wait for it or stop it") from error
        yield


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A client of the cluster at `scheduler`, or of one of this machine's cores with `workers` processes.

    Raises:
        CampaignError: if the scheduler cannot be reached, or has no worker after a minute.
    """
    import dask
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        stack.enter_context(_ended_in_order())
        stack.enter_context(
            dask.config.set(
                {"distributed.scheduler.allowed-failures": DEATHS, "distributed.comm.timeouts.connect": "30s"}
            )
        )
        if scheduler is not None:
            try:
                client = stack.enter_context(Client(scheduler, timeout=30))
                client.wait_for_workers(1, timeout=60)
            except (OSError, TimeoutError, ValueError) as error:
                raise CampaignError(f"--scheduler {scheduler}: cannot be used: {error}") from error
        else:
            scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix="auv_lse_dask_"))
            local = stack.enter_context(
                LocalCluster(
                    n_workers=workers or cores(),
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    memory_limit=0,
                    local_directory=scratch,
                    silence_logs=logging.CRITICAL,
                )
            )
            client = stack.enter_context(Client(local))
        yield client


@contextlib.contextmanager
def _ended_in_order() -> Iterator[None]:
    """Makes SIGTERM (of a batch system, a service manager) what Ctrl-C is: no worker and no scratch folder stays.

    A parent that ignores SIGINT (a script in the background) hands that on: it is taken back.
    """
    before = {s: signal.signal(s, signal.default_int_handler) for s in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0))


# Re-running one mission -----------------------------------------------------------------------------------------------


def rerun(folder: Path, wanted: str, to: Path | None) -> tuple[Path, list[str]]:
    """Flies the mission of one row again, with full recording: run folder with bag, summary, figures and report.

    Args:
        folder: The campaign's folder.
        wanted: The row's id, or the beginning of it.
        to: Run folder, by default one in the campaign's.

    Returns:
        The run folder, and the keys of the summary that came out otherwise than in the row (times aside).

    Raises:
        CampaignError: if there is no such row, or the id fits several.
        Exception: whatever the mission fails with; that is what it was re-run for.
    """
    import pyarrow.parquet

    paths = sorted((folder / "rows").glob(f"{wanted}*.parquet"))
    if len(paths) != 1:
        raise CampaignError(f"{folder}: {len(paths)} rows have an id that begins with '{wanted}'; expected one")
    (row,) = pyarrow.parquet.read_table(paths[0]).to_pylist()
    to = to or folder / "reruns" / str(row["id"])
    if to.exists() and any(to.iterdir()):
        raise CampaignError(f"{to}: exists and is not empty; expected a new folder (--to)")
    run = fly_run(yaml.safe_load(row["parameters"]), f"mission {row['id']}")
    write_run(run, to)
    summary = write_outputs(evaluate(run, BOUNDS), to)
    now = {field.name: getattr(summary, field.name) for field in dataclasses.fields(summary)}
    timed = {"wall_s", "planning_median_s", "planning_max_s"}
    changed = [name for name, value in now.items() if name not in timed and not _same(value, row.get(name))]
    return to, changed if row["status"] == "ok" else []


def _same(now: Any, then: Any) -> bool:
    if isinstance(now, tuple):
        return isinstance(then, list) and len(now) == len(then) and all(map(_same, now, then))
    if isinstance(now, float) and math.isnan(now):
        return then is None or bool(then != then)
    return bool(now == then)


# Command line ---------------------------------------------------------------------------------------------------------


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/campaign."""
    p = argparse.ArgumentParser(
        prog="scripts/campaign",
        description="Flies a grid or list of settings times seeds in simulation (fleet engine, no ROS), a result row "
        "in Parquet for each mission as it finishes. Started again, it goes on where it stopped.",
        epilog=campaign_spec.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("spec", nargs="?", type=Path, metavar="SPEC.yaml", help="the campaign (below)")
    p.add_argument("--out", type=Path, metavar="DIR", help="the campaign's folder (default: runs/campaigns/NAME)")
    add_cluster_options(p)
    p.add_argument("--retry-failed", action="store_true", help="fly missions that failed before again")
    p.add_argument("--list", action="store_true", help="print the missions and which of them have a row, and end")
    p.add_argument("--rerun", metavar="ID", help="fly the mission of one row of --out again, with full recording")
    p.add_argument("--to", type=Path, metavar="DIR", help="run folder of --rerun (default: DIR/reruns/ID)")
    return p


def add_cluster_options(p: argparse.ArgumentParser) -> None:
    """The options that say where missions are flown."""
    where = p.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask cluster to fly on (default: this machine)"
    )
    where.add_argument(
        "--workers", type=_positive, metavar="N", help="processes on this machine (default: one per core)"
    )


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text}; expected 1 or more")
    return int(text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies a campaign. Returns 0; 1 if missions failed; 2 if it cannot be done; 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    if options.rerun is not None:
        return _rerun(options)
    try:
        if options.spec is None:
            raise CampaignError("SPEC.yaml: missing; expected a campaign file (or --rerun ID with --out DIR)")
        spec = CampaignSpec.load(options.spec)
        folder = options.out or default_root() / "campaigns" / spec.name
        if options.list:
            return _list(spec, folder)
        with _locked(folder):  # refused before a cluster is started
            (folder / "campaign.yaml").write_text(options.spec.read_text())
        with cluster(options.scheduler, options.workers) as client, display() as show:
            state = run_campaign(spec, folder, client, retry_failed=options.retry_failed, progress=show)
        page = finish(spec, folder, state)
    except (ParameterError, CampaignError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; finished missions are kept: the same command goes on from here", file=sys.stderr)
        return 130
    print(f"{state.done} missions flown, {state.before} had been, {state.failed} failed; {page}")
    return 1 if state.failed else 0


def default_root() -> Path:
    """Where results go that nobody said another place for."""
    return Path(os.environ.get("AUV_LSE_ROOT", Path.cwd())) / "runs"


def finish(spec: CampaignSpec, folder: Path, state: Progress) -> Path:
    """Merges the rows and writes the page; returns its path."""
    from auv_lse_sim.campaign.page import write_page

    kept = Rows(folder, columns_of(spec))
    rows = rows_of(spec, kept.read())
    kept.write_table(rows)
    if state.done:
        facts = {k: v for k, v in dataclasses.asdict(state).items() if k != "last"}
        facts["efficiency"] = state.efficiency
        (folder / "progress.json").write_text(json.dumps(facts, indent=2) + "\n")
    page: Path = write_page(spec, rows, folder)
    return page


def _list(spec: CampaignSpec, folder: Path) -> int:
    have = Rows(folder, columns_of(spec)).statuses() if (folder / "rows").is_dir() else {}
    for job in spec.jobs():
        print(f"{job.id}  {have.get(job.id, '-'):6}  seed {job.seed:<5} {job.group}")
    return 0


def _rerun(options: argparse.Namespace) -> int:
    """A mission that fails fails here too, with its traceback: that is what it was flown again for."""
    try:
        if options.out is None:
            raise CampaignError("--rerun: expected the campaign's folder in --out DIR")
        to, changed = rerun(options.out, options.rerun, options.to)
    except CampaignError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(f"run folder: {to}")
    if changed:
        print(f"came out otherwise than in the row: {', '.join(changed)}", file=sys.stderr)
    return 0


@contextlib.contextmanager
def display() -> Iterator[Callable[[Progress], None]]:
    """Shows a campaign's progress: a live bar on a terminal, else a line every ten seconds."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bars

    console = Console()
    if not console.is_terminal:
        last = [0.0]

        def line(state: Progress) -> None:
            done = state.before + state.done
            if time.monotonic() - last[0] > 10.0 or done == state.total:
                last[0] = time.monotonic()
                print(
                    f"{done}/{state.total} missions, {state.failed} failed, {duration(state.left_s)} left", flush=True
                )

        yield line
        return
    bars = Bars(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
        console=console,
    )
    with bars:
        task = bars.add_task("missions", total=None, left="starting")

        def bar(state: Progress) -> None:
            failed = f", {state.failed} failed" if state.failed else ""
            text = f"{duration(state.left_s)} left{failed}"
            bars.update(task, total=state.total, completed=state.before + state.done, left=text)

        yield bar


def duration(seconds: float) -> str:
    """A time for readers: 45 s, 12 min, 3 h 20 min."""
    if seconds != seconds:
        return "unknown time"
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


if __name__ == "__main__":
    sys.exit(main())
