"""The nodes of this package in this process, spun by hand."""

from __future__ import annotations

import contextlib
import importlib.util
import math
import socket
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import itertools

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from pymavlink.dialects.v20 import common as mavlink
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.process.dive import DIVE_VARIABLE, tagged_frame
from auv_lse_common.topics.plan_codecs import decode_waypoint
from auv_lse_common.topics.quality import EVERY, LATCHED
from auv_lse_common.topics.records import RunReport
from auv_lse_common.topics.ros_conversions import header
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan as PlanOfMate
from auv_lse_comms import driver_node
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.mavlink.messages.events import AutopilotEstimate
from auv_lse_comms.mavlink.vehicle_link_node import VehicleLinkNode
from auv_lse_comms.mavlink.waypoints import ends_to_reach
from auv_lse_comms.micromodem.micromodem_node import MicromodemNode
from auv_lse_comms.modem_node import ModemNode
from auv_lse_comms.packet.codec import decode
from auv_lse_msgs.msg import ModemTx, Plan, Sounding, TdmaStatus, Waypoint

pytestmark = pytest.mark.ros


class Spun:
    """A node with its parameters, and a second node beside it."""

    def __init__(self, make: Callable[[], Any], file: Path, namespace: str) -> None:
        rclpy.init(args=["--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(file)])
        self.executor = SingleThreadedExecutor()
        self.node = make()
        self.bench = rclpy.create_node("bench", use_global_arguments=False)
        self.executor.add_node(self.node)
        self.executor.add_node(self.bench)

    def collect(self, kind: type, topic: str) -> list[Any]:
        messages: list[Any] = []
        self.bench.create_subscription(kind, topic, messages.append, EVERY)
        return messages

    def until(self, condition: Callable[[], Any], each: Callable[[], None] = lambda: None) -> None:
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end, "did not happen in time"
            each()
            self.executor.spin_once(timeout_sec=0.05)


@contextlib.contextmanager
def spun(make: Callable[[], Any], file: Path, parameters: str, namespace: str = "/auv2") -> Iterator[Spun]:
    """`make()` in its namespace with the parameters (YAML, below ros__parameters)."""
    file.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in parameters.splitlines()))
    found = None
    try:
        found = Spun(make, file, namespace)
        yield found
    finally:
        if found is not None:
            found.executor.shutdown()
            found.node.destroy_node()
            found.bench.destroy_node()
        rclpy.try_shutdown()


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


@pytest.mark.parametrize(("configured", "asked", "sent"), [(0, 0, 0), (3, 0, 3), (3, 5, 5)])
def test_micromodem_node_sends_to_the_configured_destination(
    tmp_path: Path, configured: int, asked: int, sent: int
) -> None:
    parameters = f"modem: {{kind: micromodem, port: /dev/does-not-exist, destination: {configured}}}"
    with spun(MicromodemNode, tmp_path / "p.yaml", parameters) as s:
        s.node._on_transmit(ModemTx(source=2, destination=asked, payload=bytes(252)))
        assert s.node._modem.modem._sending._waiting.destination == sent


def test_modem_node_refuses_a_slot_order_with_a_stranger_and_goes_on(tmp_path: Path) -> None:
    with spun(ModemNode, tmp_path / "p.yaml", "mission: {vehicles: 3, steps: 10}\ntdma: {order: [1, 2, 3]}") as s:
        (result,) = s.node.set_parameters([Parameter("tdma.order", value=[1, 4])])
        assert not result.successful
        assert result.reason == (
            "parameters of /auv2/modem_node: tdma.order: got (1, 4); [4] are not among the vehicles 1..3"
        )
        (result,) = s.node.set_parameters([Parameter("tdma.order", value=[3, 2, 1])])
        assert result.successful


@pytest.mark.parametrize(
    ("make", "namespace", "parameters", "message"),
    [
        (
            ModemNode,
            "/auv4",
            "mission: {vehicles: 3, steps: 10}",
            "address: got 4; expected a vehicle of the mission, 1..3",
        ),
        (MicromodemNode, "/auv200", "modem: {kind: micromodem, port: /dev/x}", "modem address: got 200"),
        (MicromodemNode, "/auv2", "modem: {kind: micromodem, port: x}", "address 'x': expected /dev/NAME"),
        (VehicleLinkNode, "/auv2", "link: {kind: mavlink, endpoint: x}", "address 'x': expected /dev/NAME"),
        (VehicleLinkNode, "/auv2", "link: {kind: mavlink}\narea: {origin_lat_deg: 46.5}", "expected both"),
    ],
)
def test_a_node_that_cannot_start_names_the_parameter_that_is_wrong(
    tmp_path: Path, make: Callable[[], Any], namespace: str, parameters: str, message: str
) -> None:
    named = pytest.raises(ParameterError, match=f"parameters of {namespace}/.*{message}")
    with named, spun(make, tmp_path / "p.yaml", parameters, namespace):
        pass


