"""A vehicle's acoustic bridge from the sections of a mission file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auv_lse_common.params import ParameterError, section
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.config import PacketConfig, TdmaConfig
from auv_lse_comms.packet import Limits
from auv_lse_comms.selection import ReceiversRisk, load_receivers
from auv_lse_comms.tag import KeyFileError, read_key


def limits_of(parameters: Mapping[str, Any], packet: PacketConfig) -> Limits:
    """What this mission's packets can hold, from its steps, action set and operating area.

    Args:
        parameters: Nested parameters; `mission`, `motion` and `area` belong to other packages, which check them.
        packet: The section `packet`.
    """
    known: dict[str, Any] = {"depth_m": (packet.depth_min_m, packet.depth_max_m)}
    if "steps" in parameters.get("mission", {}):
        known["steps"] = parameters["mission"]["steps"]
    if "actions_deg" in parameters.get("motion", {}):
        known["n_actions"] = len(parameters["motion"]["actions_deg"])
    polygon = parameters.get("area", {}).get("polygon_m")
    if packet.check_limits and polygon is not None:
        corners = np.asarray(polygon, dtype=float).reshape(-1, 2)
        known["north_m"], known["east_m"] = Limits.box(corners, packet.area_margin_m)
    return Limits(**known)


def bridge_of(
    parameters: Mapping[str, Any], where: str, address: int, receivers: ReceiversRisk | None = None
) -> ModemBridge:
    """The bridge of vehicle `address`.

    Args:
        parameters: Nested parameters of its modem_node.
        where: Where they came from, for messages.
        address: Number of the vehicle.
        receivers: What the receivers know, for `packet.selection` "useful"; None: `packet.receivers`.

    Raises:
        ParameterError: naming what cannot be used, the key file's faults among them.
    """
    tdma = section(TdmaConfig, parameters, "tdma", where)
    packet = section(PacketConfig, parameters, "packet", where)
    vehicles = int(parameters.get("mission", {}).get("vehicles", max((*tdma.order, address))))
    if packet.selection == "useful" and receivers is None:
        receivers = load_receivers(packet.receivers, parameters, where, address)
    try:
        key = read_key(packet.key_file) if packet.tag else None
        limits = limits_of(parameters, packet)
        return ModemBridge(tdma, packet, address, vehicles, limits=limits, key=key, receivers=receivers)
    except KeyFileError as error:
        raise ParameterError(f"{where}: packet.key_file: {error}") from error
    except ValueError as error:
        raise ParameterError(f"{where}: {error}") from error
