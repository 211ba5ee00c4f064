"""The SROS 2 policy lets a vehicle's nodes do what the table of topics lists, and nothing of another vehicle."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest
from verb_main import verb_main

from auv_lse_common.topics.table import VEHICLE_TOPICS
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_run.vehicle.security_policy import policy

main = verb_main("security-policy")


def test_nodes_may_use_all_topics_of_their_vehicle() -> None:
    root = ElementTree.fromstring(policy(2).partition("\n")[2])
    assert [enclave.get("path") for enclave in root.iter("enclave")] == ["/auv2"]
    nodes = {(profile.get("ns"), profile.get("node")) for profile in root.iter("profile")}
    assert nodes == {("/", "recorder_node"), *(("/auv2", node) for _, node in vehicle_nodes(True, True))}
    for profile in root.iter("profile"):
        topics = {topic.text for topic in profile.iter("topic")}
        assert {f"/auv2/{name}" for name in VEHICLE_TOPICS if "lockstep" not in name} <= topics
        assert not any(str(topic).startswith("/auv") and not str(topic).startswith("/auv2/") for topic in topics)


#: The schema of SROS 2's policies, version 0.2.0: elements, their attributes and what is below them.
RULES = {"ALLOW", "DENY"}
SCHEMA = {
    "policy": ({"version": {"0.2.0"}}, {"enclaves"}),
    "enclaves": ({}, {"enclave"}),
    "enclave": ({"path": None}, {"profiles"}),
    "profiles": ({}, {"profile"}),
    "profile": ({"ns": None, "node": None}, {"topics", "services", "actions"}),
    "topics": ({"publish": RULES, "subscribe": RULES}, {"topic"}),
    "services": ({"reply": RULES, "request": RULES}, {"service"}),
    "topic": ({}, set()),
    "service": ({}, set()),
}


def test_policy_follows_the_schema() -> None:
    text = policy(3)
    assert text.startswith('<?xml version="1.0" encoding="UTF-8"?>\n<policy version="0.2.0">\n')
    for element in ElementTree.fromstring(text.partition("\n")[2]).iter():
        attributes, below = SCHEMA[element.tag]
        assert element.keys() == list(attributes), element.tag
        for name, allowed in attributes.items():
            assert allowed is None or element.get(name) in allowed, (element.tag, name)
        assert {child.tag for child in element} <= below
        if below:
            assert len(element), f"{element.tag} holds something"
        else:
            assert re.fullmatch(r"(/[a-z_][a-z0-9_]*)+", element.text or ""), "a name from the root, so of one meaning"


def test_invalid_vehicle_name_is_rejected(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["auv3"]) == 0
    assert 'path="/auv3"' in capsys.readouterr().out
    assert main(["boat"]) == 2
    assert "use a name from auv1 to auv255" in capsys.readouterr().err
