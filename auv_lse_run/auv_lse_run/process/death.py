"""Why a process has died, in words: its signal or exit code, and the likely cause."""

import shutil
import signal
from collections.abc import Mapping
from pathlib import Path

#: The folder of files in memory, which DDS and state files use.
_SHARED = Path("/dev/shm")
#: A file system with less free space (bytes), or a computer with less free memory (share), counts as full.
_LEAST_BYTES, _LEAST_MEMORY = 2**20, 0.05
_CAUSES = {
    "SIGABRT": "it ended itself after an error in compiled code",
    "SIGFPE": "invalid arithmetic in compiled code",
    "SIGHUP": "its terminal was closed",
    "SIGILL": "this processor lacks an instruction of a compiled library",
    "SIGINT": "interrupted by Ctrl-C, or by another program",
    "SIGSEGV": "a compiled library crashed",
    "SIGTERM": "another program, or the computer's shutdown, ended it",
    "SIGXCPU": "over its limit of processor time (ulimit -t)",
    "SIGXFSZ": "over the limit of file sizes (ulimit -f)",
}
_OTHER_BUS_ERROR = "a file in memory became shorter, or its disk failed"
_CODES = {
    1: "an error in the program",
    2: "it rejects its parameters",
    126: "its program may not be executed",
    127: "its program is missing, or the memory that it may use (ulimit -v) is too small for its libraries",
}


def cause(code: int, *, hung: bool = False) -> str:
    """Why a process has ended.

    Args:
        code: Its exit code; minus the signal's number if a signal ended it.
        hung: Whether the watchdog has killed it.

    Returns:
        Signal or exit code and the likely cause, "SIGKILL: the computer has no memory left".
    """
    if code >= 0:
        words = _CODES.get(code, "")
        return f"exit code {code}" + (f": {words}" if words else "")
    try:
        name = signal.Signals(-code).name
    except ValueError:  # most real-time signals have no name
        return f"signal {-code}"
    if name == "SIGBUS":
        return f"{name}: {shared_memory_problem() or _OTHER_BUS_ERROR}"
    if name == "SIGKILL":
        return f"{name}: {_killed(hung)}"
    return f"{name}: {_CAUSES[name]}" if name in _CAUSES else name


def shared_memory_problem() -> str:
    """Why the libraries of ROS may end a process by SIGBUS as soon as they are loaded; "" if they do not."""
    try:
        disk = shutil.disk_usage(_SHARED)
    except FileNotFoundError:  # not on macOS
        return ""
    except OSError:
        return f"{_SHARED}, which DDS needs, cannot be read"
    if disk.free < _LEAST_BYTES:
        return (
            f"{_SHARED}, which DDS needs, is full ({disk.free // 1024} kB of {disk.total // 2**20} MB free); remove "
            "files there, or make it larger"
        )
    return ""


def _killed(hung: bool) -> str:
    if hung:
        return "the watchdog killed it"
    memory = _memory()
    free, total = memory.get("MemAvailable", 0), memory.get("MemTotal", 0)
    if total and free < _LEAST_MEMORY * total:
        return f"the computer has no memory left ({free // 1024} of {total // 1024} MB)"
    return "another program, or the kernel for want of memory, killed it"


def _memory(path: Path = Path("/proc/meminfo")) -> Mapping[str, int]:
    """The computer's memory (kB) by name (Linux; else empty)."""
    try:
        rows = (line.split() for line in path.read_text().splitlines())
        return {row[0].rstrip(":"): int(row[1]) for row in rows if len(row) > 1}
    except (OSError, ValueError):
        return {}
