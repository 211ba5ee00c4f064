"""The fork server: a process that has imported the modules of all nodes, and forks them without delay.

A node's imports take half a second to a second of processor time. A mission has fourteen or sixty nodes, and a node
that died must be back soon. The fork server imports once, and once loads compiled code and message types (`prepare`),
each module before the first node that needs it: the first nodes begin while it loads for the others. Each node is still
a separate process, with its own log, process group and the command line of `ros2 run`. The server has no ROS context
and starts no thread; importing rclpy starts two idle ones, which forked nodes do not have.

Requests are JSON lines on the server's standard input: the first has environment and log file, each further one a
node. The server answers on its standard output with each node's process id and, later, its exit code. It ends when its
input is closed, and Linux ends its nodes with it.

`load_early` starts a server in advance, for a command whose own imports take seconds.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import Any

from auv_lse_common.support.free_memory import return_code_pages, return_free_memory
from auv_lse_common.support.missing_packages import is_installed
from auv_lse_run.process.processes import LaunchError, Process, die_with_parent, end, open_log

#: Space (bytes) in the server's command line for that of a node.
_COMMAND_ROOM = 4000
#: Longest wait (s) for the server to fork a process: without numba's cache it compiles first, which may take minutes.
_START_S = 600.0
#: Longest wait (s) for processes that end with the server.
_END_S = 5.0
#: Module prepared after those of the nodes, for all nodes.
_COMMON_MODULE = "auv_lse_common.node.entry_point"


class ForkedProcess:
    """A process started by a fork server, with the used part of the interface of `subprocess.Popen`.

    Attributes:
        returncode: Exit code, minus the signal's number if that ended it; None while it runs.
    """

    def __init__(self, server: ForkServer, name: str) -> None:
        self.returncode: int | None = None
        self._server = server
        self._name = name
        self._pid: int | None = None

    @property
    def pid(self) -> int:
        """Process id; waits until the process exists.

        Raises:
            LaunchError: if the server does not start it.
        """
        until = time.monotonic() + _START_S
        while self._pid is None and self.returncode is None and time.monotonic() < until:
            self._server.read(1.0)
        if self._pid is None:
            raise LaunchError(f"{self._name}: the fork server has not started it; see {self._server.log}")
        return self._pid

    @property
    def begun(self) -> bool:
        """Whether the process exists by now."""
        self.poll()
        return self._pid is not None

    def poll(self) -> int | None:
        """The exit code; None while it runs, or does not exist yet."""
        if self.returncode is None:
            self._server.read(0.0)
        return self.returncode

    def wait(self, timeout: float) -> int:
        """Waits for its end.

        Raises:
            subprocess.TimeoutExpired: if it still runs after `timeout` (s).
        """
        until = time.monotonic() + timeout
        while self.poll() is None:
            left = until - time.monotonic()
            if left <= 0.0:
                raise subprocess.TimeoutExpired(self._name, timeout)
            self._server.read(left)
        assert self.returncode is not None
        return self.returncode

    def forked(self, pid: int) -> None:
        """Records the process id that the server reports."""
        self._pid = pid

    def ended(self, code: int) -> None:
        """Records the exit code that the server reports."""
        self.returncode = code


class ForkServer:
    """The client of a fork server."""

    def __init__(
        self,
        log: Path,
        environment: Mapping[str, str],
        *,
        in_turn: bool = False,
    ) -> None:
        """Starts the server.

        Args:
            log: File for errors of the server itself. If a log file cannot be written, the output goes to this
                process's standard error.
            in_turn: Whether the receiver of a message waits for the sender to finish its work (Linux: SCHED_BATCH).
                In lockstep that saves a fifth of the processor time; otherwise it delays answers.
        """
        global _early
        self.log = log
        self._started: list[ForkedProcess] = []
        self._left: list[ForkedProcess] = []  # still running at the server's end, with which Linux ends them
        self._rest = b""
        self._server, _early = _early or _launch(environment), None
        self._ask({"server_log": str(log), "environment": dict(environment), "in_turn": in_turn})

    def start(self, process: Process, command: Sequence[str], log: Path, *, append: bool = False) -> ForkedProcess:
        """Starts a process; its output goes to the file `log`, appended if `append`."""
        number = len(self._started)
        request = {
            "number": number,
            "entries": [entry.value for entry in entries_of(process)],
            "command": list(command),
            "log": str(log),
            "append": append,
        }
        forked = ForkedProcess(self, process.name)
        self._started.append(forked)
        self._ask(request)
        return forked

    def _ask(self, request: Mapping[str, Any]) -> None:
        assert self._server.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended; `read` reports that
            self._server.stdin.write(json.dumps(request).encode() + b"\n")
            self._server.stdin.flush()

    @property
    def running(self) -> bool:
        """Whether the server runs; its processes end with it."""
        return self._server.poll() is None

    def kill(self) -> None:
        """Kills the server and its processes."""
        self._server.kill()

    def read(self, timeout_s: float) -> None:
        """Reads the server's answers; waits up to `timeout_s` for one."""
        assert self._server.stdout is not None
        if self._server.stdout.closed:
            return
        pipe = self._server.stdout.fileno()
        while select.select([pipe], [], [], timeout_s)[0]:
            data = os.read(pipe, 65536)
            if not data:
                code = self._server.wait()
                left = [forked for forked in self._started if forked.returncode is None]
                for forked in left:
                    forked.ended(code or -signal.SIGTERM)
                self._left += left
                return
            *lines, self._rest = (self._rest + data).split(b"\n")
            for line in lines:
                answer = json.loads(line)
                forked = self._started[answer["number"]]
                if "pid" in answer:
                    forked.forked(answer["pid"])
                else:
                    forked.ended(answer["ended"])
            timeout_s = 0.0

    def close(self) -> None:
        """Ends the server and its processes."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._server.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._server.wait(1.0)
        end([self._server])
        self.read(1.0)
        self._server.stdout.close()
        _wait_for_end([forked.pid for forked in self._left if forked.begun])


def _wait_for_end(pids: Iterable[int]) -> None:
    """Waits until processes have ended that get SIGTERM from Linux at the server's end; kills them if that is late."""
    until = time.monotonic() + _END_S
    for pid in pids:
        while _lives(pid):
            if time.monotonic() > until:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.01)


