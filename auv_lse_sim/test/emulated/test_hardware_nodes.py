"""micromodem_node and vehicle_link_node over real rclpy, as processes, against emulated hardware in the test."""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

sys.path.insert(0, str(Path(__file__).parent))

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_bench import Bench, bench
from sensor_msgs.msg import FluidPressure, NavSatFix, Range

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.topics.quality import LATCHED
from auv_lse_common.topics.ros_conversions import header
from auv_lse_comms.micromodem.log import read_entries, replay_log
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_msgs.msg import MissionState, ModemRx, ModemTx, Waypoint
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.host_ports import PtyPort
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.modem_rack import ModemRack

pytestmark = pytest.mark.ros

PAYLOAD = bytes(range(252))


def value_of(message: DiagnosticArray, key: str) -> str:
    return next(v.value for v in message.status[0].values if v.key == key)


def test_micromodem_node_sends_receives_and_finds_its_port_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sent = []
    link, log = tmp_path / "modem", tmp_path / "lines.log"
    with bench(tmp_path) as b:
        b.start(
            "auv_lse_comms",
            "micromodem_node",
            "/**:\n  ros__parameters:\n"
            f"    modem: {{kind: micromodem, port: {link}, log_file: {log}, backoff_max_s: 0.3}}\n",
            namespace="/auv2",
        )
        tx = b.publisher(ModemTx, "/auv2/modem/tx")
        rx = b.collect(ModemRx, "/auv2/modem/rx")
        diagnostics = b.collect(DiagnosticArray, "/auv2/diagnostics")
        rack = ModemRack({2: PtyPort(link)}, lambda k, packet: sent.append(packet), time.time())

        def until(condition, what):
            def served():
                rack.serve(time.time())
                rack.poll(time.time())
                b.keepers[0].tick(time.monotonic())  # prints what the node reports
                return condition()

            end = time.monotonic() + 30.0
            while not served():
                assert time.monotonic() < end, f"{what}; {b.words()}"
                b.executor.spin_once(timeout_sec=0.005)

        def ready():
            return rack.modems[2].address == 2 and diagnostics and diagnostics[-1].status[0].message == "idle"

        until(ready, "the modem was not configured")
        tx.publish(ModemTx(header=header(time.time()), source=2, destination=0, payload=PAYLOAD))
        until(lambda: sent, "the packet did not reach the water")
        assert (sent[0].source, sent[0].destination, sent[0].payload) == (2, 0, PAYLOAD)
        rack.arrive(
            0.0, 2, HeardPacket(start_s=time.time() - 2.0, source=1, destination=0, payload=PAYLOAD[::-1], snr_db=7.5)
        )
        until(lambda: rx, "nothing was received")
        assert (rx[0].source, rx[0].destination, bytes(rx[0].payload), rx[0].snr_db) == (1, 0, PAYLOAD[::-1], 7.5)
        assert math.isnan(rx[0].travel_s)
        stamp_s = rx[0].header.stamp.sec + rx[0].header.stamp.nanosec * 1e-9
        assert abs(stamp_s - time.time()) < 5.0

        rack.close()  # unplugged
        diagnostics.clear()
        b.until(lambda: diagnostics and diagnostics[-1].status[0].level != b"\x00", "word that the port is gone")
        rack = ModemRack({2: PtyPort(link)}, lambda k, packet: sent.append(packet), time.time())
        diagnostics.clear()
        until(ready, "the modem was not found again")
        tx.publish(ModemTx(header=header(time.time()), source=2, destination=0, payload=PAYLOAD))
        until(lambda: len(sent) == 2, "the second packet did not reach the water")
        shown = [line for line in capsys.readouterr().out.splitlines() if line.startswith("auv2: ")]
        assert [line.split(":")[1] for line in shown] == [" modem lost", " the modem is ready again"]
        for keeper in b.keepers:
            keeper.stop()
        rack.close()
    with log.open() as lines:
        again = replay_log(read_entries(lines), ModemConfig(kind="micromodem", port=str(link)))
    assert again.written == again.logged
    assert again.modem.counts["connections"] == 2


def report_until(b: Bench, dock: MavlinkDock, report: Report, condition, what: str) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end, f"{what}; {b.words()}"
        dock.report(2, time.time(), report)
        for _ in range(10):
            dock.serve(time.time())
            b.executor.spin_once(timeout_sec=0.005)


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_vehicle_link_node_gives_odometry_in_enu_and_hands_on_waypoints(tmp_path: Path, mode: str) -> None:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    legs = []
    vehicle = MavlinkVehicle(2, (0.5, 30.0, -40.0), 15.0, Origin(lat_deg=46.5, lon_deg=6.6), legs.append)
    dock = MavlinkDock({2: vehicle}, {2: f"udpout://127.0.0.1:{number}"})
    report = Report(
        heading_rad=0.5,
        north_m=30.0,
        east_m=-40.0,
        depth_m=4.0,
        speed_mps=1.5,
        yaw_rate_radps=0.1,
        altitude_m=11.0,
        pressure_pa=140551.6,
    )
    with bench(tmp_path) as b:
        b.start(
            "auv_lse_mavlink",
            "vehicle_link_node",
            "/**:\n  ros__parameters:\n    area: {origin_lat_deg: 46.5, origin_lon_deg: 6.6}\n"
            f"    link: {{kind: mavlink, endpoint: 'udpin://127.0.0.1:{number}', mode: {mode}}}\n",
            namespace="/auv2",
        )
        odometry = b.collect(Odometry, "/auv2/odometry")
        navsat = b.collect(NavSatFix, "/auv2/navsat")
        altitude = b.collect(Range, "/auv2/altitude")
        pressure = b.collect(FluidPressure, "/auv2/pressure")
        waypoint = b.publisher(Waypoint, "/auv2/waypoint", LATCHED)
        state = b.publisher(MissionState, "/auv2/mission/state", LATCHED)
        state.publish(MissionState(header=header(time.time()), revision=1, state=MissionState.RUNNING))
        report_until(b, dock, report, lambda: odometry and navsat and altitude and pressure, "no odometry")
        pose = odometry[-1].pose.pose
        assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx((-40.0, 30.0, -4.0), abs=1e-3)
        # heading 0.5 clockwise from north is pi/2 - 0.5 counter-clockwise from east
        assert 2.0 * math.atan2(pose.orientation.z, pose.orientation.w) == pytest.approx(math.pi / 2 - 0.5, abs=1e-6)
        assert odometry[-1].twist.twist.linear.x == pytest.approx(1.5)
        assert odometry[-1].twist.twist.angular.z == pytest.approx(-0.1)
        assert (navsat[-1].latitude, navsat[-1].longitude) == pytest.approx((46.50027, 6.59948), abs=1e-5)
        assert altitude[-1].range == pytest.approx(11.0, abs=0.01)
        assert pressure[-1].fluid_pressure == pytest.approx(140551.6, abs=0.5)
        # a node that was started again gets the last waypoint, whose leg may still be to come: it goes to its start
        again = mode == "position_target"
        waypoint.publish(
            Waypoint(
                header=header(time.time() - (3600.0 if again else 0.0)),  # long before any start of this node
                step=0,
                start_heading_rad=0.5,
                start_north_m=45.0,
                start_east_m=-30.0,
                end_heading_rad=0.5,
                end_north_m=60.0,
                end_east_m=-20.0,
                depth_m=4.0,
            )
        )
        report_until(b, dock, report, lambda: legs, "no leg")
        assert legs[0].end_state[1:] == pytest.approx((45.0, -30.0) if again else (60.0, -20.0), abs=0.012)
    dock.close()
