"""Starts the processes of a mission on this machine, watches them, and ends every one of them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path

from auv_lse_common.process.fork_server import ForkedProcess, ForkServer
from auv_lse_common.process.processes import RECORDER_STOP_S, Process, end, executable_path, last_lines


class ProcessGroup:
    """The running processes of a mission."""

    def __init__(
        self,
        log_folder: Path,
        environment: dict[str, str],
        processes: Sequence[Process] = (),
        *,
        in_turn: bool = False,
    ) -> None:
        """Starts nothing yet.

        Args:
            log_folder: Gets a file with the output of each process.
            environment: The processes' environment.
            processes: What will be started, as far as it is known: starts faster then.
            in_turn: As `ForkServer` takes it.

        Raises:
            LaunchError: if one of `processes` is not installed.
        """
        self._logs = log_folder
        self._server = ForkServer(processes, self.log("fork_server"), environment, in_turn=in_turn)
        self._running: dict[str, ForkedProcess] = {}

    def start(self, process: Process, parameter_file: Path, extra: Sequence[str] = ()) -> None:
        """Starts one process with the mission's parameters.

        Raises:
            LaunchError: if it is not installed.
        """
        path = "+".join((str(executable_path(process)), *(name for _, name in process.beside)))
        command = [path, "--ros-args", "--params-file", str(parameter_file), *process.ros_arguments, *extra]
        self._running[process.name] = self._server.start(process, command, self.log(process.name))

    def log(self, name: str) -> Path:
        """The file with the output of a process."""
        return self._logs / f"{name}.log"

    @property
    def loading(self) -> bool:
        """Whether a process waits for the fork server, which loads, or even compiles, before it forks the first one."""
        return any(process.poll() is None and not process.begun for process in self._running.values())

    def ended(self) -> list[tuple[str, int]]:
        """Name and exit code of the processes that have ended by themselves."""
        codes = {name: process.poll() for name, process in self._running.items()}
        return [(name, code) for name, code in codes.items() if code is not None]

    def last_words(self, name: str, lines: int = 15) -> str:
        """The last lines of a process's log."""
        return last_lines(self.log(name), lines)

    def cpu_s(self) -> dict[str, float]:
        """Processor time (s, user and system) that each running process has taken so far (Linux; else empty)."""
        times = {}
        begun = {name: process for name, process in self._running.items() if process.begun}
        for name, process in begun.items():
            with contextlib.suppress(OSError, ValueError, IndexError):
                fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
                times[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return times

    def stop(self) -> None:
        """Ends every process, the recorder last, so that it records the end of the others."""
        begun = {n: p for n, p in self._running.items() if p.begun}  # the others end with the server
        first = {n: p for n, p in begun.items() if "recorder" not in n}
        end(first.values())
        end((p for n, p in begun.items() if n not in first), RECORDER_STOP_S)
        self._running.clear()
        self._server.close()
