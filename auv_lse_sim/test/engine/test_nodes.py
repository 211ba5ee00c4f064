"""Every vehicle node over real rclpy, as a process of its own."""

from __future__ import annotations

import importlib.util
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

sys.path.insert(0, str(Path(__file__).parent))

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from ros_bench import Bench, bench

from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import START_VARIABLE
from auv_lse_common.node.state_memory import forget_copy
from auv_lse_common.node.state_slots import invalidate
from auv_lse_common.topics.codecs import decode_mate_navigation
from auv_lse_common.topics.quality import LATCHED
from auv_lse_common.topics.ros_conversions import header
from auv_lse_common.vocabulary.plan import Plan as MatePlan
from auv_lse_comms.packet.codec import Packet, decode, encode
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_msgs.msg import (
    Bound,
    KernelCenters,
    MateNavigation,
    MissionCommand,
    MissionState,
    ModemRx,
    ModemTx,
    Plan,
    SampleArray,
    Sounding,
    TdmaStatus,
    Waypoint,
)
from auv_lse_run.vehicle.security_policy import policy as policy_of

pytestmark = pytest.mark.ros

PARAMETERS = """\
/**:
  ros__parameters:
    mission: {vehicles: 2, steps: 20, seed: 7}
    area: {polygon_m: [-50.0, -50.0, 350.0, -50.0, 350.0, 350.0, -50.0, 350.0]}
    gp: {publish_period_s: 0.5}
    planner: {iterations: 30, odometry_timeout_s: 1.5}
"""


def sounding(north_m: float, east_m: float, depth_m: float) -> Sounding:
    return Sounding(header=header(time.time()), north_m=north_m, east_m=east_m, depth_m=depth_m)


def value_of(message: DiagnosticArray, key: str) -> str:
    return next(v.value for v in message.status[0].values if v.key == key)


def set_parameter(b: Bench, node: str, name: str, value: object) -> object:
    client = b.node.create_client(SetParameters, f"{node}/set_parameters")
    b.until(client.service_is_ready, f"service of {node}")
    future = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
    b.until(future.done, "answer to set_parameters")
    return future.result().results[0]


def runs_with_a_position(states: list[MissionState], odometry: Any) -> bool:
    """Publishes a position; whether the mission, which waits for one, runs."""
    message = Odometry(header=header(time.time()))
    message.pose.pose.orientation.w = 1.0
    odometry.publish(message)
    return bool(states) and states[-1].state == MissionState.RUNNING