def test_modem_node_sends_useful_samples_and_takes_them_back(tmp_path: Path) -> None:
    parameters = (
        "mission: {vehicles: 2, steps: 50}\n"
        "area: {polygon_m: [0.0, 0.0, 300.0, 0.0, 300.0, 400.0, 0.0, 400.0]}\n"
        "tdma: {order: [2, 1], slot_s: 2.0, guard_s: 0.1, send_duration_s: 0.5, max_range_m: 500.0}\n"
        "packet: {selection: useful, navigation: false}"
    )
    with spun(ModemNode, tmp_path / "p.yaml", parameters) as s:
        sent = s.collect(ModemTx, "/auv2/modem/tx")
        soundings = s.bench.create_publisher(Sounding, "/auv2/sounding", EVERY)
        plans = s.bench.create_publisher(Plan, "/auv2/plan", LATCHED)
        failed = s.bench.create_publisher(ModemTx, "/auv2/modem/failed", EVERY)
        s.until(lambda: all(p.get_subscription_count() for p in (soundings, plans, failed)))
        for k in range(60):
            place = {"north_m": 5.0 * k, "east_m": 37.0 * k % 400.0, "depth_m": 14.0 + 0.03 * k}
            soundings.publish(Sounding(header=header(float(k)), **place))
        s.until(lambda: s.node._intake.bridge.unsent + len(s.node._intake._soundings) == 60)
        plans.publish(Plan(vehicle=2, step=1, north_m=5.0, actions=[5], naive_path=0xFF))
        s.until(lambda: sent)
        failed.publish(ModemTx(header=sent[0].header, source=2))
        s.until(lambda: s.node._bridge.counts["slots.missed.modem"] == 1)
        assert len(sent) == 1
        s.until(lambda: len(sent) == 2)
        first, again = (decode(bytes(message.payload)).samples for message in sent)
        assert len(first) == 19
        assert (first == again).all(), "worth as much as before"


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
    ("place_m", "steps"),
    [((10.0, 1.0), [7]), ((12.0, 9.0), [7]), ((-3.0, 2.0), [6, 7])],
    ids=["on the leg", "inside of its turn", "before it"],
)
def test_a_restarted_link_does_not_turn_back_to_the_start_of_the_leg(
    place_m: tuple[float, float], steps: list[int]
) -> None:
    last = Waypoint(step=7, turn_rad=math.pi / 2, turn_radius_m=15.0, end_north_m=15.0, end_east_m=15.0)
    assert [end.step for end in ends_to_reach(decode_waypoint(last), *place_m)] == steps


def test_a_mates_navigation_is_published_before_its_samples(tmp_path: Path) -> None:
    """A map placed its samples by it: those that came first stayed where they were told."""
    parameters = "mission: {vehicles: 2, steps: 50}"
    mate = ModemBridge(TdmaConfig(), PacketConfig(navigation=True), 1, 2)
    mate.set_plan(PlanOfMate(step=1, heading_rad=0.0, north_m=5.0, east_m=0.0, actions=(5,), naive_path=0xFF))
    mate.set_dead_reckoning(DeadReckoning(stamp_s=0.5, heading_rad=0.0, north_m=1.0, east_m=2.0, depth_m=3.0))
    mate.add_soundings([[float(k), 3.0 * k, 0.0, 14.0, 3.0 * k, 0.0] for k in range(10)])
    payload = mate.poll(0.5)
    assert payload is not None
    with spun(ModemNode, tmp_path / "p.yaml", parameters) as s:
        published: list[str] = []
        for name in ("_team_navigation", "_team_samples"):
            spy = types.SimpleNamespace(publish=lambda message, name=name: published.append(name))
            setattr(s.node, name, spy)
        s.node._intake.add_packet(2.5, 1, payload)
        s.node.publish_received(3.0)
    assert published == ["_team_navigation", "_team_samples"]


