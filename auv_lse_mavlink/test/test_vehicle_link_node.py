"""vehicle_link_node in this process, spun by hand."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import itertools
import math
import socket
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from pymavlink.dialects.v20 import common as mavlink
from spinning import spun

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.topics.plan_codecs import decode_waypoint
from auv_lse_common.topics.quality import LATCHED
from auv_lse_common.topics.records import RunReport
from auv_lse_common.topics.ros_conversions import header
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_comms import driver_node
from auv_lse_mavlink import vehicle_link_node
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.targets.waypoints import ends_to_reach
from auv_lse_mavlink.vehicle_link_node import VehicleLinkNode
from auv_lse_msgs.msg import Sounding, Waypoint

pytestmark = pytest.mark.ros


class Autopilot:
    """Vehicle 2's: 20 Hz, at 30 m north, -40 m east, 4 m deep, over ground 15 m deep."""

    def __init__(self, port: int) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.start_s = time.monotonic()
        self.altitude_cm = 1100

    def speak(self) -> None:
        boot_ms = round(1000.0 * (time.monotonic() - self.start_s))
        for message in (
            mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, mavlink.MAV_STATE_ACTIVE, 3),
            mavlink.MAVLink_gps_global_origin_message(465000000, 66000000, 0, 0),
            mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_local_position_ned_message(boot_ms, 30.0, -40.0, 4.0, 0, 0, 0),
            mavlink.MAVLink_distance_sensor_message(boot_ms, 30, 8000, self.altitude_cm, 2, 0, 25, 255),
        ):
            with contextlib.suppress(ConnectionRefusedError):
                self.socket.send(message.pack(self.mav))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("wanted", [True, False])
def test_vehicle_link_node_gives_soundings(tmp_path: Path, wanted: bool) -> None:
    port = free_port()
    autopilot = Autopilot(port)
    parameters = (
        "area: {origin_lat_deg: 46.5, origin_lon_deg: 6.6}\n"
        f"link: {{kind: mavlink, endpoint: 'udpin://127.0.0.1:{port}', sounding_every_s: 0.5, soundings: {wanted}, "
        "pressure: none}"
    )
    with spun(VehicleLinkNode, tmp_path / "p.yaml", parameters) as s:
        if not wanted:
            assert s.node.count_publishers("/auv2/sounding") == 0
            return
        soundings = s.collect(Sounding, "/auv2/sounding")
        s.until(lambda: len(soundings) >= 3, autopilot.speak)
        for sounding in soundings:
            assert sounding.header.frame_id == "map"
            assert (sounding.north_m, sounding.east_m) == pytest.approx((30.0, -40.0), abs=1e-3)
            assert sounding.depth_m == pytest.approx(15.0, abs=0.01)
        stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in soundings]
        assert abs(stamps[-1] - time.time()) < 5.0
        assert all(math.ceil(b / 0.5) > math.ceil(a / 0.5) for a, b in itertools.pairwise(stamps))
    autopilot.socket.close()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("link: {kind: mavlink, endpoint: x}", "'x' is not an address; write /dev/NAME"),
        ("link: {kind: mavlink}\narea: {origin_lat_deg: 46.5}", "so one is missing"),
    ],
)
def test_a_link_that_cannot_start_names_the_parameter_that_is_wrong(
    tmp_path: Path, parameters: str, message: str
) -> None:
    named = pytest.raises(ParameterError, match=f"parameters of /auv2/.*{message}")
    with named, spun(VehicleLinkNode, tmp_path / "p.yaml", parameters):
        pass


@pytest.mark.parametrize("by_s", [6.0, -6.0])
def test_a_hosts_clock_that_is_set_loses_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_s: float) -> None:
    port = free_port()
    autopilot = Autopilot(port)
    parameters = f"link: {{kind: mavlink, endpoint: 'udpin://127.0.0.1:{port}', pressure: none}}"
    with spun(VehicleLinkNode, tmp_path / "p.yaml", parameters) as s:
        link, clock = s.node._autopilot.link, s.node.now_s
        s.until(lambda: link.report.heard, autopilot.speak)
        monkeypatch.setattr(s.node, "now_s", lambda: clock() + by_s)
        s.until(lambda: link.counts["clock_steps"])
        assert (link.counts["lost"], link.counts["clock_steps"]) == (0, 1)
    autopilot.socket.close()


