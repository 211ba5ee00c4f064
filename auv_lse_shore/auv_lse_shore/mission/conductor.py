"""Starts a mission's processes, watches the mission to its end, and ends every process."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from rich.console import Console

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.process.processes import LOADING, LOADING_TOLD_S, Process
from auv_lse_shore.mission.display import Display, MissionProgress, reward_shown
from auv_lse_shore.mission.launcher import ProcessGroup
from auv_lse_shore.mission.watch_node import MissionWatch

_START_S = 90.0


class MissionError(RuntimeError):
    """A mission that did not end as it should: what happened, and where to look."""


class Interrupt:
    """Turns Ctrl-C and SIGTERM into a flag, so that the processes are ended in order.

    Attributes:
        came: Whether one of the two signals has come.
    """

    def __init__(self) -> None:
        """Takes over both signals."""
        self.came = False
        for sign in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sign, self._note)

    def _note(self, sign: int, frame: FrameType | None) -> None:
        self.came = True

    def over(self) -> None:
        """Nothing has to be ended in order any more: from now on either signal is a KeyboardInterrupt."""
        for sign in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sign, signal.default_int_handler)


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
    """Starts every process, watches the mission to its end, and ends every process.

    Args:
        settings: The mission, as written to mission.yaml in `folder`.
        folder: The run folder.
        environment: The processes' environment (`launcher.local_environment`).
        console: Where the progress is shown.
        interrupt: Ends the mission early.
        processes: What to start (`processes.mission_processes`); the mission's other nodes are started elsewhere.
        start_s: Longest time (s) until all nodes have found each other, from when they are loaded; None: as long as a
            team of that size needs.
        when_running: Called once when the first tick has come.

    Returns:
        Wall-clock seconds of the phases "start", "mission" and "ending"; those not reached are left out.

    Raises:
        MissionError: if a node ends by itself or the simulator gives up. Every process is ended then, too.
    """
    os.environ.update(environment)
    start_s = _START_S + 10.0 * settings.mission.vehicles if start_s is None else start_s
    progress = MissionProgress(
        vehicles=settings.mission.vehicles,
        steps_total=settings.mission.steps,
        reward=reward_shown(settings.planner_settings(1).planner),
    )
    marks = {"began": time.monotonic()}
    forked_s, told = marks["began"], False
    started_s: dict[str, float] = {}
    group = ProcessGroup(folder / "logs", environment, processes, in_turn=settings.sim.lockstep)
    with contextlib.ExitStack() as stack:
        stack.callback(group.stop)
        for process in processes:
            follows = process.executable != "sim_node"  # every clock but the simulator's follows /clock
            group.start(process, folder / "mission.yaml", ("-p", "use_sim_time:=true") if follows else ())
        watch = stack.enter_context(MissionWatch(progress))
        display = stack.enter_context(Display(progress, console))
        while not interrupt.came and progress.phase != "finished":
            state, message = watch.wait(0.1)
            if group.loading:
                forked_s = time.monotonic()
                if not told and forked_s - marks["began"] > LOADING_TOLD_S:
                    console.print(f"still {LOADING}")
                    told = True
            _check(state, message, group, folder, time.monotonic() - forked_s > start_s)
            if state in ("running", "finished"):
                progress.phase = state
                if "running" not in marks:
                    marks["running"], started_s = time.monotonic(), group.cpu_s()
                    if when_running is not None:
                        when_running()
            display.refresh()
        marks["ended"] = time.monotonic()
        processor_s = group.cpu_s()
    phases = {"ending": time.monotonic() - marks["ended"]}
    if "running" in marks:
        phases = {"start": marks["running"] - marks["began"], "mission": marks["ended"] - marks["running"], **phases}
    times = {"wall_s": phases, "processor_s": processor_s, "processor_start_s": started_s}
    (folder / "logs" / "times.json").write_text(json.dumps(times, indent=1) + "\n")
    return phases


def _check(state: str, message: str, group: ProcessGroup, folder: Path, late: bool) -> None:
    """Checks that the mission can go on.

    Raises:
        MissionError: if a process has ended, the simulator has given up, or the nodes do not find each other.
    """
    for name, code in group.ended():
        raise MissionError(
            f"{name} ended by itself (exit code {code}); the end of {group.log(name)}:\n{group.last_words(name)}"
        )
    if state == "failed":
        raise MissionError(f"the simulator gave up: {message}; logs: {folder / 'logs'}")
    if state == "waiting" and late:
        raise MissionError(f"the nodes have not found each other: {message}; logs: {folder / 'logs'}")
