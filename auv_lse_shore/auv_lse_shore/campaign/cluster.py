"""The Dask cluster that missions are flown on: one elsewhere, or this machine's cores."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import tempfile
from collections.abc import Iterator
from typing import Any

from auv_lse_shore.campaign.errors import CampaignError

#: A mission is recorded as failed when more workers than this have died while flying it.
LOST_WORKERS = 2


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
                {"distributed.scheduler.allowed-failures": LOST_WORKERS, "distributed.comm.timeouts.connect": "30s"}
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
    """Treats SIGTERM (of a batch system, a service manager) as Ctrl-C, so that no worker and no scratch folder stays.

    A child of a process that ignores SIGINT (a script in the background) ignores it too; here it does not.
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


@contextlib.contextmanager
def lost_cluster_is_an_error() -> Iterator[None]:
    """Raises a CampaignError for what Dask raises when its scheduler is gone."""
    from distributed.client import CancelledError, ClosedClientError, CommClosedError

    try:
        yield
    except (CancelledError, ClosedClientError, CommClosedError) as error:
        raise CampaignError(f"the cluster is gone ({error}); the same command goes on from here") from error
