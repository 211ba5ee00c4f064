"""How long an inspection command looks for nodes, with a simulated clock and a simulated graph."""

from __future__ import annotations

import importlib.util
from types import SimpleNamespace
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("needs rclpy (scripts/test sets it up)", allow_module_level=True)

from auv_lse_common.inspect import graph_node

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
