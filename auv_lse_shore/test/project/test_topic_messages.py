"""Messages to and from the values they carry, as received and as recorded: hand-worked numbers and round trips."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.map_codecs import MARKERS
from auv_lse_common.topics.records import (
    Altitude,
    BoundReport,
    CentersReport,
    FieldReport,
    GeodeticPosition,
    HealthReport,
    MissionOrder,
    Odometry,
    PlanReport,
    Pressure,
    Reception,
    RunReport,
    SimReport,
    TdmaReport,
    Transmission,
    Waypoint,
)
from auv_lse_common.topics.table import MISSION_TOPICS, TRUTH_TOPIC, VEHICLE_TOPICS, Topic
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition, DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.mission_run import Action, Command, RunState, RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_record.message_types import make_message, project_types
from auv_lse_sim.engine.conversions import checked_leg, pressure_pa

ROS = importlib.util.find_spec("rclpy") is not None and importlib.util.find_spec("auv_lse_msgs") is not None

TOPICS = {**VEHICLE_TOPICS, **MISSION_TOPICS, "truth/odometry": TRUTH_TOPIC}
PLAN = Plan(step=7, heading_rad=0.5, north_m=1.25, east_m=-2.5, actions=(1, 10, 0), naive_path=0xF4)
TOUR = dataclasses.replace(PLAN, tour=Tour(segment_legs=2, bearings=(0, 255, 64)))
LEG = MotionTable(MotionConfig()).leg(7, PLAN.state, 3)
STATUS = RunStatus(
    state=RunState.HOLDING,
    stop=Stop(action=Action.GO_TO, position_m=(1.0, 2.0)),
    team_abort=True,
    reason="leak",
    limits=("leak",),
)
MATE = MateNavigation(
    stamp_s=61.25,
    source=3,
    sent_s=61.0,
    raw_north_m=310.0,
    raw_east_m=-40.5,
    fix_raw_north_m=200.0,
    fix_raw_east_m=-10.0,
    fix_north_m=203.0,
    fix_east_m=-11.5,
    travel_s=0.25,
)
POSITION = DeadReckoning(stamp_s=12.5, heading_rad=0.5, north_m=10.25, east_m=-3.5, depth_m=2.0)
CORRECTED = CorrectedPosition(
    stamp_s=12.5,
    heading_rad=0.5,
    north_m=10.25,
    east_m=-3.5,
    depth_m=2.0,
    covariance=((0.0, 0.0, 0.0), (0.0, 400.0, -12.5), (0.0, -12.5, 16.0)),
)
ODOMETRY = Odometry(
    stamp_s=2.0,
    heading_rad=math.radians(30),
    north_m=10.0,
    east_m=20.0,
    depth_m=3.0,
    speed_mps=1.5,
    yaw_rate_radps=0.25,
    covariance=((0.01, 0.1, 0.25), (0.1, 4.0, 1.0), (0.25, 1.0, 9.0)),
)
ORDER = MissionOrder(stamp_s=1.0, command=int(Command.ABORT), team=True, source="a test", number=3)

#: A value of every topic that the table encodes and decodes.
VALUES: dict[str, Any] = {
    "sounding": Sounding(1.5, 10.0, 20.0, 15.0, 11.0, 19.0),
    "odometry": ODOMETRY,
    "truth/odometry": ODOMETRY,
    "dead_reckoning": POSITION,
    "corrected": CORRECTED,
    "fix": Fix(stamp_s=600.0, north_m=101.0, east_m=52.0, raw_north_m=104.5, raw_east_m=50.25, std_m=0.8),
    "altitude": Altitude(stamp_s=1.0, altitude_m=12.5, min_m=0.25, max_m=128.0),
    "pressure": Pressure(stamp_s=1.0, pressure_pa=201325.0),
    "mission/command": ORDER,
    "mission/end": ORDER,
    "mission/state": RunReport(stamp_s=1.5, revision=4, status=STATUS, warnings=("battery: low",)),
    "kernel_centers": CentersReport(
        stamp_s=1.0,
        revision=4,
        locations_m=np.array([[1.0, 2.0], [3.0, 4.0]]),
        depths_m=np.array([5.0, 6.0]),
        noise_std_m=np.array([0.3, 0.2]),
        position_effect_m=np.array([[0.5], [0.25]]),
    ),
    "field": FieldReport(
        stamp_s=1.0,
        north_m=np.array([0.0, 2.0, 4.0]),
        east_m=np.array([10.0, 12.0]),
        level_m=15.0,
        variance_scale=0.75,
        **{
            name: np.full((3, 2), value, np.float32)
            for name, value in {"mean_m": 15.0, "std_m": 1.5, "risk": 2.5, "p_safe": 0.5}.items()
        },
    ),
    "map/quality": Quality(stamp_s=1.0, revision=4, found_share=0.75, undiscovered_m=220.5, deviation_m=8.25),
    "plan": PlanReport(stamp_s=1.0, vehicle=3, plan=PLAN),
    "team/plans": PlanReport(stamp_s=1.0, vehicle=3, plan=TOUR),
    "waypoint": Waypoint(
        stamp_s=1.0,
        leg=LEG,
        speed_mps=1.5,
        depth_m=4.0,
        end=tuple(map(float, LEG.end_state)),
        then=Stop(action=Action.SURFACE),
    ),
    "planner/bound": BoundReport(
        stamp_s=3.0, step=2, jbar=5.0, reward_so_far=1.0, lower_bound=2.0, lower_bound_max=3.0, incumbent_value=4.0,
        incumbent_kept=True, iterations=9, planning_s=0.5, deadline_hit=True, map_revision=7, plans_heard=2,
        odometry_taken=2.75,
    ),
    "modem/tx": Transmission(stamp_s=1.0, source=1, payload=bytes(range(252))),
    "modem/rx": Reception(
        stamp_s=1.0, source=1, snr_db=17.5, sent_s=0.25, arrival_s=0.5, travel_s=0.25, payload=b"\x00\xff"
    ),
    "team/samples": Soundings.of_packet(4.0, 2, np.array([[1.5, 2.5, 15.25], [3.5, 4.5, 16.25]])),
    "team/navigation": MATE,
    "team/command": ORDER,
    "tdma": TdmaReport(
        stamp_s=1.0, vehicle=1, slot_owner=2, own_slot=False, next_own_slot=9.0, slots_used=3, slots_missed=1,
        packets_received=4, reasons=("slots.missed.late",), counts=(1,),
    ),
    "diagnostics": HealthReport(stamp_s=1.0, name="gp_node", level=1, text="slow", values={"update": "0.5"}),
    "/sim/status": SimReport(
        stamp_s=1.0, state=1, message="runs", steps=(3, 4), steps_total=8, packets_sent=5, packets_received=4,
        packets_lost=1, speed=12.5,
    ),
}  # fmt: skip


@pytest.fixture(
    scope="module",
    params=[pytest.param("ros", marks=[pytest.mark.ros, pytest.mark.skipif(not ROS, reason="needs ROS")]), "recorded"],
)
def make(request: pytest.FixtureRequest) -> Callable[[Topic, Any], Any]:
    """Makes a message of a topic's value: as nodes receive it, or as a recording gives it."""
    if request.param == "ros":
        from auv_lse_common.topics.ros_conversions import to_message

        return lambda topic, value: to_message(topic.kind, topic.encode(value, 2))
    store = project_types()

    def recorded(topic: Topic, value: Any) -> Any:
        message = make_message(store, topic.kind, topic.encode(value, 2))
        return store.deserialize_cdr(store.serialize_cdr(message, topic.kind), topic.kind)

    return recorded


