"""Starts the processes of a mission, follows it to its end, and ends them. Follows missions of `ros2 launch`, too."""

import contextlib
import json
import math
import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from auv_lse_common.mission_file.settings import Settings
from auv_lse_run.mission.display import Display, MissionProgress, progress_of
from auv_lse_run.mission.watch_node import MissionWatch
from auv_lse_run.process.interrupt import Interrupt
from auv_lse_run.process.keeper import SILENT_S, ProcessKeeper, node_task
from auv_lse_run.process.processes import Process, last_lines

_START_S, _PERIOD_S = 90.0, 0.1


class MissionError(RuntimeError):
    """A mission that failed: what happened, and where to look."""


def conduct(
    settings: Settings,
    folder: Path,
    environment: dict[str, str],
    console: Console,
    interrupt: Interrupt,
    processes: Sequence[Process],
    start_s: float | None = None,
    when_running: Callable[[], None] | None = None,
) -> dict[str, float]:
    """Starts every process, follows the mission to its end, and ends every process.

    Args:
        settings: The mission, as written to mission.yaml in `folder`.
        environment: The processes' environment (`domain.node_environment`).
        interrupt: Ends the mission early.
        processes: What to start (`mission_processes`); other nodes of the mission are started elsewhere.
        start_s: Longest time (s) for the loaded nodes to discover each other; None: enough for a team of that size.
        when_running: Called once after the first tick.

    Returns:
        Wall-clock seconds of the phases "start", "mission" and "ending"; those not reached are left out.

    Raises:
        MissionError: if a node ends or the simulator fails. Every process is ended then, too.
        LaunchError: if a process is not installed.
    """
    start_s = _START_S + 10.0 * settings.mission.vehicles if start_s is None else start_s
    keeper = _keeper(settings, folder, environment, console, processes)
    started_s: dict[str, float] = {}

    def look_after(state: str, message: str) -> None:
        died = keeper.tick(time.monotonic())
        _check(state, message, died, keeper, folder / "logs", keeper.loaded_for_s > start_s)
        if state in ("running", "finished") and not started_s:
            started_s.update(keeper.cpu_s())
            if when_running is not None:
                when_running()

    with contextlib.ExitStack() as stack:
        stack.callback(keeper.stop)
        keeper.tick(time.monotonic())
        try:
            marks = follow(progress_of(settings), environment, console, interrupt, look_after)
        except MissionError as error:
            if not (started_s and settings.record.folder) or settings.sim.apart or "recorder_node" in str(error):
                raise
            again = f"auv_lse replay {shlex.quote(str(folder))} --report"
            raise MissionError(f"{error}\nThe mission is recorded up to here. For its report: {again}") from error
        processor_s = keeper.cpu_s()
    return write_times(folder, marks, processor_s, started_s)


def follow(
    progress: MissionProgress,
    environment: dict[str, str],
    console: Console,
    interrupt: Interrupt,
    look_after: Callable[[str, str], None] = lambda state, message: None,
) -> dict[str, float]:
    """Shows the progress of a mission until it ends or is interrupted.

    Args:
        progress: Updated while the mission runs; its phase is "finished" if the mission is complete.
        environment, console, interrupt: As `conduct` takes them.
        look_after: Called ten times a second with the mission's state and message.

    Returns:
        Wall-clock times as `write_times` takes them.

    Raises:
        MissionError: if the simulator has failed.
    """
    marks = {"began": time.monotonic()}
    with MissionWatch(progress, environment) as watch, Display(progress, console) as display:
        while not interrupt.came and progress.phase != "finished":
            state, message = watch.wait(_PERIOD_S)
            progress.started_s = time.monotonic() - marks["began"]
            if state in ("running", "finished"):
                progress.phase = state
                marks.setdefault("running", time.monotonic())
            if interrupt.came:  # a shutdown may have ended the processes, too: that is no failure
                break
            look_after(state, message)
            if state == "failed":
                raise MissionError(f"the simulator stopped the mission: {message}")
            display.refresh()
    return marks | {"ended": time.monotonic()}


def _keeper(
    settings: Settings, folder: Path, environment: dict[str, str], console: Console, processes: Sequence[Process]
) -> ProcessKeeper:
    # Every clock but the simulator's own follows /clock.
    clock = {process: () if process.executable == "sim_node" else ("-p", "use_sim_time:=true") for process in processes}
    tasks = [node_task(process, folder / "mission.yaml", *clock[process]) for process in processes]
    logs, in_turn = folder / "logs", settings.sim.lockstep
    silent_s = math.inf if settings.sim.lockstep else SILENT_S  # in lockstep the simulator names who does not answer
    return ProcessKeeper(tasks, logs, environment, console.print, restart=False, silent_s=silent_s, in_turn=in_turn)


def write_times(
    folder: Path, marks: dict[str, float], processor_s: dict[str, float], started_s: dict[str, float]
) -> dict[str, float]:
    """Writes logs/times.json; returns the wall-clock seconds of the phases.

    Args:
        marks: Times (s) at which it "began", was "running" (left out if it never was) and "ended".
        processor_s, started_s: Processor time (s) of each process in all, and before the first tick.
    """
    phases = {"ending": time.monotonic() - marks["ended"]}
    if "running" in marks:
        phases = {"start": marks["running"] - marks["began"], "mission": marks["ended"] - marks["running"], **phases}
    times = {"wall_s": phases, "processor_s": processor_s, "processor_start_s": started_s}
    with contextlib.suppress(OSError):  # a full disk; the evaluation of the mission reports it
        (folder / "logs" / "times.json").write_text(json.dumps(times, indent=1) + "\n")
    return phases


def _check(
    state: str, message: str, died: Sequence[tuple[str, int]], keeper: ProcessKeeper, logs: Path, late: bool
) -> None:
    """Raises MissionError if the mission cannot go on."""
    for name, code in died:
        log, why = keeper.log(name), keeper.why_died(name, code)
        raise MissionError(f"{name} ended unexpectedly ({why}); the end of {log}:\n{last_lines(log)}")
    if state == "failed":
        raise MissionError(f"the simulator stopped the mission: {message}; logs: {logs}")
    if state == "waiting" and late:
        raise MissionError(f"discovery timed out: {message}; logs: {logs}")
