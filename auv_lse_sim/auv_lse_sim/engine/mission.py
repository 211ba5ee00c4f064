"""scripts/mission: flies a team mission as real ROS 2 processes and leaves one run folder."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console
from rich.text import Text

from auv_lse_common.params import ParameterError
from auv_lse_sim.engine.display import Display, Progress
from auv_lse_sim.engine.launcher import LaunchError, ProcessGroup, local_environment, own_domain
from auv_lse_sim.engine.processes import mission_processes
from auv_lse_sim.engine.vehicle_file import vehicle_file
from auv_lse_sim.engine.watch_node import Watcher
from auv_lse_sim.judge.summary import Summary
from auv_lse_sim.settings import Settings
from auv_lse_sim.world.ground_source import ground_of
from auv_lse_sim.world.navigable import fit_to_ground

_START_S = 90.0


class MissionError(RuntimeError):
    """A mission that did not end as it should: what happened, and where to look."""


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/mission."""
    p = argparse.ArgumentParser(
        prog="scripts/mission",
        description="Flies a team mission as real ROS 2 processes and leaves one run folder with the recording, the "
        "figures and a report.",
    )
    p.add_argument(
        "mission",
        nargs="?",
        type=Path,
        metavar="MISSION.yaml",
        help="mission file (default: config/missions/default.yaml)",
    )
    p.add_argument("--vehicles", type=int, metavar="K", help="number of vehicles, 1 to 20")
    p.add_argument("--steps", type=int, metavar="N", help="legs that each vehicle travels")
    p.add_argument("--method", metavar="NAME", help="planning method: augmented, plain, best, ... (docs/planner.md)")
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
        help="any parameter, as --set planner.iterations=500; again for more",
    )
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to make (default: runs/DATE-TIME)")
    p.add_argument(
        "--for-vehicles",
        type=Path,
        metavar="FILE",
        help="write the mission file for the vehicles: without the simulator's parameters and the run's folder, "
        "everything else filled in; flies nothing (docs/operations.md)",
    )
    p.add_argument("--no-report", action="store_true", help="leave out figures and report.html")
    p.add_argument(
        "--parameters", action="store_true", help="print every parameter with unit, range and meaning, and end"
    )
    return p


def overrides_of(options: argparse.Namespace) -> dict[str, Any]:
    """Flat parameters {name: value} that the command line asks for.

    Raises:
        ParameterError: for a --set that is not NAME=VALUE, or whose value is not YAML.
    """
    import yaml

    wanted: dict[str, Any] = {}
    pairs = {
        "mission.vehicles": options.vehicles,
        "mission.steps": options.steps,
        "mission.seed": options.seed,
        "planner.method": options.method,
        "sim.channel.packet_loss": options.packet_loss,
    }
    wanted.update({name: value for name, value in pairs.items() if value is not None})
    if options.bathymetry is not None:
        wanted["sim.bathymetry.file"] = str(options.bathymetry.resolve())
    if options.real_time_factor is not None:
        wanted.update({"sim.real_time_factor": options.real_time_factor, "sim.lockstep": False})
    if options.area is not None:
        south, west, north, east = options.area
        wanted["area.polygon_m"] = [south, west, north, west, north, east, south, east]
    for text in options.set:
        name, sign, value = text.partition("=")
        if not sign or not name:
            raise ParameterError(f"--set {text!r}: expected NAME=VALUE, as planner.iterations=500")
        try:
            wanted[name] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            problem = getattr(error, "problem", None) or str(error)
            raise ParameterError(f"--set {text!r}: the value is not YAML: {problem}; expected as in a file") from error
    return wanted


def hardware_of(modem: str, vehicle_link: str, vehicles: int, folder: Path) -> dict[str, Any]:
    """Parameters by which each vehicle's drivers and the simulator's emulated hardware find each other.

    Args:
        modem: "direct", or "emulated": a pty per vehicle, at modems/auvK in the run folder.
        vehicle_link: "direct", or "mavlink": a free UDP port of this machine per vehicle.
        vehicles: Number of vehicles.
        folder: The run folder, absolute.
    """
    wanted: dict[str, Any] = {}
    for k in range(1, vehicles + 1):
        if modem == "emulated":
            wanted[f"auv{k}.modem.kind"] = "micromodem"
            wanted[f"auv{k}.modem.port"] = str(folder / "modems" / f"auv{k}")
            wanted[f"auv{k}.modem.log_file"] = str(folder / "logs" / f"auv{k}.modem_lines.log")
    if vehicle_link == "mavlink":
        with contextlib.ExitStack() as stack:  # all are held until all are known, so that no two are the same
            for k in range(1, vehicles + 1):
                probe = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                probe.bind(("127.0.0.1", 0))
                wanted[f"auv{k}.link.kind"] = "mavlink"
                wanted[f"auv{k}.link.soundings"] = False  # sim_node gives them
                wanted[f"auv{k}.link.endpoint"] = f"udpin://127.0.0.1:{probe.getsockname()[1]}"
    return wanted