def as_plain(value: Any) -> Any:
    """A value with its arrays as lists, so that it can be compared; headings to what a quaternion keeps."""
    if isinstance(value, Soundings):
        return [(*tuple(sounding)[:4], sounding.vehicle) for sounding in value]
    if dataclasses.is_dataclass(value):
        found = {f.name: as_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        if "heading_rad" in found:
            found["heading_rad"] = round(found["heading_rad"], 12)
        return found
    if isinstance(value, tuple):
        return [as_plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("name", sorted(VALUES))
def test_a_value_comes_back_from_its_message(make: Any, name: str) -> None:
    topic = TOPICS[name]
    back = topic.decode(make(topic, VALUES[name]))
    if name == "diagnostics":
        (back,) = back
    assert str(as_plain(back)) == str(as_plain(VALUES[name]))


def test_every_topic_that_is_encoded_and_decoded_is_tested_here() -> None:
    assert set(VALUES) == {name for name, topic in TOPICS.items() if topic.encode and topic.decode} - {"autopilot"}


def test_stamps_come_back_to_the_nanosecond(make: Any) -> None:
    for value in (0.0, 1.0, 0.9999999999, 1611.000000001, 1.8e9 + 0.25):
        message = make(TOPICS["sounding"], Sounding(value, 0.0, 0.0, 0.0))
        assert seconds(message.header.stamp) == pytest.approx(value, abs=1e-9 + np.spacing(value))
        assert message.header.frame_id == "map"


def test_odometry_is_enu_with_its_covariance(make: Any) -> None:
    # heading 30 deg; variances: heading 0.01, north 4, east 9; covariances: north-east 1, heading-north 0.1,
    # heading-east 0.25
    message = make(TOPICS["odometry"], ODOMETRY)
    p = message.pose.pose.position
    assert (p.x, p.y, p.z) == (20.0, 10.0, -3.0)
    matrix = np.asarray(message.pose.covariance).reshape(6, 6)
    assert (matrix[0, 0], matrix[1, 1], matrix[5, 5]) == (9.0, 4.0, 0.01)
    assert (matrix[0, 1], matrix[1, 5], matrix[0, 5]) == (1.0, -0.1, -0.25), "yaw grows against heading"
    assert message.child_frame_id == make(TRUTH_TOPIC, ODOMETRY).child_frame_id == "auv2/base_link"
    assert ODOMETRY.position_std_m == (2.0, 3.0)


def test_a_position_on_earth_has_the_covariance_of_east_and_north(make: Any) -> None:
    message = make(TOPICS["navsat"], GeodeticPosition.of(ODOMETRY, (46.5, 6.6)))
    assert message.latitude == pytest.approx(46.5 + 10.0 / 111_170.0, abs=1e-7), "10 m north"
    assert message.longitude == pytest.approx(6.6 + 20.0 / 76_800.0, abs=1e-6), "20 m east"
    assert message.altitude == -3.0, "robot_localization drops a fix without one"
    assert list(message.position_covariance) == [9.0, 1.0, 0.0, 1.0, 4.0, 0.0, 0.0, 0.0, 1e8], "ENU, row by row"
    assert (message.position_covariance_type, message.header.frame_id) == (1, "auv2/base_link")
    unknown = make(TOPICS["navsat"], GeodeticPosition.of(POSITION, (46.5, 6.6)))
    assert unknown.position_covariance_type == 0


def test_a_hostile_tour_is_decoded_as_it_is_and_not_sound(make: Any) -> None:
    hostile = make(TOPICS["plan"], PlanReport(stamp_s=1.0, vehicle=3, plan=TOUR))
    hostile.segment_legs = 0
    assert not TOPICS["plan"].decode(hostile).plan.tour.is_sound


def test_a_leg_with_numbers_that_are_not_finite_is_refused(make: Any) -> None:
    waypoint = VALUES["waypoint"]
    assert checked_leg(waypoint) == LEG
    assert not make(TOPICS["waypoint"], dataclasses.replace(waypoint, then=None)).last
    for change, words in (({"straight_m": math.nan}, "waypoint of step 7"), ({"radius_m": 0.0}, "radius above 0")):
        with pytest.raises(ValueError, match=words):
            checked_leg(dataclasses.replace(waypoint, leg=dataclasses.replace(LEG, **change)))


def test_a_packet_is_a_line_between_two_vehicles_that_fades(make: Any) -> None:
    here, there = (
        Plan(step=1, heading_rad=0.0, north_m=n, east_m=n + 1.0, actions=(), naive_path=0xFF) for n in (1.0, 5.0)
    )
    line = make(TOPICS["packets"], (3.0, 2, there, here))
    assert [(point.x, point.y) for point in line.points] == [(6.0, 5.0), (2.0, 1.0)], "from the sender"
    assert (line.ns, line.lifetime.sec, line.header.frame_id) == ("from auv2", 10, "map")


def test_a_path_lies_at_the_vehicles_depth(make: Any) -> None:
    path = make(TOPICS["path"], (1.0, np.array([[0.0, 1.0, 2.0], [math.pi / 2, 3.0, 4.0]]), 5.0))
    assert [(q.pose.position.x, q.pose.position.y, q.pose.position.z) for q in path.poses] == [(2, 1, -5), (4, 3, -5)]
    assert path.poses[1].pose.orientation.w == pytest.approx(1.0), "heading east is yaw 0"


def test_ragged_messages_are_refused(make: Any) -> None:
    message = make(TOPICS["kernel_centers"], VALUES["kernel_centers"])
    message.depth_m = [1.0]
    with pytest.raises(ValueError, match=r"differ in length: \[2, 2, 1, 2\]"):
        TOPICS["kernel_centers"].decode(message)
    message = make(TOPICS["team/samples"], VALUES["team/samples"])
    message.east_m = [1.0]
    with pytest.raises(ValueError, match=r"differ in length: \[2, 1, 2\]"):
        TOPICS["team/samples"].decode(message)


def test_maps_have_south_west_first_and_unknown_outside(make: Any) -> None:
    grid = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 40.0, 0.0, 40.0, 80.0, 0.0, 40.0))).grid(10.0)
    inside = np.where(grid.inside, 1.0, np.nan)
    layers = {"mean_m": 15.0 * inside, "std_m": inside, "risk": 2.5 * inside, "p_safe": 0.5 * inside}
    axes = {"north_m": grid.north_m, "east_m": grid.east_m}
    field = FieldReport(stamp_s=1.0, level_m=15.0, variance_scale=0.7, **axes, **layers)
    message = make(TOPICS["field"], field)
    assert (message.rows, message.columns) == grid.inside.shape
    assert (message.south_m, message.west_m) == (grid.north_m[0], grid.east_m[0])
    risk = make(TOPICS["risk_map"], (field, 5.0))
    cells = np.asarray(risk.data).reshape(risk.info.height, risk.info.width)
    assert set(np.unique(cells)) == {-1, 50}
    assert np.array_equal(cells == -1, ~grid.inside)
    assert risk.info.origin.position.x == pytest.approx(grid.east_m[0] - 5.0)


