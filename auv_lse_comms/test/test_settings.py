"""A vehicle's bridge from a mission's parameters."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.settings import bridge_of

MISSION: dict[str, Any] = {
    "mission": {"vehicles": 3, "steps": 50},
    "motion": {"actions_deg": [-30.0, 0.0, 30.0]},
    "area": {"polygon_m": [0.0, 0.0, 300.0, 0.0, 300.0, 400.0, 0.0, 400.0]},
}
PLAN = Plan(step=50, heading_rad=0.0, north_m=350.0, east_m=-50.0, actions=(2,), naive_path=NONE)


def test_limits_come_from_the_mission() -> None:
    bridge = bridge_of({**MISSION, "packet": {"area_margin_m": 60.0}}, "m.yaml", 2)
    assert (bridge.address, bridge.vehicles) == (2, 3)
    bridge.set_plan(PLAN)
    for change, reason in (
        ({"step": 51}, "step"),
        ({"actions": (3,)}, "action"),
        ({"north_m": 361.0}, "position"),
        ({"east_m": -61.0}, "position"),
    ):
        with pytest.raises(ValueError, match=reason):
            bridge.set_plan(dataclasses.replace(PLAN, **change))


def test_faults_name_the_file_and_the_parameter(tmp_path: Path) -> None:
    for parameters, message in (
        ({"tdma": {"order": [1, 4]}}, r"m.yaml: tdma.order is \(1, 4\), but \[4\] are not among the vehicles 1..3"),
        ({"tdma": {"slot_s": 1.0}}, r"m.yaml: tdma.slot_s: 1 s is too short; use at least 4.400 s"),
        ({"packet": {"tag": True}}, r"m.yaml: packet.key_file is empty, but tag: true needs the team's key"),
        ({"packet": {"tag": True, "key_file": "key"}}, r"m.yaml: packet.session is empty, but tag: true needs"),
        (
            {"packet": {"tag": True, "key_file": str(tmp_path / "none"), "session": "a"}},
            r"packet.key_file: .*none: cannot be read",
        ),
        ({"packet": {"tagg": True}}, r"packet.tagg: unknown parameter .* did you mean 'tag'"),
    ):
        with pytest.raises(ParameterError, match=message):
            bridge_of({**MISSION, **parameters}, "m.yaml", 1)


@pytest.mark.parametrize("key", ["vehicles", "steps"])
@pytest.mark.parametrize("order", [[], [1, 2, 3]])
def test_what_all_vehicles_must_share_has_no_default(key: str, order: list[int]) -> None:
    shared = {k: v for k, v in MISSION["mission"].items() if k != key}
    message = (
        rf"m.yaml: mission\.{key} is missing; all vehicles must share it. Add the number .* to the "
        "mission file, section mission"
    )
    with pytest.raises(ParameterError, match=message):
        bridge_of({**MISSION, "mission": shared, "tdma": {"order": order}}, "m.yaml", 1)
    with pytest.raises(ParameterError, match=r"mission\.vehicles is missing"):
        bridge_of({}, "m.yaml", 1)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"mission": {"vehicles": 3.0, "steps": 9}}, r"mission.vehicles must be a whole number .*, not 3.0"),
        ({"mission": {"vehicles": 0, "steps": 9}}, r"mission.vehicles must be a whole number .*, not 0"),
        ({"mission": {"vehicles": 3, "steps": 70000}}, r"mission.steps must be a whole number from 1 .*, not 70000"),
        ({"motion": {"actions_deg": 30.0}}, r"motion.actions_deg must be a list .*, not 30.0"),
        ({"motion": 7}, r"motion must be a mapping of parameters, not 7"),
        ({"area": {"polygon_m": [1.0, 2.0, 3.0]}}, r"area.polygon_m has 3 numbers; give north, east"),
        ({"area": {"polygon_m": ["a", "b"]}}, r"area.polygon_m\[0\] must be a number.*, not 'a'"),
    ],
)
def test_what_other_packages_own_is_refused_by_name(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match="m.yaml: " + message):
        bridge_of({**MISSION, **parameters}, "m.yaml", 1)


def test_a_team_with_a_key(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("ab" * 32)
    key.chmod(0o600)
    packet = {"tag": True, "key_file": str(key), "session": "a"}
    one, two = (bridge_of({**MISSION, "packet": packet}, "m.yaml", a) for a in (1, 2))
    one.set_plan(PLAN)
    payload = one.poll(1.0)
    assert payload is not None
    assert two.receive(3.0, 1, payload) is not None
    assert two.receive(4.0, 1, payload) is None
    assert two.counts["rejected.replay"] == 1


def test_a_late_start_of_a_modem_must_fit_the_slot() -> None:
    modem = {"kind": "micromodem", "port": "/dev/ttyUSB0"}
    message = r"tdma.send_duration_s: 2.2 s is too short.*; use at least 4.00 s: modem.start_timeout_s \(2 s\)"
    with pytest.raises(ParameterError, match=message):
        bridge_of({**MISSION, "modem": modem}, "m.yaml", 1, confirmed=True)
    bridge_of({**MISSION, "modem": modem, "tdma": {"send_duration_s": 4.0}}, "m.yaml", 1, confirmed=True)
    bridge_of({**MISSION, "modem": modem}, "m.yaml", 1)  # an emulated modem, which starts at once
    with pytest.raises(ParameterError, match=r"at least 2.83 s: .* packet at rate 5"):
        bridge_of({**MISSION, "modem": {**modem, "rate": 5}}, "m.yaml", 1, confirmed=True)


def test_a_ping_and_its_answer_must_fit_what_a_packet_leaves_of_the_slot() -> None:
    modem = {"kind": "micromodem", "port": "/dev/ttyUSB0", "ping": True}
    tdma = {"send_duration_s": 4.0}
    with pytest.raises(ParameterError, match=r"tdma.slot_s: 9 s is too short with modem.ping; use at least 10.00 s"):
        bridge_of({**MISSION, "modem": modem, "tdma": {**tdma, "slot_s": 9.0}}, "m.yaml", 1, confirmed=True)
    with pytest.raises(ParameterError, match=r"9.8 s is too short.* and 0.2 s to begin in"):  # else it would never ping
        bridge_of({**MISSION, "modem": modem, "tdma": {**tdma, "slot_s": 9.8}}, "m.yaml", 1, confirmed=True)
    bridge_of({**MISSION, "modem": modem, "tdma": tdma}, "m.yaml", 1, confirmed=True)
    with pytest.raises(ParameterError, match="ping and synchronous are both true"):
        bridge_of({**MISSION, "modem": {**modem, "synchronous": True}, "tdma": tdma}, "m.yaml", 1)
