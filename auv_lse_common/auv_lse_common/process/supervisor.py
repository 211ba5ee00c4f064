"""Keeps processes running: starts them again when they die or hang, ever more slowly, and ends them in order.

Theory of operation: `Supervisor.tick` is called a few times a second. Each process is running or due at a time. One
that has ended is due after a wait that doubles with each death, up to `LONGEST_WAIT_S`; a process that has run for
`STEADY_S` has earned its first wait back. Every start and every death is said once. Nodes are forked by a fork server,
so that one that was killed is back at once; should the server die, its nodes die with it, and all are started again.

A node says every second that it serves its callbacks (`heartbeat`). One that has been silent for `SILENT_S` though its
process runs is killed, and so started again. If the fork server does not report that death, it hangs itself, and goes
the same way. Silence counts in the supervisor's own ticks, so that a machine that stood still kills nobody.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from auv_lse_common.process.fork_server import ForkedProcess, ForkServer, can_fork
from auv_lse_common.process.heartbeat import SOCKET_VARIABLE, Heartbeats
from auv_lse_common.process.processes import RECORDER_STOP_S, LaunchError, Process, Running, end, last_lines, start

#: First wait (s) before a process that died is started again, and the longest.
FIRST_WAIT_S = 0.5
LONGEST_WAIT_S = 30.0
#: After this time (s) of running a process that dies waits no longer than at its first death.
STEADY_S = 20.0
#: A node that has not said for this time (s) that it serves its callbacks hangs; doubled each time that it does.
SILENT_S = 30.0
#: The same before its first word: it may have to compile.
_SILENT_AT_FIRST_S = 4.0 * SILENT_S
#: A process that was killed is gone within this time (s).
_DEATH_S = 10.0
#: A tick counts for this much silence (s) at most.
_LONGEST_TICK_S = 1.0
#: Exit code of a node that refuses its parameters (`auv_lse_common.node.entry_point.Main`).
REFUSED = 2
_SIGNALS = {sign.value: sign.name for sign in signal.Signals}  # real-time signals between the first and last have none


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A process to keep running.

    Attributes:
        name: For people and the log file, "auv2.gp_node".
        command: Its command line at its n-th start, from 0: a recorder must not write into its last folder.
        last: Whether it is ended only after the others, as the recorder is.
        node: The node that it is, which a fork server may start; None: any other program.
    """

    name: str
    command: Callable[[int], Sequence[str]]
    last: bool = False
    node: Process | None = None


@dataclass(slots=True)
class _State:
    """How it stands with a task."""

    task: Task
    process: Running | None = None
    starts: int = 0
    told: bool = False  # that it has begun
    started_s: float = 0.0
    due_s: float = 0.0
    wait_s: float = field(default=FIRST_WAIT_S)
    silent_s: float = 0.0  # since its last word, or since it began
    limit_s: float = math.inf  # of silence; infinite for what is no node, until its first word
    hangs: int = 0  # in a row
    killed: bool = False  # because it hung


