"""auv_lse autopilot-check against the simulated autopilot on UDP, and against one whose settings are wrong."""

from __future__ import annotations

import math
import socket
import threading
import time
from typing import Any

import pytest
from bench_of_autopilot import free_udp_port
from pymavlink.dialects.v20 import common as mavlink
from verb_main import verb_main

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.device_findings import Finding
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_mavlink import check_command
from auv_lse_mavlink.autopilot_check import AutopilotCheck, CheckOptions
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_sim.emulated.ardupilot.parameter_protocol import ParameterProtocol
from auv_lse_sim.emulated.ardupilot.parameters import ROVER_DEFAULTS, SUB_DEFAULTS, Parameters
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle

main = verb_main("autopilot-check")


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


def test_the_simulated_autopilot_lacks_nothing_and_flies_three_legs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = free_udp_port()
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
        "note    depth is zeroed at 980.0 hPa, where the sensor is now. If the vehicle floats, all depths",
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
    sub.answer({"FS_PILOT_INPUT": 2.0, "RNGFND1_ORIENT": 25.0, "SYSID_MYGCS": 255.0, "FS_GCS_ENABLE": 2.0})
    texts = {finding.text: finding.ok for finding in sub.check.findings()}
    for words in (
        "LOCAL_POSITION_NED: 0.0 Hz; at least 1 Hz are needed for odometry. Without GPS it begins when an origin is "
        "set: --origin LAT LON sets one",
        "no GPS_GLOBAL_ORIGIN. Wait for GPS; without GPS, --origin LAT LON sets it",
        "not armed: the mission waits until it is. If it is armed while no stack runs: the vehicle disarms and drifts",
        "mode 19; targets are followed in mode 4. Arm first, then choose it: arming clears it",
        "FS_PILOT_INPUT = 2; set 1 (the vehicle disarms 3 s after a joystick stops, or without one)",
        "FS_GCS_ENABLE = 2; set 4 (the vehicle disarms and drifts)",
        "SYSID_MYGCS = 255; set 245 (FS_GCS_ENABLE watches this system: link.system_id)",
    ):
        assert texts[words] is False, texts
    assert texts["RNGFND1_ORIENT = 25 (the range finder looks down)"] is True
    assert texts["FS_LEAK_ENABLE: no answer"] is None
    assert sub.check.fly(sub.now_s) == "the autopilot is not armed"
    assert not sub.check.flying
    assert sub.check.findings()[-1].text == "flight: the autopilot is not armed"


def test_other_components_of_the_vehicle_are_not_its_autopilot() -> None:
    """BlueOS's camera manager, and a sonar whose distances the autopilot does not pass on."""
    sub = Sub()
    for component in (100, 194):
        sub.listen(5)
        autopilot, sub.mav = sub.mav, mavlink.MAVLink(None, srcSystem=2, srcComponent=component)
        sub.say(mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, mavlink.MAV_STATE_STANDBY, 3))
        for _ in range(20):
            sub.say(mavlink.MAVLink_distance_sensor_message(1000, 30, 5000, 900, 1, 0, 25, 0))
        sub.mav = autopilot
    sub.check.ask()
    sub.answer({"FS_GCS_ENABLE": 2.0})
    texts = {finding.text: finding.ok for finding in sub.check.findings()}
    assert texts["FS_GCS_ENABLE = 2; set 4 (the vehicle disarms and drifts)"] is False, texts
    assert any(text.startswith("DISTANCE_SENSOR: 0.0 Hz; at least") and ok is False for text, ok in texts.items())


def test_an_autopilot_with_another_component_id_is_named() -> None:
    sub = Sub()
    sub.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=7)
    sub.listen(2)
    (finding,) = sub.check.findings()
    assert finding.text.endswith("heard instead: 2 (component 7)"), finding.text


