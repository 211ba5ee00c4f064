"""The simulated side of a mission in lockstep: which tick may run when, without ROS."""

from __future__ import annotations

import socket
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_mavlink.port import AutopilotPort
from auv_lse_sim.engine import simulation as simulation_module
from auv_lse_sim.engine.simulation import MissionState, Simulation, Speed
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.vehicle.target_leg import leg_to
from auv_lse_sim.world import VehicleOutput

PAYLOAD = bytes(252)


def simulation(recorded: bool = False, lockstep: bool = True, vehicles: int = 1) -> Simulation:
    settings = Settings.load(None, {"mission.vehicles": vehicles, "mission.steps": 4})
    return Simulation(settings, ground_of(settings), lockstep=lockstep, recorded=recorded)


def handle(sim: Simulation, tick: int, waypoints: int = 0, packets: int = 0, finished: bool = False) -> None:
    """Every vehicle's nodes announce the tick."""
    for k in sim.vehicles:
        sim.take_done(k, "safety", tick, (0,), False)
        sim.take_done(k, "planner", tick, (waypoints, waypoints), finished)
        sim.take_done(k, "modem_sent", tick, (packets,), False)


def test_the_first_tick_waits_for_every_node_of_every_vehicle() -> None:
    sim = simulation(vehicles=2)
    sim.begin()
    for k in (1, 2):
        for phase in ("gp", "safety", "planner", "modem"):
            assert not sim.ready()
            sim.take_done(k, phase, 0, (), False)
    assert sim.ready()
    assert sim.state is MissionState.WAITING


def test_a_tick_waits_for_the_waypoints_and_packets_that_are_announced() -> None:
    sim = simulation()
    outputs = sim.advance()
    assert (sim.tick, sim.now_s, sim.state) == (1, 1.0, MissionState.RUNNING)
    assert sim.arrivals == [0]
    assert sim.soundings == [len(outputs[1].soundings)]
    assert not sim.ready()
    handle(sim, 1, waypoints=1, packets=1)
    assert sim.silence(14.0) == ""
    missing = "packets of auv1: 0 of 1, waypoints of auv1: 0 of 1"
    assert sim.silence(61.0) == f"tick 1: no answer for 61 s; missing {missing}"
    sim.take_packet(1, 1.0, PAYLOAD)
    assert not sim.ready()
    sim.take_waypoint(1, None)  # one that cannot be used counts as well
    assert sim.ready()
    sim.advance()
    assert (sim.tick, sim.sent) == (2, 1), "the packet went into the water before the tick"


def test_a_recorder_may_be_twenty_ticks_behind() -> None:
    sim = simulation(recorded=True)
    sim.advance()
    for tick in range(1, 21):
        handle(sim, tick)
        assert sim.ready()
        sim.advance()
    handle(sim, 21)
    assert not sim.ready()
    sim.take_recorded(1)
    assert sim.ready()


def test_the_mission_ends_once_the_recorder_has_its_last_tick() -> None:
    sim = simulation(recorded=True)
    for tick in range(1, 6):
        sim.advance()
        handle(sim, tick, finished=tick == 5)
    sim.take_state(1, 1, RunStatus(state=RunState.ENDED, stop=None))
    sim.take_recorded(4)
    assert sim.finished
    assert not sim.ready(), "the end of the recording would be lost"
    assert sim.silence(14.0) == ""
    assert sim.silence(16.0) == "tick 5: no answer for 16 s; missing recorder: tick 4 of 5"
    sim.take_recorded(5)
    assert sim.ready()
    assert sim.advance() == {}
    assert sim.state is MissionState.FINISHED
    assert sim.silence(61.0) == ""


def test_the_mission_ends_when_every_planner_is_finished_and_every_end_is_reported() -> None:
    sim = simulation(vehicles=2)
    sim.advance()
    sim.take_done(1, "planner", 1, (0, 0), True)
    sim.take_state(1, 1, RunStatus(state=RunState.ENDED, stop=None))
    assert not sim.finished
    sim.take_done(2, "planner", 1, (0, 0), True)
    assert sim.steps == [4, 4]
    assert not sim.finished, "the recording would lack the end of vehicle 2"
    sim.take_state(2, 1, RunStatus(state=RunState.ENDED, stop=None))
    assert sim.finished
    assert sim.advance() == {}
    assert (sim.state, sim.tick) == (MissionState.FINISHED, 1)


