"""Command-line options that scripts/campaign and scripts/reproduce share."""

from __future__ import annotations

import argparse
from pathlib import Path

from auv_lse_common.support.project_folder import project_folder


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


def default_root() -> Path:
    """The folder of results, where no other is given."""
    return project_folder() / "runs"