def run_folder(wanted: Path | None, root: Path) -> Path:
    """Makes the run folder.

    Raises:
        MissionError: if it exists and holds something, or cannot be made.
    """
    folder = wanted
    if folder is None:
        base = root / "runs" / datetime.now().strftime("%Y-%m-%d-%H%M%S")
        folder, again = base, 1
        while folder.exists():
            again += 1
            folder = base.with_name(f"{base.name}-{again}")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise MissionError(
            f"--out {folder}: exists and is not empty; expected a new or empty folder (nothing was changed)"
        )
    try:
        (folder / "logs").mkdir(parents=True)
    except OSError as error:
        raise MissionError(f"--out {folder}: cannot be made: {error.strerror or error}") from error
    return folder.resolve()


def write_vehicle_file(settings: Settings, path: Path) -> None:
    """Writes the mission file for the vehicles.

    Raises:
        ParameterError: if the mission cannot be flown by vehicles as it is.
        MissionError: if the file exists or cannot be written.
    """
    text = vehicle_file(settings)
    try:
        with path.open("x") as file:
            file.write(text)
    except FileExistsError:
        raise MissionError(f"--for-vehicles {path}: exists; expected a new file (nothing was changed)") from None
    except OSError as error:
        raise MissionError(f"--for-vehicles {path}: cannot be written: {error.strerror or error}") from error


def _say(console: Console, text: str) -> None:
    """Prints words that may hold anything, [brackets] too, as they are."""
    console.print(Text(text), highlight=False, soft_wrap=True)


def _complain(console: Console, error: object) -> None:
    console.print(Text.assemble(("error:", "red"), f" {error}"), highlight=False, soft_wrap=True)


class _Interrupt:
    """Ctrl-C and SIGTERM as a flag, so that every process is ended in order."""

    def __init__(self) -> None:
        self.came = False
        for sign in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sign, self._note)

    def _note(self, sign: int, frame: FrameType | None) -> None:
        self.came = True


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies a mission. Returns 0, 1 if it failed, 2 if what was asked cannot be done, 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    console = Console(stderr=False)
    if options.parameters:
        print_parameters(console)
        return 0
    root = Path(os.environ.get("AUV_LSE_ROOT", Path(__file__).resolve().parents[3]))
    try:
        settings = Settings.load(
            options.mission or root / "config" / "missions" / "default.yaml", overrides_of(options)
        )
        notes: list[str] = []
        if options.for_vehicles is None or settings.sim.bathymetry.file:  # a synthetic lake says nothing of a real one
            settings, notes = fit_to_ground(settings, ground_of(settings), area_given=options.area is not None)
        if options.for_vehicles is not None:
            write_vehicle_file(settings, options.for_vehicles)
        else:
            folder = run_folder(options.out, root)
    except (ParameterError, MissionError, ValueError) as error:
        _complain(console, error)
        return 2
    for note in notes:
        _say(console, note)
    if options.for_vehicles is not None:
        _say(console, f"written: {options.for_vehicles} (copy it to every vehicle; docs/operations.md)")
        return 0
    _say(console, f"run folder: {folder}")
    settings = settings.with_overrides({"record.folder": str(folder / "bag")})
    settings = settings.with_overrides(
        hardware_of(options.modem, options.vehicle_link, settings.mission.vehicles, folder)
    )
    (folder / "mission.yaml").write_text(settings.to_parameter_file())
    interrupt = _Interrupt()
    started = time.monotonic()
    try:
        with own_domain() as domain:
            environment = local_environment(root, domain)
            watch = f"ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
            _say(console, f"to watch from another terminal: export {watch}")
            phases = fly(settings, folder, environment, console, interrupt, options.modem, options.vehicle_link)
    except (MissionError, LaunchError) as error:
        _complain(console, error)
        return 1
    wall_s = time.monotonic() - started
    code = 130 if interrupt.came else 0
    if interrupt.came:
        console.print("interrupted: every process is ended, the recording is readable", highlight=False)
    try:
        conclude(folder, settings, wall_s, phases, console, report=not options.no_report)
    except (OSError, ValueError) as error:
        _complain(console, f"the mission was flown, but its evaluation failed: {error}")
        return code or 1
    return code


def print_parameters(console: Console) -> None:
    """Every parameter of a mission file with default, unit, range and meaning."""
    from rich.table import Table

    from auv_lse_common.params import describe
    from auv_lse_sim.settings import SECTION_CLASSES

    for name, cls in SECTION_CLASSES.items():
        table = Table(title=f"{name}: {(cls.__doc__ or '').strip().splitlines()[0]}", title_justify="left")
        for column in ("parameter", "default", "unit", "allowed", "meaning"):
            table.add_column(column, overflow="fold")
        for row in describe(cls, f"{name}."):
            table.add_row(*(Text(str(cell)) for cell in row))
        console.print(table)


