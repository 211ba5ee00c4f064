"""The simulated ArduPilot against the table of what real ones do (facts.toml)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from bench_of_autopilot import OPERATOR, Bench
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_sim.emulated.ardupilot.personality import ROVER, SUB

TABLE = tomllib.loads(Path(__file__).with_name("facts.toml").read_text())
FACTS = TABLE["fact"]
OWN = {"message", "hz", "system", "within"}


def bench_of(fact: dict[str, Any]) -> Bench:
    return Bench({"sub": SUB, "rover": ROVER}[fact["vehicle"]], **fact.get("setup", {}))


def do(bench: Bench, step: str) -> None:
    """Carries out one step of the column `do`."""
    word, *rest = step.split()
    if word in ("read", "set"):
        name = rest[0].encode()
        if word == "read":
            bench.send(mavlink.MAVLink_param_request_read_message(1, 1, name, -1))
        else:
            bench.send(mavlink.MAVLink_param_set_message(1, 1, name, float(rest[1]), 9), OPERATOR)
        return
    values = [float(value) for value in rest]
    steps = {
        "arm": lambda: bench.arm(),
        "disarm": lambda: bench.arm(False),
        "mode": lambda: bench.mode(int(values[0])),
        "target": lambda: bench.target(*values),
        "wait": lambda: bench.pass_s(*values),
        "silent": lambda: setattr(bench, "beats", False),
        "heard": lambda: setattr(bench, "beats", True),
        "no_echo": lambda: setattr(bench.autopilot, "has_echo", False),
        "leak": lambda: setattr(bench.autopilot.failsafes, "leaks", True),
        "joystick": lambda: bench.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), OPERATOR),
        "upload": lambda: bench.upload([(values[0], values[1])]),
        "command": lambda: bench.command(int(values[0]), *values[1:]),
        "set_origin": lambda: bench.send(mavlink.MAVLink_set_gps_global_origin_message(1, 465000000, 66000000, 0)),
        "reboot": lambda: bench.autopilot.reboot(bench.now_s),
    }
    steps[word]()


def check(bench: Bench, expected: dict[str, Any], since: int, since_s: float) -> None:
    """Compares what was sent since entry `since` with one row of the column `expect`."""
    sender = expected.get("system", 1)
    said = [message for _, message in bench.said[since:] if message.get_srcSystem() == sender]
    if "absent" in expected:
        assert expected["absent"] not in {message.get_type() for message in said}
    elif "text" in expected:
        texts = [(m.severity, m.text) for m in said if m.get_type() == "STATUSTEXT"]
        assert (expected["severity"], expected["text"]) in texts
    elif "ack" in expected:
        assert [m.result for m in said if m.get_type() == "COMMAND_ACK"][-1] == expected["ack"]
    else:
        found = [m for m in said if m.get_type() == expected["message"]]
        assert found, f"no {expected['message']}"
        if "hz" in expected:
            assert len(found) / (bench.now_s - since_s) == pytest.approx(expected["hz"], rel=0.2)
        fields = {name: getattr(found[-1], name) for name in expected if name not in OWN}
        assert fields == pytest.approx({name: expected[name] for name in fields}, abs=expected.get("within", 0.01))


@pytest.mark.parametrize("fact", [f for f in FACTS if "do" in f], ids=lambda fact: fact["what"])
def test_the_simulated_autopilot_does_as_the_real_one(fact: dict[str, Any]) -> None:
    bench = bench_of(fact)
    since, since_s = len(bench.said), bench.now_s
    for step in fact["do"]:
        if not step.startswith("wait"):
            since, since_s = len(bench.said), bench.now_s
        do(bench, step)
    for expected in fact["expect"]:
        check(bench, expected, since, since_s)


@pytest.mark.parametrize(
    ("vehicle", "every_s", "speed_mps"),
    [(f["vehicle"], row["every"], row["speed"]) for f in FACTS for row in f.get("repeat", ())],
)
def test_its_speed_with_a_repeated_target_is_the_measured_one(vehicle: str, every_s: float, speed_mps: float) -> None:
    bench = bench_of({"vehicle": vehicle})
    bench.arm()
    bench.mode(bench.autopilot.own.guided)
    bench.command(178, 1.0, 1.0, -1.0)
    positions = []
    for _ in range(round(max(40.0, 4.0 * every_s) / every_s)):
        bench.target(1000.0, 0.0, 0.0)
        bench.pass_s(every_s, 0.1)
        positions.append(bench.position[0])
    half = len(positions) // 2
    mean_mps = (positions[-1] - positions[half]) / ((len(positions) - 1 - half) * every_s)
    assert mean_mps == pytest.approx(speed_mps, abs=0.02)


def test_every_fact_names_its_source_and_is_checked() -> None:
    for fact in FACTS:
        assert fact["source"] in TABLE["sources"], fact["what"]
        assert fact["seen"], fact["what"]
        assert fact.get("expect") or fact.get("repeat"), fact["what"]


def test_a_wrong_fact_is_found() -> None:
    bench = Bench()
    with pytest.raises(AssertionError):
        check(bench, {"message": "HEARTBEAT", "base_mode": 82}, 0, bench.now_s - 1.0)
    with pytest.raises(AssertionError):
        check(bench, {"absent": "HEARTBEAT"}, 0, bench.now_s - 1.0)
