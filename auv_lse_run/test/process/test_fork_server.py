"""The fork server: what it starts is a process of its own, with its own log, command line and exit code."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs the built workspace (scripts/test sets it up)", allow_module_level=True)

from auv_lse_run.process import fork_server
from auv_lse_run.process.fork_server import ForkServer, prepare
from auv_lse_run.process.keeper import ProcessKeeper, Task
from auv_lse_run.process.processes import LaunchError, Process, end

pytestmark = pytest.mark.ros

MODEM = Process(package="auv_lse_comms", executable="modem_node", namespace="/auv1")
#: A command that runs until it is ended: a node without its mission's parameters refuses them and ends at once.
RUNS = ["modem_node", "--ros-args", "-r", "__ns:=/auv7", "-p", "mission.vehicles:=7", "-p", "mission.steps:=6"]


def _command_line(pid: int) -> list[str]:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().rstrip("\0").split("\0")
    except (FileNotFoundError, ProcessLookupError):
        return []


def test_processes_are_separate_and_their_ends_are_reported(tmp_path: Path) -> None:
    server = ForkServer(tmp_path / "server.log", {**os.environ, "ROS_DOMAIN_ID": "103"})
    try:
        asked = server.start(MODEM, ["modem_node", "--help"], tmp_path / "help.log")
        assert asked.wait(30.0) == 0
        assert "modem_node: packets and TDMA of one vehicle" in (tmp_path / "help.log").read_text()
        refused = server.start(MODEM, ["modem_node", "--ros-args", "-r", "__ns:=/auv"], tmp_path / "refused.log")
        assert refused.wait(30.0) == 2
        assert "does not end in the vehicle's number" in (tmp_path / "refused.log").read_text()

        running, killed = (server.start(MODEM, RUNS, tmp_path / f"{n}.log") for n in "ab")
        until = time.monotonic() + 10.0
        while (shown := _command_line(running.pid)) != RUNS:  # its first deed, a moment after the fork
            assert time.monotonic() < until, f"ps shows {shown}; expected what ros2 run would show"
        assert os.getpgid(running.pid) == running.pid, "it leads a group of its own"
        os.kill(killed.pid, signal.SIGKILL)
        assert killed.wait(10.0) == -signal.SIGKILL
        assert running.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(0.01)
        end([running])
        assert running.poll() is not None
        last = server.start(MODEM, RUNS, tmp_path / "c.log")
        assert last.pid
    finally:
        server.close()
    until = time.monotonic() + 10.0
    while Path(f"/proc/{last.pid}").exists():
        assert time.monotonic() < until, "a process outlives the server"
        time.sleep(0.05)
    assert last.poll() is not None


def test_what_is_forked_while_the_server_closes_ends_with_it(tmp_path: Path) -> None:
    """Ctrl-C while the nodes are being started: the last of them must not write when the run folder is cleared."""
    for number in range(5):
        server = ForkServer(tmp_path / "server.log", {**os.environ, "ROS_DOMAIN_ID": "103"})
        command = [*RUNS, "-p", f"packet.session:={tmp_path}"]
        assert server.start(MODEM, command, tmp_path / "first.log").pid, "the server has loaded its modules"
        later = [server.start(MODEM, command, tmp_path / f"{number} {k}.log") for k in range(6)]
        server.close()
        left = [pid for pid in _pids() if "modem_node" in (line := _command_line(pid)) and command[-1] in line]
        assert not left, number
        assert all(forked.poll() is not None for forked in later)


def test_after_the_servers_death_the_end_of_its_processes_is_awaited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shutdown ends all at once: a recorder that still writes must not find its folder cleared."""
    monkeypatch.setattr(fork_server, "_END_S", 0.3)
    server = ForkServer(tmp_path / "server.log", {**os.environ, "ROS_DOMAIN_ID": "103"})
    log, until_s = tmp_path / "node.log", time.monotonic() + 60.0
    forked = server.start(MODEM, RUNS, log)
    pid = forked.pid
    try:
        while not log.exists() or "ready after" not in log.read_text():
            assert forked.poll() is None, log.read_text()
            assert time.monotonic() < until_s
            time.sleep(0.05)
        os.kill(pid, signal.SIGSTOP)  # it takes its time
        server._server.terminate()
        assert forked.wait(30.0) == -signal.SIGTERM
        server.close()
        assert not fork_server._lives(pid)
    finally:
        if fork_server._lives(pid):
            os.kill(pid, signal.SIGKILL)


