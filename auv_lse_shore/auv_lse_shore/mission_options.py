"""The command line of auv_lse mission, and its options that other commands have, too."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.parameters import ParameterError, nest, problems
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.mission_file.strict_yaml import yaml_value

#: First part of the name of a vehicle's own parameter: auv2.vehicle.depth_m.
_VEHICLE = re.compile(r"auv\d+")


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse mission, and its options that other commands have, too."""
    p = argparse.ArgumentParser(
        prog="auv_lse mission",
        description="Runs a simulated team mission as real ROS 2 processes. The run folder gets the recording, figures "
        "and a report.",
        epilog="Exit codes: 0 the mission is complete; 1 it failed; 2 wrong command line or impossible request; "
        "130 Ctrl-C. Guide: docs/guide/first-mission.md",
    )
    add_mission_options(p)
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to create (default: runs/DATE-TIME)")
    p.add_argument(
        "--for-vehicles",
        type=Path,
        metavar="FILE",
        help="write the complete mission file for the vehicles, without the parameters of simulator and run folder; "
        "start nothing (docs/guide/bench-to-water.md)",
    )
    p.add_argument(
        "--live", action="store_true", help="open the live view of the mission in the browser (docs/guide/live-view.md)"
    )
    p.add_argument("--no-report", action="store_true", help="skip the figures and report.html")
    p.add_argument(
        "--parameters", action="store_true", help="print every parameter with its unit, range and meaning, and exit"
    )
    return p


class _AreaAction(argparse.Action):
    """Stores the words of --area; a mission file that follows them is the positional argument."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option: str | None = None) -> None:
        if len(values) > 1 and Path(values[-1]).suffix in (".yaml", ".yml"):
            namespace.mission = Path(values.pop())
        namespace.area = values


def add_mission_options(p: argparse.ArgumentParser) -> None:
    """Adds the options that choose a mission: its file, and overrides of the file's parameters (`overrides_of`)."""
    p.add_argument(
        "mission",
        nargs="?",
        type=Path,
        metavar="MISSION.yaml",
        help="mission file (default: config/missions/default.yaml)",
    )
    p.add_argument("--vehicles", type=int, metavar="K", help="number of vehicles, 1 to 20")
    p.add_argument("--steps", type=int, metavar="N", help="number of legs per vehicle")
    p.add_argument("--method", metavar="NAME", help=f"planning method: {', '.join(METHODS)} (docs/design/planner.md)")
    p.add_argument("--seed", type=int, help="seed of all random numbers: ground, sensors, channel, planners")
    p.add_argument("--packet-loss", type=float, metavar="P", help="probability that a packet is lost, 0 to 1")
    add_ground_options(p)
    p.add_argument(
        "--area",
        action=_AreaAction,
        nargs="+",
        metavar=("FILE|SOUTH", "WEST NORTH EAST"),
        help="operating area: a file (GeoJSON, KML, GPX, GeoPackage, shapefile, QGroundControl, ...), or four numbers "
        "(m, local north and east; default with --bathymetry: the file's extent)",
    )
    p.add_argument(
        "--real-time-factor",
        type=float,
        metavar="X",
        help="run at X times real time (default: lockstep, as fast as possible)",
    )
    p.add_argument(
        "--modem",
        choices=("direct", "emulated"),
        default="direct",
        help="emulated: packets go through drivers, serial ports and Micromodem sentences",
    )
    p.add_argument(
        "--vehicle-link",
        choices=("direct", "mavlink"),
        default="direct",
        help="mavlink: waypoints go through drivers to a simulated MAVLink autopilot",
    )
    add_set_option(p)


def add_ground_options(p: argparse.ArgumentParser) -> None:
    """Adds the options of the bathymetry (`ground_given`)."""
    p.add_argument(
        "--bathymetry",
        type=Path,
        metavar="FILE",
        help="real bathymetry: CSV or XYZ of soundings, npz or ESRI ASCII grid, GeoTIFF, netCDF (GEBCO), BAG, S-102",
    )
    sign = p.add_mutually_exclusive_group()
    sign.add_argument("--depths", action="store_true", help="the bathymetry holds depths, positive down")
    sign.add_argument("--elevations", action="store_true", help="the bathymetry holds elevations, positive up")
    p.add_argument(
        "--water-level", type=float, metavar="M", help="elevation of the water surface in the datum of the elevations"
    )


def add_set_option(p: argparse.ArgumentParser) -> None:
    """Adds --set (`settings_given`)."""
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set a parameter, such as level_set.level_m=12 (the isobath) or auv2.vehicle.depth_m=4; repeatable",
    )


