"""The processes and topics of a mission: computed once, used by scripts/mission, the launch file and the recorder."""

from __future__ import annotations

from dataclasses import dataclass

#: Topics of one vehicle, below its namespace: {name: type}.
VEHICLE_TOPICS = {
    "sounding": "auv_lse_msgs/msg/Sounding",
    "odometry": "nav_msgs/msg/Odometry",
    "altitude": "sensor_msgs/msg/Range",
    "pressure": "sensor_msgs/msg/FluidPressure",
    "kernel_centers": "auv_lse_msgs/msg/KernelCenters",
    "field": "auv_lse_msgs/msg/LevelSetField",
    "risk_map": "nav_msgs/msg/OccupancyGrid",
    "isobath": "visualization_msgs/msg/Marker",
    "plan": "auv_lse_msgs/msg/Plan",
    "path": "nav_msgs/msg/Path",
    "waypoint": "auv_lse_msgs/msg/Waypoint",
    "planner/bound": "auv_lse_msgs/msg/Bound",
    "modem/tx": "auv_lse_msgs/msg/ModemTx",
    "modem/rx": "auv_lse_msgs/msg/ModemRx",
    "team/plans": "auv_lse_msgs/msg/Plan",
    "team/samples": "auv_lse_msgs/msg/SampleArray",
    "tdma": "auv_lse_msgs/msg/TdmaStatus",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}

#: Last names of the topics that late readers get the last message of.
LATCHED_TOPICS = ("kernel_centers", "risk_map", "field", "plan", "status")

#: Topics that belong to the whole mission.
MISSION_TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/sim/status": "auv_lse_msgs/msg/SimStatus",
}

#: In lockstep, how many ticks the recorder may be behind before the simulator waits for it.
RECORDER_LAG_TICKS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """One process of a mission: what `ros2 run` would start.

    Attributes:
        package: ROS 2 package.
        executable: Its entry point, which is also the node's name.
        namespace: Node namespace, "/auv1" or "/".
    """

    package: str
    executable: str
    namespace: str

    @property
    def name(self) -> str:
        """Name for people and log files: "auv1.gp_node", "sim_node"."""
        return f"{self.namespace.strip('/')}.{self.executable}".strip(".")

    @property
    def ros_arguments(self) -> tuple[str, ...]:
        """Remappings that put the node into its namespace."""
        return ("-r", f"__ns:={self.namespace}") if self.namespace != "/" else ()


def mission_processes(
    vehicles: int, modem: str = "direct", vehicle_link: str = "direct", record: bool = True
) -> list[Process]:
    """Every process of a mission, the simulator last.

    Args:
        vehicles: Number of vehicles.
        modem: "direct" (the simulated channel on modem/tx and modem/rx), or "emulated" (micromodem_node and an
            emulated Micromodem-2 per vehicle between them).
        vehicle_link: "direct", or "mavlink" (vehicle_link_node and a simulated MAVLink vehicle between them).
        record: Whether a recorder runs.
    """
    processes: list[Process] = []
    if record:
        processes.append(Process(package="auv_lse_sim", executable="recorder_node", namespace="/"))
    for vehicle in range(1, vehicles + 1):
        namespace = f"/auv{vehicle}"
        nodes = [("auv_lse_gp", "gp_node"), ("auv_lse_planner", "planner_node"), ("auv_lse_comms", "modem_node")]
        if modem == "emulated":
            nodes.append(("auv_lse_comms", "micromodem_node"))
        if vehicle_link == "mavlink":
            nodes.append(("auv_lse_comms", "vehicle_link_node"))
        processes += [Process(package=p, executable=e, namespace=namespace) for p, e in nodes]
    processes.append(Process(package="auv_lse_sim", executable="sim_node", namespace="/"))
    return processes


def recorded_topics(vehicles: int) -> dict[str, str]:
    """Every topic of a mission with its type, as the recorder subscribes to them."""
    topics = dict(MISSION_TOPICS)
    for vehicle in range(1, vehicles + 1):
        topics.update({f"/auv{vehicle}/{name}": kind for name, kind in VEHICLE_TOPICS.items()})
        topics[f"/truth/auv{vehicle}/odometry"] = "nav_msgs/msg/Odometry"
    return topics
