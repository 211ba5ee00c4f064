"""The processes of a mission: computed once, used by scripts/mission, the launch file and the simulator."""

from __future__ import annotations

from dataclasses import dataclass

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


def vehicle_nodes(modem: bool, link: bool) -> list[tuple[str, str]]:
    """Package and executable of each node of one vehicle.

    Args:
        modem: Whether micromodem_node runs between modem_node and a modem.
        link: Whether vehicle_link_node runs between the stack and an autopilot.
    """
    nodes = [("auv_lse_gp", "gp_node"), ("auv_lse_planner", "planner_node"), ("auv_lse_comms", "modem_node")]
    if modem:
        nodes.append(("auv_lse_comms", "micromodem_node"))
    if link:
        nodes.append(("auv_lse_comms", "vehicle_link_node"))
    return nodes


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
        nodes = vehicle_nodes(modem == "emulated", vehicle_link == "mavlink")
        processes += [Process(package=p, executable=e, namespace=namespace) for p, e in nodes]
    processes.append(Process(package="auv_lse_sim", executable="sim_node", namespace="/"))
    return processes
