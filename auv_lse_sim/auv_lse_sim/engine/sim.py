"""scripts/sim: the simulator and its recorder alone; the vehicles run elsewhere on this machine (scripts/vehicle)."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from auv_lse_common.domain import DomainError, domain_number, taken_domain
from auv_lse_common.processes import Process
from auv_lse_sim.engine.mission import fly, prepare, project_root, write_mission
from auv_lse_sim.engine.options import add_mission_options
from auv_lse_sim.engine.run_folder import run_folder


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/sim."""
    p = argparse.ArgumentParser(
        prog="scripts/sim",
        description="Runs the simulator of a mission, and its recorder. The vehicles are started one by one with "
        "scripts/vehicle, each with the mission.yaml that this command writes. The mission begins when the last one "
        "is there, and is the same as that of scripts/mission.",
        epilog="Exit codes: 0 the mission is complete; 1 it failed; 2 the request cannot be met; 130 Ctrl-C.",
    )
    add_mission_options(p)
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to make (default: runs/DATE-TIME)")
    p.add_argument("--domain", metavar="N", help="ROS domain (default: ROS_DOMAIN_ID, else 0), as scripts/vehicle's")
    p.add_argument("--no-record", action="store_true", help="start no recorder; no report is made then")
    p.add_argument("--no-report", action="store_true", help="leave out figures and report.html")
    p.set_defaults(for_vehicles=None)
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulates a mission. Returns 0, 1 if it failed, 2 if the request cannot be met, 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    console = Console(stderr=False)

    def say(text: str) -> None:
        console.print(Text(text), highlight=False, soft_wrap=True)

    root = project_root()
    try:
        domain = domain_number(options.domain or os.environ.get("ROS_DOMAIN_ID") or "0")
        settings, notes = prepare(options, root)
        folder = run_folder(options.out, root)
    except (ValueError, DomainError) as error:
        say(f"error: {error}")
        return 2
    settings = write_mission(settings, folder, options, record=not options.no_record)
    for note in notes:
        say(note)
    say(f"run folder: {folder}")
    say("start each vehicle in a terminal of its own:")
    where = f" --domain {domain}" if options.domain else ""
    for vehicle in range(1, settings.mission.vehicles + 1):
        say(f"    scripts/vehicle auv{vehicle} {folder / 'mission.yaml'}{where}")
    names = ["sim_node"] if options.no_record else ["recorder_node", "sim_node"]
    processes = [Process(package="auv_lse_sim", executable=name, namespace="/") for name in names]
    owned = taken_domain(domain)
    return fly(settings, folder, console, processes, owned, start_s=math.inf, report=not options.no_report)


if __name__ == "__main__":
    sys.exit(main())
