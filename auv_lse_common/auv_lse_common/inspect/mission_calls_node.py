"""Sends commands to the missions of running vehicles, and receives their states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from auv_lse_common.inspect.graph_node import Graph
from auv_lse_common.vocabulary.mission_run import Command
from auv_lse_msgs.msg import MissionCommand, MissionState
from auv_lse_msgs.srv import RunMission


def tell(graph: Graph, vehicle: str, command: Command, source: str, team: bool) -> tuple[bool, str]:
    """Sends a command of operator `source` to the mission of `vehicle` ("auv2").

    Args:
        team: With ABORT: whether to send it to the team mates by acoustic packet.

    Returns:
        Whether it is accepted, and the result or the reason of the refusal.

    Raises:
        GraphError: if the vehicle does not answer.
    """
    message = MissionCommand(command=int(command), source=source, team=team)
    answer = graph.call(f"/{vehicle}/mission/run", RunMission, RunMission.Request(command=message))
    return answer.accepted, answer.message


def states(graph: Graph, vehicles: Sequence[str], seconds: float) -> dict[str, Any]:
    """The last MissionState of each vehicle that publishes one within `seconds`."""
    heard: dict[str, Any] = {}

    def keep(name: str) -> Callable[[Any], None]:
        return lambda message: heard.update({name: message})

    for name in vehicles:
        graph.listen(f"/{name}/mission/state", MissionState, keep(name))
    graph.spin(seconds)
    return heard