SIM, DIVE, OTHER = "sim-1123-184534-3f2a", "auv2-1123-184534-77aa", "auv2-1123-184600-88bb"


@pytest.mark.parametrize("own", ["", DIVE], ids=["started by hand", "a dive"])
def test_hardware_takes_nothing_that_a_simulation_or_another_dive_has_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: str
) -> None:
    """It failed: a modem driver that was started by hand was handed the packets of a simulated mission."""
    monkeypatch.setenv(DIVE_VARIABLE, own)
    with spun(MicromodemNode, tmp_path / "p.yaml", "modem: {kind: micromodem, port: /dev/does-not-exist}") as s:
        taken: list[int] = []
        monkeypatch.setattr(s.node._modem, "send", lambda now_s, payload, to: taken.append(payload[0]) or len(taken))
        reports = s.collect(DiagnosticArray, "/auv2/diagnostics")
        packets = s.bench.create_publisher(ModemTx, "/auv2/modem/tx", EVERY)
        s.until(lambda: packets.get_subscription_count() and s.bench.count_publishers("/auv2/diagnostics"))
        for number, dive in enumerate((SIM, OTHER, own)):
            packets.publish(ModemTx(header=Header(frame_id=tagged_frame(dive, "map")), payload=bytes([number] * 252)))
        s.until(lambda: taken)
        assert taken == [2]
        s.until(lambda: any(OTHER in status.message for report in reports for status in report.status))
        status = reports[-1].status[0]
        assert (status.name, int.from_bytes(status.level, "little")) == ("/auv2/micromodem_node", 1)
        assert f"{SIM} publishes in this ROS domain, too: 1 messages ignored (modem/tx)" in status.message


def test_an_autopilot_gets_no_waypoint_of_a_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIVE_VARIABLE, DIVE)
    with spun(VehicleLinkNode, tmp_path / "p.yaml", "link: {kind: mavlink}") as s:
        legs = s.bench.create_publisher(Waypoint, "/auv2/waypoint", LATCHED)
        s.until(legs.get_subscription_count)
        for step, dive in enumerate((SIM, "", OTHER, DIVE)):
            legs.publish(Waypoint(header=Header(frame_id=tagged_frame(dive, "map")), step=step, end_north_m=9.0))
            s.until(lambda n=step: sum(sum(c.values()) for c in s.node.strangers._counts.values()) + (n == 3) > n)
        s.until(lambda: s.node._last is not None)
        assert (s.node._waypoints, s.node._last[0]) == (1, 3)


def test_a_node_names_its_dive_in_what_it_publishes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIVE_VARIABLE, DIVE)
    with spun(ModemNode, tmp_path / "p.yaml", "mission: {vehicles: 2, steps: 3}") as s:
        found = s.collect(TdmaStatus, "/auv2/tdma")
        s.until(lambda: found)
        assert found[0].header.frame_id == f"{DIVE}/map"


@pytest.mark.parametrize(
    ("make", "parameters", "text"),
    [
        (MicromodemNode, "modem: {kind: micromodem, port: /dev/no-modem}", "modem.port /dev/no-modem: "),
        (
            VehicleLinkNode,
            "link: {kind: mavlink, endpoint: 'udpin://127.0.0.1:%d'}",
            "link.endpoint udpin://127.0.0.1:%d: no autopilot heard",
        ),
    ],
)
def test_a_driver_without_its_device_logs_and_publishes_what_it_waits_for(
    make: Callable[[], Any], parameters: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert driver_node._DIAGNOSTICS_PERIOD_S < 5.0
    monkeypatch.setattr(driver_node, "_DIAGNOSTICS_PERIOD_S", 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    parameters, text = (line % port if "%d" in line else line for line in (parameters, text))
    with spun(make, tmp_path / "p.yaml", parameters) as s:
        logs = s.collect(Log, "/rosout")
        reports = s.collect(DiagnosticArray, "/auv2/diagnostics")
        waiting = lambda: [log.msg for log in logs if log.msg.startswith(f"waiting for a device on {text}")]
        s.until(lambda: waiting() and len(reports) >= 3)
        assert len(waiting()) == 1, "the log has it once"
        assert reports[0].status[0].level == DiagnosticStatus.ERROR
