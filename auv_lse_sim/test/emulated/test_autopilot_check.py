"""scripts/autopilot-check against the simulated autopilot on UDP, and against one whose settings are wrong."""

from __future__ import annotations

import math
import socket
import threading
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_mavlink.autopilot_check import AutopilotCheck
from auv_lse_mavlink.check_command import main
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle


class Sea(threading.Thread):
    """A simulated vehicle on UDP, ten times a second, at 40 m/s along its legs."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.legs: list[Leg] = []
        self.along_m, self.position = 0.0, (0.0, 0.0, 0.0)
        origin = Origin(lat_deg=46.5, lon_deg=6.6)
        self.vehicle = MavlinkVehicle(2, self.position, 2.0, origin, self.legs.append)
        self.dock = MavlinkDock({2: self.vehicle}, {2: f"udpout://127.0.0.1:{port}"})
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.is_set():
            if self.legs:
                self.along_m += 4.0
                self.position = self.legs[0].state_at(min(self.along_m, self.legs[0].length_m))
                if self.along_m >= self.legs[0].length_m and len(self.legs) > 1:
                    del self.legs[0]
                    self.along_m = 0.0
            heading, north, east = map(float, self.position)
            pressure_pa = 98_000.0 + 4.0 * 9807.5
            report = Report(
                heading_rad=heading, north_m=north, east_m=east, depth_m=4.0, altitude_m=9.0, pressure_pa=pressure_pa
            )
            if not self.legs:
                self.dock.send_on_deck(2, time.time(), 98_000.0)
            self.dock.report(2, time.time(), report)
            for _ in range(10):
                self.dock.serve(time.time())
                time.sleep(0.01)
        self.dock.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_the_simulated_autopilot_lacks_nothing_and_flies_three_legs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = free_port()
    sea = Sea(port)
    sea.start()
    try:
        code = main([f"udpin://127.0.0.1:{port}", "--vehicle", "2", "--seconds", "2", "--legs"])
    finally:
        sea.over.set()
        sea.join(5.0)
    printed = capsys.readouterr().out
    assert code == 0, printed
    for words in (
        "ok      LOCAL_POSITION_NED: ",
        "ok      SCALED_PRESSURE2: ",
        "ok      depth is zeroed at 980.0 hPa; the autopilot's own depth is ",
        "ok      origin known",
        "ok      armed",
        "3 legs flown",
    ):
        assert words in printed, printed
    assert "note    SYS_STATUS: not sent" in printed
    assert printed.endswith("nothing is missing\n")
    assert math.hypot(*map(float, sea.position[1:])) < 5.0, "it is back"


class Sub:
    """An ArduSub that is not set up: plain pymavlink."""

    def __init__(self) -> None:
        self.check = AutopilotCheck(LinkConfig(), 2)
        self.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.reader = mavlink.MAVLink(None)
        self.now_s = 1_700_000_000.0

    def say(self, message: mavlink.MAVLink_message) -> None:
        self.check.receive(self.now_s, message.pack(self.mav))

    def answer(self, values: dict[str, float]) -> None:
        for datagram in self.check.outgoing():
            for message in self.reader.parse_buffer(datagram) or ():
                if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in values:
                    name = message.param_id.encode()
                    kind = mavlink.MAV_PARAM_TYPE_REAL32
                    self.say(mavlink.MAVLink_param_value_message(name, values[message.param_id], kind, 9, 0))

    def listen(self, seconds: int, mode: int = 19, flags: int = 0) -> None:
        for _ in range(seconds):
            self.now_s += 1.0
            self.say(mavlink.MAVLink_heartbeat_message(12, 3, flags, mode, mavlink.MAV_STATE_ACTIVE, 3))
            self.say(mavlink.MAVLink_attitude_message(1000, 0, 0, 0.0, 0, 0, 0))


def test_a_missing_package_is_named() -> None:
    sub = Sub()
    sub.listen(5)
    sub.answer({"FS_PILOT_INPUT": 2.0, "RNGFND1_ORIENT": 25.0, "SYSID_MYGCS": 255.0})
    texts = {finding.text: finding.ok for finding in sub.check.findings()}
    for words in (
        "LOCAL_POSITION_NED: 0.0 Hz; expected at least 1 Hz for odometry",
        "no GPS_GLOBAL_ORIGIN: expected one",
        "not armed: the mission waits until it is",
        "mode 19; expected one of [4]",
        "FS_PILOT_INPUT = 2; expected 0 or 1: 2 disarms after 3 s without a pilot",
        "SYSID_MYGCS = 255; expected 245: FS_GCS_ENABLE watches this system: link.system_id",
    ):
        assert texts[words] is False, texts
    assert texts["RNGFND1_ORIENT = 25 (the range finder looks down)"] is True
    assert texts["FS_LEAK_ENABLE: no answer (0 does not report a leak)"] is None
    assert sub.check.fly(sub.now_s) == "the autopilot is not armed"
    assert not sub.check.flying
    assert sub.check.findings()[-1].text == "flight: the autopilot is not armed"


def test_a_missing_autopilot_is_reported_with_those_present(capsys: pytest.CaptureFixture[str]) -> None:
    sub = Sub()
    sub.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    sub.listen(2)
    (finding,) = sub.check.findings()
    assert finding.text.endswith("heard instead: 7")
    assert main(["nowhere://x"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_the_pressure_that_is_sent_and_its_zero_are_reported() -> None:
    sub = Sub()
    sub.listen(5)

    def found() -> dict[str, bool | None]:
        return {finding.text: finding.ok for finding in sub.check.findings()}

    assert found()["SCALED_PRESSURE2: not sent; expected it for depth (link.pressure; none for a boat)"] is False
    sub.say(mavlink.MAVLink_scaled_pressure3_message(1000, 960.0, 0.0, 1000))
    assert any(text.endswith("Sent instead: SCALED_PRESSURE3") for text in found())
    for _ in range(20):  # disarmed at 10 m
        sub.listen(1)
        sub.say(mavlink.MAVLink_scaled_pressure2_message(1000, 1960.0, 0.0, 1000))
    assert any("zero of pressure refused: got 1960 hPa" in text and ok is False for text, ok in found().items())
    for _ in range(60):
        sub.listen(1)
        sub.say(mavlink.MAVLink_scaled_pressure2_message(1000, 960.0, 0.0, 1000))
        sub.say(mavlink.MAVLink_local_position_ned_message(1000, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0))
    wanted = (
        "depth is zeroed at 960.0 hPa; the autopilot's own depth is +8.00 m off pressure depth; targets are shifted"
    )
    assert any(text.startswith(wanted) and ok for text, ok in found().items()), found()
