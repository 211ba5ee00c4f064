"""How long an inspection command looks for nodes, with a simulated clock and a simulated graph."""

from __future__ import annotations

import importlib.util
from types import SimpleNamespace
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("needs rclpy (scripts/test sets it up)", allow_module_level=True)

from auv_lse_run.inspect import graph_node, nodes, params, topics

pytestmark = pytest.mark.ros

#: By default DDS announces a participant every 3 s; this one is announced late.
_LATE_S = 3.0


class _Graph(graph_node.Graph):
    """/talker is there at once, /late after `_LATE_S`; the endpoints of a third participant have no node name."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, unnamed_until_s: float = 0.0, **options: Any) -> None:
        super().__init__(**{key: value for key, value in options.items() if key != "spin_s"})
        self.now_s, self.node, self._unnamed_until_s = 0.0, self, unnamed_until_s
        monkeypatch.setattr(graph_node.time, "monotonic", lambda: self.now_s)
        self.discover(options.get("spin_s"))

    def spin(self, seconds: float) -> None:
        self.now_s += seconds

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [("talker", "/"), *[("late", "/")] * (self.now_s > _LATE_S)]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [("/chat", ["std_msgs/msg/String"])]

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        name = "_NODE_NAME_UNKNOWN_" if self.now_s < self._unnamed_until_s else "talker"
        return [SimpleNamespace(node_name=name, endpoint_gid=[1] * 16)]

    def get_subscriptions_info_by_topic(self, topic: str) -> list[Any]:
        return []

    def get_name(self) -> str:
        return "_auv_lse_inspect_1"


def test_a_node_that_announces_itself_every_3_s_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = _Graph(monkeypatch)
    assert graph.nodes() == ["/late", "/talker"]
    assert graph.missing == ""
    assert graph.now_s < 4.5, "with the start of Python: within 5 s"


@pytest.mark.parametrize(("wanted", "took_s"), [("/talker", 1.0), ("/chat", 1.0), ("/late", 3.5)])
def test_what_is_asked_for_by_name_ends_the_discovery(
    monkeypatch: pytest.MonkeyPatch, wanted: str, took_s: float
) -> None:
    assert _Graph(monkeypatch, wanted=wanted).now_s == pytest.approx(took_s, abs=0.2)


def test_a_participant_whose_node_names_are_missing_is_waited_for_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _Graph(monkeypatch, unnamed_until_s=3.8).missing == ""
    graph = _Graph(monkeypatch, unnamed_until_s=9.0)
    assert graph.missing == "node names of 1 participant on /chat"
    assert graph.now_s < 4.5
    assert _Graph(monkeypatch, spin_s=1.0, unnamed_until_s=9.0).now_s == pytest.approx(1.0, abs=0.1)


class _Alone(_Graph):
    """Nothing but what an inspecting command itself brings: its hidden node, and the topics of every node."""

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(self.get_name(), "/")]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [("/rosout", ["rcl_interfaces/msg/Log"])]

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [SimpleNamespace(node_name=self.get_name(), endpoint_gid=[1] * 16)]


@pytest.mark.parametrize(
    ("tool", "words", "printed"),
    [(nodes, ["list"], ""), (nodes, ["list", "-c"], "0\n"), (topics, ["list"], ""), (params, ["list"], "")],
)
def test_a_list_of_an_empty_domain_names_it_and_what_to_check(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tool: Any, words: list[str], printed: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "85")
    monkeypatch.setattr(graph_node, "domains_with_participants", lambda: [7, 82, 85])
    graph = _Alone(monkeypatch)
    options = tool.parser().parse_args(words)
    with pytest.raises(graph_node.GraphError) as raised:
        options.call(options, graph)
    assert str(raised.value) == (
        "no other node in ROS domain 85 after 3.2 s. Check that the nodes run, that their ROS_DOMAIN_ID is 85 (nodes "
        "of this machine use 7, 82: --domain N), and that DDS reaches them: "
        "only nodes of this computer are searched; ROS_STATIC_PEERS=ADDRESS adds another computer. --spin-time 10 "
        "waits longer"
    )
    assert capsys.readouterr().out == printed
    assert graph.now_s < 4.5, "with the start of Python: within 5 s"


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({}, "ROS_AUTOMATIC_DISCOVERY_RANGE, which is not set, finds nodes of this subnet"),
        (
            {"ROS_STATIC_PEERS": "10.0.0.2", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
            "nodes of this computer and of the named peers, ROS_STATIC_PEERS=10.0.0.2",
        ),
    ],
)
def test_the_range_of_the_discovery_is_named(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], words: str
) -> None:
    for name in graph_node.NETWORK_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert words in graph_node.discovery_range()


def test_a_domain_with_a_node_or_a_nameless_participant_is_not_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    _Graph(monkeypatch).require_nodes()

    class Nameless(_Alone):
        def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
            return [SimpleNamespace(node_name="_NODE_NAME_UNKNOWN_", endpoint_gid=[2] * 16)]

    graph = Nameless(monkeypatch)
    graph.require_nodes()
    assert graph.missing == "node names of 1 participant on /rosout"
