"""The last rounds of a node that lets messages gather."""

from __future__ import annotations

import importlib.util

import pytest

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("needs rclpy (scripts/test sets it up)", allow_module_level=True)

from auv_lse_common.node import entry_point

pytestmark = pytest.mark.ros


class _Executor:
    def __init__(self, stopping: _Stopping) -> None:
        self.rounds: list[float | None] = []
        self._stopping = stopping

    def add_node(self, node: object) -> None:
        pass

    def wake(self) -> None:
        pass

    def spin_once(self, timeout_sec: float | None = None) -> None:
        self.rounds.append(timeout_sec)
        self._stopping.requested = len(self.rounds) >= 3

    def shutdown(self) -> None:
        self.rounds.append(-1.0)


class _Stopping:
    requested = False

    def set_wake(self, wake: object) -> None:
        pass


class _Node:
    def __init__(self, gather_s: float) -> None:
        self.gather_s = gather_s


@pytest.mark.parametrize(("gather_s", "last"), [(0.001, [0.0] * entry_point._LAST_ROUNDS), (0.0, [])])
def test_collected_messages_are_handled_before_the_end(
    monkeypatch: pytest.MonkeyPatch, gather_s: float, last: list[float]
) -> None:
    stopping = _Stopping()
    executor = _Executor(stopping)
    monkeypatch.setattr(entry_point, "make_executor", lambda: executor)
    monkeypatch.setattr(entry_point.rclpy, "ok", lambda: True)
    entry_point.spin(stopping, _Node(gather_s))
    assert executor.rounds == [None, None, None, *last, -1.0]