def _lives(pid: int) -> bool:
    """Whether a process of ours has not ended; a zombie has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (OSError, IndexError):
        return False


#: The server of `load_early`, until a `ForkServer` uses it.
_early: subprocess.Popen[bytes] | None = None


def load_early(processes: Iterable[Process], environment: Mapping[str, str]) -> None:
    """Starts a server that begins to import the modules of `processes`; the next `ForkServer` uses it.

    Args:
        processes: The processes that will probably be started.
        environment: The variables that matter to the imported libraries; the complete environment comes later.

    Raises:
        LaunchError: if one of `processes` is not installed.
    """
    global _early
    _early = _launch(environment, sorted({entry.module for p in processes for entry in entries_of(p)}))


def end_early() -> None:
    """Ends the server of `load_early` if no `ForkServer` uses it: the command has started nothing."""
    global _early
    if _early is not None:
        _early.kill()
        _early.communicate()
        _early = None


def _launch(environment: Mapping[str, str], modules: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    """Starts a server, which imports `modules`; its errors go to the terminal until it has a log."""
    return subprocess.Popen(
        [sys.executable, "-m", __name__, *modules, " " * _COMMAND_ROOM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=dict(environment),
        start_new_session=True,
        preexec_fn=die_with_parent,
    )


@functools.cache
def _nodes() -> EntryPoints:
    """The nodes of all installed packages; cached, because it reads a file of each package."""
    return entry_points(group="auv_lse.nodes")


def entries_of(process: Process) -> list[EntryPoint]:
    """The entry points of a process's nodes.

    Raises:
        LaunchError: if no installed package has one; names the package.
    """
    return [_entry_of(package, name) for package, name in ((process.package, process.executable), *process.beside)]


def _entry_of(package: str, node: str) -> EntryPoint:
    for entry in _nodes().select(name=node):
        if entry.module.split(".")[0] == package:
            return entry
    if is_installed(package):
        raise LaunchError(f"{package} has no node {node}. In a checkout run scripts/setup --force")
    raise LaunchError(
        f"{node} needs the package {package}, which is not installed. Install it with pip or colcon; in a checkout run "
        "scripts/setup --force"
    )


# ---------------------------------------------------------------------- the server's side


def serve(modules: Sequence[str]) -> int:
    """Imports `modules`, then serves requests from standard input until it ends; returns the exit code.

    A module that cannot be imported is skipped; the process that needs it reports the error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the mission's command
    for module in modules:
        with contextlib.suppress(Exception):
            importlib.import_module(module)
    numbers: dict[int, int] = {}
    loaded: set[str] = set()
    terminal = os.dup(2)
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda sign, frame: None)
    requests = b""
    while True:
        ready = select.select([sys.stdin.fileno(), woken], [], [])[0]
        if woken in ready:
            os.read(woken, 1024)
            for pid, status in _ended():
                _answer(number=numbers.pop(pid), ended=os.waitstatus_to_exitcode(status))
        if sys.stdin.fileno() in ready:
            data = os.read(sys.stdin.fileno(), 65536)
            if not data:
                return 0
            *lines, requests = (requests + data).split(b"\n")
            for line in lines:
                request = json.loads(line)
                if "server_log" in request:
                    _begin(request)
                    continue
                _load(request["entries"], loaded)
                server = os.getpid()
                pid = os.fork()
                if pid == 0:
                    os.close(woken)
                    os.close(wake)
                    _run(request, terminal, server)
                numbers[pid] = request["number"]
                _answer(number=request["number"], pid=pid)


