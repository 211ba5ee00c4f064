"""auv_lse vehicle: runs the nodes of one vehicle, and restarts them, until SIGTERM or Ctrl-C."""

import argparse
import math
import os
import re
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import (
    as_comment,
    file_in_memory,
    parameter_text,
    parameters_for,
    read_parameter_file,
)
from auv_lse_common.mission_file.parameters import ParameterError, flatten, merge, section
from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.table import check_sections
from auv_lse_common.mission_file.settings import Settings, beyond_team, check_pattern, check_vehicle
from auv_lse_common.node.dive import DIVE_VARIABLE, WAIT_VARIABLE, new_dive
from auv_lse_common.support.installed_copy import COPY_VARIABLE, note_software, own_copy
from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.vocabulary.vehicle_name import vehicle_name
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_run.process.domain import (
    DomainError,
    dive_on,
    domain_number,
    loopback_problem,
    node_environment,
    note_run,
    own_records,
    refuse_running_dive,
    run_on,
    simulator_of,
    vehicle_domain,
    wanted_domain,
)
from auv_lse_run.process.interrupt import Interrupt, first_signal
from auv_lse_run.process.keeper import REFUSED, SILENT_S, ProcessKeeper, Task, node_task
from auv_lse_run.process.processes import RECORDER, LaunchError, Process
from auv_lse_run.vehicle.dive_record import DiveRecord, StateFolderError, copy_folders
from auv_lse_run.vehicle.vehicle_choice import chosen_vehicle

