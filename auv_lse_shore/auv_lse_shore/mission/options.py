"""The command line of scripts/mission."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.parameter_file import nest
from auv_lse_common.mission_file.parameters import ParameterError, problems
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections

#: A parameter's name that begins so is one vehicle's: auv2.vehicle.depth_m.
_VEHICLE = re.compile(r"auv\d+")


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/mission."""
    p = argparse.ArgumentParser(
        prog="scripts/mission",
        description="Flies a team mission as real ROS 2 processes and leaves one run folder with the recording, the "
        "figures and a report.",
        epilog="Exit codes: 0 the mission is complete; 1 it failed; 2 the request cannot be met; 130 Ctrl-C.",
    )
    add_mission_options(p)
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to make (default: runs/DATE-TIME)")
    p.add_argument(
        "--for-vehicles",
        type=Path,
        metavar="FILE",
        help="write the mission file for the vehicles: without the simulator's parameters and the run's folder, "
        "everything else filled in; starts nothing (docs/guide/bench-to-water.md)",
    )
    p.add_argument(
        "--live", action="store_true", help="open the live view of the mission in the browser (docs/guide/live-view.md)"
    )
    p.add_argument("--no-report", action="store_true", help="leave out figures and report.html")
    p.add_argument(
        "--parameters", action="store_true", help="print every parameter with its unit, range and meaning, and exit"
    )
    return p


def add_mission_options(p: argparse.ArgumentParser) -> None:
    """Adds what says which mission to fly: the file, and what is otherwise than in it (`overrides_of`)."""
    p.add_argument(
        "mission",
        nargs="?",
        type=Path,
        metavar="MISSION.yaml",
        help="mission file (default: config/missions/default.yaml)",
    )
    p.add_argument("--vehicles", type=int, metavar="K", help="number of vehicles, 1 to 20")
    p.add_argument("--steps", type=int, metavar="N", help="legs that each vehicle travels")
    p.add_argument("--method", metavar="NAME", help=f"planning method: {', '.join(METHODS)} (docs/design/planner.md)")
    p.add_argument("--seed", type=int, help="seed of every random stream: ground, sensors, channel, planners")
    p.add_argument("--packet-loss", type=float, metavar="P", help="probability that a packet is lost, 0 to 1")
    p.add_argument(
        "--bathymetry", type=Path, metavar="FILE", help="real ground: CSV of soundings, npz or ESRI ASCII grid, GeoTIFF"
    )
    p.add_argument(
        "--area",
        type=float,
        nargs=4,
        metavar=("SOUTH", "WEST", "NORTH", "EAST"),
        help="operating area (m, local north and east); with --bathymetry default: the file's extent",
    )
    p.add_argument(
        "--real-time-factor",
        type=float,
        metavar="X",
        help="paced run, X times real time (default: lockstep, as fast as it goes)",
    )
    p.add_argument(
        "--modem",
        choices=("direct", "emulated"),
        default="direct",
        help="emulated: through serial ports, drivers and Micromodem sentences",
    )
    p.add_argument(
        "--vehicle-link",
        choices=("direct", "mavlink"),
        default="direct",
        help="mavlink: through a simulated MAVLink vehicle",
    )
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set any parameter, as in --set planner.iterations=500; may be repeated",
    )


def overrides_of(options: argparse.Namespace) -> dict[str, Any]:
    """The parameters that the command line sets, flat: {name: value}.

    Raises:
        ParameterError: naming the option, for one that sets no parameter or a value that cannot be.
    """
    wanted: dict[str, Any] = {}
    for flag, name, value in (
        ("--vehicles", "mission.vehicles", options.vehicles),
        ("--steps", "mission.steps", options.steps),
        ("--seed", "mission.seed", options.seed),
        ("--method", "planner.method", options.method),
        ("--packet-loss", "sim.channel.packet_loss", options.packet_loss),
    ):
        if value is not None:
            _check(f"{flag} {value}", name, value)
            wanted[name] = value
    if options.bathymetry is not None:
        wanted["sim.bathymetry.file"] = str(options.bathymetry.resolve())
    if options.real_time_factor is not None:
        _check(f"--real-time-factor {options.real_time_factor:g}", "sim.real_time_factor", options.real_time_factor)
        if options.real_time_factor == 0.0:
            raise ParameterError(
                "--real-time-factor 0: expected more than 0; without it a mission is as fast as it goes"
            )
        wanted.update({"sim.real_time_factor": options.real_time_factor, "sim.lockstep": False})
    if options.area is not None:
        south, west, north, east = options.area
        wanted["area.polygon_m"] = [south, west, north, west, north, east, south, east]
    wanted.update(settings_given(options.set))
    return wanted


def settings_given(texts: Sequence[str]) -> dict[str, Any]:
    """The parameters that `--set NAME=VALUE` sets, flat: {name: value}.

    Raises:
        ParameterError: for a text that is not NAME=VALUE, whose value is not YAML, or that sets no parameter.
    """
    wanted: dict[str, Any] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign or not name:
            raise ParameterError(f"--set {text!r}: expected NAME=VALUE, as in planner.iterations=500")
        try:
            wanted[name] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            problem = getattr(error, "problem", None) or str(error)
            raise ParameterError(
                f"--set {text!r}: the value is not YAML: {problem}; write it as in a mission file"
            ) from error
        _check(f"--set {text}", name, wanted[name])
    return wanted


def _check(option: str, name: str, value: Any) -> None:
    """Refuses a parameter that there is not, or a value that it cannot have, in the name of the option."""
    vehicle, _, rest = name.partition(".")
    nested = nest({rest if _VEHICLE.fullmatch(vehicle) else name: value})
    check_sections(nested, option)
    for section, values in nested.items():
        for problem in problems(SECTIONS[section], values, f"{option}: {section}"):
            raise ParameterError(problem)
