"""The processes of a mission, for auv_lse mission, auv_lse sim and the launch file."""

from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_run.process.processes import RECORDER, Process

#: In lockstep, ticks that the recorder may lag behind before the simulator waits; none at the mission's end.
RECORDER_LAG_TICKS = 20


def mission_processes(
    vehicles: int,
    modem: str = "direct",
    vehicle_link: str = "direct",
    record: bool = True,
    together: bool = False,
) -> list[Process]:
    """Every process of a mission, the simulator last.

    Args:
        modem: "direct" (the simulated channel on modem/tx and modem/rx), or "emulated" (micromodem_node and an
            emulated Micromodem-2 per vehicle between them).
        vehicle_link: "direct", or "mavlink" (vehicle_link_node and a simulated MAVLink vehicle between them).
        record: Whether a recorder runs.
        together: Whether the nodes of a vehicle, drivers excepted, share a process. In lockstep they rarely work at
            the same time, and discovery of fewer processes is faster.
    """
    processes: list[Process] = []
    if record:
        processes.append(RECORDER)
    for vehicle in range(1, vehicles + 1):
        namespace = f"/auv{vehicle}"
        nodes = vehicle_nodes(modem == "emulated", vehicle_link == "mavlink")
        if together:
            (package, executable), *beside = vehicle_nodes(modem=False, link=False)
            nodes = nodes[1 + len(beside) :]
            first = Process(package=package, executable=executable, namespace=namespace, beside=tuple(beside))
            processes.append(first)
        processes += [Process(package=p, executable=e, namespace=namespace) for p, e in nodes]
    processes.append(Process(package="auv_lse_sim", executable="sim_node", namespace="/"))
    return processes
