"""Processes that die are started again, ever more slowly, and all of them end."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import signal
import sys
import time
from pathlib import Path

import pytest

from auv_lse_run.process import keeper
from auv_lse_run.process.keeper import (
    FIRST_WAIT_S,
    LONGEST_WAIT_S,
    SAFETY_SHARE,
    SILENT_S,
    STEADY_S,
    ProcessKeeper,
    Task,
    node_task,
)
from auv_lse_run.process.processes import Process


class Bench:
    """A keeper with a clock of its own, and what it has said."""

    def __init__(
        self, folder: Path, restart: bool = True, share: float = 1.0, silent_s: float = SILENT_S, **commands: str
    ) -> None:
        self.now_s, self.said = 100.0, []
        tasks = [
            Task(
                name=name,
                command=lambda n, text=text: ["sh", "-c", text.replace("START", str(n))],
                last=name == "last",
                silent_share=share,
            )
            for name, text in commands.items()
        ]
        self.keeper = ProcessKeeper(tasks, folder, os.environ, self.said.append, restart=restart, silent_s=silent_s)

    def after(self, seconds: float) -> list[tuple[str, int]]:
        self.now_s += seconds
        return self.keeper.tick(self.now_s)

    def death(self) -> tuple[str, int]:
        """Waits for the next process to end by itself; the keeper's clock stands still."""
        until = time.monotonic() + 10.0
        while not (died := self.after(0.0)):
            assert time.monotonic() < until
            time.sleep(0.01)
        return died[0]


#: A program that says all the time that it lives.
ALIVE = """import os, socket, time
socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
address = chr(0) + os.environ['NOTIFY_SOCKET'][1:]
while True:
    socket.sendto(b'WATCHDOG=1', address)
    time.sleep(0.01)"""


def alive_for(bench: Bench, seconds: float) -> None:
    """So many seconds by the keeper's clock, with time in between in which a process can say that it lives."""
    for _ in range(round(seconds)):
        time.sleep(0.03)
        assert bench.after(1.0) == []


@pytest.mark.skipif(sys.platform != "linux", reason="as below")
@pytest.mark.parametrize("restart", [True, False])
def test_what_a_process_reports_is_shown_at_once(tmp_path: Path, restart: bool) -> None:
    report = "import os; from auv_lse_common.node.heartbeat import Heartbeat as H; H(os.environ).report('é: hears')"
    bench = Bench(tmp_path, restart=restart, node=f'{sys.executable} -c "{report}"; exec sleep 60')
    until = time.monotonic() + 20.0
    while "é: hears" not in bench.said:
        assert time.monotonic() < until, bench.said
        bench.after(0.0)
        time.sleep(0.05)
    bench.keeper.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="sockets without a file, and who has sent, as Linux has them")
@pytest.mark.parametrize("share", [1.0, SAFETY_SHARE])
def test_hanging_process_is_killed_and_restarted(tmp_path: Path, share: float) -> None:
    bench = Bench(tmp_path, share=share, node=f'exec {sys.executable} -c "{ALIVE}"', silent="exec sleep 60")
    silent_s = share * SILENT_S
    bench.after(0.0)
    time.sleep(0.5)
    alive_for(bench, 2.0 * silent_s)
    pid = bench.keeper.running["node"]
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.1)
    bench.after(1.0)  # takes what it has still said
    bench.after(3600.0)  # the keeper stood still itself: that is no silence
    alive_for(bench, silent_s - 3.0)
    assert bench.keeper.running["node"] == pid
    said = len(bench.said)
    while len(bench.said) == said:
        bench.after(1.0)
    assert bench.said[said] == (f"node hangs: killing process {pid}, which has served no callback for {silent_s:.0f} s")
    assert bench.death() == ("node", -9)
    assert bench.keeper.why_died("node", -9) == "SIGKILL: the watchdog killed it"
    bench.after(FIRST_WAIT_S)
    assert bench.keeper.starts == {"node": 2, "silent": 1}, "what never said that it lives may be silent"
    bench.keeper.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="sockets without a file, as Linux has them")
