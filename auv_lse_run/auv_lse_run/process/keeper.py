"""The process keeper: starts a list of processes, watches them, restarts them if asked to, and ends them in order.

Theory of operation
-------------------
The caller calls `ProcessKeeper.tick` a few times a second; the first call starts every process, in order. Nodes are
forked by a fork server, which imports their modules; other programs are started directly. No process depends on a log
file. A process that has ended is reported by `tick`. What follows depends on `restart`:

- False, for a simulated mission: nothing. A mission cannot go on without one of its nodes, so the caller ends it.
- True, for a vehicle: the process is started again at once, because an autopilot's failsafe does not wait for its
  link. If it dies again within `STEADY_S`, it waits for `FIRST_WAIT_S`, and twice as long with each further death, up
  to `LONGEST_WAIT_S`. If the fork server dies, its nodes die with it, and all are started again.

Watchdog: a node reports once a second that it serves its callbacks (`heartbeat`). One that was silent for `silent_s`
although its process runs is killed and restarted; without `restart`, a node that hangs, and one that answers again, is
only reported. If the fork server does not report that death within `_DEATH_S`, the
keeper kills the fork server and its children. Silence is counted in the keeper's own ticks, so that no node is killed
after the computer was suspended.
"""

import contextlib
import math
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from auv_lse_common.node.heartbeat import SOCKET_VARIABLE, Heartbeats
from auv_lse_run.process.death import cause
from auv_lse_run.process.fork_server import ForkedProcess, ForkServer, entries_of
from auv_lse_run.process.processes import (
    LAST_STOP_S,
    LaunchError,
    Process,
    Running,
    end,
    last_lines,
    log_problem,
    start,
)

