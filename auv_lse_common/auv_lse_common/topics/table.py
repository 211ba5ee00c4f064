"""The topics of a mission: the type, the readers and the delivery of each, in one table.

Nodes take the quality of service from here and, in lockstep, the number of readers to wait for. The recorder takes
the list of topics. A new topic or a new reader of one is entered here once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic.

    Attributes:
        kind: Its ROS type.
        readers: The nodes of the stack that read it, without the recorder as it records. "a|b": b reads it only
            where a does not run.
        latched: True if a late reader gets the last message.
        recorded: True if the recorder subscribes to it from the start.
        command: True if hardware acts on it, so that a replay leaves it out.
        writer: The node of the vehicle that alone writes it; "" if others do, too, or nobody of the vehicle reads it.
    """

    kind: str
    readers: tuple[str, ...] = ()
    latched: bool = False
    recorded: bool = True
    command: bool = False
    writer: str = ""


_DONE = "auv_lse_msgs/msg/LockstepDone"

#: Topics of one vehicle, by their name below its namespace. "lockstep/PHASE": the nodes that a phase lets go on.
VEHICLE_TOPICS = {
    "sounding": Topic(kind="auv_lse_msgs/msg/Sounding", readers=("gp_node", "modem_node")),
    "odometry": Topic(kind="nav_msgs/msg/Odometry", readers=("planner_node", "safety_node")),
    "dead_reckoning": Topic(kind="nav_msgs/msg/Odometry", readers=("gp_node", "modem_node")),
    "fix": Topic(kind="auv_lse_msgs/msg/Fix", readers=("gp_node", "modem_node")),
    "altitude": Topic(kind="sensor_msgs/msg/Range", readers=("safety_node",)),
    "pressure": Topic(kind="sensor_msgs/msg/FluidPressure"),
    "autopilot": Topic(kind="auv_lse_msgs/msg/AutopilotStatus", readers=("safety_node",), latched=True),
    "mission/command": Topic(kind="auv_lse_msgs/msg/MissionCommand", readers=("safety_node",), command=True),
    "mission/state": Topic(
        kind="auv_lse_msgs/msg/MissionState",
        readers=("planner_node", "modem_node", "vehicle_link_node|sim_node"),
        latched=True,
        command=True,
        writer="safety_node",
    ),
    "kernel_centers": Topic(
        kind="auv_lse_msgs/msg/KernelCenters", readers=("planner_node",), latched=True, writer="gp_node"
    ),
    "corrected": Topic(kind="nav_msgs/msg/Odometry", readers=("planner_node",), writer="gp_node"),
    "field": Topic(kind="auv_lse_msgs/msg/LevelSetField", latched=True),
    "risk_map": Topic(kind="nav_msgs/msg/OccupancyGrid", latched=True),
    "isobath": Topic(kind="visualization_msgs/msg/Marker"),
    "plan": Topic(kind="auv_lse_msgs/msg/Plan", readers=("modem_node",), latched=True, writer="planner_node"),
    "path": Topic(kind="nav_msgs/msg/Path"),
    "waypoint": Topic(
        kind="auv_lse_msgs/msg/Waypoint", readers=("vehicle_link_node|sim_node",), latched=True, command=True
    ),
    "planner/bound": Topic(kind="auv_lse_msgs/msg/Bound"),
    "modem/tx": Topic(kind="auv_lse_msgs/msg/ModemTx", readers=("micromodem_node|sim_node",), command=True),
    "modem/rx": Topic(kind="auv_lse_msgs/msg/ModemRx", readers=("modem_node",)),
    "modem/sent": Topic(kind="auv_lse_msgs/msg/ModemTx", readers=("modem_node",)),
    "modem/failed": Topic(kind="auv_lse_msgs/msg/ModemTx", readers=("modem_node",), recorded=False),
    "team/plans": Topic(kind="auv_lse_msgs/msg/Plan", readers=("planner_node",), writer="modem_node"),
    "team/samples": Topic(kind="auv_lse_msgs/msg/SampleArray", readers=("gp_node",), writer="modem_node"),
    "team/navigation": Topic(kind="auv_lse_msgs/msg/MateNavigation", readers=("gp_node",), writer="modem_node"),
    "team/command": Topic(
        kind="auv_lse_msgs/msg/MissionCommand", readers=("safety_node",), command=True, writer="modem_node"
    ),
    "tdma": Topic(kind="auv_lse_msgs/msg/TdmaStatus"),
    "diagnostics": Topic(kind="diagnostic_msgs/msg/DiagnosticArray"),
    "lockstep/modem": Topic(
        kind=_DONE, readers=("gp_node", "safety_node", "planner_node"), recorded=False, writer="modem_node"
    ),
    "lockstep/gp": Topic(kind=_DONE, readers=("planner_node",), recorded=False, writer="gp_node"),
    "lockstep/safety": Topic(
        kind=_DONE, readers=("planner_node", "modem_node", "vehicle_link_node"), recorded=False, writer="safety_node"
    ),
    "lockstep/planner": Topic(kind=_DONE, readers=("modem_node",), recorded=False, writer="planner_node"),
}

_VEHICLE_NODES = ("gp_node", "safety_node", "planner_node", "modem_node", "micromodem_node", "vehicle_link_node")

#: Topics of the whole mission. Each vehicle's nodes count once among the readers.
MISSION_TOPICS = {
    "/clock": Topic(kind="rosgraph_msgs/msg/Clock", readers=_VEHICLE_NODES),
    "/mission/command": Topic(kind="auv_lse_msgs/msg/MissionCommand", readers=("sim_node",), command=True),
    "/sim/status": Topic(kind="auv_lse_msgs/msg/SimStatus", latched=True),
    "/lockstep/tick": Topic(
        kind="auv_lse_msgs/msg/LockstepTick", readers=(*_VEHICLE_NODES, "recorder_node"), recorded=False
    ),
    "/lockstep/done": Topic(kind=_DONE, readers=("sim_node",), recorded=False),
}

#: The simulator's truth of one vehicle, below /truth/auvN.
TRUTH_TOPIC = Topic(kind="nav_msgs/msg/Odometry")


def reader_count(topic: Topic, nodes: Sequence[str]) -> int:
    """How many of the running `nodes` read the topic.

    Args:
        topic: The topic.
        nodes: Names of the nodes that run: of one vehicle (and "sim_node") for a vehicle's topic, else of all.
    """
    present = [next((name for name in reader.split("|") if name in nodes), "") for reader in topic.readers]
    return sum(nodes.count(name) for name in present)


def recorded_topics(vehicles: int) -> dict[str, Topic]:
    """The topics that the recorder subscribes to from the start, by full name."""
    topics = {name: topic for name, topic in MISSION_TOPICS.items() if topic.recorded}
    for vehicle in range(1, vehicles + 1):
        topics |= {f"/auv{vehicle}/{name}": topic for name, topic in VEHICLE_TOPICS.items() if topic.recorded}
        topics[f"/truth/auv{vehicle}/odometry"] = TRUTH_TOPIC
    return topics