class Supervisor:
    """Runs tasks until `stop`."""

    def __init__(
        self,
        tasks: Sequence[Task],
        logs: Path,
        environment: Mapping[str, str],
        say: Callable[[str], None],
        silent_s: float = SILENT_S,
    ) -> None:
        """Starts nothing yet.

        Args:
            tasks: What to keep running.
            logs: Folder of their outputs, a file each, appended to at each start.
            environment: Their environment.
            say: Told every start and every death in one line.
            silent_s: How long (s) a process may be silent that has said that it lives; infinite: for ever.
        """
        self._silent_limit_s = silent_s
        self._heartbeats = Heartbeats()
        self._ticked_s = math.inf
        self._states = [_State(task) for task in tasks]
        self._logs, self._say = logs, say
        self._environment = {**environment, SOCKET_VARIABLE: self._heartbeats.address}
        self._forked = [task.node for task in tasks if task.node is not None and can_fork(task.node)]
        self._server: ForkServer | None = None

    @property
    def running(self) -> dict[str, int]:
        """Process id of each task that runs; a node that waits for the fork server does not yet."""
        alive = ((s.task.name, s.process) for s in self._states if s.process is not None and s.process.poll() is None)
        return {name: process.pid for name, process in alive if _begun(process)}

    @property
    def loading(self) -> bool:
        """Whether a node waits for the fork server, which loads, or even compiles, before it forks the first one."""
        return any(s.process is not None and s.process.poll() is None and not _begun(s.process) for s in self._states)

    @property
    def starts(self) -> dict[str, int]:
        """How often each task has been started."""
        return {s.task.name: s.starts for s in self._states}

    def log(self, name: str) -> Path:
        """The file with the output of a task."""
        return self._logs / f"{name}.log"

    def tick(self, now_s: float) -> list[tuple[str, int]]:
        """Starts what is due.

        Args:
            now_s: A clock that nothing sets back.

        Returns:
            Name and exit code of each task that has died since the last call; -9 for one that signal 9 ended.
        """
        died = []
        alive = self._heartbeats.take()
        passed_s = min(max(0.0, now_s - self._ticked_s), _LONGEST_TICK_S)
        self._ticked_s = now_s
        for state in self._states:
            if state.process is not None and (code := state.process.poll()) is not None:
                state.process = None
                died.append((state.task.name, code))
                self._note_death(state, code, now_s)
            if state.process is None and now_s >= state.due_s:
                self._start(state, now_s)
            self._tell_start(state)
            self._look_for_life(state, alive, passed_s, now_s)
        return died

    def _look_for_life(self, state: _State, alive: set[int], passed_s: float, now_s: float) -> None:
        """Kills a process that hangs, and a fork server that does not report the death of one."""
        process = state.process
        if process is None or not state.told:
            return
        state.silent_s += passed_s
        if process.pid in alive and not state.killed:
            state.silent_s, state.limit_s = 0.0, self._silent_limit_s * 2.0**state.hangs
        if state.silent_s < state.limit_s:
            return
        if state.killed:
            self._say(
                f"{state.task.name} was killed, but the fork server does not say so: it is killed, and all it ran"
            )
            if self._server is not None:
                self._server.kill()
            state.limit_s = math.inf
            return
        self._say(
            f"{state.task.name} hangs: process {process.pid} runs, but has not said for {state.silent_s:.0f} s that it "
            "serves its callbacks; it is killed"
        )
        steady = now_s - state.started_s >= 10.0 * state.limit_s
        state.hangs = 1 if steady else state.hangs + 1
        state.killed, state.silent_s, state.limit_s = True, 0.0, _DEATH_S
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)

    def _note_death(self, state: _State, code: int, now_s: float) -> None:
        name, ran_s = state.task.name, now_s - state.started_s
        if ran_s >= STEADY_S:
            state.wait_s = FIRST_WAIT_S
        state.due_s = now_s + state.wait_s
        how = _SIGNALS.get(-code, f"signal {-code}") if code < 0 else f"exit code {code}"
        log = self.log(name)
        words = last_lines(log, 3).replace("\n", "\n    ")
        self._say(
            f"{name} died ({how}) after {ran_s:.0f} s; starts again in {state.wait_s:g} s; {log} ends:\n    {words}"
        )
        state.wait_s = min(2.0 * state.wait_s, LONGEST_WAIT_S)

    def _start(self, state: _State, now_s: float) -> None:
        name, command = state.task.name, [str(part) for part in state.task.command(state.starts)]
        try:
            state.process = self._launch(state.task, command)
        except (OSError, LaunchError) as error:
            state.due_s = now_s + state.wait_s
            self._say(f"{name} cannot be started ({command[0]}): {error}; the next try in {state.wait_s:g} s")
            state.wait_s = min(2.0 * state.wait_s, LONGEST_WAIT_S)
            return
        state.starts += 1
        state.started_s, state.told, state.killed, state.silent_s = now_s, False, False, 0.0
        watched = state.task.node is not None and math.isfinite(self._silent_limit_s)
        state.limit_s = _SILENT_AT_FIRST_S * 2.0**state.hangs if watched else math.inf

    def _tell_start(self, state: _State) -> None:
        """Says once that a process has begun: the fork server may have to load, or even to compile, before."""
        if state.process is None or state.told or not _begun(state.process):
            return
        state.told = True
        again = f" again (start {state.starts})" if state.starts > 1 else ""
        self._say(f"{state.task.name} started{again}, process {state.process.pid}")

    def _launch(self, task: Task, command: list[str]) -> Running:
        log = self.log(task.name)
        if task.node not in self._forked or task.node is None:
            return start(command, log, self._environment, append=True)
        if self._server is None or not self._server.running:
            self._server = ForkServer(self._forked, self._logs / "fork_server.log", self._environment)
        return self._server.start(task.node, command, log, append=True)

    def stop(self) -> None:
        """Ends every task, those marked `last` after the others."""
        begun = [(s.task, s.process) for s in self._states if s.process and _begun(s.process)]
        end(process for task, process in begun if not task.last)
        end((process for task, process in begun if task.last), RECORDER_STOP_S)
        if self._server is not None:
            self._server.close()
        self._heartbeats.close()
        for state in self._states:
            state.process = None


def _begun(process: Running) -> bool:
    return not isinstance(process, ForkedProcess) or process.begun