def test_gp_node_keeps_a_map_that_a_late_reader_gets_whole(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        b.start("auv_lse_gp", "gp_node", PARAMETERS)
        b.start("auv_lse_planner", "safety_node", PARAMETERS)
        soundings = b.publisher(Sounding, "/auv1/sounding")
        samples = b.publisher(SampleArray, "/auv1/team/samples")
        for i in range(5):
            soundings.publish(sounding(40.0 * i, 0.0, 10.0 + 2.0 * i))
        soundings.publish(sounding(0.0, 0.0, math.nan))
        samples.publish(
            SampleArray(header=header(time.time()), source=2, north_m=[0.0], east_m=[100.0], depth_m=[12.0])
        )
        samples.publish(
            SampleArray(header=header(time.time()), source=2, north_m=[0.0, 1.0], east_m=[50.0], depth_m=[12.0])
        )
        diagnostics = b.collect(DiagnosticArray, "/auv1/diagnostics")

        def of_gp() -> list[DiagnosticArray]:
            return [d for d in diagnostics if d.status[0].name.endswith("gp_node")]

        b.until(lambda: of_gp() and value_of(of_gp()[-1], "centers") == "6", "a map of 6 centers")
        assert value_of(of_gp()[-1], "refused") == "1"
        states = b.collect(MissionState, "/auv1/mission/state")  # not latched: what was said before it does not get
        b.until(lambda: len(states) > 1, "the mission's state again and again")
        assert [(s.revision, s.state) for s in states[:2]] == [(1, MissionState.WAITING)] * 2  # for a position
        policy = {element.text for element in ElementTree.fromstring(policy_of(1).partition("\n")[2]).iter()}
        graph = b.node
        for node in ("gp_node", "safety_node"):
            for of_node in (
                graph.get_publisher_names_and_types_by_node,
                graph.get_subscriber_names_and_types_by_node,
                graph.get_service_names_and_types_by_node,
                graph.get_client_names_and_types_by_node,
            ):
                used = {name for name, _ in of_node(node, "/auv1")}
                assert used <= policy, f"{node} uses what its SROS 2 policy does not allow: {used - policy}"
        late = b.collect(KernelCenters, "/auv1/kernel_centers", LATCHED)
        b.until(lambda: late, "the latched centers")
        assert sorted(zip(late[0].north_m, late[0].east_m, strict=True)) == [
            (0.0, 0.0),
            (0.0, 100.0),
            (40.0, 0.0),
            (80.0, 0.0),
            (120.0, 0.0),
            (160.0, 0.0),
        ]
        risk = b.collect(OccupancyGrid, "/auv1/risk_map", LATCHED)
        b.until(lambda: risk, "the risk map")
        cells = risk[0].data
        assert risk[0].info.width * risk[0].info.height == len(cells)
        assert min(c for c in cells if c >= 0) < 50 <= max(cells), "near the soundings there is less risk than far off"


def test_modem_node_sends_252_bytes_in_its_slot_and_survives_what_it_hears(tmp_path: Path) -> None:
    parameters = (
        PARAMETERS
        + "    tdma: {order: [1, 2], slot_s: 2.0, guard_s: 0.1, send_duration_s: 0.5, max_range_m: 500.0}\n"
        + "    packet: {navigation: false}\n"  # the driver here gives no dead-reckoned positions
    )
    with bench(tmp_path) as b:
        b.start("auv_lse_comms", "modem_node", parameters)
        plan = b.publisher(Plan, "/auv1/plan", LATCHED)
        soundings = b.publisher(Sounding, "/auv1/sounding")
        rx = b.publisher(ModemRx, "/auv1/modem/rx")
        tx = b.collect(ModemTx, "/auv1/modem/tx")
        plans = b.collect(Plan, "/auv1/team/plans")
        samples = b.collect(SampleArray, "/auv1/team/samples")
        navigation = b.collect(MateNavigation, "/auv1/team/navigation")
        for i in range(30):
            soundings.publish(sounding(float(i), 0.0, 12.0 + 0.01 * i))
        plan.publish(
            Plan(vehicle=1, step=3, heading_rad=0.5, north_m=10.0, east_m=20.0, actions=[5, 5, 0], naive_path=0xF0)
        )
        b.until(lambda: len(tx) >= 2, "two packets")
        for message in tx:
            assert len(message.payload) == 252
            stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            assert stamp % 4.0 < 2.0, "slots 0, 2, 4 ... of 2 s are vehicle 1's"
        packet = decode(bytes(tx[0].payload))
        assert (packet.plan.step, packet.plan.actions, packet.plan.naive_path) == (3, (5, 5, 0), 0xF0)
        assert len(packet.samples) == 19

        failed = b.publisher(ModemTx, "/auv1/modem/failed")
        failed.publish(ModemTx(header=tx[1].header, source=1))
        b.until(lambda: len(tx) >= 3, "a third packet")
        second, third = (decode(bytes(message.payload)).samples for message in tx[1:3])
        assert len(second) == 11, "the other soundings"
        assert (second == third).all(), "what the modem did not send is sent again"

        mate = Packet(
            MatePlan(step=1, heading_rad=0.0, north_m=5.0, east_m=6.0, actions=(1,), naive_path=0xFF),
            np.array([[1.0, 2.0, 14.0]]),
            navigation=Navigation(raw_cm=(150, -250)),
        )
        for payload in (b"", bytes(252), b"\xff" * 252, encode(mate)[:-1], encode(mate)):
            rx.publish(
                ModemRx(
                    header=header(time.time()), source=2, sent_s=9.0, arrival_s=9.25, travel_s=0.25, payload=payload
                )
            )
        b.until(lambda: plans and samples and navigation, "the mate's plan, samples and navigation")
        told = decode_mate_navigation(navigation[0])
        assert (told.source, told.stamp_s, told.sent_s, told.travel_s) == (2, 9.25, 9.0, 0.25)
        assert (told.raw_north_m, told.raw_east_m, told.has_fix) == (1.5, -2.5, False)
        assert (plans[0].vehicle, plans[0].north_m, list(plans[0].actions)) == (2, 5.0, [1])
        assert list(samples[0].depth_m) == [14.0]
        status = b.collect(TdmaStatus, "/auv1/tdma")
        b.until(
            lambda: (
                status
                and sum(n for r, n in zip(status[-1].reasons, status[-1].counts, strict=True) if "rejected" in r) >= 3
            ),
            "counts",
        )

        assert set_parameter(b, "/auv1/modem_node", "tdma.slot_s", 3.0).successful
        refused = set_parameter(b, "/auv1/modem_node", "tdma.slot_s", 0.5)
        assert not refused.successful
        assert "slot_s" in refused.reason
        assert not set_parameter(b, "/auv1/modem_node", "packet.area_margin_m", 5.0).successful
        assert "only at the start" in set_parameter(b, "/auv1/modem_node", "mission.steps", 5).reason


def test_planner_node_plans_reports_missing_odometry_and_resumes_after_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "journal"))
    with bench(tmp_path) as b:
        b.start("auv_lse_planner", "planner_node", PARAMETERS)
        odometry = b.publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data)  # as INS drivers publish
        b.publisher(MissionState, "/auv1/mission/state", LATCHED).publish(
            MissionState(revision=1, state=MissionState.RUNNING)
        )
        waypoints = b.collect(Waypoint, "/auv1/waypoint")
        bounds = b.collect(Bound, "/auv1/planner/bound")
        diagnostics = b.collect(DiagnosticArray, "/auv1/diagnostics")
        message = Odometry(header=header(time.time()))
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(math.pi / 4), math.cos(math.pi / 4)

        def first_leg() -> bool:
            if not waypoints:
                odometry.publish(message)  # again and again: best effort may lose one
            return bool(waypoints and bounds)

        b.until(first_leg, "a first leg", timeout_s=60.0)
        assert waypoints[0].step == 0
        assert waypoints[0].turn_radius_m == 15.0
        assert bounds[0].iterations > 0
        latched = b.collect(Plan, "/auv1/plan", LATCHED)
        b.until(lambda: latched, "the latched plan")
        assert latched[0].vehicle == 1
        b.until(
            lambda: any("planning has stopped" in d.status[0].message for d in diagnostics),
            "the word that odometry stopped",
        )
        assert set_parameter(b, "/auv1/planner_node", "planner.iterations", 77).successful
        assert not set_parameter(b, "/auv1/planner_node", "planner.iterations", 0).successful
        assert not set_parameter(b, "/auv1/planner_node", "mission.steps", 5).successful
        client = b.node.create_client(GetParameters, "/auv1/planner_node/get_parameters")
        b.until(client.service_is_ready, "get_parameters")
        future = client.call_async(
            GetParameters.Request(names=["planner.iterations", "motion.turn_radius_m", "mission.seed"])
        )
        b.until(future.done, "answer")
        iterations, radius, seed = future.result().values
        assert (iterations.integer_value, radius.double_value, seed.integer_value) == (77, 15.0, 7)
        (process,) = b.keepers[-1].running.values()
        os.kill(process, signal.SIGKILL)
        b.start("auv_lse_planner", "planner_node", PARAMETERS)
        again = b.collect(Waypoint, "/auv1/waypoint", LATCHED)
        b.until(lambda: again, "the last waypoint, for a link that was started again, too")
        assert (again[0].header, again[0].step) == (waypoints[-1].header, waypoints[-1].step)
        assert again[0].end_north_m == waypoints[-1].end_north_m