def test_an_isobath_becomes_segments_between_its_vertices(make: Any) -> None:
    lines = [np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]), np.array([[9.0, 8.0], [7.0, 6.0]])]
    isobath = SimpleNamespace(lines=lines, shallow_edge=[], deep_edge=lines[:1])
    markers = [make(TOPICS["isobath"], (1.0, index, isobath, 15.0)) for index in range(len(MARKERS))]
    ends = [[(p.x, p.y) for p in marker.points] for marker in markers]
    first = [(1.0, 0.0), (3.0, 2.0), (3.0, 2.0), (5.0, 4.0)]
    assert ends == [[*first, (8.0, 9.0), (6.0, 7.0)], [], first]
    assert all(p.z == -15.0 for p in markers[0].points)


def test_no_echo_is_infinite_and_depth_is_pressure(make: Any) -> None:
    assert make(TOPICS["altitude"], Altitude(stamp_s=1.0, altitude_m=math.nan)).range == math.inf
    assert pressure_pa(10.0) == pytest.approx(101325.0 + 98065.0, abs=4.0), "10 m of water, slightly compressed"


def test_an_autopilot_is_reported_as_it_reports_itself(make: Any) -> None:
    says = AutopilotReport(heard=True, armed=True, mode=4, mode_obeys=True, battery=0.5, leak=-1, stamp_s=1.0)
    message = make(TOPICS["autopilot"], SimpleNamespace(stamp_s=1.0, report=says, battery_v=15.5))
    assert TOPICS["autopilot"].decode(message) == says
    assert message.battery_v == 15.5