def test_a_rehearsal_of_separate_vehicles_leaves_the_last_one_time_to_report_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its reports do not reach the simulator: without its autopilot it would hold, and its dive not end."""
    apart = {"sim.apart": True, "sim.lockstep": False, "sim.real_time_factor": 1.0}
    settings = Settings.load(None, {"mission.vehicles": 1, "mission.steps": 4, **apart})
    sim = Simulation(settings, ground_of(settings), lockstep=False, recorded=False)
    tick, seen = sim.world.tick, list[float]()

    def at_the_end(now_s: float) -> dict[int, VehicleOutput]:
        outputs = {k: replace(o, truth=replace(o.truth, step=3, loitering=True)) for k, o in tick(now_s).items()}
        seen.append(now_s)
        return outputs

    monkeypatch.setattr(sim.world, "tick", at_the_end)
    while sim.advance():
        assert len(seen) < 60
    assert sim.state is MissionState.FINISHED
    assert len(seen) >= 10


def test_a_mission_that_ends_early_says_why() -> None:
    settings = Settings.load(None, {"mission.vehicles": 1, "mission.steps": 4, "mission.until.found": 0.8})
    sim = Simulation(settings, ground_of(settings), lockstep=True, recorded=False)
    sim.advance()
    leg = leg_to(0.0, 0.0, 0.0, (20.0, 0.0), 15.0, step=1)
    sim.take_waypoint(1, leg, then=Stop(action=Action.HOLD))
    sim.take_done(1, "planner", 1, (1, 1), True)
    sim.take_state(1, 1, RunStatus(state=RunState.ENDED, stop=None))
    assert sim.advance() == {}
    assert sim.steps == [2]
    assert sim.message == "the quality asked for was reached: 80 % found"


def test_a_mission_is_over_when_batteries_end_it_before_the_planners_do() -> None:
    sim = simulation(vehicles=2)
    sim.advance()
    early = RunStatus(state=RunState.ENDED, stop=Stop(action=Action.HOLD), reason="the battery suffices for the way")
    sim.take_state(1, 1, early)
    assert not sim.finished, "the other vehicle goes on"
    sim.take_done(2, "planner", 1, (0, 0), True)
    sim.take_state(2, 1, RunStatus(state=RunState.ENDED, stop=None, reason="the last leg is complete"))
    assert sim.advance() == {}
    assert (sim.state, sim.message) == (MissionState.FINISHED, "ended early: auv1: the battery suffices for the way")


def test_an_item_that_cannot_be_sent_is_reported_once() -> None:
    sim = simulation()
    sim.advance()
    sim.take_packet(1, 1.0, PAYLOAD)
    sim.take_packet(1, 1.0, PAYLOAD)  # the transducer is busy with the first
    sim.advance()
    (problem,) = sim.take_problems()
    assert problem.startswith("packet of auv1 at 1.0 s: ")
    assert sim.take_problems() == []


def test_without_lockstep_no_tick_is_ready_by_itself() -> None:
    sim = simulation(lockstep=False)
    sim.advance()
    handle(sim, 1)
    assert not sim.ready(), "a timer gives the ticks"


def test_speed_is_that_of_the_last_seconds() -> None:
    speed = Speed()
    for wall_s in range(40):
        speed.mark(float(wall_s) ** 2, float(wall_s))
    assert speed.value == pytest.approx(39.0 + 14.0), "mean slope of t^2 from 14 s to 39 s"


def test_a_tick_waits_for_the_states_that_are_announced_and_the_vehicle_obeys() -> None:
    sim = simulation()
    for tick in range(1, 4):
        sim.advance()
        handle(sim, tick)
    sim.advance()
    handle(sim, 4)
    sim.take_done(1, "safety", 4, (1,), False)
    assert not sim.ready()
    sim.take_state(1, 1, RunStatus(state=RunState.HOLDING, stop=Stop(action=Action.SURFACE)))
    assert sim.ready()
    assert sim.runs == [RunState.HOLDING]


def test_a_vehicle_in_state_ended_stops_unless_it_completes_its_last_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    sim, stop, stops = simulation(lockstep=False), Stop(action=Action.SURFACE), []
    monkeypatch.setattr(sim.world, "obey", lambda vehicle, stop: stops.append(stop))
    leg = leg_to(0.0, 0.0, 0.0, (50.0, 0.0), 15.0)
    sim.take_waypoint(1, leg)
    sim.take_state(1, 1, RunStatus(state=RunState.ENDED, stop=stop))
    sim.take_waypoint(1, replace(leg, step=1), then=stop)
    sim.take_state(1, 2, RunStatus(state=RunState.ENDED, stop=stop))
    assert stops == [stop, None]


def test_a_mission_in_real_time_is_over_when_its_ended_vehicle_surfaces_on_command() -> None:
    sim, last = simulation(lockstep=False), Stop(action=Action.GO_TO, position_m=(500.0, 0.0))
    sim.take_waypoint(1, leg_to(0.0, 0.0, 0.0, (20.0, 0.0), 15.0, step=3), then=last)
    sim.take_state(1, 1, RunStatus(state=RunState.ENDED, stop=last))
    for _ in range(30):
        assert sim.advance(), "it is on its way to the recovery position"
    assert sim.steps == [4], "its last leg is complete"
    sim.take_state(1, 2, RunStatus(state=RunState.ENDED, stop=Stop(action=Action.SURFACE), reason="SURFACE by root"))
    sim.advance()
    assert sim.advance() == {}
    assert (sim.state, sim.steps) == (MissionState.FINISHED, [4])


def test_the_time_of_a_hold_does_not_count_against_the_mission() -> None:
    sim = simulation(lockstep=False)
    sim.take_state(1, 1, RunStatus(state=RunState.HOLDING, stop=Stop(action=Action.HOLD)))
    while sim.now_s < 2.0 * sim._settings.longest_s:
        assert sim.advance()
    sim.take_state(1, 2, RunStatus(state=RunState.RUNNING, stop=None))
    while sim.state is MissionState.RUNNING:
        sim.advance()
    assert sim.state is MissionState.FAILED


def held(reason: str, limits: tuple[str, ...] = ()) -> RunStatus:
    return RunStatus(state=RunState.HOLDING, stop=Stop(action=Action.HOLD), reason=reason, limits=limits)


def run_held(monkeypatch: pytest.MonkeyPatch, status: RunStatus) -> Simulation:
    monkeypatch.setattr(simulation_module, "LONGEST_HELD_S", 30.0)
    sim = simulation()
    sim.take_state(1, 1, status)
    while sim.now_s < 60.0 and sim.advance():
        pass
    return sim


@pytest.mark.parametrize(
    ("reason", "limits"),
    [
        ("the autopilot is in mode 9, in which it follows no targets", ()),
        ("no usable odometry for 30 s", ("odometry: no usable odometry for 30 s",)),
    ],
)
def test_a_lockstep_mission_that_nothing_lets_go_on_fails_with_the_reason(
    monkeypatch: pytest.MonkeyPatch, reason: str, limits: tuple[str, ...]
) -> None:
    sim = run_held(monkeypatch, held(reason, limits))
    assert sim.state is MissionState.FAILED
    assert sim.message.startswith("every vehicle under way has been held for 31 s")
    assert sim.message.endswith(f"auv1 HOLDING ({reason})")


@pytest.mark.parametrize("reason", ["HOLD by operator", "waits for GO"])
def test_a_mission_that_waits_for_people_goes_on_and_shows_it(monkeypatch: pytest.MonkeyPatch, reason: str) -> None:
    sim = run_held(monkeypatch, held(reason))
    assert (sim.state, sim.message) == (MissionState.RUNNING, f"auv1 HOLDING ({reason})")


def test_a_lockstep_tick_reads_what_the_drivers_sent_before_it() -> None:
    """Otherwise an autopilot on a busy computer misses heartbeats that are in its socket, and surfaces."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"udpin://127.0.0.1:{probe.getsockname()[1]}"
    settings = Settings.load(None, {"mission.vehicles": 1, "link.kind": "mavlink", "link.endpoint": endpoint})
    sim = Simulation(settings, ground_of(settings), lockstep=True, recorded=False)
    driver = AutopilotPort(settings.vehicle(1).link, 1, origin=None)
    try:
        driver.step(0.0, 0.0)  # opens the port that the autopilot calls
        for tick in range(20):
            for k, output in sim.advance().items():
                sim.deliver(k, output)
            if tick < 3:
                sim.serve()  # later nobody has time to
            driver.step(sim.now_s, sim.now_s)
        assert driver.link.counts["lost"] == 0
        assert sim.links.dock is not None
        assert not sim.links.dock.vehicles[1].failsafes.is_critical
        assert driver.link.report.armed
    finally:
        driver.close(sim.now_s, sim.now_s)
        sim.links.close()


@pytest.mark.ros
def test_a_mission_that_has_failed_for_want_of_answers_stays_failed() -> None:
    pytest.importorskip("rclpy", reason="needs rclpy (scripts/test sets it up)")
    from auv_lse_sim.engine.sim_node import SimNode

    states: list[MissionState] = []
    node = SimpleNamespace(_last_status=None)

    def publish(state: MissionState, message: str) -> None:
        states.append(state)
        node._last_status = state, message

    node._publish_status = publish
    node._sim = SimpleNamespace(
        state=MissionState.RUNNING, silence=lambda waited_s: f"{waited_s:.0f}" * (waited_s > 15)
    )
    for waited_s in (3.0, 16.0, 61.0, 77.0, 130.0):
        node._waiting_since_s = time.monotonic() - waited_s
        SimNode._watch(node)
    assert states == [MissionState.RUNNING, MissionState.FAILED]