def test_planner_node_that_restarts_after_its_end_reports_the_end_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever the vehicle is then; without its journal it would wait until the last leg counts as timed out."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "journal"))
    with bench(tmp_path) as b:
        parameters = PARAMETERS.replace("steps: 20", "steps: 1")
        b.start("auv_lse_planner", "planner_node", parameters)
        odometry = b.publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data)
        state = MissionState(revision=1, state=MissionState.RUNNING)
        b.publisher(MissionState, "/auv1/mission/state", LATCHED).publish(state)
        waypoints = b.collect(Waypoint, "/auv1/waypoint")
        ends = b.collect(MissionCommand, "/auv1/mission/end")
        message = Odometry(header=header(time.time()))
        message.pose.pose.orientation.w = 1.0

        def until(done: Callable[[], object], what: str) -> None:
            def sent() -> object:
                odometry.publish(message)  # again and again: best effort may lose one
                return done()

            b.until(sent, what, timeout_s=30.0)

        until(lambda: waypoints, "the only leg")
        message.header = header(time.time() + 60.0)  # no jump: it had the time to go there
        leg = waypoints[0]
        message.pose.pose.position.x = leg.end_east_m + 2.0 * math.sin(leg.end_heading_rad)
        message.pose.pose.position.y = leg.end_north_m + 2.0 * math.cos(leg.end_heading_rad)
        until(lambda: ends, "the end")
        (process,) = b.keepers[-1].running.values()
        os.kill(process, signal.SIGKILL)
        b.start("auv_lse_planner", "planner_node", parameters)
        again = b.collect(MissionCommand, "/auv1/mission/end")
        message.pose.pose.position.x = message.pose.pose.position.y = 0.0  # back before the leg's end
        until(lambda: again, "the end, reported by the new process")


