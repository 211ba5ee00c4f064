"""Creates a vehicle's acoustic bridge from the sections of a mission file."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from auv_lse_common.mission_file.methods import unless_paper_method
from auv_lse_common.mission_file.parameters import ParameterError, is_given, section
from auv_lse_common.mission_file.sections.acoustics import WINDOW_S, PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig, shared_number
from auv_lse_common.mission_file.sections.modem import PAYLOAD_BYTES, ModemConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.modem_rates import packet_duration_s
from auv_lse_comms.bridge import MateTracks, ModemBridge, ModemFeatures, Pace
from auv_lse_comms.packet.codec import Limits
from auv_lse_comms.packet.key import KeyFileError, read_key


def limits_of(parameters: Mapping[str, Any], packet: PacketConfig, where: str) -> Limits:
    """Limits of this mission's packets, from its steps, action set and operating area; `where` is for messages.

    `mission.steps` is required. Without `motion.actions_deg` or `area.polygon_m` the field table's limits apply.

    Raises:
        ParameterError: naming what is missing or cannot be used.
    """
    known: dict[str, Any] = {"depth_m": (packet.depth_min_m, packet.depth_max_m)}
    known["steps"] = shared_number(parameters, "steps", where)
    motion = section(MotionConfig, parameters, "motion", where)
    area = section(AreaConfig, parameters, "area", where)
    if is_given(parameters, "motion.actions_deg"):
        known["n_actions"] = len(motion.actions_deg)
    if is_given(parameters, "area.polygon_m"):
        corners = np.reshape(area.polygon_m, (-1, 2))
        known["north_m"], known["east_m"] = Limits.box(corners, packet.area_margin_m)
    try:
        return Limits(**known)
    except ValueError as error:
        raise ParameterError(f"{where}: {error}") from error


def check_send_duration(tdma: TdmaConfig, modem: ModemConfig, where: str) -> None:
    """Refuses slots in which a Micromodem that starts late would still be sending when the next slot begins.

    Raises:
        ParameterError: with the time that is needed.
    """
    if modem.kind == "micromodem" and tdma.send_duration_s < modem.send_duration_s - 1e-9:
        raise ParameterError(
            f"{where}: tdma.send_duration_s: {tdma.send_duration_s:g} s is too short, so a late transmission "
            f"could overlap the next slot; use at least {modem.send_duration_s:.2f} s: modem.start_timeout_s "
            f"({modem.start_timeout_s:g} s) and a packet at rate {modem.rate}"
        )


def least_send_duration_s(settings: Settings) -> float:
    """The least `tdma.send_duration_s` (s) that suits the modems of all vehicles, if they are Micromodems."""
    return max(settings.tdma.send_duration_s, *(own.modem.send_duration_s for own in settings.vehicles))


def bridge_of(
    parameters: Mapping[str, Any],
    where: str,
    address: int,
    confirmed: bool = False,
    handshake_s: float = 0.0,
) -> ModemBridge:
    """The bridge of vehicle `address`.

    Args:
        parameters: Nested parameters of its modem_node; `mission.vehicles` and `mission.steps` are required.
        confirmed: Whether a Micromodem (`modem.kind`) must confirm each packet.
        handshake_s: Time (s) from handing over a packet to the earliest transmission; 0 in simulated time.

    Raises:
        ParameterError: naming what cannot be used, problems of the key file included.
    """
    tdma = section(TdmaConfig, parameters, "tdma", where)
    packet = section(PacketConfig, parameters, "packet", where)
    packet = replace(packet, navigation=unless_paper_method(packet.navigation, parameters))
    vehicles = shared_number(parameters, "vehicles", where)
    limits = limits_of(parameters, packet, where)
    modem = section(ModemConfig, parameters, "modem", where)
    if confirmed:
        check_send_duration(tdma, modem, where)
    is_micromodem = modem.kind == "micromodem"
    features = ModemFeatures(
        confirm_s=modem.confirm_s if confirmed and is_micromodem else math.inf,
        second_lead_s=handshake_s if is_micromodem and modem.synchronous else None,
        pings=is_micromodem and modem.ping,
        on_air_s=packet_duration_s(modem.rate, PAYLOAD_BYTES),
    )
    ping_slot_s = tdma.needed_s + tdma.ping_s - tdma.travel_s + WINDOW_S
    if features.pings and tdma.slot_s < ping_slot_s - 1e-9:
        raise ParameterError(
            f"{where}: tdma.slot_s: {tdma.slot_s:g} s is too short with modem.ping; use at least "
            f"{ping_slot_s:.2f} s: a packet, a ping and its answer, and {WINDOW_S:g} s to begin in"
        )
    try:
        key = read_key(packet.key_file) if packet.tag else None
        bridge = ModemBridge(tdma, packet, address, vehicles, limits=limits, key=key, modem=features)
    except KeyFileError as error:
        raise ParameterError(f"{where}: packet.key_file: {error}") from error
    except ValueError as error:
        raise ParameterError(f"{where}: {error}") from error
    if not packet.tag:
        bridge.tracks = MateTracks(_pace(parameters, where))
    return bridge


def _pace(parameters: Mapping[str, Any], where: str) -> Pace:
    """This vehicle's pace; mates are assumed to have the same."""
    motion = section(MotionConfig, parameters, "motion", where)
    vehicle = section(VehicleConfig, parameters, "vehicle", where)
    leg_s = motion.turn_radius_m * math.radians(motion.theta_max_deg) / vehicle.speed_mps
    return Pace(speed_mps=vehicle.speed_mps, leg_s=leg_s, surfacing_steps=math.ceil(vehicle.surfacing_s / leg_s))
