"""Simulates the missions of a campaign on a cluster and writes a result row for each as it finishes.

A few more missions than cores are submitted at any time. A row is on disk before the next mission is submitted: a
campaign that is killed at any moment and restarted simulates only the missions without a row. If a worker dies, Dask
gives its mission to another. A mission that raises an error, or whose workers die repeatedly, becomes a row of status
"failed" with its error; the others continue.
"""

import contextlib
import dataclasses
import fcntl
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from auv_lse_common.support.plurals import counted
from auv_lse_record.software import other_versions, version
from auv_lse_shore.campaign.cluster import CampaignError, lost_cluster_is_an_error
from auv_lse_shore.campaign.mission_row import failed_row, mission_row
from auv_lse_shore.campaign.rows import Rows, columns_of, rows_of
from auv_lse_shore.campaign.spec import CampaignSpec, Job

#: Missions submitted beyond one per thread of the cluster, as a share of the threads (at least one).
AHEAD = 0.25
#: Period (s) of a look at the cluster while no mission ends.
_LOOK_S = 5.0


@dataclasses.dataclass(slots=True, kw_only=True)
class CampaignState:
    """Progress of a campaign.

    Attributes:
        total: Missions of the campaign.
        before: Missions with a row from an earlier run.
        done: Missions simulated in this run, failed ones included.
        failed: Missions that failed, in this run or in an earlier one.
        threads: Missions that the cluster simulates at once; 0: it has no worker now.
        elapsed_s: Wall-clock time since the first was submitted.
        busy_s: Sum of the missions' wall-clock times.
        offered_s: Time that the cluster had for missions, of all its threads.
        left_s: Estimate of the time left, at most that of the budget; NaN before the first mission ended.
        limited: Whether a budget may end the campaign before its last mission.
        last: Row of the mission that ended last.
    """

    total: int
    before: int
    done: int = 0
    failed: int = 0
    threads: int = 1
    elapsed_s: float = 0.0
    busy_s: float = 0.0
    offered_s: float = 0.0
    left_s: float = float("nan")
    limited: bool = False
    last: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def progress(self) -> str:
        """Finished missions of all, as text."""
        return f"{self.before + self.done} of {'up to ' if self.limited else ''}{self.total} missions"

    @property
    def efficiency(self) -> float | None:
        """Share of the cluster's time spent on missions; None if it had no time."""
        return self.busy_s / self.offered_s if self.offered_s > 0.0 else None


def run_campaign(
    spec: CampaignSpec,
    folder: Path,
    client: Any,
    *,
    retry_failed: bool = False,
    budget_s: float = float("inf"),
    progress: Callable[[CampaignState], None] | None = None,
) -> CampaignState:
    """Simulates the missions of a campaign that have no row yet. The caller has `locked` the folder.

    Args:
        client: `distributed.Client` of the cluster.
        retry_failed: Whether missions that failed earlier are repeated.
        budget_s: Time (s) from now after which no mission should end; those that probably would are not started.

    Raises:
        ParameterError: if a setting cannot be used; before anything is simulated.
        CampaignError: if the cluster is gone.
    """
    jobs = spec.jobs()
    rows = Rows(folder, columns_of(spec))
    statuses = rows.statuses()
    todo = [job for job in jobs if statuses.get(job.id) not in (("ok",) if retry_failed else ("ok", "failed"))]
    if todo and len(todo) < len(jobs):
        _report_versions(rows_of(spec, rows.read()))
    state = CampaignState(total=len(jobs), before=len(jobs) - len(todo))
    state.failed = sum(statuses.get(job.id) == "failed" for job in jobs)
    state.limited = math.isfinite(budget_s)
    queue = _Queue(todo, client, state, budget_s, {name for name, status in statuses.items() if status == "failed"})
    with lost_cluster_is_an_error():
        while queue.fill():
            for future in queue.finished():
                rows.write(queue.take(future))
                if progress is not None:
                    progress(state)
            if not state.threads and progress is not None:
                progress(state)
    return state


