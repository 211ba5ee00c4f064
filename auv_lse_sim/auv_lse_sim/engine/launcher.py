"""Starts the processes of a mission on this machine, watches them, and ends every one of them."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from auv_lse_sim.engine.processes import Process

#: Domains whose UDP ports stay below Linux's ephemeral range.
_DOMAINS = range(1, 102)
_STOP_S = 3.0


class LaunchError(RuntimeError):
    """A process that cannot be started, or a mission without a free ROS domain."""


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no other mission on this machine uses, for as long as the context lasts.

    Raises:
        LaunchError: if all are taken.
    """
    folder = Path(tempfile.gettempdir())
    start = os.getpid() % len(_DOMAINS)
    for offset in range(len(_DOMAINS)):
        domain = _DOMAINS[(start + offset) % len(_DOMAINS)]
        path = folder / f"auv_lse_domain_{domain}.lock"
        try:
            file = path.open("a")
        except PermissionError:
            continue  # another user's
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            try:
                yield domain
            finally:
                path.unlink(missing_ok=True)
            return
    raise LaunchError(f"all ROS domains {_DOMAINS[0]}..{_DOMAINS[-1]} are in use by missions on this machine")


def local_environment(root: Path, domain: int) -> dict[str, str]:
    """This process's environment, with DDS kept to this machine and to `domain`.

    Args:
        root: The project's folder, which holds config/.
        domain: ROS domain.
    """
    environment = dict(os.environ)
    environment["ROS_DOMAIN_ID"] = str(domain)
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
    environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(root / "config" / "fastdds_localhost.xml")
    environment["RCUTILS_COLORIZED_OUTPUT"] = "0"
    environment["PYTHONUNBUFFERED"] = "1"
    environment["OMP_NUM_THREADS"] = "1"
    environment["OPENBLAS_NUM_THREADS"] = "1"
    return environment


def executable_path(process: Process) -> Path:
    """The installed entry point of a process, as `ros2 run` finds it.

    Raises:
        LaunchError: if the package or the executable is not installed.
    """
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix

    try:
        path = Path(get_package_prefix(process.package)) / "lib" / process.package / process.executable
    except PackageNotFoundError as error:
        raise LaunchError(f"package {process.package} is not installed; build the workspace: scripts/setup") from error
    if not path.is_file():
        raise LaunchError(f"{path} is missing; build the workspace anew: scripts/setup --force")
    return path


class ProcessGroup:
    """The running processes of a mission."""

    def __init__(self, log_folder: Path, environment: dict[str, str]) -> None:
        """Starts nothing yet; each process's output goes to a file in `log_folder`."""
        self._logs = log_folder
        self._environment = environment
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, process: Process, parameter_file: Path, extra: Sequence[str] = ()) -> None:
        """Starts one process with the mission's parameters.

        Raises:
            LaunchError: if it cannot be started.
        """
        path = executable_path(process)
        command = [str(path), "--ros-args", "--params-file", str(parameter_file), *process.ros_arguments, *extra]
        with self.log(process.name).open("wb") as log:
            try:
                self._running[process.name] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=self._environment,
                    start_new_session=True,
                    preexec_fn=_die_with_parent,
                )
            except OSError as error:
                raise LaunchError(f"{process.name}: cannot be started ({path}): {error}") from error

    def log(self, name: str) -> Path:
        """The file with the output of a process."""
        return self._logs / f"{name}.log"

    def ended(self) -> list[tuple[str, int]]:
        """Name and exit code of the processes that have ended by themselves."""
        return [(name, process.returncode) for name, process in self._running.items() if process.poll() is not None]

    def last_words(self, name: str, lines: int = 15) -> str:
        """The last lines of a process's log."""
        text = self.log(name).read_text(errors="replace").splitlines()
        return "\n".join(text[-lines:]) or "(no output)"

    def cpu_s(self) -> dict[str, float]:
        """Processor time (s, user and system) that each running process has taken so far (Linux; else empty)."""
        times = {}
        for name, process in self._running.items():
            with contextlib.suppress(OSError, ValueError, IndexError):
                fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
                times[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return times

    def stop(self) -> None:
        """Ends every process, the recorder last, so that it records the end of the others."""
        first = {n: p for n, p in self._running.items() if "recorder" not in n}
        self._end(first)
        self._end({n: p for n, p in self._running.items() if n not in first})
        self._running.clear()

    @staticmethod
    def _end(processes: dict[str, subprocess.Popen[bytes]]) -> None:
        for sign, patience_s in ((signal.SIGINT, _STOP_S), (signal.SIGTERM, 1.0), (signal.SIGKILL, 5.0)):
            left = [p for p in processes.values() if p.poll() is None]
            for process in left:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, sign)
            until = time.monotonic() + patience_s
            for process in left:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(max(until - time.monotonic(), 0.01))


def _die_with_parent() -> None:
    """Runs in the child: asks Linux to end it with its parent, even if the parent is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
