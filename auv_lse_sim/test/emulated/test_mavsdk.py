"""Independent check: MAVSDK finds the simulated MAVLink vehicle, reads its position and uploads a mission to it.

`mavsdk_server` is started here, on free ports of the loopback interface, and is ended here whatever happens.
"""

import asyncio
import contextlib
import importlib.util
import math
import os
import re
import socket
import subprocess
import tempfile
import threading
import time
import warnings
from pathlib import Path

import pytest
from bench_of_autopilot import free_udp_port
from verb_main import verb_main

from auv_lse_mavlink.messages.datum import Origin
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle

autopilot_check = verb_main("autopilot-check")

if importlib.util.find_spec("mavsdk") is None:
    pytest.skip("mavsdk (>=3.17,<4, test only) is not installed", allow_module_level=True)

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
VEHICLE = Report(heading_rad=0.7, north_m=120.0, east_m=-45.0, depth_m=4.0, speed_mps=1.5, altitude_m=11.0)


@contextlib.contextmanager
def mavsdk_server(url: str, *options: str):
    """The gRPC server between mavsdk and MAVLink; gives its port."""
    binary = Path(importlib.util.find_spec("mavsdk").origin).parent / "bin" / "mavsdk_server"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        grpc_port = probe.getsockname()[1]
    command = [str(binary), "-p", str(grpc_port), *options, url]
    with tempfile.TemporaryDirectory() as folder:  # it is killed, and removes none of its folders
        environment = {**os.environ, "TMPDIR": folder}
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)
        said: list[str] = []
        reader = threading.Thread(target=lambda: said.extend(server.stdout), daemon=True)
        reader.start()
        try:
            yield grpc_port, said
        finally:
            server.kill()
            server.wait()
            reader.join(5.0)
            server.stdout.close()


class Sea(threading.Thread):
    """Ticks a simulated vehicle in real time, ten times a second."""

    def __init__(self, udp_port: int):
        super().__init__(daemon=True)
        self.legs = []
        start = (VEHICLE.heading_rad, VEHICLE.north_m, VEHICLE.east_m)
        self.vehicle = MavlinkVehicle(2, start, 15.0, ORIGIN, self.legs.append)
        self.dock = MavlinkDock({2: self.vehicle}, {2: f"udpout://127.0.0.1:{udp_port}"})
        self.stop = threading.Event()

    def run(self):
        while not self.stop.is_set():
            self.dock.serve(time.time())
            self.dock.report(2, time.time(), VEHICLE)
            for _ in range(20):
                self.dock.serve(time.time())
                time.sleep(0.005)
        self.dock.close()


async def talk(grpc_port: int) -> dict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from mavsdk import System
        from mavsdk.mission import MissionItem, MissionPlan

        system = System(mavsdk_server_address="127.0.0.1", port=grpc_port)
        await system.connect()
    seen = {}
    async for state in system.core.connection_state():
        if state.is_connected:
            break
    async for position in system.telemetry.position():
        seen["position"] = (position.latitude_deg, position.longitude_deg, position.relative_altitude_m)
        break
    async for attitude in system.telemetry.attitude_euler():
        seen["yaw_deg"] = attitude.yaw_deg
        break
    async for local in system.telemetry.position_velocity_ned():
        seen["ned"] = (local.position.north_m, local.position.east_m, local.position.down_m)
        seen["speed"] = math.hypot(local.velocity.north_m_s, local.velocity.east_m_s)
        break
    async for armed in system.telemetry.armed():
        seen["armed"] = armed
        break
    nothing = {
        "is_fly_through": True,
        "gimbal_pitch_deg": math.nan,
        "gimbal_yaw_deg": math.nan,
        "camera_action": MissionItem.CameraAction.NONE,
        "loiter_time_s": math.nan,
        "camera_photo_interval_s": math.nan,
        "acceptance_radius_m": 3.0,
        "yaw_deg": math.nan,
        "camera_photo_distance_m": math.nan,
        "vehicle_action": MissionItem.VehicleAction.NONE,
    }
    items = [
        MissionItem(latitude_deg=lat, longitude_deg=lon, relative_altitude_m=-5.0, speed_m_s=1.5, **nothing)
        for lat, lon in ((46.5020, 6.6000), (46.5025, 6.6010), (46.5020, 6.6020))
    ]
    await system.mission.upload_mission(MissionPlan(items))
    back = await system.mission.download_mission()
    seen["back"] = [(item.latitude_deg, item.longitude_deg, item.relative_altitude_m) for item in back.mission_items]
    return seen


def test_mavsdk_reads_position_and_uploads_a_mission():
    udp_port = free_udp_port()
    sea = Sea(udp_port)
    with mavsdk_server(f"udpin://127.0.0.1:{udp_port}") as (grpc_port, said):
        sea.start()
        try:
            seen = asyncio.run(asyncio.wait_for(talk(grpc_port), 45.0))
        except TimeoutError:
            pytest.fail("mavsdk did not finish; its server said:\n" + "".join(said[-30:]))
        finally:
            sea.stop.set()
            sea.join(5.0)
    # 120 m north is 120 / 111 160 deg at this latitude, 45 m west 45 / 76 760 deg (WGS84, by hand to 1e-6 deg)
    assert seen["position"][0] == pytest.approx(46.5 + 120.0 / 111160.0, abs=2e-6)
    assert seen["position"][1] == pytest.approx(6.6 - 45.0 / 76760.0, abs=2e-6)
    assert seen["position"][2] == pytest.approx(-4.0, abs=1e-3)
    assert seen["yaw_deg"] == pytest.approx(math.degrees(0.7), abs=0.01)
    assert seen["ned"] == pytest.approx((120.0, -45.0, 4.0), abs=1e-4)
    assert seen["speed"] == pytest.approx(1.5, abs=1e-4)
    assert seen["armed"]
    waypoints = [(46.5020, 6.6000, -5.0), (46.5025, 6.6010, -5.0), (46.5020, 6.6020, -5.0)]
    assert len(seen["back"]) == 3
    for got, sent in zip(seen["back"], waypoints, strict=True):
        assert got == pytest.approx(sent, abs=1e-6)
    # and the vehicle goes there: three legs, each beginning where the one before it ends
    assert len(sea.legs) == 3
    _, north, east = sea.legs[-1].end_state
    assert north == pytest.approx(0.0020 * 111160.0, abs=0.5)
    assert east == pytest.approx(0.0020 * 76760.0, abs=0.5)
    assert not [line for line in said if re.search(r"\bError\b", line)]


def test_autopilot_check_hears_mavsdk_as_an_autopilot_and_names_what_it_lacks(capsys):
    """MAVSDK with an autopilot's ids sends heartbeats, of its own making, and nothing of a position."""
    udp_port = free_udp_port()
    with mavsdk_server(f"udpout://127.0.0.1:{udp_port}", "--sysid", "2", "--compid", "1"):
        code = autopilot_check([f"udpin://127.0.0.1:{udp_port}", "--vehicle", "2", "--seconds", "5"])
    printed = capsys.readouterr().out
    assert code == 1, printed
    assert "ok      HEARTBEAT: " in printed, printed
    assert "MISSING LOCAL_POSITION_NED: 0.0 Hz; at least 1 Hz are needed for odometry" in printed
    assert "MISSING not armed: the mission waits until it is" in printed
