"""Times for readers, and the time left of a campaign."""

import time

import pytest

from auv_lse_shore.campaign.cluster import CampaignError
from auv_lse_shore.campaign.progress_display import duration, left
from auv_lse_shore.campaign.runner import CampaignState, _Queue
from auv_lse_shore.campaign.spec import Job


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(float("nan"), "unknown time"), (45.2, "45 s"), (720.0, "12 min"), (12000.0, "3 h 20 min")],
)
def test_durations_for_readers(seconds, text):
    assert duration(seconds) == text


class _Finished:
    status, key = "finished", "k"

    def result(self):
        return {"status": "ok", "busy_s": 20.0}

    def release(self):
        """Nothing to release."""


@pytest.mark.parametrize(("budget_s", "left_s"), [(float("inf"), 399.0 * 20.0), (90.0, 90.0)])
def test_the_time_left_is_at_most_that_of_the_budget(budget_s, left_s):
    jobs = [Job(id=str(i), group="g", varied={}, seed=i, patterns={}) for i in range(400)]
    state = CampaignState(total=400, before=0, limited=budget_s < 1e9)
    queue = _Queue(jobs, None, state, budget_s)
    ended = _Finished()
    queue._running[ended], queue._began = jobs[0], time.monotonic()
    queue.take(ended)
    assert state.left_s == pytest.approx(left_s, abs=1.0)
    assert state.progress == f"1 of {'up to ' if state.limited else ''}400 missions"


class _Cluster:
    """A client whose cluster has `threads` by worker."""

    def __init__(self):
        self.threads = {}
        self.submitted = 0

    def nthreads(self):
        return self.threads

    def submit(self, *args, **options):
        self.submitted += 1
        return _Waiting()


class _Waiting:
    cancelled = False

    def cancel(self):
        self.cancelled = True


def test_a_cluster_that_grows_and_shrinks_is_kept_busy_and_shown():
    jobs = [Job(id=str(i), group="g", varied={}, seed=i, patterns={}) for i in range(20)]
    state, cluster = CampaignState(total=20, before=0, left_s=54.0), _Cluster()
    queue = _Queue(jobs, cluster, state, float("inf"))
    for threads, submitted, shown in (
        ({}, 1, "waiting: the cluster has no worker"),
        ({"a": 4}, 5, "54 s left"),
        ({"a": 4, "b": 8}, 15, "54 s left"),
        ({"b": 8}, 15, "54 s left"),
        ({}, 15, "waiting: the cluster has no worker"),
    ):
        cluster.threads = threads
        assert queue.fill()
        assert (cluster.submitted, left(state)) == (submitted, shown)
    state.done = state.total
    assert left(state) == "54 s left", "there is nothing to wait for"


def test_the_efficiency_counts_the_threads_that_there_were(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    state, cluster = CampaignState(total=20, before=0), _Cluster()
    queue = _Queue([], cluster, state, float("inf"))
    assert state.efficiency is None
    for threads, after_s in (({"a": 12}, 0.0), ({"a": 1}, 10.0), ({}, 10.0), ({}, 50.0)):
        now[0] += after_s
        cluster.threads = threads
        queue.fill()
    state.busy_s = 65.0
    assert state.efficiency == pytest.approx(65.0 / (12 * 10.0 + 1 * 10.0))


def test_a_budget_ends_a_campaign_whose_cluster_has_no_worker(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    jobs = [Job(id=str(i), group="g", varied={}, seed=i, patterns={}) for i in range(20)]
    queue = _Queue(jobs, _Cluster(), CampaignState(total=20, before=0), 60.0)
    assert queue.fill()
    waiting = list(queue._running)
    now[0] += 61.0
    assert not queue.fill()
    assert [future.cancelled for future in waiting] == [True] * len(waiting)


def test_a_scheduler_that_does_not_answer_is_a_lost_cluster():
    class Gone(_Cluster):
        def nthreads(self):
            raise OSError("Timed out trying to connect")

    with pytest.raises(CampaignError, match=r"lost the cluster .* same command again"):
        _Queue([], Gone(), CampaignState(total=20, before=0), 60.0).fill()
