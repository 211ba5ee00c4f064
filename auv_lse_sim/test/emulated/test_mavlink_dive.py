"""Whole dives with a simulated autopilot and the link: legs, surfacings, and an autopilot that does not obey."""

import dataclasses
import math
import random
from itertools import pairwise

import pytest
from bench_of_autopilot import FLAT_GROUND, end_of
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.mission_run import Action, Command, MissionRun, Stop
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, AutopilotState
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.vehicle.travel import EstimatedState, Travel
from auv_lse_sim.emulated.fault import Fault
from benchmarks.navigation.lone_vehicle import LoneVehicle

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
MOTION = MotionTable(MotionConfig())


class Dive(LoneVehicle):
    """Along straight legs to the north, with a record of truth and dead reckoning."""

    def __init__(self, mode: str, **parameters):
        super().__init__(FLAT_GROUND, ORIGIN, {"auv1.link.mode": mode, **parameters})
        self.truth, self.raw = [], []

    def fly(self, seconds: int) -> None:
        for _ in range(seconds):
            output = self.tick()
            self.truth.append((output.truth.north_m, output.truth.east_m, output.truth.depth_m))
            self.raw.append((output.dead_reckoning.north_m, output.dead_reckoning.east_m))

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]


@pytest.mark.parametrize("mode", ["position_target", "mission"])
@pytest.mark.parametrize("fault", Fault)
def test_the_safety_watch_acts_on_an_autopilot_that_refuses_ignores_or_never_stops(mode, fault):
    dive = Dive(mode)
    run = MissionRun(True, Stop(action=Action.SURFACE))
    watch = SafetyWatch(SafetyConfig(), Fence((-900.0, -900.0, 900.0, -900.0, 900.0, 900.0, -900.0, 900.0), 50.0), 20.0)

    def fly(seconds):
        for _ in range(seconds):
            told = len(dive.events)
            dive.fly(1)
            for event in dive.events[told:]:
                if isinstance(event, AutopilotState):
                    watch.autopilot(event.report)
                if isinstance(event, AutopilotEstimate):
                    pose = (event.heading_rad, event.north_m, event.east_m, event.depth_m)
                    watch.odometry(dive.now_s, *pose, event.speed_mps)
            watch.step(dive.now_s, run)
            dive.link.stop(dive.now_s, run.status.stop)
            dive.flow()
        return set(run.limits)

    dive.leg(0, 20.0)  # ArduSub sinks along its leg
    dive.leg(1, 200.0)
    assert fly(40) == set(), "it follows its target"
    dive.vehicle.fault = fault
    if fault is not Fault.NONE and fault is not Fault.NEVER_STOPS:
        behind = dataclasses.replace(dive.link.targets[0], north_m=-400.0, east_m=-400.0)
        dive.link.command(dive.now_s, behind)
    else:
        run.command(Command.HOLD, "test")
    tripped = fly(14)
    assert tripped == (set() if fault is Fault.NONE else {"autopilot"}), run.limits
    if fault is Fault.NONE:
        return
    assert run.status.stop == Stop(action=Action.SURFACE)
    dive.vehicle.fault = Fault.NONE
    fly(60)
    assert dive.truth[-1][2] < 0.5, "it surfaces as soon as it obeys"
    assert dive.link.report.disobeys == ""


