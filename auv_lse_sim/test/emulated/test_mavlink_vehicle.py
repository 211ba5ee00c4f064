"""The simulated autopilot: its legs by geometry, its protocol against our link, over bytes and over real UDP."""

import math
import random
import time
from dataclasses import replace

import pytest
from bench_of_autopilot import end_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.topics.records import Altitude, Pressure
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_comms.transport import UdpPort
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages.conversion import Target, mission_item
from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle
from auv_lse_sim.vehicle.target_leg import leg_to

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
MOTION = MotionTable(MotionConfig())
START = (0.3, 10.0, -20.0)


def test_legs_by_hand():
    straight = leg_to(0.0, 0.0, 0.0, (30.0, 0.0), 15.0)
    assert (straight.action_rad, straight.straight_m) == pytest.approx((0.0, 30.0))
    # a quarter turn to starboard ends one radius ahead and one to the right; 10 m further lies 10 m to the right
    turn = leg_to(0.0, 0.0, 0.0, (15.0, 25.0), 15.0)
    assert (turn.action_rad, turn.straight_m) == pytest.approx((math.pi / 2, 10.0))
    port = leg_to(math.pi, 0.0, 0.0, (-15.0, 15.0), 15.0)
    assert (port.action_rad, port.straight_m) == pytest.approx((-math.pi / 2, 0.0), abs=1e-6)


@given(st.floats(-3.1, 3.1), st.integers(0, len(MOTION.turns_rad) - 1))
def test_the_end_of_a_planners_leg_gives_that_leg_back(heading, action):
    leg = MOTION.leg(3, [heading, 100.0, 200.0], action)
    end = end_of(leg)
    back = leg_to(heading, 100.0, 200.0, (end.north_m, end.east_m), leg.radius_m, 3)
    assert back.action_rad == pytest.approx(leg.action_rad, abs=1e-6)
    assert back.straight_m == pytest.approx(leg.straight_m, abs=1e-5)


@given(st.floats(-3.1, 3.1), st.floats(-300, 300), st.floats(-300, 300))
def test_every_target_can_be_reached_and_is(heading, north, east):
    leg = leg_to(heading, 0.0, 0.0, (north, east), 15.0)
    assert leg.end_state[1:] == pytest.approx((north, east), abs=0.06)  # ON_CIRCLE_M
    assert leg.straight_m >= 0.0
    assert abs(leg.action_rad) < 2.0 * math.pi


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_target_a_little_inside_the_turning_circle_is_turned_to_more_tightly(side):
    """A quarter turn whose end has moved with the map by 3 m; by the other circle it would take a minute more."""
    leg = leg_to(0.0, 0.0, 0.0, (12.0, side * 15.0), 15.0, tightest_m=10.0)
    assert leg.end_state[1:] == pytest.approx((12.0, side * 15.0))
    assert (leg.radius_m, leg.straight_m) == pytest.approx((12.3, 0.0))  # (12^2 + 15^2) / (2 * 15)
    assert 1.5 < side * leg.action_rad < 2.0
    passed = leg_to(0.0, 0.0, 0.0, (12.0, side * 15.0), 15.0, tightest_m=15.0)
    assert (passed.radius_m, passed.action_rad) == pytest.approx((15.0, side * math.pi / 2))
    assert math.dist(passed.end_state[1:], (12.0, side * 15.0)) == pytest.approx(3.0)
    round_by = leg_to(0.0, 0.0, 0.0, (10.0, side * 15.0), 15.0, tightest_m=15.0)
    assert side * round_by.action_rad < -math.pi, "5 m inside"


class Sea:
    """One link and one autopilot, joined by bytes; `lose` says which datagrams never arrive."""

    def __init__(self, lose=lambda: False, **values):
        self.legs: list[Leg] = []
        self.vehicle = MavlinkVehicle(2, START, 15.0, ORIGIN, self.legs.append)
        self.link = VehicleLink(LinkConfig(kind="mavlink", **values), 2, ORIGIN)
        self.lose = lose
        self.now_s = 100.0
        self.told = []
        for _ in range(2):  # the origin is known after the first
            self.vehicle.send_on_deck(self.now_s)
            self.flow()

    def tick(self, north=10.0, east=-20.0, heading=0.3):
        self.now_s += 1.0
        report = Report(
            heading_rad=heading,
            north_m=north,
            east_m=east,
            depth_m=4.0,
            speed_mps=1.5,
            altitude_m=11.5,
            pressure_pa=140551.6,
        )
        self.vehicle.report(self.now_s, report)
        self.link.poll(self.now_s)
        self.flow()

    def flow(self):
        for _ in range(500):
            down, up = self.link.outgoing(), self.vehicle.outgoing()
            for datagram in down:
                if not self.lose():
                    self.vehicle.receive(self.now_s, datagram)
            for datagram in up:
                if not self.lose():
                    self.link.receive(self.now_s, datagram)
            self.told += self.link.events()
            if not down and not up:
                return
        raise AssertionError("link and vehicle never come to rest")

    def of(self, kind):
        return [event for event in self.told if isinstance(event, kind)]


