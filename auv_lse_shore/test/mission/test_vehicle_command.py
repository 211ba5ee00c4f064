"""auv_lse sim and auv_lse vehicle, each in a process of its own: together they fly the mission of auv_lse mission."""

from __future__ import annotations

import importlib.util
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.state_memory import MemoryCopy
from auv_lse_record.recording import Recording, recording_in
from auv_lse_record.run_reader import read_run
from auv_lse_run.process.domain import own_domain
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.faults import kills

pytestmark = [pytest.mark.ros, pytest.mark.mission]

ROOT = Path(__file__).resolve().parents[3]


def start(module: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "auv_lse_run", module, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "AUV_LSE_ROOT": str(ROOT)},
    )


def test_vehicles_started_one_by_one_fly_the_same_mission(tmp_path: Path) -> None:
    folder = tmp_path / "a run"
    with own_domain() as free:  # let go at once: auv_lse sim takes it
        domain = ("--domain", str(free))
    short = ("--vehicles", "2", "--steps", "5", "--seed", "5", "--no-report", "--out", str(folder))
    started = [start("sim", *short, *domain)]
    try:
        until = time.monotonic() + 60.0
        while not (folder / "mission.yaml").is_file():
            assert time.monotonic() < until, "the simulator has not written its mission.yaml"
            time.sleep(0.1)
        for k in (2, 1):
            vehicle = ("vehicle", f"auv{k}", str(folder / "mission.yaml"), *domain)
            started.append(start(*vehicle, "--out", str(tmp_path / f"auv {k}")))
        outputs = [process.communicate(timeout=150)[0] for process in started]
    finally:
        for process in started:
            process.kill()
    assert [process.returncode for process in started] == [0, 0, 0], outputs
    assert f"auv_lse vehicle auv2 {shlex.quote(str(folder / 'mission.yaml'))}" in outputs[0]
    assert "auv2: the simulated mission has finished" in outputs[1]
    by_hand = read_run(folder)
    settings = Settings.load(folder / "mission.yaml")
    by_fleet = Fleet(settings, ground_of(settings)).run()  # equal to auv_lse mission: test_mission.py
    assert [p.payload for p in by_hand.sent] == [p.payload for p in by_fleet.sent]
    assert len(by_hand.sent) > 2
    for one, other in zip(by_hand.vehicles, by_fleet.vehicles, strict=True):
        assert [(d.now_s, d.plan) for d in one.decisions] == [(d.now_s, d.plan) for d in other.decisions]


def test_vehicles_that_share_nothing_but_the_water_survive_the_death_of_every_node(tmp_path: Path) -> None:
    """Three ROS domains; packets pass through emulated modems alone. In real time: three legs, a minute.

    An autopilot surfaces if its link is dead for 3 s, which a busy computer may need to start it again: `auv_lse faults
    kills` kills links.
    """
    nodes = [node for node in kills.NODES if node != "vehicle_link_node"]

    def one_of_each(travel_s: float) -> list[tuple[float, int, str]]:
        return [(3.0 + 5.0 * number, 1, node) for number, node in enumerate(nodes)]

    flight = kills.fly(tmp_path / "lake é 1", 3, one_of_each, {"tdma.slot_s": "8.0"})
    assert flight.codes == [0, 0, 0], flight.outputs
    assert len(flight.kills) == len(nodes) == 5
    assert all(kill.back_s < 15.0 for kill in flight.kills), flight.kills  # 5 s on a machine that has time
    assert not any(kill.lost for kill in flight.kills), flight.kills
    assert len(flight.sockets) > 20, "of three processes and their nodes"
    assert [socket for socket in flight.sockets if not socket.local] == [], "nothing listens beyond this machine"
    assert flight.steps[2] == [0, 1, 2]
    assert flight.steps[1] in ([0, 1, 2], [0, 1], [0, 2], [1, 2]), "each once; one may fall to the recorder's death"
    for k, mate in ((1, 2), (2, 1)):
        with Recording(recording_in(flight.recordings[k])) as recording:
            names = [name for name in recording.topics if name.startswith("/auv")]
            heard = [(topic, message) for topic, _, message in recording.messages(names)]
        assert {topic.split("/")[1] for topic, _ in heard} == {f"auv{k}"}, "no topic of the mate's"
        plans = [message for topic, message in heard if topic == f"/auv{k}/team/plans"]
        assert plans, "the mate's plan came through the water"
        assert {plan.vehicle for plan in plans} == {mate}
    states = list(tmp_path.glob("**/*.state"))
    assert len(states) > 6
    assert [path for path in states if MemoryCopy(path).text is not None] == [], "it leaves nothing in memory"
