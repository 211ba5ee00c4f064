"""The table of topics against the nodes' code: who reads what, and that every message type exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from auv_lse_common.topics.table import (
    MISSION_TOPICS,
    PHASES,
    TRUTH_TOPIC,
    VEHICLE_TOPICS,
    announces,
    find_topic,
    full_name,
    reader_count,
    recorded_topics,
    waits_for,
)
from auv_lse_shore.reference_pages.tables import nodes

ROOT = Path(__file__).resolve().parents[3]

#: Subscriptions that the table does not list: they read whatever topic there is, watch from outside,
#: or need a message package that may be missing.
READ_ALONG = {"dvl_node", "mission_node", "recorder_node", "sim_status_node", "watch_node"}


def strings(node: ast.AST) -> str:
    """The literal text in an expression: of `space + "modem/tx"` it is "modem/tx"."""
    return "".join(n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str))


def topic_names(call: ast.Call) -> list[str]:
    """The texts among a call's arguments: a topic's name, or the row with this name of a table."""
    return [strings(argument) for argument in call.args if isinstance(argument, ast.Constant | ast.Subscript)]


def subscriptions() -> dict[str, set[str]]:
    """{node: topics that its module subscribes to}, by the source code."""
    found: dict[str, set[str]] = {}
    for path in ROOT.glob("auv_lse_*/auv_lse_*/**/*_node.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        methods = [c for c in calls if isinstance(c.func, ast.Attribute)]
        topics = {
            name
            for c in methods
            if c.func.attr in ("listen", "create_subscription", "_listen", "_subscribe")
            for name in topic_names(c)
        }
        if topics - {""}:
            found[path.stem] = topics - {""}
    return found


def test_every_reader_in_the_table_subscribes_and_every_subscriber_is_in_the_table() -> None:
    by_code = subscriptions()
    assert by_code.pop("vehicle_node") == {"/lockstep/tick"}, "and each lockstep topic that the node is to read"
    listed: dict[str, set[str]] = {}
    for name, topic in (VEHICLE_TOPICS | MISSION_TOPICS).items():
        for reader in (node for entry in topic.readers for node in entry.split("|")):
            listed.setdefault(reader, set()).add(name)
    for node, topics in by_code.items():
        if node in READ_ALONG:
            continue
        expected = listed[node] - {"/clock", "dive"}  # ROS itself subscribes, and the base node
        if node != "sim_node":
            expected = {name for name in expected if "lockstep/" not in name}  # the base node subscribes
        assert topics == expected, node
    assert set(listed) - {"recorder_node"} <= set(by_code)


def publishers() -> dict[str, set[str]]:
    """{topic: nodes of a vehicle that publish it}, by the source code; "lockstep/PHASE": by their phases."""
    found: dict[str, set[str]] = {}
    for path in ROOT.glob("auv_lse_*/auv_lse_*/**/*_node.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        for call in (c for c in calls if isinstance(c.func, ast.Attribute)):
            if call.func.attr == "publisher":
                found.setdefault(strings(call.args[0]), set()).add(path.stem)
            elif call.func.attr == "phase":
                found.setdefault(f"lockstep/{strings(call.args[0])}", set()).add(path.stem)
    return found


def test_a_topic_with_one_writer_is_written_by_that_node_alone() -> None:
    by_code = publishers()
    for name, topic in VEHICLE_TOPICS.items():
        if topic.writer and "|" not in topic.writer:
            assert by_code[name] == {topic.writer}, name
    assert by_code["odometry"] == {"vehicle_link_node"}, "and the simulator where no autopilot is linked"


def test_every_message_type_of_our_own_exists() -> None:
    for topic in (*VEHICLE_TOPICS.values(), *MISSION_TOPICS.values(), TRUTH_TOPIC):
        package, _, name = topic.kind.split("/")
        if package == "auv_lse_msgs":
            assert (ROOT / "auv_lse_msgs" / "msg" / f"{name}.msg").is_file(), topic.kind


def test_the_end_of_a_phase_is_told_to_the_nodes_that_wait_for_it_and_to_no_other() -> None:
    for phase in PHASES:
        waiting = {PHASES[other].node for other in PHASES if set(waits_for(other)) & set(announces(phase))}
        topic = VEHICLE_TOPICS.get(f"lockstep/{phase}")
        assert set(topic.readers if topic else ()) == waiting, phase
    assert set(VEHICLE_TOPICS["lockstep/modem"].readers) == {"gp_node", "safety_node", "planner_node"}


def test_each_phase_waits_for_topics_of_its_own_node() -> None:
    for name, topic in VEHICLE_TOPICS.items():
        for phase in topic.awaited_by:
            nodes = {node for entry in (*topic.readers, topic.writer) for node in entry.split("|")}
            assert PHASES[phase].node in nodes, (name, phase)


def test_topics_are_found_by_their_full_names() -> None:
    for topic in (*VEHICLE_TOPICS.values(), TRUTH_TOPIC):
        assert find_topic(full_name(topic, 12)) == (topic, 12)
    assert find_topic("/boat3/plan") == (VEHICLE_TOPICS["plan"], 3), "a namespace ends in the vehicle's number"
    assert find_topic("/sim/status") == (MISSION_TOPICS["/sim/status"], 0)
    for name in ("/auv1/camera", "/plan", "/truth/auv1/plan", "/boat/plan", "auv1/plan"):
        assert find_topic(name) is None, name


def test_readers_are_counted_among_the_nodes_that_run() -> None:
    direct = ["gp_node", "planner_node", "modem_node", "sim_node"]
    emulated = [*direct, "micromodem_node"]
    assert reader_count(VEHICLE_TOPICS["sounding"], direct) == 2
    assert reader_count(VEHICLE_TOPICS["lockstep/modem"], emulated) == 2, "safety_node does not run"
    assert reader_count(VEHICLE_TOPICS["modem/tx"], direct) == 1, "the simulator"
    assert reader_count(VEHICLE_TOPICS["modem/tx"], emulated) == 1, "the driver in its position"
    assert reader_count(MISSION_TOPICS["/lockstep/tick"], 3 * direct[:3] + ["recorder_node"]) == 10
    assert reader_count(VEHICLE_TOPICS["sounding"], direct, together=direct) == 1, "one process reads it once"
    everyone, together = [*3 * emulated, "recorder_node"], direct
    assert reader_count(MISSION_TOPICS["/lockstep/tick"], everyone, together) == 7, "drivers have their own processes"


def test_the_recorder_records_every_vehicles_topics_and_the_truth() -> None:
    topics = recorded_topics(2)
    assert {"/clock", "/sim/status", "/auv1/plan", "/auv2/modem/tx", "/truth/auv2/odometry"} <= set(topics)
    assert not any("lockstep" in name for name in topics)
    assert topics["/auv1/plan"].latched
    assert not topics["/auv1/modem/tx"].latched


def test_the_table_of_nodes_lists_every_topic_that_a_node_publishes() -> None:
    rows = {line.split("|")[1].strip(" `"): line for line in nodes().splitlines() if "_node`" in line}
    for name, row in rows.items():
        (path,) = ROOT.glob(f"auv_lse_*/auv_lse_*/**/{name}.py")
        for topic in re.findall(r'self\.publisher\("([^"]+)"\)', path.read_text()):
            assert f"`{topic}`" in row.split("|")[4], f"{name} publishes {topic}"
