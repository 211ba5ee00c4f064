"""The nodes of this package in this process, spun by hand."""

from __future__ import annotations

import importlib.util
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from spinning import spun

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.topics.quality import EVERY
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_common.vocabulary.plan import Plan as PlanOfMate
from auv_lse_comms import driver_node
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.micromodem.micromodem_node import MicromodemNode
from auv_lse_comms.modem_node import ModemNode
from auv_lse_msgs.msg import ModemTx, TdmaStatus

pytestmark = pytest.mark.ros


@pytest.mark.parametrize(("configured", "asked", "sent"), [(0, 0, 0), (3, 0, 3), (3, 5, 5)])
def test_micromodem_node_sends_to_the_configured_destination(
    tmp_path: Path, configured: int, asked: int, sent: int
) -> None:
    parameters = f"modem: {{kind: micromodem, port: /dev/does-not-exist, destination: {configured}}}"
    with spun(MicromodemNode, tmp_path / "p.yaml", parameters) as s:
        s.node._on_transmit(ModemTx(source=2, destination=asked, payload=bytes(252)))
        assert s.node._modem.modem._sending._waiting.destination == sent


def test_modem_node_refuses_a_slot_order_with_an_unknown_vehicle_and_goes_on(tmp_path: Path) -> None:
    with spun(ModemNode, tmp_path / "p.yaml", "mission: {vehicles: 3, steps: 10}\ntdma: {order: [1, 2, 3]}") as s:
        (result,) = s.node.set_parameters([Parameter("tdma.order", value=[1, 4])])
        assert not result.successful
        assert result.reason == (
            "parameters of /auv2/modem_node: tdma.order is (1, 4), but [4] are not among the vehicles 1..3"
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
            "address 4 is not a vehicle of the mission, 1..3",
        ),
        (
            MicromodemNode,
            "/auv200",
            "modem: {kind: micromodem, port: /dev/x}",
            "modem address 200 is not from 1 to 127",
        ),
        (
            MicromodemNode,
            "/auv2",
            "modem: {kind: micromodem, port: x}",
            "'x' is not an address; write /dev/NAME",
        ),
    ],
)
def test_a_node_that_cannot_start_names_the_parameter_that_is_wrong(
    tmp_path: Path, make: Callable[[], Any], namespace: str, parameters: str, message: str
) -> None:
    named = pytest.raises(ParameterError, match=f"parameters of {namespace}/.*{message}")
    with named, spun(make, tmp_path / "p.yaml", parameters, namespace):
        pass


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
            packets.publish(ModemTx(dive=dive, payload=bytes([number] * 252)))
        s.until(lambda: taken)
        assert taken == [2]
        s.until(lambda: any(OTHER in status.message for report in reports for status in report.status))
        status = reports[-1].status[0]
        assert (status.name, int.from_bytes(status.level, "little")) == ("/auv2/micromodem_node", 1)
        assert f"{SIM} publishes in this ROS domain, too: 1 message ignored (modem/tx)" in status.message


def test_a_node_names_its_dive_in_what_it_publishes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DIVE_VARIABLE, DIVE)
    with spun(ModemNode, tmp_path / "p.yaml", "mission: {vehicles: 2, steps: 3}") as s:
        found = s.collect(TdmaStatus, "/auv2/tdma")
        s.until(lambda: found)
        assert (found[0].dive, found[0].header.frame_id) == (DIVE, "map")


def test_a_driver_without_its_device_logs_and_publishes_what_it_waits_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert driver_node._DIAGNOSTICS_PERIOD_S < 5.0
    monkeypatch.setattr(driver_node, "_DIAGNOSTICS_PERIOD_S", 0.3)
    with spun(MicromodemNode, tmp_path / "p.yaml", "modem: {kind: micromodem, port: /dev/no-modem}") as s:
        reports = s.collect(DiagnosticArray, "/auv2/diagnostics")
        text = "waiting for a device on modem.port /dev/no-modem: "
        waiting = lambda: [log.msg for log in s.logs if log.msg.startswith(text)]
        s.until(lambda: waiting() and len(reports) >= 3)
        assert len(waiting()) == 1, "the log has it once"
        assert reports[0].status[0].level == DiagnosticStatus.ERROR