def test_what_the_vehicle_reports_is_what_the_link_gives():
    sea = Sea()
    sea.tick(north=321.0, east=-54.0, heading=-2.5)
    sea.tick(north=321.0, east=-54.0, heading=-2.5 + 2 * math.pi)  # headings come back in -pi to pi
    for odometry in sea.of(AutopilotEstimate):
        assert (odometry.north_m, odometry.east_m, odometry.depth_m) == pytest.approx((321.0, -54.0, 4.0), abs=1e-3)
        assert odometry.heading_rad == pytest.approx(-2.5, abs=1e-6)
        assert odometry.speed_mps == pytest.approx(1.5, abs=1e-6)
    assert [o.stamp_s for o in sea.of(AutopilotEstimate)] == [101.0, 102.0]
    assert sea.of(Altitude)[0].altitude_m == pytest.approx(11.5, abs=0.005)
    assert sea.of(Pressure)[-1].pressure_pa == pytest.approx(140551.6, abs=0.1)
    assert sea.link.datum.autopilot == ORIGIN


def legs_of_a_walk(count, seed=1):
    rng = random.Random(seed)
    legs, state = [], START
    for step in range(count):
        legs.append(MOTION.leg(step, state, rng.randrange(len(MOTION.turns_rad))))
        state = tuple(float(x) for x in legs[-1].state_at(legs[-1].length_m))
    return legs


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_a_hundred_legs_through_the_link_are_the_planners_legs(mode):
    sea = Sea(mode=mode)
    sea.tick()
    legs = legs_of_a_walk(100)
    for leg in legs:
        sea.link.command(sea.now_s, end_of(leg))
        sea.flow()
        assert sea.link.quiet  # no time need pass
        heading, north, east = leg.state_at(leg.length_m - 1.0)
        sea.tick(float(north), float(east), float(heading))
    assert len(sea.legs) == 100
    for flown, planned in zip(sea.legs, legs, strict=True):
        assert flown.step == planned.step
        assert flown.end_state[1:] == pytest.approx(planned.state_at(planned.length_m)[1:], abs=0.012)
        assert math.remainder(flown.heading_rad - planned.heading_rad, 2 * math.pi) == pytest.approx(0.0, abs=0.01)
    assert len(sea.of(AutopilotEstimate)) == 101


def test_a_path_that_returns_to_an_earlier_position_is_travelled():
    """Four quarter turns: their last end is where they began, and the vehicle goes round once more."""
    sea = Sea()
    sea.tick()
    state = START
    for step in range(9):
        leg = MOTION.leg(step, state, len(MOTION.turns_rad) - 1)
        assert leg.action_rad == pytest.approx(math.pi / 2)
        sea.link.command(sea.now_s, end_of(leg))
        sea.flow()
        state = tuple(float(x) for x in leg.end_state)
        for along_m in range(2, 23, 2):
            heading, north, east = leg.state_at(float(along_m))
            sea.tick(float(north), float(east), float(heading))
    assert len(sea.legs) == 9


def test_a_target_is_turned_to_from_where_the_vehicle_is_if_it_comes_late_or_in_place_of_another():
    sea = Sea()
    sea.tick()
    first, second, third = legs_of_a_walk(3)
    sea.link.command(sea.now_s, end_of(first))
    sea.flow()
    for along_m, turned in ((first.length_m - 2.0, 0.0), (first.length_m + 3.0, 0.2)):  # it circles by then
        heading, north, east = (float(value) for value in first.state_at(along_m))
        sea.tick(north, east, heading + turned)
    sea.link.command(sea.now_s, end_of(second))
    sea.flow()
    late = sea.legs[1]
    assert (late.heading_rad, late.north_m, late.east_m) == pytest.approx((heading + 0.2, north, east))
    sea.tick(north + 1.0, east + 1.0, heading + 0.3)
    elsewhere = replace(end_of(third), begins_m=(north + 1.0, east + 1.0))
    sea.link.command(sea.now_s, elsewhere)
    sea.flow()
    other = sea.legs[2]
    assert (other.heading_rad, other.north_m, other.east_m) == pytest.approx((heading + 0.3, north + 1.0, east + 1.0))