@pytest.mark.parametrize("silent_s", [30.0, math.inf])
def test_a_hang_in_a_mission_is_reported_once_and_its_end_too(tmp_path: Path, silent_s: float) -> None:
    bench = Bench(tmp_path, restart=False, silent_s=silent_s, node=f'exec {sys.executable} -c "{ALIVE}"')
    bench.after(0.0)
    until = time.monotonic() + 20.0
    while math.isnan(bench.keeper._states[0].served_s):  # Python may start slowly
        assert time.monotonic() < until
        bench.after(0.0)
        time.sleep(0.05)
    alive_for(bench, 40.0)
    pid = bench.keeper.running["node"]
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.1)
    bench.after(1.0)  # takes what it has still said
    alive_for(bench, 50.0)
    hangs = [f"node hangs: process {pid} has served no callback for 30 s"]
    assert bench.said == (hangs if silent_s == 30.0 else []), "lockstep: a node may take any time for a tick"
    os.kill(pid, signal.SIGCONT)
    answers, until = re.compile(r"node answers again after \d+ s"), time.monotonic() + 20.0
    while len(bench.said) == 1 and time.monotonic() < until:
        time.sleep(0.1)
        bench.after(0.0)
    time.sleep(0.5)
    bench.after(0.0)
    assert [bool(answers.fullmatch(text)) for text in bench.said] == ([False, True] if silent_s == 30.0 else [])
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.1)
    bench.after(1.0)
    alive_for(bench, 31.0)
    assert bench.said[2:] == (hangs if silent_s == 30.0 else []), "each hang is reported"
    bench.keeper.stop()


def test_safety_node_counts_as_hung_sooner_than_other_nodes() -> None:
    shares = {}
    for package, executable in (("auv_lse_planner", "safety_node"), ("auv_lse_gp", "gp_node")):
        process = Process(package=package, executable=executable, namespace="/auv1")
        shares[executable] = node_task(process, Path("mission.yaml")).silent_share
    assert shares == {"safety_node": SAFETY_SHARE, "gp_node": 1.0}


def test_dead_process_is_restarted_after_a_doubling_wait(tmp_path: Path) -> None:
    bench = Bench(tmp_path, node="echo start START; exit 3")
    bench.after(0.0)
    waits = []
    assert bench.death() == ("node", 3)
    bench.after(0.0)
    assert bench.keeper.starts == {"node": 2}, "at once: an autopilot's failsafe waits for 2.5 s"
    for deaths in range(2, 9):
        assert bench.death() == ("node", 3)
        assert bench.keeper.starts == {"node": deaths}
        waited = 0.0
        while bench.keeper.starts == {"node": deaths}:
            bench.after(0.5)
            waited += 0.5
        waits.append(waited)
    assert waits == [min(FIRST_WAIT_S * 2**n, LONGEST_WAIT_S) for n in range(7)]
    assert bench.said[1].startswith("node died after 0 s (exit code 3); restarting at once; the end")
    assert "start 0" in bench.said[1], "with its last words"
    assert "node restarted (start 2)" in bench.said[2]
    assert bench.said[3].startswith("node died after 0 s (exit code 3); restarting in 0.5 s; the end")
    assert (tmp_path / "node.log").read_text().splitlines()[:7] == [f"start {n}" for n in range(7)], "the log goes on"
    bench.keeper.stop()


def test_loading_is_no_steady_running(tmp_path: Path) -> None:
    """A node that dies whenever it has loaded must not be restarted at once for ever."""
    bench = Bench(tmp_path, node="exit 3")
    (state,) = bench.keeper._states
    state.task = dataclasses.replace(state.task, node=Process(package="p", executable="n", namespace="/auv1"))
    bench.after(0.0)
    waits = []
    for deaths in range(1, 5):
        time.sleep(0.1)
        bench.now_s += 2.0 * STEADY_S  # it loaded so long
        assert bench.death() == ("node", 3)
        waited = 0.0
        bench.after(0.0)
        while bench.keeper.starts == {"node": deaths}:
            bench.after(0.5)
            waited += 0.5
        waits.append(waited)
    assert waits == [0.0, FIRST_WAIT_S, 2.0 * FIRST_WAIT_S, 4.0 * FIRST_WAIT_S]
    bench.keeper.stop()