class _Queue:
    """Keeps the cluster busy with missions, however many workers it has at the time, and the state of the campaign."""

    def __init__(
        self, todo: Sequence[Job], client: Any, state: CampaignState, budget_s: float, failed: Set[str] = frozenset()
    ) -> None:
        """Args: failed: ids of missions that failed earlier."""
        self._todo, self._client, self._state, self._budget_s = todo, client, state, budget_s
        self._failed = failed
        self._waiting, self._running = iter(todo), dict[Any, Job]()
        self._began = self._looked = time.monotonic()
        self._busy: dict[str, list[float]] = {}

    def fill(self) -> bool:
        """Submits missions for all threads and some ahead, unless they would probably exceed the budget.

        Once it is used up, missions are cancelled that wait for a cluster without workers.

        Returns:
            Whether any is under way.
        """
        with lost_cluster_is_an_error(OSError):
            threads = sum(self._client.nthreads().values())
        before, self._looked = self._looked, time.monotonic()
        self._state.offered_s += self._state.threads * (self._looked - before)
        self._state.threads = threads
        if not threads and self._looked - self._began > self._budget_s:
            for future in self._running:
                future.cancel()
            self._running.clear()
        usual = self._state.busy_s / self._state.done if self._state.done else 0.0
        while len(self._running) < threads + max(1, int(AHEAD * threads)):
            job = next(self._waiting, None) if time.monotonic() - self._began + usual < self._budget_s else None
            if job is None:
                break
            future = self._client.submit(mission_row, job, key=f"mission-{job.id}-{time.time_ns()}", pure=False)
            self._running[future] = job
        return bool(self._running)

    def finished(self) -> list[Any]:
        """The futures that have finished; waits a while for the first."""
        from distributed import wait

        with contextlib.suppress(TimeoutError):
            wait(list(self._running), timeout=_LOOK_S, return_when="FIRST_COMPLETED")
        return [future for future in self._running if future.done()]

    def take(self, future: Any) -> dict[str, Any]:
        """The row of a finished future, which is released; the state counts it."""
        state, job = self._state, self._running.pop(future)
        row = _finished_row(future, job)
        busy_s = row.get("busy_s") or 0.0
        state.done += 1
        state.failed += (row["status"] == "failed") - (job.id in self._failed)
        state.busy_s += busy_s
        state.elapsed_s = time.monotonic() - self._began
        state.last = row
        self._busy.setdefault(job.group, []).append(busy_s)
        state.left_s = self._left_s()
        future.release()
        return row

    def _left_s(self) -> float:
        """Estimate of the time left: each mission takes the mean time of its setting, until the budget is used up."""
        done = [value for values in self._busy.values() for value in values]
        means = {group: sum(values) / len(values) for group, values in self._busy.items()}
        total = sum(means.get(job.group, sum(done) / len(done)) for job in self._todo)
        estimate_s = max(total - sum(done), 0.0) / max(self._state.threads, 1) if len(done) < len(self._todo) else 0.0
        return max(min(estimate_s, self._budget_s - self._state.elapsed_s), 0.0)


def _report_versions(rows: Sequence[Mapping[str, Any]]) -> None:
    others = other_versions(rows)
    if others:
        print(f"{counted(len(rows), 'row')} from version {others}; new ones are from {version()}", flush=True)


def _finished_row(future: Any, job: Job) -> dict[str, Any]:
    """The row of a finished future; a mission that Dask stopped retrying has failed."""
    if future.status == "finished":
        row: dict[str, Any] = future.result()
        return row
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise CampaignError(
            f"lost the cluster (mission {job.id} {future.status}). Run the same command again to continue"
        )
    return failed_row(job, error)


def make_folder(folder: Path) -> Path:
    """Makes a folder if it is missing; returns it.

    Raises:
        CampaignError: if there is a file of that name.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise CampaignError(f"{folder} is a file, not a folder; choose another name") from error
    return folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Locks a campaign's folder for this process.

    Raises:
        CampaignError: if another process holds it.
    """
    with (make_folder(folder) / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CampaignError(f"{folder}: another process works on this campaign. Wait for it or stop it") from error
        yield
