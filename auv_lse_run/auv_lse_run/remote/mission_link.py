"""The vehicle's own nodes, over ROS: gives them orders, and keeps the newest of what they publish."""

import contextlib
import math
import time
from collections.abc import Callable
from typing import Any

from auv_lse_common.support.confinement import confine
from auv_lse_common.vocabulary.health import LEGS_LEFT, LEGS_PLANNED
from auv_lse_common.vocabulary.mission_run import Command, RunState
from auv_lse_run.remote.orders import ACTED, ALWAYS, INTERRUPTED, REFUSED, SILENT, Order

_GIVEN = (Command.GO, Command.HOLD, Command.SURFACE, Command.ABORT, Command.RESET)
_COMMANDS = {command.name.lower(): command for command in _GIVEN}
#: Time (s) to find the vehicle's service.
_FIND_S = 5.0
#: Time (s) for the first state and position: the mission's state comes every second.
_FIRST_S = 3.0
#: Time (s) for which a node's report of ill health is shown.
_HEALTH_S = 15.0


class Newest:
    """The newest message of a topic, and how old it is.

    A latched topic delivers its last message to a new reader. How old that one is cannot be seen: its age is unknown
    until the next message.
    """

    def __init__(self) -> None:
        self.value: Any = None
        self._since_s = math.inf
        self._count = 0

    def take(self, value: Any, now_s: float) -> None:
        """Adds a message, stamped by a steady clock."""
        self.value, self._since_s = value, now_s
        self._count += 1

    def age_s(self, now_s: float) -> float | None:
        """Age (s) of the value; None: unknown."""
        return now_s - self._since_s if self._count > 1 else None


class MissionLink:
    """A session's connection to the nodes of one vehicle on its ROS domain."""

    def __init__(self, name: str, domain: int) -> None:
        """Joins nothing yet.

        Args:
            name: The vehicle, "auv2".
        """
        self._name, self._domain = name, domain
        self._stack = contextlib.ExitStack()
        self._graph: Any = None
        self._newest: dict[str, Newest] = {}
        self._health: dict[str, tuple[str, float]] = {}
        self._legs: dict[str, int] = {}  # by battery and planned, as the nodes' diagnostics name them
        #: A message may have arrived at any time since messages were last taken: it counts as that old.
        self._spun_s = time.monotonic()

    def give(self, order: Order) -> tuple[str, str]:
        """Gives an order to safety_node; returns outcome and text."""
        from auv_lse_run.inspect.mission_calls_node import CommandCalls

        graph, answers = self._joined(), []
        source = f"{order.name or order.laptop} (order {order.number})"
        report: Callable[[str, Any], None] = lambda _, answer: answers.append(answer)
        age = (order.given_s, order.valid_s)
        calls = CommandCalls(graph, [self._name], _COMMANDS[order.verb], order.team, report, source, *age)
        graph.discover(_FIND_S, calls.step)
        calls.finish()
        is_sent = self._name in calls.silent and self._name not in calls.unsent
        if not answers and is_sent and order.verb not in ALWAYS:  # repeated later, it could undo a HOLD
            return INTERRUPTED, f"its safety_node has not answered, and may have obeyed {order.verb}; see its state"
        if not answers:
            return SILENT, "its safety_node does not answer; are its nodes running?"
        return (ACTED if answers[0].accepted else REFUSED), answers[0].message

    def state(self) -> dict[str, Any]:
        """The newest state, position and battery, each with its age (s; None: unknown)."""
        graph = self._joined()
        if not self._newest:
            self._listen(graph)
            end_s = time.monotonic() + _FIRST_S
            while time.monotonic() < end_s and not all(self._newest[name].value for name in ("mission", "position")):
                graph.spin(0.05)
        graph.spin(0.05)
        now_s = self._spun_s = time.monotonic()
        found: dict[str, Any] = dict.fromkeys(_READERS)
        for name, newest in self._newest.items():
            if newest.value is not None:
                found[name] = _READERS[name](newest.value) | {"age_s": newest.age_s(now_s)}
        ill = (f"{name}: {text}" for name, (text, at_s) in self._health.items() if text and now_s - at_s < _HEALTH_S)
        return found | {"health": sorted(ill), "legs": dict(self._legs)}

    def close(self) -> None:
        """Leaves the domain."""
        self._stack.close()

    def _joined(self) -> Any:
        if self._graph is None:
            confine(self._domain)
            from auv_lse_run.inspect.graph_node import Graph  # after the environment is set

            self._graph = self._stack.enter_context(Graph(at_once=True))
        return self._graph

    def _listen(self, graph: Any) -> None:
        from auv_lse_run.inspect.mission_calls_node import STATE_TOPICS, DiagnosticArray

        graph.discover(_FIND_S, lambda: f"/{self._name}/mission/state" in graph.topics())
        for name, (topic, kind) in STATE_TOPICS.items():
            newest = self._newest[name] = Newest()
            graph.listen(f"/{self._name}/{topic}", kind, lambda m, n=newest: n.take(m, self._spun_s))
        graph.listen(f"/{self._name}/diagnostics", DiagnosticArray, self._take_health)

    def _take_health(self, message: Any) -> None:
        for status in message.status:
            is_ill = int.from_bytes(status.level, "little") > 0
            self._health[status.name] = (status.message if is_ill else "", time.monotonic())
            self._legs |= {v.key: int(v.value) for v in status.values if v.key in (LEGS_LEFT, LEGS_PLANNED)}


def _mission(message: Any) -> dict[str, Any]:
    return {
        "state": RunState(message.state).name,
        "reason": message.reason,
        "limits": list(message.limits),
        "warnings": list(message.warnings),
    }


def _position(message: Any) -> dict[str, Any]:
    at = message.pose.pose.position
    position = {"north_m": _number(at.y), "east_m": _number(at.x), "depth_m": _number(-at.z)}
    return position | {"speed_mps": _number(message.twist.twist.linear.x)}


def _autopilot(message: Any) -> dict[str, Any]:
    return {"heard": bool(message.heard), "armed": bool(message.armed), "battery": _number(message.battery)}


def _path(message: Any) -> dict[str, Any]:
    return {"north_east_m": [[p.pose.position.y, p.pose.position.x] for p in message.poses[:200]]}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


_READERS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "mission": _mission,
    "position": _position,
    "autopilot": _autopilot,
    "path": _path,
}