def test_steady_process_is_restarted_at_once(tmp_path: Path) -> None:
    bench = Bench(tmp_path, node="sleep 60")
    bench.after(0.0)
    for _ in range(3):
        bench.after(STEADY_S)
        os.kill(bench.keeper.running["node"], signal.SIGKILL)
        assert bench.death() == ("node", -9)
        assert f"node died after {STEADY_S:.0f} s (SIGKILL: " in bench.said[-1]
        bench.after(0.0)
    assert bench.keeper.running
    bench.keeper.stop()
    assert not bench.keeper.running


def test_loading_that_takes_long_is_reported_and_a_late_restart_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A node that is restarted in mid-dive is forked a moment after the request."""
    bench, begun = Bench(tmp_path, node="sleep 60"), False
    monkeypatch.setattr(keeper._State, "begun", property(lambda state: begun))
    bench.after(0.0)
    bench.after(1.0)
    begun = True
    bench.after(3600.0)
    begun = False
    bench.after(0.2)
    assert not any("loading" in line for line in bench.said)
    assert bench.keeper.loaded_for_s == 0.0
    bench.after(5.0)
    bench.after(5.1)
    assert bench.said[-1] == "still loading the nodes: recompiling changed code; this may take minutes"
    begun = True
    bench.keeper.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="real-time signals as Linux numbers them")
def test_unnamed_signal_is_reported_by_its_number(tmp_path: Path) -> None:
    bench = Bench(tmp_path, node="kill -40 $$")
    bench.after(0.0)
    assert bench.death() == ("node", -40)
    assert "node died after 0 s (signal 40)" in bench.said[-1]
    bench.keeper.stop()


def test_missing_command_is_retried_and_named(tmp_path: Path) -> None:
    said: list[str] = []
    keeper = ProcessKeeper([Task(name="x", command=lambda n: ["/no/such"])], tmp_path, os.environ, said.append)
    assert keeper.tick(0.0) == []
    assert said == ["x cannot be started: [Errno 2] No such file or directory: '/no/such'; trying again in 0.5 s"]
    keeper.tick(0.4)
    assert len(said) == 1
    keeper.tick(1.0)
    assert said[1].endswith("trying again in 1 s")
    keeper.stop()


@pytest.fixture
def _started_in_the_background():
    """As `auv_lse vehicle ... &` in a script: shells let such processes ignore SIGINT."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_started_in_the_background")
@pytest.mark.skipif(sys.platform != "linux", reason="signals and process groups as Linux has them")
def test_recorder_is_ended_last(tmp_path: Path) -> None:
    trap = f"trap 'echo NAME >> {tmp_path}/order; exit 0' INT; touch {tmp_path}/NAME; while true; do sleep 0.05; done"
    bench = Bench(tmp_path, last=trap.replace("NAME", "last"), first=trap.replace("NAME", "first"))
    bench.after(0.0)
    until = time.monotonic() + 20.0
    while not all((tmp_path / name).exists() for name in ("first", "last")):  # until both have set their trap
        assert time.monotonic() < until
        time.sleep(0.02)
    bench.keeper.stop()
    assert (tmp_path / "order").read_text().split() == ["first", "last"]


def test_recorder_has_time_to_close_its_file(tmp_path: Path) -> None:
    closing = "import pathlib,signal,time; signal.signal(15, signal.SIG_IGN); signal.signal(2, lambda *_: 1/0)\n"
    closing += "print('up', flush=True)\ntry: time.sleep(60)\n"
    closing += f"except ZeroDivisionError: time.sleep(5); pathlib.Path({str(tmp_path / 'closed')!r}).touch()"
    tasks = [Task(name="recorder", command=lambda n: [sys.executable, "-c", closing], last=True)]
    keeper = ProcessKeeper(tasks, tmp_path, os.environ, lambda text: None)
    keeper.tick(0.0)
    until = time.monotonic() + 10.0
    while "up" not in (tmp_path / "recorder.log").read_text():
        assert time.monotonic() < until
        time.sleep(0.01)
    keeper.stop()
    assert (tmp_path / "closed").exists(), "killed while it closed its file"