def test_senders_of_other_datagrams_are_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """ArduPilot's own number is 1, whatever the vehicle's."""
    monkeypatch.setattr(check_command, "_HEARD_S", 2.0)
    port, over = free_udp_port(), threading.Event()
    beat = mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3).pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not over.wait(0.1):
                sender.sendto(beat, ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        assert main([f"udpin://127.0.0.1:{port}", "--vehicle", "2", "--seconds", "1"]) == 1
    finally:
        over.set()
        thread.join(5.0)
    assert "(link.autopilot_system_id, or the vehicle's number); heard instead: 1 (comp" in capsys.readouterr().out


def test_a_missing_autopilot_is_reported_with_those_present(capsys: pytest.CaptureFixture[str]) -> None:
    sub = Sub()
    sub.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    sub.listen(2)
    (finding,) = sub.check.findings()
    assert finding.text.endswith("heard instead: 7 (component 1)")
    assert main(["nowhere://x"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_the_pressure_that_is_sent_and_its_zero_are_reported() -> None:
    sub = Sub()
    sub.listen(5)

    def found() -> dict[str, bool | None]:
        return {finding.text: finding.ok for finding in sub.check.findings()}

    missing = "SCALED_PRESSURE2: not sent, but depth needs it (link.pressure; none for a boat)"
    assert found()[f"{missing}. Set SR0_RAW_SENS (MAV1_RAW_SENS since 4.8), then reboot"] is False
    sub.say(mavlink.MAVLink_scaled_pressure3_message(1000, 0.0, 0.0, 4001))  # ArduSub's temperature sensor
    assert not any("Sent instead" in text for text in found())
    sub.say(mavlink.MAVLink_scaled_pressure3_message(1000, 960.0, 0.0, 1000))
    assert any(text.endswith("Sent instead: SCALED_PRESSURE3") for text in found())
    for _ in range(20):  # disarmed at 10 m
        sub.listen(1)
        sub.say(mavlink.MAVLink_scaled_pressure2_message(1000, 1960.0, 0.0, 1000))
    assert any("zero of pressure refused: 1960 hPa" in text and ok is False for text, ok in found().items())
    for _ in range(60):
        sub.listen(1)
        sub.say(mavlink.MAVLink_scaled_pressure2_message(1000, 960.0, 0.0, 1000))
        sub.say(mavlink.MAVLink_local_position_ned_message(1000, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0))
    wanted = "the autopilot's own depth is +8.00 m off pressure depth; targets are shifted"
    assert any(text.startswith(wanted) and ok for text, ok in found().items()), found()
    assert any(text.startswith("depth is zeroed at 960.0 hPa, where") and ok is None for text, ok in found().items())


def test_a_pressure_that_comes_too_rarely_names_its_parameter() -> None:
    sub = Sub()
    sub.listen(5)
    sub.say(mavlink.MAVLink_scaled_pressure2_message(1000, 960.0, 0.0, 1000))
    texts = {finding.text: finding.ok for finding in sub.check.findings()}
    cure = "Set SR0_RAW_SENS (MAV1_RAW_SENS since 4.8), then reboot"
    assert texts[f"SCALED_PRESSURE2: 0.2 Hz; depth needs at least 1 Hz. {cure}"] is False, texts


class Firmware(Sub):
    """An ArduPilot with all the parameters of a new one, under the names of 4.5 or of 4.8."""

    def __init__(self, defaults: dict[str, tuple[float, int]], renamed: bool, **options: Any) -> None:
        super().__init__()
        self.check = AutopilotCheck(LinkConfig(), 2, CheckOptions(**options))
        self.kind = 12 if "FS_PILOT_INPUT" in defaults else 11
        self.has = Parameters(defaults, renamed)
        self.protocol = ParameterProtocol(self.has, self.say)

    def listen(self, seconds: int, mode: int = 19, flags: int = 0) -> None:
        for _ in range(seconds):
            self.now_s += 1.0
            self.say(mavlink.MAVLink_heartbeat_message(self.kind, 3, flags, mode, mavlink.MAV_STATE_ACTIVE, 3))
            self.check.ask()
            self.answer({})

    def answer(self, values: dict[str, float]) -> None:
        for datagram in self.check.outgoing():
            for message in self.reader.parse_buffer(datagram) or ():
                self.protocol.handle(message)

    def apply(self) -> list[Finding]:
        parameters = self.check.parameters
        parameters.apply(self.check.changes())
        while parameters.is_applying:
            parameters.step()
            self.answer({})
        return parameters.applied()


@pytest.mark.parametrize("renamed", [False, True])
def test_a_new_ardusub_is_set_up_and_verified(renamed: bool) -> None:
    sub = Firmware(SUB_DEFAULTS, renamed, depth_m=15.0)
    sub.listen(5)
    changes = {change.name: (change.before, change.after) for change in sub.check.changes()}
    assert changes["FS_GCS_ENABLE"] == (2.0, 4.0)
    assert changes["FS_PILOT_INPUT"] == (2.0, 1.0)
    assert changes["RNGFND1_TYPE"] == (0.0, 10.0)
    assert changes["MAV_GCS_SYSID" if renamed else "SYSID_MYGCS"] == (255.0, 245.0)
    reach = changes["RNGFND1_MAX" if renamed else "RNGFND1_MAX_CM"]
    assert reach == pytest.approx((7.0, 23.0) if renamed else (700.0, 2300.0))
    for group in ("POSITION", "EXTRA1", "EXTRA3", "RAW_SENS", "EXT_STAT"):
        assert changes[f"MAV1_{group}" if renamed else f"SR0_{group}"] == (0.0, 4.0)
    found = sub.apply()
    assert [finding for finding in found if finding.ok is False] == []
    assert "reboot the autopilot" in found[-1].text
    assert ("MAV1_RAW_SENS" if renamed else "SR0_RAW_SENS") in found[-1].text
    assert sub.has["RNGFND1_MAX_CM"] == pytest.approx(2300.0)
    assert sub.check.changes() == []


def test_a_parameter_that_cannot_be_set_is_named() -> None:
    boat = Firmware(ROVER_DEFAULTS, False)
    boat.listen(5)
    boat.has.change = lambda name, value: boat.has.on_wire(name)  # type: ignore[method-assign]
    texts = [finding.text for finding in boat.apply() if finding.ok is False]
    assert "not set: FS_THR_ENABLE: 1 -> 0; it still is 1. Set it in a ground station" in texts


@pytest.mark.parametrize(
    ("value", "ok", "words"),
    [(0.0, False, "stays there under water"), (2.0, False, "disarms"), (3.0, None, "holds"), (4.0, True, "surfaces")],
)
def test_a_failsafe_is_judged_by_what_the_vehicle_does(value: float, ok: bool | None, words: str) -> None:
    sub = Firmware(SUB_DEFAULTS, False)
    sub.has.put(FS_GCS_ENABLE=value)
    sub.listen(5)
    (finding,) = [finding for finding in sub.check.findings() if finding.text.startswith("FS_GCS_ENABLE")]
    assert (finding.ok, words in finding.text) == (ok, True)
    assert words in sub.check.farewell


def test_ground_beyond_the_range_finders_reach_is_missing() -> None:
    sub = Firmware(SUB_DEFAULTS, False)
    sub.listen(3)
    sub.say(mavlink.MAVLink_distance_sensor_message(1000, 20, 700, 885, 1, 0, 25, 255))
    (finding,) = [finding for finding in sub.check.findings() if "give no soundings" in finding.text]
    assert finding.ok is False
    assert "distances beyond 7.0 m" in finding.text


def test_a_vehicle_without_gps_gets_the_origin() -> None:
    sub = Firmware(SUB_DEFAULTS, False, origin=Origin(lat_deg=46.5, lon_deg=6.6))
    sent: list[Any] = []
    for _ in range(6):
        sub.now_s += 1.0
        sub.say(mavlink.MAVLink_heartbeat_message(12, 3, 0, 19, mavlink.MAV_STATE_ACTIVE, 3))
        sub.say(mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0))
        sent += [m for datagram in sub.check.outgoing() for m in sub.reader.parse_buffer(datagram) or ()]
    origins = [(m.latitude, m.longitude) for m in sent if m.get_type() == "SET_GPS_GLOBAL_ORIGIN"]
    assert origins[:1] == [(465000000, 66000000)]
    sub.say(mavlink.MAVLink_gps_global_origin_message(465000000, 66000000, 0, 0))
    texts = {finding.text: finding.ok for finding in sub.check.findings()}
    assert texts["origin known"] is True
    assert "VISO_TYPE: no answer" in texts, "without GPS the DVL's settings matter"


def test_the_key_is_given_to_the_autopilot() -> None:
    sub = Sub()
    key = bytes(range(32))
    sub.check = AutopilotCheck(LinkConfig(), 2, key=key, nonce=5)
    sub.check.send_key(1_700_000_000.0)
    (message,) = [m for datagram in sub.check.outgoing() for m in sub.reader.parse_buffer(datagram) or ()]
    assert (message.get_type(), message.target_system, bytes(message.secret_key)) == ("SETUP_SIGNING", 2, key)
    assert message.initial_timestamp == round((1_700_000_000.0 - 1_420_070_400.0) * 1e5)
    assert main(["udpin://127.0.0.1:1", "--send-key"]) == 2
