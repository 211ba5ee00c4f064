"""Where a run's emulated modems and autopilots are, for both ends of each link."""

from __future__ import annotations

import contextlib
import socket
from pathlib import Path
from typing import Any


def hardware_of(modem: str, vehicle_link: str, vehicles: int, folder: Path) -> dict[str, Any]:
    """Parameters by which each vehicle's drivers and the simulator's emulated hardware find each other.

    Args:
        modem: "direct", or "emulated": a pty per vehicle, at modems/auvK in the run folder.
        vehicle_link: "direct", or "mavlink": a free UDP port of this machine per vehicle.
        vehicles: Number of vehicles.
        folder: The run folder, absolute.
    """
    wanted: dict[str, Any] = {}
    for k in range(1, vehicles + 1):
        if modem == "emulated":
            wanted[f"auv{k}.modem.kind"] = "micromodem"
            wanted[f"auv{k}.modem.port"] = str(folder / "modems" / f"auv{k}")
            wanted[f"auv{k}.modem.log_file"] = str(folder / "logs" / f"auv{k}.modem_lines.log")
    if vehicle_link == "mavlink":
        with (
            contextlib.ExitStack() as stack
        ):  # all sockets stay open until every port is known, so that no port comes twice
            for k in range(1, vehicles + 1):
                probe = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                probe.bind(("127.0.0.1", 0))
                wanted[f"auv{k}.link.kind"] = "mavlink"
                wanted[f"auv{k}.link.soundings"] = False  # sim_node gives them
                wanted[f"auv{k}.link.endpoint"] = f"udpin://127.0.0.1:{probe.getsockname()[1]}"
    return wanted