def test_a_lost_autopilot_and_its_return_are_a_line_each_on_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    autopilot = Autopilot(port)
    parameters = f"link: {{kind: mavlink, endpoint: 'udpin://127.0.0.1:{port}', pressure: none, lost_after_s: 1.0}}"
    with spun(VehicleLinkNode, tmp_path / "p.yaml", parameters) as s:
        shown: list[str] = []
        monkeypatch.setattr(s.node, "report_on_terminal", shown.append)
        link = s.node._autopilot.link
        s.until(lambda: link.report.heard, autopilot.speak)
        s.until(lambda: link.counts["lost"])
        s.until(lambda: link.report.heard, autopilot.speak)
    autopilot.socket.close()
    lost, again = [text for text in shown if "link lost" in text or "heard" in text]
    assert lost.startswith("auv2: link lost: no heartbeat from the autopilot for 1.")
    assert again == "auv2: the autopilot is heard again"


def test_a_restarted_link_sends_no_target_before_it_has_the_missions_state(tmp_path: Path) -> None:
    here = AutopilotEstimate(
        stamp_s=1.0, heading_rad=0.0, north_m=10.0, east_m=1.0, depth_m=4.0, speed_mps=1.0, yaw_rate_radps=0.0
    )
    held = RunStatus(state=RunState.HOLDING, stop=Stop(action=Action.HOLD))
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        link = s.node._autopilot.link
        old = Waypoint(step=7, turn_rad=math.pi / 2, turn_radius_m=15.0, end_north_m=15.0)
        s.node._on_waypoint(decode_waypoint(old))
        s.node.on_event(here)
        assert link.targets == (), "the mission may be held, or aborted"
        s.node._on_state(RunReport(stamp_s=1.0, revision=1, status=held))
        s.node.on_event(here)
        assert [target.step for target in link.targets] == [7], "for when it goes on"


@pytest.mark.parametrize("state_first", [True, False])
def test_a_link_that_is_restarted_after_the_end_sends_the_vehicle_nowhere(tmp_path: Path, state_first: bool) -> None:
    here = AutopilotEstimate(
        stamp_s=1.0, heading_rad=0.0, north_m=110.0, east_m=1.0, depth_m=0.0, speed_mps=0.0, yaw_rate_radps=0.0
    )
    surface = Stop(action=Action.SURFACE)
    ended = RunReport(stamp_s=1.0, revision=1, status=RunStatus(state=RunState.ENDED, stop=surface))
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        link = s.node._autopilot.link
        old = dataclasses.replace(
            decode_waypoint(Waypoint(step=7, straight_m=20.0, turn_radius_m=15.0, end_north_m=20.0)), then=surface
        )
        if state_first:
            s.node._on_state(ended)
        s.node._on_waypoint(old)
        for _ in range(2):
            s.node._on_state(ended)
            s.node.on_event(here)
        assert link.targets == ()
        assert link._targets.stopped, "it stays at the surface, where it is"


