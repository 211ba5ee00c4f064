"""Flies the missions of a campaign on a cluster, a result row for each as it finishes.

Missions are handed to the cluster a few per core ahead. A row is on disk before the next mission is handed out: a
campaign that is killed at any moment and started again flies only the missions that have no row yet. If a worker dies,
Dask gives its mission to another. A mission that raises an error, or whose workers die again and again, becomes a row
of status "failed" with its error; the others go on.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_lse_record.software import version
from auv_lse_shore.campaign.cluster import lost_cluster_is_an_error
from auv_lse_shore.campaign.errors import CampaignError
from auv_lse_shore.campaign.mission_row import failed_row, mission_row
from auv_lse_shore.campaign.rows import Rows, columns_of, rows_of
from auv_lse_shore.campaign.spec import CampaignSpec, Job

#: Missions handed out beyond one per thread of the cluster, as a share of them (at least one): no thread waits.
AHEAD = 0.25


@dataclasses.dataclass(slots=True, kw_only=True)
class CampaignState:
    """How far a campaign has come.

    Attributes:
        total: Missions of the campaign.
        before: Of these, missions with a row from an earlier run.
        done: Missions flown in this run, failed ones included.
        failed: Missions of this run that failed.
        threads: Missions that the cluster flies at once.
        elapsed_s: Wall-clock time since the first was handed out.
        busy_s: Sum of the missions' own wall-clock times.
        left_s: Estimate of the time left, NaN before the first mission ended.
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
        """Share of the cluster's time in which missions were flown."""
        return self.busy_s / (self.elapsed_s * self.threads) if self.elapsed_s > 0.0 else float("nan")


def run_campaign(
    spec: CampaignSpec,
    folder: Path,
    client: Any,
    *,
    retry_failed: bool = False,
    budget_s: float = float("inf"),
    progress: Callable[[CampaignState], None] | None = None,
) -> CampaignState:
    """Flies the missions of a campaign that have no row yet.

    Args:
        spec: The campaign.
        folder: Its folder.
        client: `distributed.Client` of the cluster to fly on.
        retry_failed: Whether missions that failed before are flown again.
        budget_s: No mission is handed out that would probably end later than this (s from now).
        progress: Called after each mission.

    Raises:
        ParameterError: if a setting cannot be used; before anything is flown.
        CampaignError: if another process works on the folder, or the cluster is gone.
    """
    from distributed import as_completed

    jobs = spec.jobs()
    with locked(folder):
        rows = Rows(folder, columns_of(spec))
        statuses = rows.statuses()
        todo = [job for job in jobs if statuses.get(job.id) not in (("ok",) if retry_failed else ("ok", "failed"))]
        threads = max(sum(client.nthreads().values()), 1)
        state = CampaignState(total=len(jobs), before=len(jobs) - len(todo), threads=threads)
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
            future = client.submit(mission_row, job, key=f"mission-{job.id}-{time.time_ns()}", pure=False)
            flying[future.key] = job
            return future

        with lost_cluster_is_an_error():
            first = [f for f in (hand_out() for _ in range(threads + max(1, int(AHEAD * threads)))) if f is not None]
            submitted = as_completed(first)
            for future in submitted:
                job = flying.pop(future.key)
                row = _finished_row(future, job)
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
                    submitted.add(following)
                if progress is not None:
                    progress(state)
    return state


def _say_versions(rows: Sequence[Mapping[str, Any]]) -> None:
    others = sorted({str(row.get("version") or "unknown") for row in rows} - {version()})
    if others:
        print(
            f"{len(rows)} rows are kept, of code {', '.join(others)}; what follows is flown by {version()}", flush=True
        )


def _finished_row(future: Any, job: Job) -> dict[str, Any]:
    """The row of a finished future; a mission that Dask gave up on has failed.

    Raises:
        CampaignError: if the future was cancelled: without the cluster nothing is known of the mission.
    """
    if future.status == "finished":
        row: dict[str, Any] = future.result()
        return row
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise CampaignError(
            f"the cluster is gone (mission {job.id} {future.status}); the same command goes on from here"
        )
    return failed_row(job, error)


def _left_s(busy: Mapping[str, list[float]], todo: Sequence[Job], done: int, threads: int) -> float:
    """Time left: each mission takes what the others of its setting took, on average."""
    everything = [value for values in busy.values() for value in values]
    overall = sum(everything) / len(everything)
    means = {group: sum(values) / len(values) for group, values in busy.items()}
    total = sum(means.get(job.group, overall) for job in todo)
    spent = sum(everything)
    return max(total - spent, 0.0) / threads if done < len(todo) else 0.0


def made_folder(folder: Path) -> Path:
    """`folder`, made where it is missing.

    Raises:
        CampaignError: if a file of that name is in the way.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise CampaignError(f"{folder}: is a file; expected a folder, or a name that is free") from error
    return folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds a campaign's folder for this process.

    Raises:
        CampaignError: if another process holds it.
    """
    with (made_folder(folder) / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CampaignError(f"{folder}: another process works on this campaign; wait for it or stop it") from error
        yield