@pytest.mark.parametrize("mode", ["position_target", "mission"])
@pytest.mark.parametrize("late", [False, True], ids=["in time", "late"])
def test_legs_that_do_not_join_and_come_late_take_no_more_than_twice_their_time(mode, late):
    """The map moves against odometry by up to 3 m from leg to leg; every third decision is up to 10 s late."""
    rng = random.Random(4)
    dive, planner = Dive(mode), PlannerConfig()
    travel = Travel(VehicleConfig(speed_mps=1.5), 40)
    lengths, started_s, due_s = [], [], math.nan
    while travel.decided < 40:
        dive.fly(1)
        e = dive.of(AutopilotEstimate)[-1]
        travel.move(EstimatedState(dive.now_s, e.heading_rad, e.north_m, e.east_m))
        if not travel.due(dive.now_s, planner):
            continue
        if math.isnan(due_s):
            due_s = dive.now_s + (rng.uniform(3.0, 10.0) if late and travel.decided % 3 == 1 else 0.0)
        if dive.now_s < due_s:
            continue
        due_s = math.nan
        assert dive.link.counts["disobeyed"] == 0
        state, reanchored = travel.anchor(planner)
        if travel.decided and not reanchored:
            size_m, bearing = rng.uniform(0.0, 3.0), rng.uniform(-math.pi, math.pi)
            state += [0.0, size_m * math.cos(bearing), size_m * math.sin(bearing)]
        leg = MOTION.leg(travel.decided, state, rng.choice([0, len(MOTION.turns_rad) - 1, rng.randrange(11)]))
        travel.take(leg, dive.now_s, at_once=reanchored)
        dive.link.command(dive.now_s, end_of(leg))
        dive.flow()
        lengths.append(leg.length_m)
        started_s.append(dive.now_s)
    took_s = [b - a for a, b in pairwise(started_s)]
    assert max(took_s) <= 2.0 * max(lengths) / 1.5, [round(t) for t in took_s]
    assert travel.timed_out == 0


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_a_surfacing_through_mavlink_brings_a_fix_and_its_jump_is_undone(mode):
    """The compass is 4 degrees off: the estimate jumps by metres when GPS is there again."""
    dive = Dive(mode, **{"sim.compass.bias_deg": 4.0, "sim.gps.noise_m": 0.5})
    dive.leg(0, 300.0, surface=True)
    dive.leg(1, 200.0)
    dive.fly(420)
    depths = [depth for _, _, depth in dive.truth]
    up = [i for i, depth in enumerate(depths) if depth < 0.3 and i > 60]
    assert 20 <= len(up) <= 60, "as long as GPS needs, and no longer"
    north_0, east_0, _ = dive.truth[up[0]]
    assert math.hypot(north_0, east_0) == pytest.approx(300.0, abs=12.0), "where the leg ends"
    assert depths[-1] == pytest.approx(3.0, abs=0.5), "it has dived and gone on"
    assert math.hypot(dive.truth[-1][0] - north_0, dive.truth[-1][1] - east_0) > 60.0
    assert dive.link.counts["surfacings"] == 1
    estimates = dive.of(AutopilotEstimate)[-len(dive.truth) :]  # without those on deck
    # it returns to its place at once, so the jump is seen from one second to the next
    jump_m = max(math.dist((a.north_m, a.east_m), (b.north_m, b.east_m)) for a, b in pairwise(estimates[up[0] - 3 :]))
    (fix,) = dive.of(Fix)
    at = round(fix.stamp_s) - 1
    assert (fix.north_m, fix.east_m) == pytest.approx(dive.truth[at][:2], abs=3.0)
    # the dead-reckoned position has no jump: by then it is off by as much as before the fix, which tells by how much
    off_m = math.dist((fix.raw_north_m, fix.raw_east_m), dive.truth[at][:2])
    before_m = math.dist((estimates[up[0] - 3].north_m, estimates[up[0] - 3].east_m), dive.truth[up[0] - 3][:2])
    assert off_m == pytest.approx(before_m, abs=3.0)  # at the surface it is velocity times time
    assert off_m > 2.5, "there was something to find"
    assert jump_m > 2.0
    steps = [math.dist((a.raw_north_m, a.raw_east_m), (b.raw_north_m, b.raw_east_m)) for a, b in pairwise(estimates)]
    assert max(steps) < 3.0
    raw = estimates[up[0]].raw_north_m, estimates[up[0]].raw_east_m
    assert raw == pytest.approx(dive.raw[up[0]], abs=1.0), "as the simulated vehicle's own"


def test_gps_reports_no_fix_under_water():
    dive = Dive("position_target")
    seen = []
    reader = mavlink.MAVLink(None)
    receive = dive.link.receive
    dive.link.receive = lambda now_s, data: (seen.extend(reader.parse_buffer(data) or []), receive(now_s, data))
    dive.leg(0, 60.0)
    dive.fly(40)
    gps = [m for m in seen if m.get_type() == "GPS_RAW_INT"]
    assert len(gps) == 40
    assert {m.fix_type for m in gps[20:]} == {mavlink.GPS_FIX_TYPE_NO_FIX}