def _pids() -> list[int]:
    return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit() and (path / "cmdline").exists()]


def test_early_server_is_used_with_a_later_log(tmp_path: Path) -> None:
    fork_server.load_early([MODEM], dict(os.environ))
    early = fork_server._early
    server = ForkServer(tmp_path / "server.log", {**os.environ, "ROS_DOMAIN_ID": "103"})
    try:
        assert early is not None
        assert server._server is early
        assert fork_server._early is None, "the next one has a process of its own"
        running = server.start(MODEM, RUNS, tmp_path / "a.log")
        assert int(Path(f"/proc/{running.pid}/stat").read_text().rpartition(")")[2].split()[1]) == early.pid
        assert os.readlink(f"/proc/{early.pid}/fd/2") == str(tmp_path / "server.log")
    finally:
        server.close()


def test_early_server_that_nothing_uses_is_ended() -> None:
    fork_server.load_early([MODEM], dict(os.environ))
    early = fork_server._early
    fork_server.end_early()
    assert early is not None
    assert early.returncode is not None
    assert fork_server._early is None
    fork_server.end_early()


def test_missing_process_is_named(tmp_path: Path) -> None:
    ghost = Process(package="auv_lse_gp", executable="sonar_node", namespace="/")
    server = ForkServer(tmp_path / "server.log", dict(os.environ))
    try:
        with pytest.raises(LaunchError, match="auv_lse_gp has no node sonar_node"):
            server.start(ghost, ["sonar_node"], tmp_path / "ghost.log")
    finally:
        server.close()


def test_keeper_restarts_everything_when_the_fork_server_dies(tmp_path: Path) -> None:
    task = Task(name="auv7.modem_node", command=lambda starts: RUNS, node=MODEM)
    keeper = ProcessKeeper([task], tmp_path, {**os.environ, "ROS_DOMAIN_ID": "103"}, lambda text: None)
    now_s = 0.0
    try:
        keeper.tick(now_s)
        assert keeper.running == {}, "the server loads first, and nobody waits for it"
        first = _running(keeper, now_s)
        server = int(Path(f"/proc/{first}/stat").read_text().rpartition(")")[2].split()[1])
        assert server != os.getpid()
        (tmp_path / "fork_server.log").write_text("why it dies\n")
        os.kill(server, signal.SIGKILL)
        until = time.monotonic() + 10.0
        while keeper.starts["auv7.modem_node"] == 1:
            assert time.monotonic() < until
            now_s += 0.5
            keeper.tick(now_s)
            time.sleep(0.02)
        again = _running(keeper, now_s)
        assert again != first
        assert "why it dies" in (tmp_path / "fork_server.log").read_text()
    finally:
        keeper.stop()
    assert keeper.running == {}
    assert not Path(f"/proc/{again}").exists()


def test_modules_are_loaded_once_before_the_forks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "prepared_node.py").write_text("calls = []\ndef prepare():\n    calls.append(1)\n")
    (tmp_path / "broken_node.py").write_text("def prepare():\n    raise RuntimeError\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    message = importlib.import_module("auv_lse_msgs.msg").LockstepTick
    prepare(["broken_node", "no_such_node", "prepared_node", "auv_lse_common.node.entry_point"])
    assert importlib.import_module("prepared_node").calls == [1]
    assert message.__class__._TYPE_SUPPORT is not None, "entry_point prepares the types of all messages"


def _running(keeper: ProcessKeeper, now_s: float) -> int:
    """The process id of the one task, once it has begun."""
    until = time.monotonic() + 30.0
    while not keeper.running:
        assert time.monotonic() < until
        keeper.tick(now_s)
        time.sleep(0.02)
    return next(iter(keeper.running.values()))


def test_the_first_log_of_a_forked_node_looks_at_no_module_but_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """rclpy's logger looks up its caller: without the table, it touches, and so copies, the memory of every module."""
    monkeypatch.setattr(inspect, "modulesbyfile", {})
    monkeypatch.setattr(inspect, "_filesbymodname", {})
    prepare(["auv_lse_common.node.entry_point"])
    table = dict(inspect.modulesbyfile)
    importlib.import_module("rclpy.logging").get_logger("forked").info("first log")
    assert len(table) > 100
    assert inspect.modulesbyfile == table
