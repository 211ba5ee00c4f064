"""When gp_node publishes maps: as often as they are looked at, and a whole one at the end of a mission."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from rclpy.executors import SingleThreadedExecutor

from auv_lse_common.node.intra_process import TopicPublisher
from auv_lse_common.topics.map_codecs import DEPTH_STEP_M, decode_field
from auv_lse_common.topics.quality import LATCHED
from auv_lse_common.topics.records import FieldReport, RunReport
from auv_lse_common.topics.ros_conversions import encoded
from auv_lse_common.topics.table import VEHICLE_TOPICS
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_gp.gp_node import GpNode
from auv_lse_gp.map import depth_map, online
from auv_lse_msgs.msg import LevelSetField, MissionState

pytestmark = pytest.mark.ros

PARAMETERS = """\
/**:
  ros__parameters:
    area: {polygon_m: [0.0, 0.0, 900.0, 0.0, 900.0, 900.0, 0.0, 900.0], raster_m: 20.0}
    gp: {publish_period_s: 1000.0, map_resolution_m: 20.0, length_scale_m: 60.0}
    positions: {correct: false}
"""


def flown(tmp_path: Path, parameters: str = PARAMETERS) -> GpNode:
    """The node of vehicle 2, in a context of ROS of its own."""
    file = tmp_path / "p.yaml"
    file.write_text(parameters)
    rclpy.init(args=["--ros-args", "-r", "__ns:=/auv2", "--params-file", str(file)])
    return GpNode()


def lane(stamp_s: float, east_m: float, deeper_m: float) -> np.ndarray:
    """Soundings along a lane: stamp, north, east, depth (m)."""
    north = np.arange(20.0, 880.0, 20.0)
    depth = 15.0 + 6.0 * np.sin(north / 90.0) + deeper_m
    return np.column_stack([stamp_s + north, north, np.full_like(north, east_m), depth])


@pytest.mark.parametrize("state", [RunState.ENDED, RunState.ABORTED])
def test_gp_node_publishes_a_complete_map_when_the_mission_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: RunState
) -> None:
    monkeypatch.setattr(online, "MAX_DENSE", 50)
    monkeypatch.setattr(GpNode, "_start_timer", lambda node: None)  # the test calls its steps
    node, bench = flown(tmp_path), rclpy.create_node("bench", use_global_arguments=False)
    executor, fields = SingleThreadedExecutor(), []
    try:
        executor.add_node(node)
        executor.add_node(bench)
        bench.create_subscription(LevelSetField, "/auv2/field", lambda m: fields.append(decode_field(m)), LATCHED)
        states = bench.create_publisher(MissionState, "/auv2/mission/state", LATCHED)

        def until(condition) -> None:
            end = time.monotonic() + 60.0
            while not condition():
                assert time.monotonic() < end
                executor.spin_once(timeout_sec=0.05)

        def is_complete(field: FieldReport) -> bool:
            return bool(np.nanmax(np.abs(field.mean_m - node._map.field().mean_m)) <= DEPTH_STEP_M)

        def step(now_s: float, published: int) -> None:
            node.step(now_s)
            until(lambda: len(fields) >= published)

        until(lambda: node._field.readers)
        for i, east_m in enumerate(range(40, 900, 120)):
            node._intake.add_soundings(lane(1000.0 * i, east_m, 0.0))
        step(1.0, 1)
        monkeypatch.setattr(depth_map, "RECENT_WORK", 0.0)
        for i, east_m in enumerate(range(100, 900, 120)):
            node._intake.add_soundings(lane(1e5 + 1000.0 * i, east_m, 4.0))
        step(1001.0, 2)
        assert not is_complete(fields[1]), "this large map is published in parts"
        status = RunStatus(state=state, stop=Stop(action=Action.HOLD))
        states.publish(
            encoded(VEHICLE_TOPICS["mission/state"], RunReport(stamp_s=1002.0, revision=1, status=status), 2)
        )
        until(lambda: node._is_over)
        step(1002.0, 3)
        assert (fields[2].stamp_s, is_complete(fields[2])) == (1002.0, True)
        node.step(1003.0)
        assert not node._is_final_map_due
    finally:
        executor.shutdown()
        node.destroy_node()
        bench.destroy_node()
        rclpy.try_shutdown()


def test_gp_node_computes_maps_as_often_as_they_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GpNode, "_start_timer", lambda node: None)  # the test calls its steps
    readers, published = {"field": 0, "risk_map": 0, "isobath": 0}, []
    monkeypatch.setattr(TopicPublisher, "readers", property(lambda publisher: readers.get(publisher._topic.name, 0)))
    monkeypatch.setattr(GpNode, "_publish_maps", lambda node, now_s: published.append(now_s))
    node = flown(tmp_path, PARAMETERS.replace("1000.0", "10.0") + "    record: {folder: somewhere}\n")
    try:
        assert node.recorded

        def maps(first_s: float, last_s: float) -> list[float]:
            published.clear()
            for now_s in np.arange(first_s, last_s):
                node.step(now_s)
            return list(published)

        assert maps(0.0, 25.0) == [], "nobody reads them"
        readers.update(field=1, risk_map=1, isobath=1)
        assert maps(25.0, 106.0) == [25.0, 65.0, 105.0], "the recorder alone"
        readers.update(risk_map=2)
        assert maps(106.0, 136.0) == [115.0, 125.0, 135.0], "somebody looks at the risk"
        readers.update(risk_map=1)
        assert maps(136.0, 176.0) == [175.0]
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_centers_for_a_recorder_alone_wait_for_a_map_or_another_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    readers, sent = {"field": 1, "kernel_centers": 1}, []
    monkeypatch.setattr(TopicPublisher, "readers", property(lambda publisher: readers.get(publisher._topic.name, 0)))
    node = flown(tmp_path, PARAMETERS + "    sim: {lockstep: true}\n    record: {folder: somewhere}\n")
    try:
        node._centers._publisher = SimpleNamespace(
            publish=lambda message: sent.append(len(message.depth_m)), get_subscription_count=lambda: 1
        )

        def step(now_s: float, *lanes: float) -> list[int]:
            sent.clear()
            for east_m in lanes:
                node._intake.add_soundings(lane(10.0 * east_m, east_m, 0.0))
            node.step(now_s)
            return list(sent)

        one = len(lane(0.0, 0.0, 0.0))
        assert step(1000.0, 100.0) == [one], "with the first map"
        assert step(1900.0, 300.0) == [], "the next map is not due"
        readers["kernel_centers"] = 2
        assert step(1901.0) == [2 * one], "unchanged, but somebody else has begun to read"
        assert step(1902.0, 500.0) == [3 * one]
        readers["kernel_centers"] = 1
        assert step(1903.0, 700.0) == []
        assert step(5000.0) == [4 * one], "with the next map"
        assert step(5001.0) == []
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
