"""Entry point of scripts/mission: starts loading the nodes before its own imports."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence

from auv_lse_run.process.domain import node_environment
from auv_lse_run.process.fork_server import load_early
from auv_lse_run.process.processes import LaunchError
from auv_lse_sim.engine.processes import mission_processes

#: Options that start no mission.
_NO_MISSION = {"-h", "--help", "--parameters", "--for-vehicles"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a mission as `auv_lse_shore.mission.mission` does; returns its exit code."""
    if not _NO_MISSION & {word.partition("=")[0] for word in (sys.argv[1:] if arguments is None else arguments)}:
        with contextlib.suppress(LaunchError):  # reported when the processes are started
            load_early(mission_processes(1, together=True), node_environment(0))
    from auv_lse_shore.mission import mission  # takes more than a second

    return mission.main(arguments)


if __name__ == "__main__":
    sys.exit(main())
