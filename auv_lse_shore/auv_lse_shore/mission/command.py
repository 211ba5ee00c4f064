"""The verb `auv_lse mission`: starts loading the nodes before its own imports."""

import argparse
import contextlib

from auv_lse_run.process.domain import node_environment
from auv_lse_run.process.fork_server import end_early, load_early
from auv_lse_run.process.processes import LaunchError
from auv_lse_shore.mission_options import parser
from auv_lse_sim.engine.processes import mission_processes

__all__ = ["parser", "run"]


def run(options: argparse.Namespace) -> int:
    """Runs a mission as `auv_lse_shore.mission.mission` does; returns its exit code."""
    if not options.parameters and options.for_vehicles is None:
        with contextlib.suppress(LaunchError):  # reported when the processes are started
            load_early(mission_processes(1, together=True), node_environment(0))
    try:
        from auv_lse_shore.mission import mission  # takes more than a second

        return mission.run(options)
    finally:
        end_early()
