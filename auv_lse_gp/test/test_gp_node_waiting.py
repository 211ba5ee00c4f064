"""gp_node without soundings: diagnostics and log."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node import vehicle_node
from auv_lse_common.topics.quality import EVERY
from auv_lse_gp.gp_node import GpNode

pytestmark = pytest.mark.ros


def test_gp_node_reports_the_topics_it_waits_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert vehicle_node._WAITING_PERIOD_S < 5.0
    monkeypatch.setattr(vehicle_node, "_WAITING_PERIOD_S", 0.5)
    file = tmp_path / "p.yaml"
    file.write_text("/**: {ros__parameters: {gp: {publish_period_s: 1000.0, map_resolution_m: 100.0}}}\n")
    rclpy.init(args=["--ros-args", "-r", "__ns:=/auv2", "--params-file", str(file)])
    node, bench = GpNode(), rclpy.create_node("bench", use_global_arguments=False)
    executor, logs, reports = SingleThreadedExecutor(), [], []
    try:
        executor.add_node(node)
        executor.add_node(bench)
        bench.create_subscription(Log, "/rosout", logs.append, EVERY)
        bench.create_subscription(DiagnosticArray, "/auv2/diagnostics", reports.append, EVERY)

        def until(condition: Any) -> None:
            end = time.monotonic() + 20.0
            while not condition():
                assert time.monotonic() < end, (logs, reports)
                executor.spin_once(timeout_sec=0.05)

        text = "waiting for a first message on dead_reckoning, sounding"
        until(lambda: sum(text in report.status[0].message for report in reports) >= 3)
        assert [log.msg for log in logs if text in log.msg] == [text], "the log has it once"
        assert reports[-1].status[0].level == DiagnosticStatus.WARN
        node._unheard.clear()
        until(lambda: node._waiting.is_canceled())
    finally:
        executor.shutdown()
        node.destroy_node()
        bench.destroy_node()
        rclpy.try_shutdown()


def test_gp_node_refuses_a_survey_in_metres_of_another_origin(tmp_path: Path) -> None:
    survey, file = tmp_path / "a.csv", tmp_path / "p.yaml"
    rows = [f"{n},{e},10,{46.5 + n / 111170:.7f},{6.6 + e / 76670:.7f}" for n, e in ((0, 0), (100, 0), (0, 100))]
    survey.write_text("\n".join(["north_m,east_m,depth_m,lat,lon", *rows]) + "\n")
    area = "area: {origin_lat_deg: 46.501, origin_lon_deg: 6.6}"
    file.write_text(f"/**: {{ros__parameters: {{gp: {{mean: survey, survey_file: {survey}}}, {area}}}}}\n")
    rclpy.init(args=["--ros-args", "-r", "__ns:=/auv2", "--params-file", str(file)])
    try:
        with pytest.raises(ParameterError, match=r"a\.csv' are relative to 46\.500000, 6\.600000 deg, 111 m from"):
            GpNode()
    finally:
        rclpy.try_shutdown()
