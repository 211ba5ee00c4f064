"""auv_lse mission: runs a simulated team mission as real ROS 2 processes, and evaluates it."""

import argparse
import contextlib
import importlib
import json
import os
import shlex
import shutil
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameters import ParameterError, describe
from auv_lse_common.mission_file.sections.table import SECTIONS
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.node.intra_process import TOGETHER_VARIABLE
from auv_lse_common.support import compiled
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_common.support.confinement import watch_variables
from auv_lse_common.support.missing_packages import missing
from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.support.user_error import error_text
from auv_lse_comms.bridge.mate_tracks import speeds_apart
from auv_lse_comms.settings import check_send_duration
from auv_lse_gp.compiled.modules import compiled_gp, compiled_risk
from auv_lse_record.guard import free_mb
from auv_lse_record.size_estimate import lack_of_space, size_of
from auv_lse_run.mission.conductor import MissionError, conduct
from auv_lse_run.process.domain import DomainError, dive_on, node_environment, simulation_domain
from auv_lse_run.process.interrupt import Interrupt
from auv_lse_run.process.processes import LaunchError, Process
from auv_lse_run.shipped_files import shipped_file
from auv_lse_shore.areas.area_file import AreaFiles
from auv_lse_shore.check.machine import check_priors
from auv_lse_shore.check.timing import silent_vehicles
from auv_lse_shore.live.process import LiveProcess
from auv_lse_shore.mission.run_folder import RunFolderError, removed_on_error, run_folder
from auv_lse_shore.mission.vehicle_file import write_vehicle_file
from auv_lse_shore.mission_options import check_ground_options, check_vehicles, overrides_of
from auv_lse_sim.engine.hardware import hardware_of
from auv_lse_sim.engine.processes import mission_processes
from auv_lse_sim.ground.chart import with_chart
from auv_lse_sim.ground.ground_source import ground_of, shared_ground
from auv_lse_sim.ground.navigable import fit_to_ground
from auv_lse_sim.ground.reach import clip_to_reachable


def _say(console: Console, text: str) -> None:
    """Prints text without markup: [brackets] stay."""
    console.print(Text(text), highlight=False, soft_wrap=True)


def complain(error: object) -> None:
    """Prints an error."""
    Console(stderr=True).print(Text.assemble(("error:", "red"), f" {error}"), highlight=False, soft_wrap=True)


def run(options: argparse.Namespace) -> int:
    """Runs a mission. Returns 0, 1, 2 or 130, see --help."""
    with shared_ground():
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    console = Console(stderr=False)
    if options.parameters:
        print_parameters(console)
        return 0
    root = project_folder()
    try:
        _check_use(options)
        settings, notes = prepare(options)
        if options.for_vehicles is not None:
            write_vehicle_file(settings, options.for_vehicles, overrides_of(options))
        else:
            _check_drivers(settings, options)
            folder = run_folder(options.out, root)
            with removed_on_error(folder):
                settings = write_mission(settings, folder, options)
    except ValueError as error:
        complain(error)
        return 2
    for note in notes:
        _say(console, note)
    if options.for_vehicles is not None:
        _say(console, f"written: {options.for_vehicles} (copy it to every vehicle; docs/guide/bench-to-water.md)")
        return 0
    _say(console, f"run folder: {folder}; the recording takes about {max(recording_mb(settings), 1.0):.0f} MB")
    vehicles, together = settings.mission.vehicles, settings.sim.lockstep
    processes = mission_processes(vehicles, options.modem, options.vehicle_link, together=together)
    with ExitStack() as beside:
        live = beside if options.live else None
        domain = simulation_domain(None, folder, vehicles)
        return fly(settings, folder, console, processes, domain, report=not options.no_report, live=live)


def prepare(options: argparse.Namespace) -> tuple[Settings, list[str]]:
    """The mission of the command line, and notes on what was changed to fit the ground.

    Raises:
        ValueError: naming what is impossible.
    """
    areas = AreaFiles()
    mission = options.mission or shipped_file("missions/default.yaml")
    given = overrides_of(options)
    settings = _loaded(mission, given, areas)
    check_vehicles([*given], settings.mission.vehicles)
    check_ground_options(options, settings)
    if options.for_vehicles is not None:  # the simulator's dynamics, current and DVL are no reason for warnings
        settings = settings.with_overrides({"sim.ideal": True})
    if options.for_vehicles is not None and not settings.sim.bathymetry.file:
        fitted, notes = clip_to_reachable(settings)  # the synthetic lake is not the vehicles' lake
    else:
        fitted, notes = fit_to_ground(settings, ground_of(settings), area_given=options.area is not None)
    area = OperatingArea(fitted.area)
    for own in fitted.vehicles:  # a node would refuse them, after the start
        area.grid(own.gp.map_resolution_m, "gp.map_resolution_m")
        area.grid(own.planner.map_spacing_m, "planner.map_spacing_m")
    fitted.check_origin()
    if options.for_vehicles is None:  # else the files are on the vehicles
        check_priors(fitted)
    apart = "" if fitted.packet.tag else speeds_apart([own.vehicle.speed_mps for own in fitted.vehicles])
    silent = silent_vehicles(fitted)
    return fitted, [*areas.notes(fitted.mission.vehicles), *notes, *([apart] if apart else []), *silent]