@pytest.mark.parametrize("mode", ["position_target", "mission"])
@pytest.mark.parametrize("seed", range(6))
def test_datagrams_that_are_lost_delay_but_do_not_change_the_path(mode, seed):
    rng = random.Random(seed)
    sea = Sea(lose=lambda: rng.random() < 0.2, mode=mode, upload_retries=100)
    legs = legs_of_a_walk(8)
    for leg in legs:
        sea.link.command(sea.now_s, end_of(leg))
        for _ in range(200):  # near the end of the leg that it was given last: it cannot be on one that was lost
            here = sea.legs[-1] if sea.legs else leg
            heading, north, east = here.state_at(here.length_m - 1.0 if sea.legs else 0.0)
            sea.tick(float(north), float(east), float(heading))
            if len(sea.legs) > leg.step:
                break
    assert [leg.step for leg in sea.legs] == list(range(8))
    for flown, planned in zip(sea.legs, legs, strict=True):
        assert flown.end_state[1:] == pytest.approx(planned.state_at(planned.length_m)[1:], abs=0.012)


def test_a_target_inside_one_turning_circle_is_reached_by_the_other():
    sea = Sea()
    sea.tick()
    heading, north, east = START
    north, east = north - 5 * math.sin(heading), east + 5 * math.cos(heading)
    sea.link.command(sea.now_s, Target(north_m=north, east_m=east, depth_m=4.0, heading_rad=0.0))
    sea.flow()
    assert sea.legs[0].end_state[1:] == pytest.approx((north, east), abs=1e-3)
    assert sea.legs[0].action_rad < -math.pi


def test_blind_sensor_is_no_altitude():
    sea = Sea()
    sea.vehicle.report(101.0, Report(heading_rad=0.0, north_m=0.0, east_m=0.0, depth_m=4.0))
    sea.flow()
    assert math.isnan(sea.of(Altitude)[0].altitude_m)


def test_a_mission_with_a_gap_in_its_items_is_asked_for_again_and_given_up():
    legs = []
    vehicle = MavlinkVehicle(2, START, 15.0, ORIGIN, legs.append)
    gcs = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    reader = mavlink.MAVLink(None)
    vehicle.receive(0.0, mavlink.MAVLink_mission_count_message(2, 1, 3, 0).pack(gcs))
    report = Report(heading_rad=0.0, north_m=0.0, east_m=0.0, depth_m=4.0)
    said = []
    for second in range(1, 12):
        vehicle.report(float(second), report)
        for datagram in vehicle.outgoing():
            said += reader.parse_buffer(datagram)
    asked = [m for m in said if m.get_type() == "MISSION_REQUEST_INT"]
    assert [m.seq for m in asked] == [0] * 6
    (ack,) = [m for m in said if m.get_type() == "MISSION_ACK"]
    assert ack.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert legs == []


def test_another_mission_is_flown_from_the_index_of_the_last_one_unless_an_item_is_chosen():
    legs = []
    vehicle = MavlinkVehicle(2, START, 15.0, ORIGIN, legs.append)
    gcs = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    ends = [end_of(leg) for leg in legs_of_a_walk(5)]

    def upload(targets):
        vehicle.receive(0.0, mavlink.MAVLink_mission_count_message(2, 1, len(targets), 0).pack(gcs))
        for number, target in enumerate(targets):
            vehicle.receive(0.0, mission_item(target, Datum(ORIGIN, ORIGIN), number, 4.0, 2, 1).pack(gcs))

    upload(ends[:2])
    assert len(legs) == vehicle.current == 2
    upload(ends[2:])  # three items, of which the first two are taken for flown
    assert len(legs) == vehicle.current == 3
    assert legs[-1].end_state[1:] == pytest.approx((ends[4].north_m, ends[4].east_m), abs=0.02)
    vehicle.receive(0.0, mavlink.MAVLink_mission_set_current_message(2, 1, 0).pack(gcs))
    assert len(legs) == 5


