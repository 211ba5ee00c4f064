"""Each fault of a field day is named with its cure, and is on the page of the field day."""

from __future__ import annotations

from typing import Any

import pytest

from auv_lse_shore.remote.clocks import ClockOffset
from auv_lse_shore.remote.judge import Report, judged
from benchmarks.field.faults import FAULTS
from benchmarks.field.sshd import ROOT

STATE: dict[str, Any] = {
    "mission": {"state": "WAITING", "limits": [], "warnings": []},
    "position": {"age_s": 0.1},
    "autopilot": {"heard": True, "battery": 0.9},
    "health": ["/auv1/planner_node: not planning: the mission is WAITING: waits for GO"],
}


def facts(name: str, **changed: Any) -> dict[str, Any]:
    mission = {"guard_s": 0.5, "min_battery": 0.2, "least_free_mb": 500.0, "hashes": {"packet.key_file": "k" * 64}}
    good = {
        "identity": name, "owner": name, "mission": mission, "version": "1", "commit": "", "problem": "",
        "free_mb": 9e3, "hashes": {"mission.yaml": "m" * 64}, "has_ros": True, "running": {"folder": "", "dive": "d"},
        "domain_in_use": False, "findings": [], "controller": {}, "state": STATE,
    }  # fmt: skip
    return {**good, **changed}


def problems(*of_auv2: tuple[str, Any], offset_s: float = 0.0) -> list[str]:
    reports = {f"auv{k}": Report(facts=facts(f"auv{k}"), clock=ClockOffset(0.0, 0.01)) for k in (1, 3)}
    reports["auv2"] = Report(facts=facts("auv2", **dict(of_auv2)), clock=ClockOffset(offset_s, 0.01))
    return [f"{p.vehicle} {p.level} {p.text}" for p in judged(reports, "1")]


def test_a_good_fleet_has_no_problem() -> None:
    assert problems() == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("findings", [{"part": "modem", "level": "error", "text": "no answer"}]), "auv2 error modem: no answer"),
        (("hashes", {"mission.yaml": "x" * 64}), "auv2 error its mission file (xxxxxxxx) differs from the others'"),
        (("free_mb", 100.0), "auv2 error its disk has 100 MB left"),
        (("state", {**STATE, "position": None}), "auv2 error it has no position"),
        (("state", {**STATE, "autopilot": {"heard": True, "battery": 0.15}}), "auv2 error its battery has 15 % left"),
        (("state", {**STATE, "autopilot": {"heard": True, "battery": 0.25}}), "auv2 warning its battery has 25 % left"),
        (("identity", "auv1"), "auv2 error auv1 and auv2 are one folder"),
        (("mission", {"hashes": {"packet.key_file": ""}}), "auv2 error the file of packet.key_file is missing"),
        (("version", "0"), "auv2 error it has version 0 of auv_lse, the laptop 1"),
        (("controller", {"laptop": "two", "name": "bob", "at": "noon"}), ""),
    ],
)
def test_a_fault_is_named(changed: tuple[str, Any], words: str) -> None:
    found = problems(changed)
    assert any(text.startswith(words) for text in found) if words else found == []


def test_a_clock_that_is_off_is_named() -> None:
    assert problems(offset_s=7.5)[0].startswith("auv2 error its clock is +7.50 s")


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_on_the_page(name: str) -> None:
    assert f"| **{name}**: " in (ROOT / "docs" / "guide" / "field-day.md").read_text()