#: First and longest wait (s) before a process that died again is restarted.
FIRST_WAIT_S = 0.5
LONGEST_WAIT_S = 30.0
#: A process that has served its callbacks for this time (s) is restarted at once.
STEADY_S = 5.0
#: Watchdog: longest silence (s) of a node; doubled each time that it hangs.
SILENT_S = 30.0
#: Share of that for safety_node: while it hangs, no limit is watched and no command obeyed. Its callbacks are short.
SAFETY_SHARE = 1.0 / 3.0
#: The same before a node's first heartbeat: it may have to compile code.
_SILENT_AT_FIRST_S = 4.0 * SILENT_S
#: A killed process is gone within this time (s).
_DEATH_S = 10.0
#: A tick adds at most this much (s) to a process's silence.
_LONGEST_TICK_S = 1.0
#: Loading that takes longer than this (s) is reported.
_LOADING_REPORTED_S = 10.0
#: Exit code of a node that refuses its parameters (`auv_lse_common.node.entry_point.Main`).
REFUSED = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A process to keep.

    Attributes:
        name: Name in reports and of the log file, "auv2.gp_node".
        command: Returns the command line of the n-th start, n from 0: a recorder needs a new folder each time.
        last: Whether it is ended after the others, as a recorder is.
        node: The node, for the fork server; None: any other program.
        silent_share: Share of the keeper's `silent_s` for this process.
    """

    name: str
    command: Callable[[int], Sequence[str]]
    last: bool = False
    node: Process | None = None
    silent_share: float = 1.0


def node_task(process: Process, parameter_file: Path, *arguments: str) -> Task:
    """The task of a node with the mission's parameters.

    Args:
        arguments: Further arguments after --ros-args.

    Raises:
        LaunchError: if it is not installed.
    """
    entries_of(process)
    name = "+".join((f"{process.package}/{process.executable}", *(name for _, name in process.beside)))
    command = [name, "--ros-args", "--params-file", str(parameter_file), *process.ros_arguments, *arguments]
    share = SAFETY_SHARE if process.executable == "safety_node" else 1.0
    return Task(
        name=process.name, command=lambda start_number: command, last=process.last, node=process, silent_share=share
    )


@dataclass(slots=True)
class _State:
    """The state of a task."""

    task: Task
    process: Running | None = None
    starts: int = 0
    reported: bool = False  # its start has been reported
    started_s: float = 0.0
    served_s: float = math.nan  # time of its first heartbeat; of its start where none is watched
    due_s: float = -math.inf
    wait_s: float = 0.0  # before the restart after the next death
    silent_s: float = 0.0  # since the last heartbeat, or since the start
    limit_s: float = math.inf  # longest silence; infinite for other programs before their first heartbeat
    hangs: int = 0  # in a row
    killed: bool = False  # by the watchdog
    is_reported: bool = False  # its hang, which ends by itself or with the mission

    @property
    def begun(self) -> bool:
        """Whether its process exists; a fork server may still be loading."""
        return self.process is not None and (not isinstance(self.process, ForkedProcess) or self.process.begun)


class ProcessKeeper:
    """Keeps tasks until `stop`; see the module's text."""

    def __init__(
        self,
        tasks: Sequence[Task],
        logs: Path,
        environment: Mapping[str, str],
        say: Callable[[str], None],
        *,
        restart: bool = True,
        silent_s: float = SILENT_S,
        in_turn: bool = False,
    ) -> None:
        """Starts nothing yet.

        Args:
            logs: Folder of the log files, one for each task; restarts append.
            environment: Environment of the processes.
            say: Called with a line for each start and death (with `restart`), each hang, for long loading, and for
                what a process reports.
            restart: Whether a process that died or hangs is restarted.
            silent_s: Watchdog: longest silence (s) of a process; infinite: no watchdog.
            in_turn: As `ForkServer` takes it.
        """
        self._states = [_State(task) for task in tasks]
        self._logs, self._say, self._restart = logs, say, restart
        self._silent_limit_s, self._in_turn = silent_s, in_turn
        self._heartbeats = Heartbeats() if sys.platform == "linux" else None
        self._environment = dict(environment)
        if self._heartbeats is not None:
            self._environment[SOCKET_VARIABLE] = self._heartbeats.address
        self._forked = [task.node for task in tasks if task.node is not None]
        self._server: ForkServer | None = None
        self._loads_from_s = self._loading_s = self._ticked_s = math.nan  # the first: NaN while nothing is loaded
        self._loading_reported = False
        self._log_problem = ""

    @property
    def running(self) -> dict[str, int]:
        """Process id of each task that runs."""
        alive = ((s.task.name, s.process) for s in self._states if s.process is not None and s.process.poll() is None)
        begun = {s.task.name for s in self._states if s.begun}
        return {name: process.pid for name, process in alive if name in begun}

    @property
    def starts(self) -> dict[str, int]:
        """How often each task has been started."""
        return {s.task.name: s.starts for s in self._states}

    @property
    def loaded_for_s(self) -> float:
        """Time (s) up to the last tick since the fork server was last loading modules, or compiling them."""
        return self._ticked_s - self._loading_s

    def log(self, name: str) -> Path:
        """The log file of a task."""
        return self._logs / f"{name}.log"

    def cpu_s(self) -> dict[str, float]:
        """Processor time (s, user and system) of each running process so far (Linux; else empty)."""
        times = {}
        for name, pid in self.running.items():
            with contextlib.suppress(OSError, ValueError, IndexError):
                fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
                times[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return times

    def tick(self, now_s: float) -> list[tuple[str, int]]:
        """Starts the tasks that are due, and watches those that run.

        Args:
            now_s: A monotonic clock.

        Returns:
            Name and exit code of each task that has died since the last call; -9 if signal 9 ended it.
        """
        if math.isnan(self._ticked_s):
            self._loading_s = self._ticked_s = now_s
        passed_s = min(max(0.0, now_s - self._ticked_s), _LONGEST_TICK_S)
        self._ticked_s = now_s
        alive, reports = self._heartbeats.take() if self._heartbeats is not None else (set(), ())
        for text in reports:
            self._say(text)
        died = []
        for state in self._states:
            if state.process is None and now_s >= state.due_s:
                self._start(state, now_s)
            elif state.process is not None and (code := state.process.poll()) is not None:
                state.process = None
                died.append((state.task.name, code))
                self._plan_restart(state, code, now_s)
            self._report_start(state)
            self._check_heartbeat(state, alive, passed_s, now_s)
        self._check_loading(now_s)
        return died

    def why_died(self, name: str, code: int) -> str:
        """Why a task that `tick` reports as dead has ended."""
        return cause(code, hung=any(state.killed for state in self._states if state.task.name == name))

    def stop(self) -> None:
        """Ends every process, those of tasks marked `last` after the others."""
        begun = [(s.task, s.process) for s in self._states if s.process is not None and s.begun]
        end(process for task, process in begun if not task.last)
        end((process for task, process in begun if task.last), LAST_STOP_S)
        if self._server is not None:
            self._server.close()
        if self._heartbeats is not None:
            self._heartbeats.close()
        for state in self._states:
            state.process = None

    def _check_loading(self, now_s: float) -> None:
        if all(s.begun or s.process is None or s.process.poll() is not None for s in self._states):
            self._loads_from_s = math.nan
            return
        self._loading_s = now_s
        if math.isnan(self._loads_from_s):
            self._loads_from_s = now_s
        if not self._loading_reported and now_s - self._loads_from_s > _LOADING_REPORTED_S:
            self._say("still loading the nodes: recompiling changed code; this may take minutes")
            self._loading_reported = True

    def _check_heartbeat(self, state: _State, alive: set[int], passed_s: float, now_s: float) -> None:
        """Kills a process that hangs, and a fork server that does not report its death."""
        process = state.process
        if process is None or not state.reported:
            return
        state.silent_s += passed_s
        if process.pid in alive and not state.killed:
            if state.is_reported:
                self._say(f"{state.task.name} answers again after {state.silent_s:.0f} s")
            state.silent_s, state.is_reported = 0.0, False
            state.served_s = now_s if math.isnan(state.served_s) else state.served_s
            state.limit_s = self._silent_limit_s * state.task.silent_share * 2.0**state.hangs
        if state.silent_s < state.limit_s or state.is_reported:
            return
        if not self._restart and not math.isnan(state.served_s):
            state.is_reported = True
            self._say(
                f"{state.task.name} hangs: process {process.pid} has served no callback for {state.silent_s:.0f} s"
            )
            return
        if state.killed:
            self._say(
                f"{state.task.name} was killed, but the fork server does not report it: killing the fork server and "
                "its children"
            )
            if self._server is not None:
                self._server.kill()
            state.limit_s = math.inf
            return
        self._say(
            f"{state.task.name} hangs: killing process {process.pid}, which has served no callback for "
            f"{state.silent_s:.0f} s"
        )
        steady = now_s - state.started_s >= 10.0 * state.limit_s
        state.hangs = 1 if steady else state.hangs + 1
        state.killed, state.silent_s, state.limit_s = True, 0.0, _DEATH_S
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)

    def _plan_restart(self, state: _State, code: int, now_s: float) -> None:
        if not self._restart:
            state.due_s = math.inf
            return
        name, ran_s = state.task.name, now_s - state.started_s
        if now_s - state.served_s >= STEADY_S:
            state.wait_s = 0.0
        when = f"in {state.wait_s:g} s" if state.wait_s else "at once"
        lines = last_lines(self.log(name), 3).replace("\n", "\n    ")
        self._say(
            f"{name} died after {ran_s:.0f} s ({cause(code, hung=state.killed)}); restarting {when}; "
            f"the end of {self.log(name)}:\n    {lines}"
        )
        self._wait(state, now_s)

    def _wait(self, state: _State, now_s: float) -> None:
        state.due_s = now_s + state.wait_s
        state.wait_s = min(max(2.0 * state.wait_s, FIRST_WAIT_S), LONGEST_WAIT_S)

    def _start(self, state: _State, now_s: float) -> None:
        name = state.task.name
        self._check_logs()
        try:
            command = [str(part) for part in state.task.command(state.starts)]
            state.process = self._launch(state.task, command)
        except (OSError, LaunchError) as error:
            if not self._restart:
                raise LaunchError(f"{name} cannot be started: {error}") from error
            state.wait_s = max(state.wait_s, FIRST_WAIT_S)
            self._say(f"{name} cannot be started: {error}; trying again in {state.wait_s:g} s")
            self._wait(state, now_s)
            return
        state.starts += 1
        state.started_s, state.reported, state.killed, state.silent_s = now_s, False, False, 0.0
        watched = state.task.node is not None and self._heartbeats is not None
        state.served_s = math.nan if watched else now_s
        state.limit_s = _SILENT_AT_FIRST_S * 2.0**state.hangs if watched else math.inf

    def _check_logs(self) -> None:
        """Reports once that log files cannot be written, which stops no process, and once that they can be again."""
        if not self._restart or (problem := log_problem(self._logs)) == self._log_problem:
            return
        self._log_problem = problem
        if problem:
            self._say(f"{self._logs}: log files cannot be written: {problem}; the nodes' output goes to this terminal")
        else:
            self._say(f"{self._logs}: log files can be written again")

    def _report_start(self, state: _State) -> None:
        """Reports a start once its process exists."""
        if state.process is None or state.reported or not state.begun:
            return
        state.reported = True
        if self._restart:
            again = f"restarted (start {state.starts})" if state.starts > 1 else "started"
            self._say(f"{state.task.name} {again}, process {state.process.pid}")

    def _launch(self, task: Task, command: list[str]) -> Running:
        log, append = self.log(task.name), self._restart
        if task.node not in self._forked or task.node is None:
            return start(command, log, self._environment, append=append)
        if self._server is None or not self._server.running:
            server_log = self._logs / "fork_server.log"
            self._server = ForkServer(server_log, self._environment, in_turn=self._in_turn)
        return self._server.start(task.node, command, log, append=append)
