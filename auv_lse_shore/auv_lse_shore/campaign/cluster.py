"""The Dask cluster that simulates missions: a remote one, or this machine's cores."""

import argparse
import contextlib
import logging
import os
import signal
import tempfile
from collections.abc import Iterator
from typing import Any

from auv_lse_common.support.option_types import whole_from
from auv_lse_run.process.interrupt import interrupts_postponed

#: A mission is recorded as failed when more workers than this have died while simulating it.
MAX_LOST_WORKERS = 2


class CampaignError(RuntimeError):
    """A campaign that cannot continue: its folder is in use, its cluster is gone, a row is missing."""


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A client of the cluster at `scheduler`, or of a local one with `workers` processes.

    Raises:
        CampaignError: if the scheduler cannot be reached, or has no worker after a minute.
    """
    import dask
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        stack.enter_context(_clean_shutdown())
        stack.enter_context(
            dask.config.set(
                {"distributed.scheduler.allowed-failures": MAX_LOST_WORKERS, "distributed.comm.timeouts.connect": "30s"}
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
            with interrupts_postponed():
                local = stack.enter_context(
                    LocalCluster(
                        n_workers=workers or cores(),
                        threads_per_worker=1,
                        processes=True,
                        host="127.0.0.1",
                        dashboard_address="127.0.0.1:0",
                        memory_limit=0,
                        local_directory=scratch,
                        env={"TMPDIR": scratch},  # workers are killed, and remove nothing
                        silence_logs=logging.CRITICAL,
                    )
                )
                client = stack.enter_context(Client(local))
        yield client


@contextlib.contextmanager
def _clean_shutdown() -> Iterator[None]:
    """Handles SIGINT even if the parent process ignores it, as a script in the background does."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def lost_cluster_is_an_error(*further: type[Exception]) -> Iterator[None]:
    """Turns the errors of a lost scheduler into a CampaignError, and `further` ones that only it can raise here."""
    from distributed import client

    # a closed client raises CancelledError in Dask of 2024
    closed = getattr(client, "ClosedClientError", client.CancelledError)
    try:
        yield
    except (client.CancelledError, client.CommClosedError, closed, *further) as error:
        raise CampaignError(f"lost the cluster ({error}). Run the same command again to continue") from error


def add_cluster_options(p: argparse.ArgumentParser) -> None:
    """Adds the options that select the cluster."""
    where = p.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="Dask cluster to simulate on (default: this machine)"
    )
    where.add_argument(
        "--workers", type=whole_from(1), metavar="N", help="processes on this machine (default: one per core)"
    )
