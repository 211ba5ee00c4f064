"""Addresses of a run's emulated modems and autopilots, for both ends of each link."""

import os
import socket
from collections.abc import Collection
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.settings import least_send_duration_s

#: Above Linux's ephemeral ports (up to 60999) and the ports of DDS (domains up to 213).
PORTS = range(61000, 65536)


def hardware_of(
    modem: str, vehicle_link: str, settings: Settings, folder: Path, chosen: Collection[str] = ()
) -> dict[str, Any]:
    """Parameters that connect each vehicle's drivers to the simulator's emulated hardware.

    Args:
        modem: "direct", or "emulated": a pty per vehicle, at modems/auvK in the run folder. Emulated modems have a
            PPS: they measure ranges one-way (`modem.synchronous`), unless a vehicle pings. On a clock they may begin
            to send late, as real ones do (`tdma.send_duration_s`).
        vehicle_link: "direct", or "mavlink": a free UDP port of this machine per vehicle.
        folder: The run folder, absolute.
        chosen: Names of parameters that the user has set; they are kept.

    Raises:
        ParameterError: if the folder's name cannot be part of a port's address.
    """
    vehicles = settings.mission.vehicles
    if modem == "emulated" and ":" in str(folder):
        raise ParameterError(
            f"the folder {folder} has a colon in its name, which the ports of emulated modems cannot have. Choose "
            "another --out"
        )
    wanted: dict[str, Any] = {}
    pings = any(own.modem.ping for own in settings.vehicles)
    if modem == "emulated" and not pings and not any(name.endswith("modem.synchronous") for name in chosen):
        wanted["modem.synchronous"] = True
    if modem == "emulated" and not settings.sim.lockstep and "tdma.send_duration_s" not in chosen:
        wanted["tdma.send_duration_s"] = least_send_duration_s(settings)
    for k in range(1, vehicles + 1):
        if modem == "emulated":
            wanted[f"auv{k}.modem.kind"] = "micromodem"
            wanted[f"auv{k}.modem.port"] = str(folder / "modems" / f"auv{k}")
            wanted[f"auv{k}.modem.log_file"] = str(folder / "logs" / f"auv{k}.modem_lines.log")
    if vehicle_link == "mavlink":
        for k, port in enumerate(_free_ports(vehicles), 1):
            wanted[f"auv{k}.link.kind"] = "mavlink"
            wanted[f"auv{k}.link.soundings"] = False  # sim_node publishes them
            wanted[f"auv{k}.link.endpoint"] = f"udpin://127.0.0.1:{port}"
    return wanted


def _free_ports(number: int) -> list[int]:
    """Free UDP ports of `PORTS`; a restarted driver finds its port free again."""
    found: list[int] = []
    first = os.getpid() * 8 % len(PORTS)  # runs that start at the same time try different ports
    for port in (*PORTS[first:], *PORTS[:first]):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        found.append(port)
        if len(found) == number:
            return found
    raise OSError(
        f"UDP ports {PORTS[0]} to {PORTS[-1]} of 127.0.0.1: only {len(found)} of the {number} ports needed are free"
    )