def test_nodes_whose_state_is_not_trusted_hold_and_surface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk once let an aborted vehicle dive again: its journal ended before the abort."""
    journals = tmp_path / "journal"
    monkeypatch.setenv(FOLDER_VARIABLE, str(journals))
    nodes = ("safety_node", "planner_node")
    with bench(tmp_path) as b:
        for node in nodes:
            b.start("auv_lse_planner", node, PARAMETERS)
        states = b.collect(MissionState, "/auv1/mission/state", LATCHED)
        odometry = b.publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data, readers=2)
        b.until(lambda: runs_with_a_position(states, odometry), "a mission that runs")
        files = [journals / f"auv1.{node}.state" for node in nodes]
        b.until(lambda: all(file.exists() for file in files), "two state files")
        for keeper in b.keepers[-2:]:
            keeper.stop()
        for file in files:  # as a node leaves a file that it could not write
            invalidate(file)
        states.clear()
        restarted_s = time.time()
        for node in nodes:
            b.start("auv_lse_planner", node, PARAMETERS)
        b.until(lambda: states, "the state after the restart")
        assert (states[0].state, states[0].action) == (MissionState.HOLDING, MissionState.SURFACE)
        assert "not trusted" in states[0].reason
        waypoints = b.collect(Waypoint, "/auv1/waypoint", LATCHED)
        diagnostics = b.collect(DiagnosticArray, "/auv1/diagnostics")
        message = Odometry(header=header(time.time()))
        message.pose.pose.orientation.w = 1.0

        def planner_reports() -> bool:
            odometry.publish(message)
            return any(d.status[0].name.endswith("planner_node") for d in diagnostics)

        b.until(planner_reports, "diagnostics of the planner")
        of_planner = [d.status[0] for d in diagnostics if d.status[0].name.endswith("planner_node")]
        assert of_planner[0].level == DiagnosticStatus.ERROR
        assert "not trusted" in of_planner[0].message
        stamps = [w.header.stamp.sec + w.header.stamp.nanosec * 1e-9 for w in waypoints]
        assert all(s < restarted_s for s in stamps), "a mission must not restart at its first leg"


def test_the_watch_goes_on_while_the_disk_is_stuck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stuck = tmp_path / "stuck"
    (tmp_path / "sitecustomize.py").write_text(
        "import os, time\nsync = os.fdatasync\ndef slow(file):\n"
        f"    while os.path.exists({str(stuck)!r}): time.sleep(0.05)\n    sync(file)\nos.fdatasync = slow\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "journal"))
    monkeypatch.setenv(START_VARIABLE, "a")
    with bench(tmp_path) as b:
        b.start("auv_lse_planner", "safety_node", PARAMETERS)
        states = b.collect(MissionState, "/auv1/mission/state", LATCHED)
        diagnostics = b.collect(DiagnosticArray, "/auv1/diagnostics")
        commands = b.publisher(MissionCommand, "/auv1/mission/command")
        odometry = b.publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data)
        b.until(lambda: runs_with_a_position(states, odometry), "a mission that runs")
        stuck.touch()
        try:
            commands.publish(MissionCommand(command=MissionCommand.ABORT, source="me"))
            b.until(lambda: states[-1].state == MissionState.ABORTED, "the abort")
            states.clear()
            b.until(lambda: len(states) > 2, "the state every second")
            b.until(lambda: any("the disk is slow" in d.status[0].message for d in diagnostics), "diagnostics")
            b.keepers[-1].stop()
            states.clear()
            b.start("auv_lse_planner", "safety_node", PARAMETERS)
            b.until(lambda: states, "the state after the restart")
            assert states[0].state == MissionState.ABORTED
        finally:
            stuck.unlink()
            forget_copy(tmp_path / "journal" / "auv1.safety_node.state")


def test_recorder_node_hears_a_driver_that_publishes_best_effort(tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    with bench(tmp_path) as b:
        b.start("auv_lse_record", "recorder_node", PARAMETERS + f"    record: {{folder: {tmp_path / 'bag'}}}\n", "/")
        odometry = b.node.create_publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data)
        b.until(odometry.get_subscription_count, "the recorder as a reader")
        for _ in range(10):  # the writer may know the reader before the reader knows it; what comes between is lost
            odometry.publish(Odometry(header=header(12.5)))
            b.spin(0.1)
    with AnyReader([tmp_path / "bag"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/auv1/odometry"]
        stamps = [reader.deserialize(d, c.msgtype).header.stamp.sec for c, _, d in reader.messages(connections)]
    assert len(stamps) > 5
    assert set(stamps) == {12}


@pytest.mark.parametrize(
    ("parameters", "namespace", "expected"),
    [
        (PARAMETERS.replace("iterations", "iteratons"), "/auv1", "did you mean 'iterations'"),
        (PARAMETERS.replace("planner:", "plnner:"), "/auv1", "did you mean 'planner'"),
        (PARAMETERS.replace("iterations: 30", "iterations: 0"), "/auv1", "planner.iterations must be a whole number"),
        (PARAMETERS, "/scout", "does not end in the vehicle's number"),
        (PARAMETERS, "/auv3", "vehicle 3 does not exist; mission.vehicles is 2"),
    ],
)
def test_a_wrong_parameter_ends_the_node_with_words(
    tmp_path: Path, parameters: str, namespace: str, expected: str
) -> None:
    with bench(tmp_path) as b:
        b.start("auv_lse_planner", "planner_node", parameters, namespace)
        (keeper,) = b.keepers
        ended: list[tuple[str, int]] = []
        b.until(lambda: ended.extend(keeper.tick(time.monotonic())) or ended, "the end of the node")
        ((name, code),) = ended
        assert code == 2
        words = keeper.log(name).read_text()
        assert expected in words
        assert "Traceback" not in words
