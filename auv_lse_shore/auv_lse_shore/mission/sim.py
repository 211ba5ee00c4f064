"""scripts/sim: the simulator and its recorder; each vehicle is started with scripts/vehicle."""

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

#: Mission file of separate vehicles in the run folder.
VEHICLES = "vehicles.yaml"


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/sim."""
    p = argparse.ArgumentParser(
        prog="scripts/sim",
        description="Runs the simulator of a mission, and its recorder. Start each vehicle with scripts/vehicle and "
        "the mission.yaml that this command writes. The mission begins when all vehicles have started. The result is "
        "that of scripts/mission.",
        epilog="Exit codes: 0 the mission is complete; 1 it failed; 2 wrong command line or impossible request; "
        "130 Ctrl-C.",
    )
    add_mission_options(p)
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to create (default: runs/DATE-TIME)")
    p.add_argument(
        "--domain", metavar="N", help="ROS domain, the same for scripts/vehicle (default: ROS_DOMAIN_ID, else 0)"
    )
    p.add_argument(
        "--apart",
        action="store_true",
        help="separate vehicles: each runs in its own ROS domain, in real time, with an emulated modem and a simulated "
        "autopilot, and shares only the simulated water with the others",
    )
    p.add_argument("--no-record", action="store_true", help="make no recording, and so no report")
    p.add_argument("--no-report", action="store_true", help="make no figures and no report.html")
    p.set_defaults(for_vehicles=None)
    return p


def _apart(settings: Settings, folder: Path) -> Settings:
    """The mission with separate vehicles; also writes their mission file, which has no section sim."""
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
    """Runs the simulator. Returns 0, 1, 2 or 130, as the help says."""
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
    say("start each vehicle in its own terminal:")
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