def _loaded(mission: Path, given: Mapping[str, Any], areas: AreaFiles) -> Settings:
    """The mission file with the parameters of the command line, which an error names if they cause it."""
    try:
        return Settings.load(mission, given, areas)
    except ParameterError as error:
        try:
            Settings.load(mission, read_area=AreaFiles())
        except ParameterError:
            raise error from None
        raise ParameterError(str(error).replace(f"{mission}", "the command line", 1)) from error


def _check_use(options: argparse.Namespace) -> None:
    """Refuses options that would be ignored."""
    unused = {
        "--out": options.out is not None,
        "--live": options.live,
        "--no-report": options.no_report,
        "--real-time-factor": options.real_time_factor is not None,
    }
    if options.for_vehicles is not None and any(unused.values()):
        names = ", ".join(name for name, given in unused.items() if given)
        raise ParameterError(f"--for-vehicles writes a mission file and flies nothing; leave out {names}")
    if options.for_vehicles is None and "record.folder" in overrides_of(options):
        raise ParameterError("record.folder: a simulated mission records in its run folder; choose that with --out")


def _check_drivers(settings: Settings, options: argparse.Namespace) -> None:
    """Refuses a driver that the mission file asks for, and that a simulated mission starts by an option alone."""
    for k, own in enumerate(settings.vehicles, 1):
        for name, kind, given, option in (
            ("modem.kind", own.modem.kind, options.modem, "--modem emulated"),
            ("link.kind", own.link.kind, options.vehicle_link, "--vehicle-link mavlink"),
        ):
            if kind != "direct" and given == "direct":
                raise ParameterError(
                    f"auv{k}: {name} is {kind!r}, but a simulated mission runs that driver only with {option}. Add "
                    f"it, or leave the driver out: --set {name}=direct"
                )


def write_mission(settings: Settings, folder: Path, options: argparse.Namespace, record: bool = True) -> Settings:
    """Writes the complete mission.yaml, with recording and emulated hardware in the run folder."""
    settings = with_chart(settings, folder)
    settings = settings.with_overrides({"record.folder": str(folder / "bag") if record else ""})
    if record and (lack := lack_of_space(recording_mb(settings), free_mb(folder), settings.record.least_free_mb)):
        raise RunFolderError(lack)
    hardware = hardware_of(options.modem, options.vehicle_link, settings, folder, overrides_of(options))
    settings = settings.with_overrides(hardware)
    for own in () if settings.sim.lockstep else settings.vehicles:  # else a node would refuse it, once started
        check_send_duration(settings.tdma, own.modem, settings.where)
    write_whole(folder / "mission.yaml", settings.to_parameter_file())
    return settings


def recording_mb(settings: Settings) -> float:
    """Expected size of the recording (MB)."""
    return size_of(settings).mission_mb


def fly(
    settings: Settings,
    folder: Path,
    console: Console,
    processes: Sequence[Process],
    reserved_domain: AbstractContextManager[int],
    *,
    start_s: float | None = None,
    report: bool = True,
    live: ExitStack | None = None,
) -> int:
    """Runs the mission of the run folder's mission.yaml, and evaluates the recording.

    Args:
        processes: What to start here.
        reserved_domain: Reserves a ROS domain for the mission (`simulation_domain`).
        start_s: As `conduct` takes it.
        report: Whether to make the figures and the report.
        live: Keeps the live view open after the mission's end; None: no live view.
    """
    interrupt = Interrupt()
    started = time.monotonic()
    try:
        with reserved_domain as domain:
            together = {TOGETHER_VARIABLE: "1"} if any(process.beside for process in processes) else {}
            environment = node_environment(domain) | {DIVE_VARIABLE: dive_on(domain) or "", **together}
            if live is not None:
                live.enter_context(LiveProcess(domain, environment, partial(_say, console)))
            _say(console, f"to watch from another terminal: export {watch_variables(domain)}")
            load = threading.Thread(target=preload_report, daemon=True)  # while the nodes leave a core idle
            phases = conduct(settings, folder, environment, console, interrupt, processes, start_s, load.start)
    except (MissionError, LaunchError, DomainError) as error:
        complain(error)
        return 1
    wall_s = time.monotonic() - started
    if interrupt.came and "mission" not in phases:
        if settings.record.folder:
            shutil.rmtree(settings.record.folder, ignore_errors=True)  # the recorder may have begun it
        _say(console, "interrupted before the first tick: every process has ended, nothing was recorded")
        return 130
    if interrupt.came:
        _say(console, "interrupted: every process has ended; the recording is complete up to here")
    if settings.sim.apart and not interrupt.came:
        _say(console, "the mission is complete. The vehicles' folders have the recordings: auv_lse adjust maps them")
    if not settings.record.folder or settings.sim.apart:  # separate vehicles make their own recordings
        return 130 if interrupt.came else 0
    interrupt.release()
    whole = not interrupt.came
    return report_mission(folder, settings, wall_s, phases, console, is_complete=whole, report=report, loading=load)


