"""scripts/sim: the simulator and its recorder alone; the vehicles run elsewhere on this machine (scripts/vehicle)."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.text import Text

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.process.domain import DomainError, taken_domain, wanted_domain
from auv_lse_common.support.project_folder import project_folder
from auv_lse_shore.mission.mission import fly, prepare, write_mission
from auv_lse_shore.mission.options import add_mission_options
from auv_lse_shore.mission.run_folder import begun, run_folder
from auv_lse_shore.mission.vehicle_file import send_duration_s
from auv_lse_sim.engine.processes import mission_processes

#: The file in the run folder that vehicles apart get.
VEHICLES = "vehicles.yaml"


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
    p.add_argument(
        "--apart",
        action="store_true",
        help="the vehicles share nothing with each other but the simulated water: each runs in a ROS domain of its own "
        "on an emulated modem and a simulated autopilot, in real time, by its clock",
    )
    p.add_argument("--no-record", action="store_true", help="start no recorder; no report is made then")
    p.add_argument("--no-report", action="store_true", help="leave out figures and report.html")
    p.set_defaults(for_vehicles=None)
    return p


def _apart(settings: Settings, folder: Path) -> Settings:
    """The mission with its vehicles apart; writes the vehicles' file, which has no section sim, beside it."""
    paced: dict[str, Any] = {"sim.lockstep": False, "sim.real_time_factor": 1.0, "sim.apart": True}
    paced["tdma.send_duration_s"] = send_duration_s(settings)
    for k in range(1, settings.mission.vehicles + 1):
        paced[f"auv{k}.link.soundings"] = True  # from the autopilot: the simulator's topics do not reach the vehicle
    settings = settings.with_overrides(paced)
    (folder / "mission.yaml").write_text(settings.to_parameter_file())
    body = yaml.safe_load(settings.with_overrides({"record.folder": "bag"}).to_parameter_file())
    del body["/**"]["ros__parameters"]["sim"]
    (folder / VEHICLES).write_text(yaml.safe_dump(body, sort_keys=False, default_flow_style=None, width=110))
    return settings


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulates a mission. Returns 0, 1 if it failed, 2 if the request cannot be met, 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    console = Console(stderr=False)

    def say(text: str) -> None:
        console.print(Text(text), highlight=False, soft_wrap=True)

    root = project_folder()
    try:
        domain = wanted_domain(options.domain)
        settings, notes = prepare(options, root)
        folder = run_folder(options.out, root)
        if options.apart:
            options.modem, options.vehicle_link = "emulated", "mavlink"
        with begun(folder):
            settings = write_mission(settings, folder, options, record=not options.no_record)
            if options.apart:
                settings = _apart(settings, folder)
    except (ValueError, DomainError) as error:
        say(f"error: {error}")
        return 2
    for note in notes:
        say(note)
    say(f"run folder: {folder}")
    say("start each vehicle in a terminal of its own:")
    where = f" --domain {domain}" if options.domain else ""
    for vehicle in range(1, settings.mission.vehicles + 1):
        if options.apart:
            say(f"    scripts/vehicle auv{vehicle} {folder / VEHICLES} --domain {domain + vehicle}")
        else:
            say(f"    scripts/vehicle auv{vehicle} {folder / 'mission.yaml'}{where}")
    processes = mission_processes(0, record=not options.no_record)
    owned = taken_domain(domain)
    return fly(settings, folder, console, processes, owned, start_s=math.inf, report=not options.no_report)


if __name__ == "__main__":
    sys.exit(main())