def fly(
    settings: Settings,
    folder: Path,
    environment: dict[str, str],
    console: Console,
    interrupt: _Interrupt,
    modem: str,
    vehicle_link: str,
) -> dict[str, float]:
    """Starts every process, watches the mission to its end, and ends every process.

    Returns:
        Wall-clock seconds of the phases "start", "mission" and "ending"; those not reached are left out.

    Raises:
        MissionError: if a node died or the simulator gave up; every process is ended then, too.
    """
    os.environ.update(environment)
    progress = Progress(vehicles=settings.mission.vehicles, steps_total=settings.mission.steps)
    marks = {"began": time.monotonic()}
    group = ProcessGroup(folder / "logs", environment)
    with contextlib.ExitStack() as stack:
        stack.callback(group.stop)
        for process in mission_processes(settings.mission.vehicles, modem, vehicle_link):
            follows = process.executable != "sim_node"  # every clock but the simulator's follows /clock
            group.start(process, folder / "mission.yaml", ("-p", "use_sim_time:=true") if follows else ())
        watcher = stack.enter_context(Watcher(progress))
        display = stack.enter_context(Display(progress, console))
        while not interrupt.came and progress.phase != "finished":
            state, message = watcher.wait(0.1)
            _judge(state, message, group, folder, time.monotonic() - marks["began"], progress.vehicles)
            if state in ("running", "finished"):
                progress.phase = state
                marks.setdefault("running", time.monotonic())
            display.refresh()
        marks["ended"] = time.monotonic()
        processor_s = group.cpu_s()
    phases = {"ending": time.monotonic() - marks["ended"]}
    if "running" in marks:
        phases = {"start": marks["running"] - marks["began"], "mission": marks["ended"] - marks["running"], **phases}
    times = {"wall_s": phases, "processor_s": processor_s}
    (folder / "logs" / "times.json").write_text(json.dumps(times, indent=1) + "\n")
    return phases


def _judge(state: str, message: str, group: ProcessGroup, folder: Path, since_s: float, vehicles: int) -> None:
    """Raises MissionError if the mission cannot go on."""
    for name, code in group.ended():
        raise MissionError(
            f"{name} ended by itself (exit code {code}); the end of {group.log(name)}:\n{group.last_words(name)}"
        )
    if state == "failed":
        raise MissionError(f"the simulator gave up: {message}; logs: {folder / 'logs'}")
    if state == "waiting" and since_s > _START_S + 10.0 * vehicles:
        raise MissionError(f"the nodes have not found each other: {message}; logs: {folder / 'logs'}")


def conclude(
    folder: Path, settings: Settings, wall_s: float, phases: dict[str, float], console: Console, report: bool
) -> None:
    """Evaluates the recording into summary.json, isobath.geojson and, if asked, the figures and the report."""
    from auv_lse_sim.judge.evaluation import evaluate, ground_grid
    from auv_lse_sim.judge.report import write_isobath, write_report
    from auv_lse_sim.record.bag import read_run

    began = time.monotonic()
    ground = ground_grid(settings.planner_settings(1), ground_of(settings))
    run = read_run(folder, ground=ground, wall_s=wall_s)
    if report:
        summary = write_report(run, folder)
    else:
        evaluation = evaluate(run)
        summary = evaluation.summary
        summary.write(folder / "summary.json")
        write_isobath(evaluation, folder / "isobath.geojson")
    phases["report"] = time.monotonic() - began
    times = folder / "logs" / "times.json"
    times.write_text(json.dumps({**json.loads(times.read_text()), "wall_s": phases}, indent=1) + "\n")
    for line in headlines(summary):
        _say(console, line)
    told = "report.html" if report else "summary.json"
    took = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in phases.items())
    _say(console, f"{folder / told}   ({took})")


def headlines(summary: Summary) -> list[str]:
    """The few figures of a mission that a person wants first."""
    s = summary
    lines = [
        f"map-wide Bayes risk {s.risk_before:.3f} -> {s.risk_after:.3f} per place; "
        f"path reward {s.path_reward:.0f} (mowing the lawn was expected to bring {s.lawnmower_value:.0f})",
    ]
    if s.isobath_error_m is not None and s.f1 is not None and s.misclassified_m2 is not None:
        lines.append(
            f"isobath within {s.isobath_error_m:.1f} m of the truth on average; F1 {s.f1:.3f}; "
            f"{s.misclassified_m2:.0f} m2 of {s.area_m2:.0f} m2 misclassified"
        )
    lines.append(f"packets {s.packets_sent} sent, {s.packets_received} received")
    return lines


if __name__ == "__main__":
    sys.exit(main())
