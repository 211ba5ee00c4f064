"""Sends commands to the missions of running vehicles, and receives their states."""

from __future__ import annotations

import getpass
import math
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry, Path

from auv_lse_common.vocabulary.mission_run import STALES, Command
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_msgs.msg import AutopilotStatus, MissionCommand, MissionState
from auv_lse_msgs.srv import RunMission
from auv_lse_run.inspect.graph_node import Graph

#: Time (s) without an answer after which a command is sent again, and after which the vehicle counts as silent.
_REPEAT_S, _ANSWER_S = 1.0, 5.0

__all__ = ["STATE_TOPICS", "CommandCalls", "DiagnosticArray", "states", "vehicles", "without_safety_node"]

#: The topics from which a remote session reads a vehicle's state: topic and type, by the session's name for it.
STATE_TOPICS = {
    "mission": ("mission/state", MissionState),
    "position": ("odometry", Odometry),
    "autopilot": ("autopilot", AutopilotStatus),
    "path": ("path", Path),
}


@dataclass(slots=True)
class _Call:
    """The command to one vehicle: its client, and the requests that await an answer.

    Attributes:
        given_s: When the command was given, by the vehicle's clock; 0: not known. None: the vehicle is asked first.
    """

    client: Any
    given_s: float | None
    first_s: float | None = None
    last_s: float = 0.0
    futures: list[Any] = field(default_factory=list)
    answer: Any = None


class CommandCalls:
    """A command that is sent to each vehicle as soon as its service is matched, and repeated until it answers.

    A repetition has no further effect: the same command changes a mission's state only once. A command that can set a
    vehicle in motion carries the time at which it was given, by the vehicle's clock, which is read first
    (RunMission.srv). So a vehicle that does not answer receives no GO that it could obey later.
    """

    def __init__(
        self,
        graph: Graph,
        names: Sequence[str] | None,
        command: Command,
        team: bool,
        report: Callable[[str, Any], None],
        source: str = "",
        given_s: float | None = None,
        valid_s: float = 0.0,
    ) -> None:
        """Sends nothing yet.

        Args:
            graph: The node that calls; any object with its `node` will do if vehicles are named and `finish` is not
                called.
            names: The vehicles ("auv2"); None: all that are discovered.
            team: With ABORT: whether to send it to the team mates by acoustic packet.
            report: Called with each vehicle's name and its first answer (RunMission.Response).
            source: The sender; "": this process's user.
            given_s: When the command was given, by this computer's steady clock; None: now.
            valid_s: How long it stays valid (s); 0: the default of RunMission.srv.
        """
        self._graph, self._names, self._report = graph, names, report
        message = MissionCommand(command=int(command), source=source or getpass.getuser(), team=team)
        self._message, self._valid_s = message, valid_s
        self._began_s = time.monotonic() if given_s is None else given_s
        self._asks_first = command in STALES
        self._calls: dict[str, _Call] = {}

    def step(self) -> bool:
        """Sends what can be sent now and reports new answers; returns whether every named vehicle has answered."""
        now_s = time.monotonic()
        for name in self._known() if self._names is None else self._names:
            if name not in self._calls:
                client = self._graph.node.create_client(RunMission, f"/{name}/mission/run")
                self._calls[name] = _Call(client, None if self._asks_first else 0.0)
        for name, call in self._calls.items():
            if call.answer is None:
                self._step_one(name, call, now_s)
        return self._names is not None and all(call.answer is not None for call in self._calls.values())

    def finish(self) -> None:
        """Waits for the answers of the vehicles that have received the command, at most 5 s for each."""
        while not self.step() and self._is_waiting():
            self._graph.spin(0.05)
        self.close()

    def close(self) -> None:
        """Ends the calls."""
        for call in self._calls.values():
            self._graph.node.destroy_client(call.client)

    @property
    def acknowledged(self) -> list[str]:
        """The vehicles that have answered, whether they have accepted or refused."""
        return [name for name, call in self._calls.items() if call.answer is not None]

    @property
    def silent(self) -> list[str]:
        """The vehicles that were sent a request and have not answered."""
        return [name for name, call in self._calls.items() if call.answer is None and call.first_s is not None]

    @property
    def unsent(self) -> list[str]:
        """The `silent` vehicles to which the command was not sent, because they have not reported their clock."""
        return [name for name in self.silent if self._calls[name].given_s is None]

    def _known(self) -> list[str]:
        return vehicles((*self._graph.services(), *self._graph.nodes()))

    def _step_one(self, name: str, call: _Call, now_s: float) -> None:
        found = next((f.result() for f in call.futures if f.done()), None)
        if found is not None and call.given_s is None:
            call.given_s = found.clock_s - (now_s - self._began_s)
            call.last_s, call.futures, found = -math.inf, [], None
        if found is not None:
            call.answer = found
            self._report(name, found)
        elif (call.first_s is None or now_s - call.last_s >= _REPEAT_S) and call.client.service_is_ready():
            call.first_s, call.last_s = now_s if call.first_s is None else call.first_s, now_s
            asks, given_s = call.given_s is None, call.given_s or 0.0
            request = RunMission.Request(command=self._message, ask=asks, given_s=given_s, valid_s=self._valid_s)
            call.futures.append(call.client.call_async(request))

    def _is_waiting(self) -> bool:
        now_s = time.monotonic()
        return any(
            call.answer is None and call.first_s is not None and now_s - call.first_s < _ANSWER_S
            for call in self._calls.values()
        )


def vehicles(names: Iterable[str]) -> list[str]:
    """The vehicles ("auv2") that have a mission/run service or a safety_node among these full names."""
    found = {match[1] for name in names if (match := re.fullmatch(r"/(auv\d+)/(?:mission/run|safety_node)", name))}
    return sorted(found, key=lambda name: int(name[3:]))


def without_safety_node(names: Iterable[str]) -> list[str]:
    """The vehicles ("auv2") that have nodes of the stack among these full names, but none that takes commands."""
    names, stack = list(names), {executable for _, executable in vehicle_nodes(modem=True, link=True)}
    found = {match[1] for name in names if (match := re.fullmatch(r"/(auv\d+)/(\w+)", name)) and match[2] in stack}
    return sorted(found - {*vehicles(names)}, key=lambda name: int(name[3:]))


def states(graph: Graph, names: Sequence[str], seconds: float) -> dict[str, Any]:
    """The last MissionState of each vehicle that publishes one within `seconds`."""
    heard: dict[str, Any] = {}

    def keep(name: str) -> Callable[[Any], None]:
        return lambda message: heard.update({name: message})

    for name in names:
        graph.listen(f"/{name}/mission/state", MissionState, keep(name))
    graph.spin(seconds)
    return heard
