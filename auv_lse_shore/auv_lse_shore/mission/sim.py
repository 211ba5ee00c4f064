"""auv_lse sim: the simulator and its recorder; each vehicle is started with auv_lse vehicle."""

import argparse
import math
import shlex
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.text import Text

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.dive import SIMULATION, new_dive
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_common.support.project_folder import project_folder
from auv_lse_comms.settings import least_send_duration_s
from auv_lse_run.process.domain import VEHICLE_DOMAINS, DomainError, note_run, simulator_domain, wanted_domain
from auv_lse_shore.mission.mission import complain, fly, prepare, write_mission
from auv_lse_shore.mission.run_folder import removed_on_error, run_folder
from auv_lse_shore.mission_options import add_mission_options
from auv_lse_sim.engine.processes import mission_processes
from auv_lse_sim.ground.ground_source import shared_ground

#: Mission file of separate vehicles in the run folder.
VEHICLES = "vehicles.yaml"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse sim."""
    p = argparse.ArgumentParser(
        prog="auv_lse sim",
        description="Runs the simulator of a mission, and its recorder. Start each vehicle with auv_lse vehicle and "
        "the mission.yaml that this command writes. The mission begins when all vehicles have started. The result is "
        "that of auv_lse mission.",
        epilog="Exit codes: 0 the mission is complete; 1 it failed; 2 wrong command line or impossible request; "
        "130 Ctrl-C.",
    )
    add_mission_options(p)
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to create (default: runs/DATE-TIME)")
    p.add_argument(
        "--domain",
        metavar="N",
        help="ROS domain, 1 to 80; its vehicles find it (default: ROS_DOMAIN_ID, else a free one)",
    )
    p.add_argument(
        "--apart",
        action="store_true",
        help="separate vehicles: each runs in its own ROS domain, in real time, with an emulated modem and a simulated "
        "autopilot, and shares only the simulated water with the others",
    )
    p.add_argument("--no-record", action="store_true", help="make no recording, and so no report")
    p.add_argument("--no-report", action="store_true", help="make no figures and no report.html")
    p.set_defaults(for_vehicles=None, modem=None, vehicle_link=None)
    return p


def _apart(settings: Settings, folder: Path) -> Settings:
    """The mission with separate vehicles; also writes their mission file, which has no section sim."""
    paced: dict[str, Any] = {"sim.lockstep": False, "sim.real_time_factor": 1.0, "sim.apart": True}
    paced["tdma.send_duration_s"] = least_send_duration_s(settings)
    for k in range(1, settings.mission.vehicles + 1):
        paced[f"auv{k}.link.soundings"] = True  # from the autopilot: the simulator's topics do not reach the vehicle
    settings = settings.with_overrides(paced)
    write_whole(folder / "mission.yaml", settings.to_parameter_file())
    body = yaml.safe_load(settings.with_overrides({"record.folder": "bag"}).to_parameter_file())
    del body["/**"]["ros__parameters"]["sim"]
    safety = body["/**"]["ros__parameters"].setdefault("safety", {})
    # the default folder would carry a dive that ended under simulated water into the next rehearsal or real dive
    safety["state_copies"] = safety.get("state_copies") or str((folder / "state_copies").absolute())
    write_whole(folder / VEHICLES, yaml.safe_dump(body, sort_keys=False, default_flow_style=None, width=110))
    return settings


def run(options: argparse.Namespace) -> int:
    """Runs the simulator. Returns 0, 1, 2 or 130, see --help."""
    console = Console(stderr=False)

    def say(text: str) -> None:
        console.print(Text(text), highlight=False, soft_wrap=True)

    root = project_folder()
    with ExitStack() as reserved:
        reserved.enter_context(shared_ground())
        try:
            _complete(options)
            settings, notes = prepare(options)
            domain = reserved.enter_context(simulator_domain(wanted_domain(options.domain)))
            folder = run_folder(options.out, root)
            note_run(domain, folder, new_dive(SIMULATION))  # before a vehicle can look for it
            settings = _written(settings, folder, options)
        except (ValueError, DomainError) as error:
            complain(error)
            return 2
        for note in notes:
            say(note)
        say(f"run folder: {folder}")
        say("start each vehicle in its own terminal:")
        for vehicle in range(1, settings.mission.vehicles + 1):
            file, where = folder / "mission.yaml", ""
            if options.apart:
                file, where = folder / VEHICLES, f" --domain {VEHICLE_DOMAINS[vehicle - 1]}"
            say(f"    auv_lse vehicle auv{vehicle} {shlex.quote(str(file))}{where}")
        processes = mission_processes(0, record=not options.no_record)
        owned, report = _until_released(reserved.pop_all(), domain), not options.no_report
        return fly(settings, folder, console, processes, owned, start_s=math.inf, report=report)


def _complete(options: argparse.Namespace) -> None:
    """Sets modem and link that are not given.

    Raises:
        ParameterError: naming an option that --apart would ignore.
    """
    if options.apart and options.real_time_factor not in (None, 1.0):
        pace = f"{options.real_time_factor:g}"
        raise ParameterError(f"--apart runs in real time; leave out --real-time-factor {pace}")
    if options.apart and options.modem == "direct":
        raise ParameterError("--apart needs emulated modems; leave out --modem direct")
    if options.apart and options.vehicle_link == "direct":
        raise ParameterError("--apart needs simulated autopilots; leave out --vehicle-link direct")
    options.modem, options.vehicle_link = options.modem or "direct", options.vehicle_link or "direct"


def _written(settings: Settings, folder: Path, options: argparse.Namespace) -> Settings:
    """Writes the mission's files."""
    if options.apart:
        options.modem, options.vehicle_link = "emulated", "mavlink"
    with removed_on_error(folder):
        settings = write_mission(settings, folder, options, record=not options.no_record)
        return _apart(settings, folder) if options.apart else settings


@contextmanager
def _until_released(reserved: ExitStack, domain: int) -> Iterator[int]:
    with reserved:
        yield domain