def report_mission(
    folder: Path,
    settings: Settings,
    wall_s: float,
    phases: dict[str, float],
    console: Console,
    *,
    is_complete: bool,
    report: bool = True,
    loading: threading.Thread | None = None,
) -> int:
    """Evaluates the mission, once `loading` has ended; returns the exit code.

    It is 130 if the mission or the evaluation was interrupted.
    """
    code = 0 if is_complete else 130
    mission = "the mission is complete" if is_complete else "the mission was interrupted"
    try:
        if loading is not None and loading.is_alive():
            loading.join()  # Ctrl-C during imports of two threads can leave Python's import lock taken for good
        conclude(folder, settings, wall_s, phases, console, report=report)
    except KeyboardInterrupt:
        again = f"auv_lse replay {shlex.quote(str(folder))} --report"
        _say(console, f"interrupted: {mission} and recorded. For its report: {again}")
        return 130
    except ImportError as error:
        complain(f"{mission}, but {missing(error, 'its figures and report')}")
        return code or 1
    except (OSError, ValueError) as error:
        complain(f"{mission}, but its evaluation failed: {error_text(error)}")
        return code or 1
    return code


def print_parameters(console: Console) -> None:
    """Prints every parameter with default, unit, range and meaning."""
    for name, cls in SECTIONS.items():
        table = Table(title=f"{name}: {(cls.__doc__ or '').strip().splitlines()[0]}", title_justify="left")
        for column in ("parameter", "default", "unit", "allowed", "meaning"):
            table.add_column(column, overflow="fold")
        for row in describe(cls, f"{name}."):
            table.add_row(*(Text(str(cell)) for cell in row))
        console.print(table)


def preload_report() -> None:
    """Imports the libraries of the report in advance, which takes seconds; missing ones are reported when used."""
    with contextlib.suppress(ImportError):
        importlib.import_module("auv_lse_shore.report.report")
        importlib.import_module("rosbags.highlevel")
    if compiled.USE_NUMBA:
        compiled_gp()
        compiled_risk()


def conclude(
    folder: Path, settings: Settings, wall_s: float, phases: dict[str, float], console: Console, report: bool
) -> None:
    """Evaluates the recording into summary.json, isobath.geojson and, if `report`, the figures and the report."""
    # Imported here, because the figures' libraries take a second to load.
    from auv_lse_record.run_reader import read_run
    from auv_lse_shore.judge.evaluation import evaluate, ground_grid
    from auv_lse_shore.judge.team_map import write_isobath
    from auv_lse_shore.report.progress import show_step
    from auv_lse_shore.report.report import write_report
    from auv_lse_shore.report.words import headlines

    began, processor_began_s = time.monotonic(), _processor_s()
    ground = ground_grid(settings.planner_settings(1), ground_of(settings))
    run = read_run(folder, mission=folder / "mission.yaml", ground=ground, wall_s=wall_s)
    if report:
        summary = write_report(run, folder, show_step)
    else:
        evaluation = evaluate(run, on_two_cores=True)
        summary = evaluation.summary
        summary.write(folder / "summary.json")
        write_isobath(evaluation.team_map, folder / "isobath.geojson", run.origin, evaluation.truth)
    phases["report"] = time.monotonic() - began
    times = folder / "logs" / "times.json"
    measured = {"wall_s": phases, "processor_report_s": _processor_s() - processor_began_s}
    times.write_text(json.dumps({**json.loads(times.read_text()), **measured}, indent=1) + "\n")
    for line in headlines(summary, settings.mission.steps, run):
        _say(console, line)
    page = "report.html" if report else "summary.json"
    took = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in phases.items())
    _say(console, f"{folder / page}   ({took})")


def _processor_s() -> float:
    """Processor time (s) of this process and of its children that have ended."""
    return sum(os.times()[:4])
