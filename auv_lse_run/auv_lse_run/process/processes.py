"""Processes of a mission: their description, the nodes of one vehicle, and starting and ending processes."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

_STOP_S = 3.0
#: Time (s) for a recorder to write what has come in and to close its file; long for many vehicles on a busy machine.
LAST_STOP_S = 30.0


class LaunchError(RuntimeError):
    """A process that cannot be started."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """One process of a mission: what `ros2 run` would start, or several such nodes in one process.

    Attributes:
        executable: Its entry point, which is also the node's name.
        namespace: Node namespace, "/auv1" or "/".
        beside: Package and executable of further nodes in the same process.
        last: Whether it is ended after the others, and gets `LAST_STOP_S` for it.
    """

    package: str
    executable: str
    namespace: str
    beside: tuple[tuple[str, str], ...] = ()
    last: bool = False

    @property
    def name(self) -> str:
        """Name in reports and of log files: "auv1.gp_node", "sim_node"; "auv1" for several nodes."""
        return (self.namespace.strip("/") + ("" if self.beside else f".{self.executable}")).strip(".")

    @property
    def ros_arguments(self) -> tuple[str, ...]:
        """Remappings that put the node into its namespace."""
        return ("-r", f"__ns:={self.namespace}") if self.namespace != "/" else ()


#: Ended last, so that it records the end of the others.
RECORDER = Process(package="auv_lse_record", executable="recorder_node", namespace="/", last=True)


def start(
    command: Sequence[str], log: Path, environment: Mapping[str, str], *, append: bool = False
) -> subprocess.Popen[bytes]:
    """Starts a command that writes to a log file. The kernel kills it when this process ends, even by SIGKILL.

    If the file cannot be written, the output goes to this process's standard error.

    Raises:
        OSError: if it cannot be started.
    """
    with open_log(log, 2, append=append) as output:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
            preexec_fn=die_with_parent,
        )


@contextlib.contextmanager
def open_log(log: Path, otherwise: int, *, append: bool = False) -> Iterator[int]:
    """A log file that is open for writing while the context lasts: its file descriptor.

    Args:
        log: The file; a missing folder is created.
        otherwise: The descriptor if the file cannot be written; it stays open.
        append: Whether to keep what the file has.
    """
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | (os.O_APPEND if append else os.O_TRUNC), 0o644)
    except OSError:
        yield otherwise
        return
    try:
        yield file
    finally:
        os.close(file)


def log_problem(folder: Path) -> str:
    """Why log files in a folder cannot be written, on a full disk too; "" if they can. A missing folder is created."""
    probe = folder / f".probe-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(4096))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        return error.strerror or str(error)
    return ""


class Running(Protocol):
    """A process that leads a group of its own; `subprocess.Popen` is one."""

    @property
    def pid(self) -> int:
        """Process id."""
        ...

    def poll(self) -> int | None:
        """The exit code, None while it runs."""
        ...

    def wait(self, timeout: float) -> int:
        """Waits for its end, at most `timeout` (s); raises `subprocess.TimeoutExpired` if it still runs."""
        ...


def end(processes: Iterable[Running], patience_s: float = _STOP_S) -> None:
    """Ends processes and their children: SIGINT, then SIGTERM, then SIGKILL.

    Args:
        processes: Leaders of process groups, as `start` makes them.
        patience_s: Time (s) between SIGINT and SIGTERM.
    """
    everyone = list(processes)
    for sign, wait_s in ((signal.SIGINT, patience_s), (signal.SIGTERM, 1.0), (signal.SIGKILL, 5.0)):
        left = [p for p in everyone if p.poll() is None]
        for process in left:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, sign)
        until = time.monotonic() + wait_s
        for process in left:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(until - time.monotonic(), 0.01))


def last_lines(log: Path, lines: int = 15) -> str:
    """The last lines of a log, "(no output)" if there are none."""
    text: list[str] = []
    with contextlib.suppress(OSError):
        text = log.read_text(errors="replace").splitlines()
    return "\n".join(text[-lines:]) or "(no output)"


def die_with_parent() -> None:
    """Runs in the child: asks Linux to end it with its parent, even if the parent is killed.

    Also restores SIGINT, which children of a background process ignore.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
