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