def _begin(request: Mapping[str, Any]) -> None:
    """Sets environment and log file."""
    with open_log(Path(request["server_log"]), 2, append=True) as output:  # keeps the log of an earlier server
        if output != 2:
            os.dup2(output, 2)
    os.environ.update(request["environment"])
    if request["in_turn"] and hasattr(os, "SCHED_BATCH"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _load(entries: Iterable[str], loaded: set[str]) -> None:
    """Loads the modules of entry points that are not `loaded` yet, for all processes that are forked from now on."""
    modules = {entry.partition(":")[0] for entry in entries} - loaded
    if not modules:
        return
    loaded |= modules
    prepare([*sorted(modules), _COMMON_MODULE])
    gc.collect()
    gc.freeze()  # keeps pages shared: the collector leaves objects from before the fork alone
    return_free_memory()
    return_code_pages()  # the compiler's, mostly


def prepare(modules: Sequence[str]) -> None:
    """Imports `modules` and calls `prepare()` of those that have it, so that forked processes need not load it."""
    for module in modules:
        with contextlib.suppress(Exception):
            getattr(importlib.import_module(module), "prepare", lambda: None)()


def _ended() -> Iterable[tuple[int, int]]:
    with contextlib.suppress(ChildProcessError):
        while (found := os.waitpid(-1, os.WNOHANG))[0]:
            yield found


def _answer(**answer: Any) -> None:
    os.write(sys.stdout.fileno(), json.dumps(answer).encode() + b"\n")


def _run(request: Mapping[str, Any], terminal: int, server: int) -> None:
    """In the forked process: runs the node, and does not return.

    Args:
        terminal: Where its output goes if its log file cannot be written.
        server: Process id of the fork server.
    """
    code = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setsid()
        die_with_parent()
        if os.getppid() != server:  # the server ended before the line above, so Linux sends no signal
            os._exit(0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        nothing = os.open(os.devnull, os.O_RDONLY)
        with open_log(Path(request["log"]), terminal, append=request["append"]) as log:
            for target, source in enumerate((nothing, log, log)):
                os.dup2(source, target)
        show_command(request["command"])
        sys.argv = list(request["command"])
        mains = [EntryPoint(name="node", value=value, group="console_scripts").load() for value in request["entries"]]
        code = int(mains[0](*mains[1:]) or 0)
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:  # as the interpreter would: a traceback in the process's log
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)


def show_command(command: Sequence[str]) -> None:
    """Linux: makes `ps` show `command` as this process's command line, truncated to the present length."""
    import ctypes

    with contextlib.suppress(OSError, ValueError, IndexError):
        fields = Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()
        first, last = int(fields[45]), int(fields[46])  # arg_start and arg_end, proc(5)
        room = last - first
        text = b"\0".join(os.fsencode(word) for word in command)[: room - 1]
        ctypes.memmove(first, text + bytes(room - len(text)), room)


if __name__ == "__main__":
    sys.exit(serve([word for word in sys.argv[1:] if word.strip()]))