def overrides_of(options: argparse.Namespace) -> dict[str, Any]:
    """The parameters of the command line, {dotted name: value}.

    Raises:
        ParameterError: naming the option, for an unknown parameter or an impossible value.
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
            check_option(f"{flag} {value}", name, value)
            wanted[name] = value
    wanted |= ground_given(options)
    if options.real_time_factor is not None:
        check_option(
            f"--real-time-factor {options.real_time_factor:g}", "sim.real_time_factor", options.real_time_factor
        )
        if options.real_time_factor == 0.0:
            raise ParameterError(
                "--real-time-factor must be more than 0; without it a mission runs as fast as possible"
            )
        wanted.update({"sim.real_time_factor": options.real_time_factor, "sim.lockstep": False})
    if options.area is not None:
        wanted.update(_area(options.area))
    for name, value in settings_given(options.set).items():
        if wanted.setdefault(name, value) != value:
            raise ParameterError(f"{name}: the command line sets it to {wanted[name]} and {value}. Give one value")
    return wanted


def ground_given(options: argparse.Namespace) -> dict[str, Any]:
    """The parameters of the options of the bathymetry, {dotted name: value}.

    Raises:
        ParameterError: naming the option, for an impossible value.
    """
    wanted: dict[str, Any] = {}
    if options.bathymetry is not None:
        wanted["sim.bathymetry.file"] = str(options.bathymetry.resolve())
    if options.depths or options.elevations:
        wanted["sim.bathymetry.depth_sign"] = "down" if options.depths else "up"
    if options.water_level is not None:
        check_option(f"--water-level {options.water_level:g}", "sim.bathymetry.water_level_m", options.water_level)
        wanted["sim.bathymetry.water_level_m"] = options.water_level
    return wanted


def check_ground_options(options: argparse.Namespace, settings: Settings) -> None:
    """Refuses options of a bathymetry if the mission has none.

    Raises:
        ParameterError: naming the option.
    """
    for flag in ("depths", "elevations", "water_level"):
        if getattr(options, flag) not in (None, False) and not settings.sim.bathymetry.file:
            raise ParameterError(
                f"--{flag.replace('_', '-')} is for a bathymetry, and there is none: --bathymetry FILE"
            )


def check_vehicles(names: Sequence[str], vehicles: int, where: str = "--set ") -> None:
    """Refuses parameters that are for a vehicle beyond the team, which a mission file may have.

    Args:
        names: Dotted names.

    Raises:
        ParameterError: naming the parameter.
    """
    for name in names:
        vehicle = name.partition(".")[0]
        if _VEHICLE.fullmatch(vehicle) and int(vehicle[3:]) > vehicles:
            team = "its only vehicle is auv1" if vehicles == 1 else f"its vehicles are auv1 to auv{vehicles}"
            raise ParameterError(f"{where}{name}: the mission has no {vehicle}; {team}")


def _area(words: Sequence[str]) -> dict[str, Any]:
    """The parameters of `--area`: the name of a file, or four numbers."""
    given = " ".join(words)
    if len(words) == 1:
        return {"area.file": str(Path(words[0]).resolve())}
    try:
        south, west, north, east = (float(word) for word in words)
    except ValueError:
        raise ParameterError(f"--area {given} is neither a file nor SOUTH WEST NORTH EAST (m)") from None
    if not (south < north and west < east):
        raise ParameterError(f"--area {given} must have SOUTH < NORTH and WEST < EAST (m)")
    return {"area.polygon_m": [south, west, north, west, north, east, south, east]}


def settings_given(texts: Sequence[str]) -> dict[str, Any]:
    """The parameters of `--set NAME=VALUE`, {dotted name: value}.

    Raises:
        ParameterError: for a text that is not NAME=VALUE, a value that is not YAML, or an unknown parameter.
    """
    wanted: dict[str, Any] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign or not name:
            raise ParameterError(f"--set {text!r} is not NAME=VALUE, such as planner.iterations=500")
        try:
            wanted[name] = yaml_value(value)
        except ParameterError as error:
            raise ParameterError(f"--set {name}: {error}") from error
        check_option(f"--set {text}", name, wanted[name])
    return wanted


def check_option(option: str, name: str, value: Any) -> None:
    """Refuses an unknown parameter or an impossible value.

    Args:
        option: The option that sets it, with its value, for the message.

    Raises:
        ParameterError: naming the option.
    """
    vehicle, _, rest = name.partition(".")
    nested = nest({rest if _VEHICLE.fullmatch(vehicle) else name: value})
    check_sections(nested, option)
    for section, values in nested.items():
        for problem in problems(SECTIONS[section], values, f"{option}: {section}"):
            raise ParameterError(problem)