def test_a_companion_with_the_autopilots_system_id_is_obeyed():
    legs = []
    vehicle = MavlinkVehicle(2, START, 15.0, ORIGIN, legs.append)
    companion = mavlink.MAVLink(None, srcSystem=2, srcComponent=191)
    targets = [end_of(leg) for leg in legs_of_a_walk(2)]
    vehicle.receive(0.0, mavlink.MAVLink_mission_count_message(2, 1, len(targets), 0).pack(companion))
    for number, target in enumerate(targets):
        vehicle.receive(0.0, mission_item(target, Datum(ORIGIN, ORIGIN), number, 4.0, 2, 1).pack(companion))
    assert len(legs) == 2


def test_twenty_vehicles_over_real_udp():
    team = range(1, 21)
    ears = {k: UdpPort("udpin", "127.0.0.1", 0) for k in team}
    legs = {k: [] for k in team}
    vehicles = {k: MavlinkVehicle(k, START, 15.0, None, legs[k].append) for k in team}
    dock = MavlinkDock(vehicles, {k: f"udpout://127.0.0.1:{ears[k].local_port}" for k in team})
    links = {k: VehicleLink(LinkConfig(kind="mavlink"), k, None) for k in team}
    report = Report(heading_rad=0.3, north_m=10.0, east_m=-20.0, depth_m=4.0, altitude_m=9.0)
    told = {k: [] for k in team}

    def carry(now_s):
        for k in team:
            links[k].receive(now_s, ears[k].read())
            links[k].poll(now_s)
            told[k] += links[k].events()
            for datagram in links[k].outgoing():
                ears[k].write(datagram)
        dock.serve(now_s)

    try:
        for k in team:
            dock.send_on_deck(k, 0.0, 101325.0)
        until = time.monotonic() + 10.0
        while not all(link.state is LinkState.UP for link in links.values()):
            assert time.monotonic() < until
            carry(0.0)
        for tick in range(1, 6):
            for k in team:
                dock.report(k, float(tick), report)
            while not all(sum(isinstance(e, AutopilotEstimate) for e in told[k]) == tick for k in team):
                assert time.monotonic() < until
                carry(float(tick))
        for k in team:
            links[k].command(5.0, Target(north_m=10.0 + k, east_m=40.0, depth_m=4.0, heading_rad=1.0))
        while not all(len(legs[k]) == 1 for k in team):
            assert time.monotonic() < until
            carry(5.0)
        assert all(legs[k][0].end_state[1] == pytest.approx(10.0 + k, abs=1e-4) for k in team)
    finally:
        dock.close()
        for ear in ears.values():
            ear.close()


def test_gps_tells_of_a_fix_in_a_mission_that_lies_nowhere_too():
    vehicle = MavlinkVehicle(2, START, 15.0, None, [].append)
    vehicle.report(1.0, Report(heading_rad=0.0, north_m=5.0, east_m=6.0, depth_m=0.0, gps_m=(3.0, -4.0)))
    reader = mavlink.MAVLink(None)
    said = [message for datagram in vehicle.outgoing() for message in reader.parse_buffer(datagram)]
    (gps,) = (message for message in said if message.get_type() == "GPS_RAW_INT")
    assert gps.fix_type == mavlink.GPS_FIX_TYPE_3D_FIX


def test_gps_tells_its_position_and_accuracy():
    seen, reader = [], mavlink.MAVLink(None)
    sea = Sea()
    sea.link.receive = lambda now_s, data: seen.extend(reader.parse_buffer(data) or [])
    position = {"heading_rad": 0.0, "north_m": 5.0, "east_m": 6.0, "depth_m": 0.0}
    sea.vehicle.report(sea.now_s, Report(**position, gps_m=(3.0, -4.0), gps_std_m=1.5))
    sea.flow()
    (fix,) = (m for m in seen if m.get_type() == "GPS_RAW_INT" and m.fix_type == mavlink.GPS_FIX_TYPE_3D_FIX)
    assert (fix.h_acc, fix.satellites_visible) == (1500, 9)
    assert (fix.lat * 1e-7, fix.lon * 1e-7) == pytest.approx(
        tuple(value * 1e-7 for value in Datum(ORIGIN, ORIGIN).to_geodetic(3.0, -4.0)), abs=1e-6
    )