def test_a_position_that_is_unknown_is_marked(make: Any) -> None:
    sounding = make(TOPICS["sounding"], Sounding(1.5, 10.0, 20.0, 15.0))
    sounding.raw_north_m = sounding.raw_east_m = (
        0.0  # a driver that knows no dead-reckoned position may leave the fields as made
    )
    assert np.isnan(TOPICS["sounding"].decode(sounding)[4:6]).all()
    without = MateNavigation(stamp_s=61.25, source=3, sent_s=61.0, raw_north_m=310.0, raw_east_m=-40.5)
    back = TOPICS["team/navigation"].decode(make(TOPICS["team/navigation"], without))
    assert not back.has_fix
    assert math.isnan(back.travel_s)
    hostile = make(TOPICS["team/navigation"], MATE)
    hostile.has_fix = False
    assert not TOPICS["team/navigation"].decode(hostile).has_fix, "whatever the other fields hold"


def test_messages_of_older_recordings_lack_fields() -> None:
    """What a message lacks has its default; pings were marked by an empty payload."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=0))
    old = SimpleNamespace(header=header, source=1, destination=0, snr_db=9.0, travel_s=math.nan, payload=b"")
    heard = TOPICS["modem/rx"].decode(old)
    assert heard.ping
    assert math.isnan(heard.sent_s)
    plan = SimpleNamespace(
        header=header, vehicle=1, step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, actions=[1], heuristic=0xF1
    )
    assert TOPICS["plan"].decode(plan).plan.naive_path == 0xF1