def test_a_vehicle_whose_safety_node_is_silent_surfaces_until_its_state_arrives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody watches its limits, and it obeys no command."""
    monkeypatch.setattr(vehicle_link_node, "LONGEST_SILENCE_S", 2.0)
    surface = Stop(action=Action.SURFACE)
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        targets = s.node._autopilot.link._targets
        runs = RunReport(stamp_s=1.0, revision=1, status=RunStatus(state=RunState.RUNNING, stop=None))
        shown: list[str] = []
        monkeypatch.setattr(s.node, "report_on_terminal", shown.append)
        started_s = time.monotonic()
        s.node._on_state(runs)
        s.until(lambda: targets.stopped)
        assert time.monotonic() - started_s > 2.0
        assert targets._stop == surface
        assert len(shown) == 1
        assert "safety_node has been silent" in shown[0]
        s.node._on_state(runs)
        assert not targets.stopped, "it continues"
        held = RunStatus(state=RunState.HOLDING, stop=Stop(action=Action.HOLD))
        s.node._on_state(RunReport(stamp_s=1.0, revision=2, status=held))
        end_s = time.monotonic() + 4.0
        s.until(lambda: time.monotonic() > end_s)
        assert targets._stop == held.stop, "it has stopped anyway"


def test_a_restarted_link_takes_no_short_cut_to_a_newer_waypoint(tmp_path: Path) -> None:
    """Its first waypoint may be younger than it is: the end of the leg before may still be to come."""
    here = AutopilotEstimate(
        stamp_s=1.0, heading_rad=0.0, north_m=-3.0, east_m=2.0, depth_m=4.0, speed_mps=1.0, yaw_rate_radps=0.0
    )
    young = Waypoint(header=header(time.time() + 9.0), step=7, straight_m=20.0, turn_radius_m=15.0, end_north_m=20.0)
    next_one = Waypoint(header=header(time.time() + 10.0), step=8, start_north_m=20.0, end_north_m=40.0)
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        link = s.node._autopilot.link
        s.node._on_waypoint(decode_waypoint(young))
        s.node._on_waypoint(decode_waypoint(next_one))
        s.node._on_state(RunReport(stamp_s=1.0, revision=1, status=RunStatus(state=RunState.RUNNING, stop=None)))
        s.node.on_event(here)
        assert [target.step for target in link.targets] == [6, 7, 8]
        assert link.targets[-1].begins_m == (20.0, 0.0)
        s.node._on_waypoint(decode_waypoint(next_one))
        assert link.counts["targets_replaced"] == 0, "said again by a planner that was started again"


@pytest.mark.parametrize(
    ("position_m", "steps"),
    [((10.0, 1.0), [7]), ((12.0, 9.0), [7]), ((-3.0, 2.0), [6, 7])],
    ids=["on the leg", "inside of its turn", "before it"],
)
def test_a_restarted_link_does_not_turn_back_to_the_start_of_the_leg(
    position_m: tuple[float, float], steps: list[int]
) -> None:
    last = Waypoint(step=7, turn_rad=math.pi / 2, turn_radius_m=15.0, end_north_m=15.0, end_east_m=15.0)
    assert [end.step for end in ends_to_reach(decode_waypoint(last), *position_m)] == steps


SIM, DIVE, OTHER = "sim-1123-184534-3f2a", "auv2-1123-184534-77aa", "auv2-1123-184600-88bb"


def test_an_autopilot_gets_no_waypoint_of_a_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIVE_VARIABLE, DIVE)
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        legs = s.bench.create_publisher(Waypoint, "/auv2/waypoint", LATCHED)
        s.until(legs.get_subscription_count)
        for step, dive in enumerate((SIM, "", OTHER, DIVE)):
            legs.publish(Waypoint(dive=dive, step=step, end_north_m=9.0))
            s.until(
                lambda n=step: sum(sum(c.values()) for c in s.node.foreign_messages._counts.values()) + (n == 3) > n
            )
        s.until(lambda: s.node._last is not None)
        assert (s.node._waypoints, s.node._last[0]) == (1, 3)


def test_a_link_without_an_autopilot_logs_and_publishes_what_it_waits_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(driver_node, "_DIAGNOSTICS_PERIOD_S", 0.3)
    endpoint, printed = f"udpin://127.0.0.1:{free_port()}", list[str]()
    with spun(VehicleLinkNode, tmp_path / "p.yaml", f"link: {{kind: mavlink, endpoint: '{endpoint}'}}") as s:
        reports = s.collect(DiagnosticArray, "/auv2/diagnostics")
        text = f"waiting for a device on link.endpoint {endpoint}: no autopilot heard"

        def waiting() -> list[str]:
            """The lines on the terminal: /rosout may be silent in a process in which other tests had ROS contexts."""
            printed.extend(capfd.readouterr().err.splitlines())
            return [line for line in printed if text in line]

        s.until(lambda: len(reports) >= 3)
        s.until(waiting)
        assert len(waiting()) == 1, "the log has it once"
        assert reports[0].status[0].level == DiagnosticStatus.ERROR
