"""Command-line options that scripts/campaign and scripts/reproduce share."""

from __future__ import annotations

import argparse
from pathlib import Path

from auv_lse_common.support.project_folder import project_folder


def add_cluster_options(p: argparse.ArgumentParser) -> None:
    """Adds the options that select the cluster."""
    where = p.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="Dask cluster to simulate on (default: this machine)"
    )
    where.add_argument(
        "--workers", type=_positive, metavar="N", help="processes on this machine (default: one per core)"
    )


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text}; expected a whole number from 1")
    return int(text)


def default_root() -> Path:
    """The default folder of results."""
    return project_folder() / "runs"