_TICK_S = 0.2
#: Patterns that are meant for a vehicle; others may name a user's drivers, such as /auv2/sounder_node.
_OF_VEHICLE = re.compile(r"/?auv[ _-]?\d+(/\*+)?/?", re.IGNORECASE)
#: A node that rejects its parameters within this time (s) after its first start ends the command: a restart cannot
#: help.
_FIRST_START_S = 30.0
#: Nodes that load compiled code; they start last, so that the others need not wait for it.
_SLOW_NODES = ("gp_node", "planner_node")
#: Why the nodes were ended, after a signal that no person at the terminal has sent.
_ENDED_BY: dict[signal.Signals | None, str] = {
    signal.SIGTERM: " after SIGTERM",
    signal.SIGHUP: " after SIGHUP: the terminal or SSH session was closed",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleProcesses:
    """The processes of one vehicle.

    Attributes:
        nodes: Its nodes without the recorder.
        file: The parameter file; that of a real vehicle, or a changed one, is in memory (Linux).
        recording: Folder for the recording; None: no recorder.
        simulated: Whether the nodes follow a simulator's clock.
        lockstep: Whether a simulator drives the nodes tick by tick.
    """

    vehicle: int
    file: Path
    nodes: tuple[Process, ...]
    recording: Path | None
    simulated: bool
    lockstep: bool

    def tasks(self) -> list[Task]:
        """The processes as tasks of a process keeper, in the order of their starts.

        Raises:
            LaunchError: if one is not installed.
        """
        clock = ("-p", "use_sim_time:=true") if self.simulated else ()
        nodes = sorted(self.nodes, key=lambda process: process.executable in _SLOW_NODES)
        tasks = [node_task(process, self.file, *clock) for process in nodes]
        if self.recording is not None:
            tasks.insert(1, self._recorder(self.recording))
        return tasks

    def _recorder(self, folder: Path) -> Task:
        task = node_task(RECORDER, self.file, "-p", f"record.folder:={folder}")
        return replace(task, name=f"auv{self.vehicle}.{RECORDER.executable}")


def vehicle_number(name: str) -> int:
    """The number of a vehicle from its name, as people type it (`vehicle_name`).

    Raises:
        ParameterError: if it is not a vehicle's name.
    """
    match = re.fullmatch(r"auv([1-9]\d{0,2})", vehicle_name(name))
    if match is None or int(match[1]) > 255:
        raise ParameterError(f"{name!r} is not a vehicle; use a name from auv1 to auv255")
    return int(match[1])


def vehicle_processes(name: str, file: Path, out: Path, simulated: bool, record: bool | None) -> VehicleProcesses:
    """The processes of the vehicle `name` ("auv2"), according to the mission file.

    Args:
        simulated: Whether to follow a simulator even if the file has no section `sim`.
        record: Whether to record; None: only if the file sets record.folder and no simulator records.

    Raises:
        ParameterError: naming the error in the file, or a vehicle that the mission does not have.
    """
    vehicle = vehicle_number(name)
    patterns = read_parameter_file(file)
    own = parameters_for(patterns, f"/auv{vehicle}/settings")
    check_sections(own, str(file), ignore=("use_sim_time",))
    names = ("mission", "sim", "modem", "link", "record")
    mission, sim, modem, link, recorder = (_section(own, name, file) for name in names)
    count = mission.get("vehicles")
    if isinstance(count, int) and vehicle > count:
        raise ParameterError(f"{file}: mission.vehicles is {count}, so there is no auv{vehicle}")
    simulated = simulated or "sim" in own
    lockstep = simulated and bool(sim.get("lockstep", True))
    nodes = vehicle_nodes(modem.get("kind") == "micromodem", link.get("kind") == "mavlink")
    check_vehicle(patterns, str(file), vehicle, [executable for _, executable in nodes])
    if record is None:
        record = bool(recorder.get("folder")) and not simulated
    if lockstep and not sim.get("lockstep", False):
        # Nodes read lockstep from their own parameters, where its default is false.
        patterns = merge(patterns, {"/**": merge(patterns.get("/**", {}), {"sim": {"lockstep": True}})})
    text = f"{parameter_text(patterns)}\n{as_comment(file)}"  # in metres, and without YAML that ROS cannot read
    if hasattr(os, "memfd_create"):
        file = file_in_memory(text)
    else:
        file = out / "mission.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    own_nodes = tuple(Process(package=p, executable=e, namespace=f"/auv{vehicle}") for p, e in nodes)
    return VehicleProcesses(
        vehicle=vehicle,
        file=file,
        nodes=own_nodes,
        recording=out / "bag" if record else None,
        simulated=simulated,
        lockstep=lockstep,
    )


def ignored_parameters(file: Path) -> list[str]:
    """The parameters in a mission file that are of a vehicle beyond the team.

    Raises:
        ParameterError: if the file cannot be read, or if parameters that are meant for a vehicle reach none of its
            nodes: without its own `vehicle.start`, it might not even wait for GO.
    """
    patterns = read_parameter_file(file)
    vehicles = section(MissionConfig, parameters_for(patterns, "/settings"), "mission", str(file)).vehicles
    found = []
    for pattern in patterns:
        if beyond := beyond_team(pattern, vehicles, str(file)):
            found.append(beyond)
        elif _OF_VEHICLE.fullmatch(pattern):
            check_pattern(pattern, {}, str(file), vehicles)
    return found


def open_dive(name: str, file: Path, out: Path | None, dives: Path, simulated: bool) -> tuple[DiveRecord, Path]:
    """The record of the dive that this start begins or continues, and its folder for logs and recording.

    Args:
        name: The vehicle, "auv2".
        out: The folder for logs and recording; None: a new one in `dives`, or that of the dive to continue.
        simulated: As `vehicle_processes` takes it. Without `out`, each start of a simulated vehicle begins a new dive.

    Raises:
        ParameterError: as `vehicle_processes`, or if `out` has a recording of another dive.
    """
    vehicle = vehicle_number(name)
    patterns = read_parameter_file(file)
    own = parameters_for(patterns, f"/auv{vehicle}/settings")
    new = (out or dives / f"{datetime.now():%Y-%m-%d-%H%M%S}-auv{vehicle}").resolve()
    simulated = simulated or "sim" in own
    folder = new if out or simulated else dives.resolve()
    copies = copy_folders(section(SafetyConfig, own, "safety", str(file)).state_copies)
    record = DiveRecord(folder, vehicle, file.resolve(), patterns, copies=copies, simulated=simulated)
    if record.continued is None and not record.doubt and os.path.lexists(new / "bag"):
        raise ParameterError(f"--out {new} contains a recording already, {new / 'bag'}. Choose another folder")
    if record.continued is None and (file_there := next(filter(os.path.isfile, (new, *new.parents)), None)):
        raise ParameterError(f"--out {new}: {file_there} is a file. Choose a new or empty folder")
    return record, new if out else record.continued or new


@contextmanager
def begin_dive(
    processes: VehicleProcesses, wanted: str | None, file: Path, out: Path, record: DiveRecord
) -> Iterator[tuple[int, dict[str, str]]]:
    """Reserves the ROS domain of a vehicle's dive for as long as the context lasts.

    Args:
        wanted: The domain of a command line; None: ROS_DOMAIN_ID, else the simulator's, else 0.
        file: The mission file; a simulator's is in its run folder.
        record: The record of the dive, which is ended with the context, but not by SIGHUP.

    Returns:
        The domain, and further variables of the nodes' environment (`DiveRecord.begin`).

    Raises:
        DomainError: if the domain is invalid or in use, if a dive that runs has `out` or a record of this one, or if
            another start has changed the record since it was read.
        ParameterError: if the simulator there flies another mission.
        StateFolderError: if the nodes' state could not be kept.
    """
    simulator = simulator_of(file.resolve().parent) if processes.simulated else None
    domain = domain_number(wanted_domain(wanted) or simulator or "0")
    with ExitStack() as reserved:
        reserved.enter_context(vehicle_domain(domain, processes.vehicle, processes.simulated))
        refuse_running_dive(out, processes.vehicle)
        reserved.enter_context(own_records(record.records, domain))
        if not record.is_current:
            raise DomainError(
                f"{record.records[0]}: another start of auv{processes.vehicle} changed it while this one began. "
                "Start again"
            )
        if processes.simulated and (run := run_on(domain)):
            _refuse_other_mission(processes, file, run / "mission.yaml", domain)
        dive = (processes.simulated and dive_on(domain)) or new_dive(f"auv{processes.vehicle}")
        variables = record.begin(out, dive) | {COPY_VARIABLE: own_copy()}
        note_software(out)
        with suppress(DomainError):  # a full disk must not keep a vehicle from continuing
            note_run(domain, out, variables[DIVE_VARIABLE], processes.vehicle)
        try:
            yield domain, variables
        finally:
            if processes.simulated or first_signal() != signal.SIGHUP:  # a lost connection does not end a dive
                record.end()


def _refuse_other_mission(processes: VehicleProcesses, file: Path, simulated: Path, domain: int) -> None:
    """Refuses the parameters of a vehicle that contradict those of the simulation, which has recorder and world."""
    missions = (Settings.load(path).parameters(processes.vehicle) for path in (processes.file, simulated))
    mine, others = (flatten({**own, "record": {}, "sim": {"lockstep": own["sim"]["lockstep"]}}) for own in missions)
    for name in (*others, *mine):
        if (value := mine.get(name)) != (other := others.get(name)):
            raise ParameterError(
                f"{file}: {name} is {value!r}, but {other!r} in the mission simulated in ROS domain {domain}. Start "
                f"auv{processes.vehicle} with {simulated}"
            )


def _section(parameters: dict[str, Any], name: str, file: Path) -> dict[str, Any]:
    found = parameters.get(name, {})
    if not isinstance(found, dict):
        raise ParameterError(f"{file}: {name} must be a mapping of parameters, not {found!r}")
    return found


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse vehicle."""
    p = argparse.ArgumentParser(
        prog="auv_lse vehicle",
        description="Runs the nodes of one vehicle: gp, safety, planner and modem, and, if the mission file asks for "
        "them, micromodem, vehicle link and recorder. Restarts a node that dies or hangs. SIGTERM, Ctrl-C or a closed "
        "terminal ends all nodes, the recorder last.",
        epilog="Exit codes: 0 ended by SIGTERM, or the simulated mission is complete; 1 the simulated mission failed; "
        "2 the request is impossible or the command line wrong; 130 Ctrl-C.",
    )
    p.add_argument(
        "name",
        nargs="?",
        metavar="VEHICLE",
        help="the vehicle, such as auv2 (default: AUV_LSE_VEHICLE, else the only one in the file)",
    )
    p.add_argument(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="the mission file (docs/guide/bench-to-water.md; default: AUV_LSE_MISSION)",
    )
    p.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for logs and recording (default: dives/DATE-TIME-auvN)"
    )
    p.add_argument(
        "--domain", metavar="N", help="ROS domain (default: ROS_DOMAIN_ID, else 0; with a simulator, the simulator's)"
    )
    p.add_argument(
        "--simulated",
        action="store_true",
        help="follow the simulator that auv_lse sim starts on this machine; the default if the file has a section sim",
    )
    p.add_argument(
        "--wait", action="store_true", help="make a new dive wait for GO, whatever vehicle.start is, as at boot"
    )
    p.add_argument(
        "--record",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="whether to record (default: if record.folder is set; with a simulator, auv_lse sim records)",
    )
    return p


def run(options: argparse.Namespace) -> int:
    """Runs a vehicle. Returns the exit code (see --help)."""
    root = project_folder()
    stack = ExitStack()
    try:
        options.name, options.file = chosen_vehicle(options.name, options.file)
        number, out = vehicle_number(options.name), options.out
        record, out = open_dive(options.name, options.file, out, root / "dives", options.simulated)
        processes = vehicle_processes(options.name, options.file.resolve(), out, options.simulated, options.record)
        tasks = processes.tasks()
        ignored = ignored_parameters(options.file) if record.continued is None else []
        domain, variables = stack.enter_context(begin_dive(processes, options.domain, options.file, out, record))
    except (ParameterError, LaunchError, DomainError, StateFolderError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: --out {out}: cannot be created: {error.strerror or error}", file=sys.stderr)
        return 2
    with stack:
        lockstep = " in lockstep" if processes.lockstep else ""
        follows = f", following the simulator{lockstep}" if processes.simulated else ""
        dive = f"dive {variables[DIVE_VARIABLE]}{'' if record.continued is None else ', continued'}"
        doubt = record.doubt and f"holds: {record.doubt}. {record.cure}"
        for text in ignored:
            _say(f"warning: {text}")
        for text in filter(None, (doubt, record.copies_problem, loopback_problem())):
            _say(f"auv{number}: {text}")
        waits = {WAIT_VARIABLE: "1"} if options.wait else {}
        _say(f"auv{number}: ROS domain {domain}{follows}; {dive}; logs in {out / 'logs'}")
        return _keep_running(processes, tasks, out / "logs", node_environment(domain) | variables | waits)


def _keep_running(processes: VehicleProcesses, tasks: Sequence[Task], logs: Path, environment: dict[str, str]) -> int:
    """Keeps the tasks running until a signal, a fatal death or the simulated mission's end; returns the exit code."""
    interrupt = Interrupt()
    # In lockstep a node may take any time for a tick, and none can be restarted.
    silent_s = math.inf if processes.lockstep else SILENT_S
    keeper = ProcessKeeper(tasks, logs, environment, _say, silent_s=silent_s)
    with ExitStack() as stack:
        # entered first, so left last: leaving a ROS domain may take long, and must keep no node running
        mission_end = (lambda _: None) if not processes.simulated else stack.enter_context(_mission_end(environment))
        stack.callback(_report_end, processes.vehicle, logs, interrupt)
        stack.callback(keeper.stop)
        while not interrupt.came:
            for name, code in keeper.tick(time.monotonic()):
                early = keeper.loaded_for_s < _FIRST_START_S
                if code == REFUSED and early and keeper.starts[name] == 1 and not name.endswith(RECORDER.executable):
                    _say(f"error: {name} rejects its parameters; see {keeper.log(name)}")
                    return 2
                if processes.lockstep:
                    _say(f"error: {name} died ({keeper.why_died(name, code)}); a lockstep mission cannot continue")
                    return 1
            if (ended := mission_end(not processes.lockstep or len(keeper.running) == len(tasks))) is not None:
                _say(f"auv{processes.vehicle}: the simulated mission has {ended}")
                return 0 if ended == "finished" else 1
            time.sleep(_TICK_S)
    return 0 if interrupt.signal == signal.SIGTERM else 130


def _mission_end(environment: dict[str, str]) -> Any:
    """A context that provides a function: it returns how the simulated mission has ended, None until then."""
    from auv_lse_run.mission.sim_status_node import (
        SimStatusWatch,  # imports ROS, which a real vehicle does not need here
    )

    return SimStatusWatch(environment)


def _report_end(vehicle: int, logs: Path, interrupt: Interrupt) -> None:
    """Reports that the nodes have ended, and why, also in a log: the terminal may be gone."""
    text = f"auv{vehicle}: all nodes have ended{_ENDED_BY.get(interrupt.signal, '')}"
    _say(text)
    with suppress(OSError), (logs / f"auv{vehicle}.vehicle.log").open("a") as log:
        log.write(f"{datetime.now():%Y-%m-%d %H:%M:%S} {text}\n")


def _say(text: str) -> None:
    with suppress(OSError, ValueError):  # a terminal that is gone, or a full disk behind it, must stop no vehicle
        print(text, flush=True)
