"""The safety watch: each limit exceeded, warned of, tripped and latched; ages under clocks that are set; the fence."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable

import pytest

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import AutopilotReport, SafetyWatch
from auv_lse_common.vocabulary.mission_run import Action, Command, MissionRun, RunState, Stop

SQUARE = (0.0, 0.0, 100.0, 0.0, 100.0, 200.0, 0.0, 200.0)
OK = AutopilotReport(heard=True, armed=True, mode=4, battery=0.9, leak=0)
SURFACE = Stop(action=Action.SURFACE)


class Vehicle:
    """A vehicle on its way, its mission and the watch; every step is 0.1 s and brings odometry."""

    def __init__(self, has_autopilot: bool = False, at_once: bool = True, **values: object) -> None:
        config = SafetyConfig(**{"mission_time_s": 500.0, "altitude_response": "hold", **values})
        self.run = MissionRun(at_once, SURFACE)
        self.watch = SafetyWatch(config, Fence(SQUARE, config.fence_margin_m), 10.0, has_autopilot)
        self.now_s = 1000.0
        self.position = (50.0, 50.0, 4.0)
        self.blind = self.frozen = False
        self.heading_rad, self.speed_mps, self.jitter_m = 0.3, 1.0, 1e-6
        self.late_s = 0.0  # age of the stamps of odometry

    def wait(self, seconds: float, step_s: float = 0.1) -> Vehicle:
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            if not self.blind:
                self.jitter_m = -self.jitter_m  # an estimate never stands still
                north_m, east_m, depth_m = self.position
                north_m += 0.0 if self.frozen else self.jitter_m
                self.heading_rad = (self.heading_rad + 0.01) % 6.0
                stamp_s = self.now_s - self.late_s
                self.watch.odometry(stamp_s, self.heading_rad, north_m, east_m, depth_m, self.speed_mps)
            self.watch.step(self.now_s, self.run)
        return self


def too_deep(vehicle: Vehicle) -> None:
    vehicle.position = (50.0, 50.0, 12.0)


def too_low(vehicle: Vehicle) -> None:
    vehicle.watch.altitude(0.4)


def outside(vehicle: Vehicle) -> None:
    vehicle.position = (-200.0, 50.0, 4.0)


def blind(vehicle: Vehicle) -> None:
    vehicle.blind = True
    vehicle.wait(30.0)


def silent(vehicle: Vehicle) -> None:
    vehicle.watch.autopilot(dataclasses.replace(OK, heard=False))
    vehicle.wait(30.0)


def drained(vehicle: Vehicle) -> None:
    vehicle.watch.autopilot(dataclasses.replace(OK, battery=0.1))


def leaking(vehicle: Vehicle) -> None:
    vehicle.watch.autopilot(dataclasses.replace(OK, leak=1))


def disobeyed(vehicle: Vehicle) -> None:
    vehicle.watch.autopilot(dataclasses.replace(OK, disobeys="the autopilot ignores the stop for 5 s"))


def late(vehicle: Vehicle) -> None:
    vehicle.wait(500.0 - vehicle.now_s + 1000.0)


@pytest.mark.parametrize(
    ("fault", "limit", "words", "state", "stop"),
    [
        (too_deep, "depth", "depth 12.0 m, deeper than 10.0 m", RunState.HOLDING, SURFACE),
        (too_low, "altitude", "altitude 0.4 m, lower than 1.0 m", RunState.HOLDING, Stop(action=Action.HOLD)),
        (outside, "fence", "200 m outside", RunState.HOLDING, SURFACE),
        (blind, "odometry", "no usable odometry for 3", RunState.HOLDING, SURFACE),
        (silent, "link", "no autopilot heartbeat for 3", RunState.HOLDING, Stop(action=Action.HOLD)),
        (drained, "battery", "battery at 10%, below 20%", RunState.HOLDING, SURFACE),
        (disobeyed, "autopilot", "ignores the stop", RunState.HOLDING, SURFACE),
        (leaking, "leak", "reports a leak", RunState.ABORTED, SURFACE),
        (late, "mission time", "longer than 500 s", RunState.ABORTED, SURFACE),
    ],
)
def test_a_limit_warns_then_commands_and_is_latched(fault, limit, words, state, stop) -> None:  # type: ignore[no-untyped-def]
    vehicle = Vehicle()
    vehicle.watch.autopilot(OK)
    vehicle.wait(5.0)
    assert (vehicle.run.status.state, vehicle.watch.warnings) == (RunState.RUNNING, {})
    fault(vehicle)
    vehicle.wait(2.5)
    assert words in vehicle.watch.warnings[limit]
    assert vehicle.run.limits == {}, "it only warns at first"
    vehicle.wait(1.0)
    assert (vehicle.run.status.state, vehicle.run.status.stop) == (state, stop)
    assert words in vehicle.run.limits[limit]
    vehicle.blind, vehicle.position = False, (50.0, 50.0, 4.0)
    vehicle.watch.altitude(30.0)
    vehicle.watch.autopilot(OK)
    vehicle.wait(60.0)
    assert vehicle.run.status.state is state, "latched, though all is well again"
    assert vehicle.run.command(Command.GO, "test") != ""
    vehicle.run.command(Command.RESET, "test")
    if limit != "mission time":  # which is exceeded still
        vehicle.wait(5.0)
        assert vehicle.run.command(Command.GO, "test") == ""
        assert vehicle.wait(5.0).run.status.state is RunState.RUNNING


@pytest.mark.parametrize("silent_s", [20.0, 60.0])
def test_a_silent_autopilot_is_one_loss_and_trips_one_limit(silent_s: float) -> None:
    """No odometry, altitude or pressure arrives with it; the link reports the loss 5 s late."""
    vehicle = Vehicle()
    vehicle.watch.autopilot(OK)
    vehicle.watch.altitude(20.0)
    lost_s = vehicle.wait(5.0).now_s
    vehicle.blind = True
    vehicle.wait(5.0)
    lost = dataclasses.replace(OK, heard=False, stamp_s=lost_s, depth_problem="no pressure", disobeys="no answer")
    vehicle.watch.autopilot(lost)
    tripped_s = None
    while vehicle.now_s < lost_s + silent_s:
        vehicle.wait(0.1)
        tripped_s = vehicle.now_s if vehicle.run.limits and tripped_s is None else tripped_s
    assert set(vehicle.run.limits) == ({"link"} if silent_s > 35.0 else set())
    if tripped_s is not None:
        assert tripped_s - lost_s == pytest.approx(33.0, abs=0.5), "30 s, and its patience"
    vehicle.watch.autopilot(OK)
    vehicle.wait(10.0)  # the first odometry takes a moment
    vehicle.blind = False
    vehicle.wait(5.0)
    assert set(vehicle.run.limits) <= {"link"}
    vehicle.blind = True
    vehicle.wait(35.0)
    assert "odometry" in vehicle.run.limits, "the autopilot is heard, and its odometry is missing"


def test_a_warning_that_passes_does_nothing_and_a_limit_can_only_warn() -> None:
    vehicle = Vehicle(depth_response="warn")
    too_deep(vehicle)
    assert "depth" in vehicle.wait(60.0).watch.warnings
    assert vehicle.run.status.state is RunState.RUNNING
    vehicle = Vehicle()
    for _ in range(20):  # a depth that flutters about its limit for less than half of the time
        too_deep(vehicle)
        vehicle.wait(1.4)
        vehicle.position = (50.0, 50.0, 4.0)
        vehicle.wait(1.6)
    assert vehicle.run.limits == {}


@pytest.mark.parametrize("step_s", [0.1, 0.5, 1.0])
def test_a_plausible_reading_now_and_then_does_not_reset_an_exceeded_limit(step_s: float) -> None:
    vehicle = Vehicle().wait(10.0, step_s)
    for i in range(round(6.0 / step_s) + 1):  # twice the patience
        vehicle.position = (50.0, 50.0, 4.0 if i % 25 == 24 or i == 2 else 20.0)
        vehicle.wait(step_s, step_s)
    assert set(vehicle.run.limits) == {"depth"}


def test_every_reading_of_a_step_counts_not_just_the_last_one() -> None:
    vehicle = Vehicle().wait(5.0)
    for step in range(61):  # twice the patience
        for i in range(4):
            deep = 20.0 if i < 3 else 4.0
            vehicle.watch.odometry(vehicle.now_s + 0.1, 0.3, 50.0 + 1e-6 * (4 * step + i), 50.0, deep, 1.0)
        vehicle.now_s += 0.1
        vehicle.watch.step(vehicle.now_s, vehicle.run)
        assert "depth" in vehicle.watch.warnings or "depth" in vehicle.run.limits
    assert set(vehicle.run.limits) == {"depth"}
    healthy = Vehicle().wait(5.0)
    for step in range(61):
        for i in range(4):
            deep = 20.0 if i == 3 else 4.0
            healthy.watch.odometry(healthy.now_s + 0.1, 0.3, 50.0 + 1e-6 * (4 * step + i), 50.0, deep, 1.0)
        healthy.now_s += 0.1
        healthy.watch.step(healthy.now_s, healthy.run)
        assert (healthy.watch.warnings, healthy.run.limits) == ({}, {})


@pytest.mark.parametrize("altitude_m", [0.4, 0.0, -0.0, -3.0, -math.inf])
def test_an_altitude_of_nothing_or_less_is_too_low(altitude_m: float) -> None:
    vehicle = Vehicle().wait(5.0)
    vehicle.watch.altitude(altitude_m)
    assert set(vehicle.wait(3.5).run.limits) == {"altitude"}
    vehicle = Vehicle(min_altitude_m=0.0)
    vehicle.watch.altitude(altitude_m)
    assert vehicle.wait(10.0).watch.warnings == {}, "not watched"


@pytest.mark.parametrize(("can_climb", "after_s"), [(True, 15.0), (False, 3.0)])
def test_a_vehicle_that_is_too_low_has_time_to_climb_and_then_holds(can_climb: bool, after_s: float) -> None:
    vehicle = Vehicle()
    fence = Fence(SQUARE, 150.0)
    vehicle.watch = SafetyWatch(SafetyConfig(mission_time_s=500.0), fence, 10.0, can_climb=can_climb)
    vehicle.watch.altitude(0.4)
    assert not vehicle.wait(after_s - 1.0).run.limits
    assert "altitude" in vehicle.watch.warnings
    assert set(vehicle.wait(2.0).run.limits) == {"altitude"}
    assert vehicle.run.status.stop == Stop(action=Action.HOLD)


def test_silence_does_not_hide_the_last_altitude() -> None:
    vehicle = Vehicle().wait(5.0)
    vehicle.watch.altitude(30.0)
    vehicle.wait(0.1)
    vehicle.watch.altitude(0.4)
    assert vehicle.wait(2.5).run.limits == {}, "a single reading may be an outlier"
    assert set(vehicle.wait(4.0).run.limits) == {"altitude"}


@pytest.mark.parametrize("late_s", [31.0, 3600.0])
def test_odometry_with_old_stamps_is_old(late_s: float) -> None:
    vehicle = Vehicle().wait(5.0)
    vehicle.late_s = late_s
    assert vehicle.wait(29.0).watch.warnings == {}
    assert vehicle.wait(2.0).watch.warnings == {
        "odometry": "no usable odometry for 31 s, longer than 30 s. "
        f"It arrives with stamps {late_s:.0f} s old: check its clock"
    }
    assert set(vehicle.wait(4.0).run.limits) == {"odometry"}


def test_late_odometry_is_as_old_as_its_stamp_and_early_odometry_as_its_arrival() -> None:
    vehicle = Vehicle()
    vehicle.late_s = 20.0
    assert vehicle.wait(60.0).watch.warnings == {}
    vehicle.blind = True
    assert set(vehicle.wait(11.0).watch.warnings) == {"odometry"}, "31 s old, though it came 11 s ago"
    vehicle = Vehicle()
    vehicle.late_s = -500.0
    vehicle.wait(5.0).blind = True
    assert set(vehicle.wait(31.0).watch.warnings) == {"odometry"}


def test_odometry_with_old_stamps_is_checked_all_the_same() -> None:
    vehicle = Vehicle(odometry_response="warn")
    vehicle.late_s = 3600.0
    vehicle.wait(5.0)
    too_deep(vehicle)
    assert set(vehicle.wait(4.0).run.limits) == {"depth"}


def test_before_the_mission_nothing_trips_while_the_vehicle_is_afloat() -> None:
    vehicle = Vehicle(has_autopilot=True, at_once=False)
    vehicle.position = (50.0, 50.0, 0.2)
    too_low(vehicle)
    leaking(vehicle)
    vehicle.wait(60.0)
    assert vehicle.run.status.state is RunState.WAITING
    assert set(vehicle.watch.warnings) == {"altitude", "altimeter", "leak"}


@pytest.mark.parametrize("command", [Command.HOLD, Command.SURFACE, Command.ABORT])
def test_a_command_before_the_first_go_lets_nothing_trip_afloat(command: Command) -> None:
    vehicle = Vehicle(at_once=False)
    vehicle.run.command(command, "test")
    vehicle.blind = True
    assert vehicle.wait(60.0).run.limits == {}
    assert set(vehicle.watch.warnings) == {"odometry"}
    vehicle.blind, vehicle.position = False, (50.0, 50.0, 12.0)
    assert set(vehicle.wait(5.0).run.limits) == {"depth"}, "under water it is watched"


def test_an_altimeter_that_stops_is_told_and_trips_nothing() -> None:
    vehicle = Vehicle(altitude_response="surface").wait(60.0)
    assert vehicle.watch.warnings == {}, "a vehicle need not have one"
    vehicle.watch.altitude(float("nan"))
    vehicle.wait(29.0)
    assert vehicle.watch.warnings == {}, "no echo is no silence"
    vehicle.now_s -= 3600.0  # the clock is set
    vehicle.wait(1.0)
    vehicle.wait(30.0)
    assert vehicle.watch.warnings == {"altimeter": "no altitude for 60 s, longer than 30 s"}
    assert vehicle.run.limits == {}
    vehicle.watch.altitude(12.0)
    assert vehicle.wait(0.2).watch.warnings == {}


def cruise(vehicle: Vehicle, metres: float, altitude_m: float | None = None, depth_m: float | None = None) -> Vehicle:
    """Moves to the east at 1 m/s; altitude and depth vary by centimetres unless they are given."""
    for second in range(round(metres)):
        north_m, east_m, _ = vehicle.position
        vehicle.position = (north_m, east_m + 1.0, 4.0 + 0.01 * (second % 3) if depth_m is None else depth_m)
        vehicle.watch.altitude(12.0 + 0.01 * (second % 5) if altitude_m is None else altitude_m)
        vehicle.wait(1.0, 1.0)
    return vehicle


@pytest.mark.parametrize(("apart_s", "is_told"), [(0.3, True), (3.0, True), (20.0, False)])
def test_a_heading_that_jumps_again_and_again_is_told_and_trips_nothing(apart_s: float, is_told: bool) -> None:
    vehicle = Vehicle().wait(5.0)
    for _ in range(6):
        vehicle.heading_rad = (vehicle.heading_rad + math.pi) % (2.0 * math.pi)
        vehicle.wait(apart_s)
    assert (vehicle.watch.warnings == {"heading": "heading jumps by up to 179 deg; check the compass"}) == is_told
    assert (vehicle.watch.warnings == {}) == (not is_told)
    assert vehicle.run.limits == {}
    assert vehicle.wait(12.0).watch.warnings == {}, "it has passed"


def test_an_altimeter_that_hangs_while_the_vehicle_moves_counts_as_none() -> None:
    vehicle = cruise(Vehicle(), 40.0)
    assert vehicle.watch.warnings == {}
    cruise(vehicle, 11.0, altitude_m=12.3)
    assert vehicle.watch.warnings == {}, "flat ground"
    cruise(vehicle, 2.0, altitude_m=12.3)
    assert vehicle.watch.warnings == {"altimeter": "altitude frozen at 12.3 m for 12 m of travel"}
    vehicle.wait(40.0)
    assert "no altitude for" in vehicle.watch.warnings["altimeter"], "then it fell silent"
    assert cruise(vehicle, 3.0).watch.warnings == {}
    assert vehicle.run.limits == {}
    assert cruise(Vehicle(), 60.0, altitude_m=math.inf).watch.warnings == {}, "no ground in reach all the way"


def test_altitudes_before_the_first_position_are_of_no_travel() -> None:
    vehicle = Vehicle()
    vehicle.blind = True
    for second in range(30):
        vehicle.blind = second < 15
        vehicle.watch.altitude(12.3)
        vehicle.wait(1.0)
    assert vehicle.watch.warnings == {}


def test_a_depth_gauge_that_hangs_while_the_vehicle_moves_is_told() -> None:
    vehicle = cruise(Vehicle(), 20.0)
    assert cruise(vehicle, 49.0, depth_m=4.25).watch.warnings == {}
    cruise(vehicle, 4.0, depth_m=4.25)
    assert vehicle.watch.warnings == {"depth gauge": "depth frozen at 4.25 m for 52 m of travel"}
    assert cruise(vehicle, 1.0).watch.warnings == {}
    assert vehicle.run.limits == {}
    assert cruise(vehicle, 140.0, depth_m=0.0).watch.warnings == {}, "at the surface it is the same all the time"
    ideal = cruise(Vehicle(), 220.0, depth_m=4.0)
    assert ideal.watch.warnings == {}, "of an ideal vehicle in the simulator it never varies"


def test_a_vehicle_that_is_found_submerged_before_its_mission_is_watched() -> None:
    """Its computer has started again under water, on call: nobody is there to say GO."""
    vehicle = Vehicle(has_autopilot=True, at_once=False)
    leaking(vehicle)
    vehicle.wait(60.0)
    assert vehicle.run.status.state is RunState.ABORTED
    assert set(vehicle.run.limits) == {"leak"}


def test_a_vehicle_that_comes_from_outside_is_not_fenced_in_before_it_has_arrived() -> None:
    vehicle = Vehicle()
    outside(vehicle)
    assert vehicle.wait(60.0).run.limits == {}
    vehicle.position = (50.0, 50.0, 4.0)
    vehicle.wait(5.0)
    outside(vehicle)
    assert set(vehicle.wait(5.0).run.limits) == {"fence"}


def test_after_a_reset_a_vehicle_outside_of_the_fence_may_come_back() -> None:
    vehicle = Vehicle()
    vehicle.wait(5.0)
    outside(vehicle)
    assert set(vehicle.wait(5.0).run.limits) == {"fence"}
    vehicle.run.command(Command.RESET, "test")
    assert vehicle.run.command(Command.GO, "test") == ""
    assert vehicle.wait(60.0).run.status.state is RunState.RUNNING
    vehicle.position = (50.0, 50.0, 4.0)
    vehicle.wait(5.0)
    outside(vehicle)
    assert set(vehicle.wait(5.0).run.limits) == {"fence"}, "it is back, and fenced in again"


def test_a_watch_that_is_started_again_goes_on_with_its_time_and_fence() -> None:
    first, second = Vehicle(), Vehicle()
    first.wait(400.0)
    second.watch.restore(json.loads(json.dumps(first.watch.snapshot())))
    outside(second)
    assert set(second.wait(5.0).run.limits) == {"fence"}
    second.run.command(Command.RESET, "test")
    second.run.command(Command.GO, "test")
    assert set(second.wait(110.0).run.limits) == {"mission time"}


def test_odometry_that_no_vehicle_can_have_counts_as_none() -> None:
    vehicle = Vehicle()
    vehicle.wait(5.0)
    vehicle.position = (math.nan, 50.0, 4.0)
    assert set(vehicle.wait(35.0).run.limits) == {"odometry"}


def test_odometry_that_hangs_counts_as_none_once_the_vehicle_has_moved() -> None:
    vehicle = Vehicle()
    vehicle.frozen = True
    assert vehicle.wait(60.0).run.limits == {}, "it waits at its start"
    vehicle.position = (55.0, 50.0, 4.0)
    assert set(vehicle.wait(60.0).run.limits) == {"odometry"}, "though its heading goes on changing"


def test_odometry_that_says_it_stands_still_may_stand_still() -> None:
    vehicle = Vehicle()
    vehicle.frozen, vehicle.speed_mps = True, 0.0
    vehicle.wait(5.0)
    vehicle.position = (55.0, 50.0, 4.0)
    assert vehicle.wait(60.0).run.limits == {}, "an ideal vehicle waits at the surface for its fix"


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
def test_a_clock_that_is_set_makes_nothing_old(step_s: float) -> None:
    vehicle = Vehicle(has_autopilot=True)
    vehicle.watch.autopilot(OK)
    vehicle.wait(5.0)
    vehicle.now_s += step_s
    assert vehicle.wait(10.0).run.limits == {}
    vehicle.blind = True
    vehicle.wait(20.0)
    vehicle.now_s += step_s
    assert vehicle.wait(8.0).run.limits == {}, "28 s without odometry by any clock that was not set"
    assert set(vehicle.wait(8.0).run.limits) == {"odometry"}, "and that age was not forgotten"
    vehicle.run.command(Command.RESET, "test")
    vehicle.blind = False
    assert vehicle.wait(5.0).run.limits == {}
    blind(vehicle)
    assert set(vehicle.wait(5.0).run.limits) == {"odometry"}, "and a real age still counts"


def test_the_mission_waits_for_an_autopilot_that_is_heard_armed_and_in_its_mode() -> None:
    vehicle = Vehicle(has_autopilot=True)
    assert vehicle.wait(120.0).run.status.reason == "the autopilot is not heard"
    assert vehicle.run.limits == {}, "one that was never heard is not lost"
    vehicle.watch.autopilot(dataclasses.replace(OK, armed=False))
    assert vehicle.wait(1.0).run.status.reason == "the autopilot is not armed"
    vehicle.watch.autopilot(dataclasses.replace(OK, mode=19, mode_obeys=False))
    assert "mode 19" in vehicle.wait(1.0).run.status.reason
    assert vehicle.run.status.state is RunState.WAITING
    vehicle.watch.autopilot(OK)
    assert vehicle.wait(1.0).run.status.state is RunState.RUNNING


def comes_and_goes(vehicle: Vehicle) -> None:
    vehicle.position, vehicle.blind = (50.0, 50.0, 0.2), False
    vehicle.wait(5.0)
    vehicle.blind = True
    vehicle.wait(31.0)


def stale(vehicle: Vehicle) -> None:
    vehicle.position = (50.0, 50.0, 0.2)
    vehicle.blind, vehicle.late_s = False, 200.0
    vehicle.wait(1.0)


@pytest.mark.parametrize(
    ("before", "words"),
    [
        (lambda vehicle: vehicle.wait(5.0), "no position has arrived yet"),
        (lambda vehicle: vehicle.wait(120.0), "no position has arrived yet"),
        (comes_and_goes, "no position for more than 30 s"),
        (stale, "positions arrive with stamps more than 30 s old; check the clock of their sender"),
    ],
)
@pytest.mark.parametrize("has_autopilot", [False, True])
def test_a_mission_that_is_given_go_without_a_position_waits_for_one(
    before: Callable[[Vehicle], object], words: str, has_autopilot: bool
) -> None:
    vehicle = Vehicle(has_autopilot, at_once=False)
    if has_autopilot:
        vehicle.watch.autopilot(OK)
    vehicle.blind = True
    before(vehicle)
    for _ in range(2):  # a second GO changes nothing
        assert vehicle.run.command(Command.GO, "test") == ""
        for _ in range(3):
            assert (vehicle.run.status.state, vehicle.run.status.reason) == (RunState.WAITING, words)
            assert vehicle.wait(40.0).run.limits == {}, "before its first leg it waits, and does not surface"
    vehicle.position, vehicle.blind, vehicle.late_s = (50.0, 50.0, 0.2), False, 0.0
    assert vehicle.wait(0.2).run.status.state is RunState.RUNNING, "it starts by itself"
    vehicle.blind = True
    assert set(vehicle.wait(40.0).run.limits) == {"odometry"}, "once it has begun, the limit counts"


def test_a_mission_that_continues_does_not_wait_for_a_position_but_is_watched() -> None:
    begun = Vehicle().wait(5.0).run.snapshot()
    vehicle = Vehicle(at_once=False)
    vehicle.run.restore(begun)
    vehicle.blind = True
    assert vehicle.wait(5.0).run.status.state is RunState.RUNNING
    assert set(vehicle.wait(40.0).run.limits) == {"odometry"}


def test_the_fence_by_hand() -> None:
    fence = Fence((*SQUARE, 0.0, 0.0), 10.0)  # the first corner once more
    assert fence.outside_m(50.0, 50.0) == 0.0
    assert fence.outside_m(-30.0, 50.0) == pytest.approx(30.0)
    assert fence.outside_m(103.0, 204.0) == pytest.approx(5.0), "from the corner"
    with pytest.raises(ValueError, match="at least 3 corners"):
        Fence((0.0, 0.0, 1.0, 1.0), 10.0)
