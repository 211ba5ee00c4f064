"""Checks timing and slots; estimates duration and packet content."""

import math

import numpy as np

from auv_lse_common.mission_file.sections.acoustics import WINDOW_S
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.plurals import counted
from auv_lse_comms.bridge.mate_tracks import speeds_apart
from auv_lse_comms.packet.fields import are_paired, capacity
from auv_lse_comms.packet.navigation import MAX_BYTES
from auv_lse_comms.tdma import Tdma
from auv_lse_planner.methods.tour_candidates import MAX_EXPLICIT_ACTIONS
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.check.findings import Findings

#: Least steps of the mission for each segment of a tour (auv_lse_planner, method tour).
_STEPS_PER_SEGMENT = 2


def check_timing(settings: Settings, findings: Findings) -> None:
    """Checks slots and decision times; estimates duration and packet content.

    Each check runs if the parameters that it reads are usable.
    """
    longest_s = None
    if findings.usable("motion"):
        longest_s = _check_legs(settings, MotionTable(settings.motion).leg_length_m, findings)
    if not _check_order(settings, findings) or not findings.usable("tdma"):
        return
    cycle_s = _check_slots(settings, longest_s, findings)
    apart = speeds_apart([own.vehicle.speed_mps for own in settings.vehicles])
    if apart and not settings.packet.tag and findings.usable("vehicle.speed_mps", "packet.tag"):
        findings.warning(apart)
    if findings.usable("planner", "motion", "mission", "packet", "sim.altimeter", "link"):
        _check_packet(settings, cycle_s, findings)


def _check_legs(settings: Settings, leg_m: float, findings: Findings) -> float | None:
    """Checks decision times. Returns the longest vehicle's duration (s), if it is known."""
    longest_s = 0.0
    for number, own in enumerate(settings.vehicles, 1):
        if not findings.usable("vehicle.speed_mps", "planner", vehicle=number):
            continue
        leg_s = leg_m / own.vehicle.speed_mps
        longest_s = max(longest_s, own.vehicle.start_delay_s + settings.mission.steps * leg_s)
        if own.planner.replan_lead_s >= leg_s:
            findings.warning(
                f"auv{number}: planner.replan_lead_s: {own.planner.replan_lead_s:g} s is not less than the time "
                f"of a leg, {leg_s:.1f} s ({leg_m:.1f} m at vehicle.speed_mps = {own.vehicle.speed_mps:g})"
            )
        elif own.planner.deadline_s >= own.planner.replan_lead_s:
            findings.warning(
                f"auv{number}: planner.deadline_s: {own.planner.deadline_s:g} s is not less than "
                f"planner.replan_lead_s ({own.planner.replan_lead_s:g} s), so plans may come after their leg "
                "starts"
            )
    if not findings.usable("mission", "vehicle.speed_mps", "vehicle.start_delay_s", "planner"):
        return None
    minutes, seconds = divmod(round(longest_s), 60)
    findings.note(
        f"duration: {minutes} min {seconds} s without current. Each vehicle has "
        f"{counted(settings.mission.steps, 'leg')} of {leg_m:.1f} m"
    )
    return longest_s


def _check_order(settings: Settings, findings: Findings) -> bool:
    """Whether the order of the slots is usable."""
    tdma, vehicles = settings.tdma, settings.mission.vehicles
    if not findings.usable("tdma.order", "mission.vehicles"):
        return False
    try:
        for number in range(1, vehicles + 1):
            Tdma(tdma, number, vehicles)
    except ValueError as error:
        findings.error(f"{settings.where}: {error}")
        return False
    for text in silent_vehicles(settings):
        findings.warning(text)
    return True


def silent_vehicles(settings: Settings) -> list[str]:
    """A sentence for each vehicle without a slot."""
    order = settings.tdma.order
    return [
        f"tdma.order: {list(order)} has no slot for auv{number}, which therefore never sends"
        for number in range(1, settings.mission.vehicles + 1)
        if order and number not in order
    ]


def _check_slots(settings: Settings, longest_s: float | None, findings: Findings) -> float:
    """Checks travel time and plan expiry. Returns the duration of a cycle (s)."""
    tdma = settings.tdma
    order = tdma.order or tuple(range(1, settings.mission.vehicles + 1))
    corners = np.reshape(settings.area.polygon_m, (-1, 2))
    span = float(np.hypot(*(corners[:, None] - corners).T).max())
    if span > tdma.max_range_m and findings.usable("area.polygon_m"):
        span = math.ceil(span)
        slot_s = tdma.needed_s + (span - tdma.max_range_m) / tdma.sound_speed_mps + WINDOW_S
        longer = f", and tdma.slot_s of at least {math.ceil(10.0 * slot_s) / 10.0:g} s" if slot_s > tdma.slot_s else ""
        findings.warning(
            f"tdma.max_range_m: {tdma.max_range_m:g} m is shorter than the area, so packets from its far end "
            f"arrive in the next slot; use at least {span} m{longer}"
        )
    cycle_s = len(order) * tdma.slot_s
    spare = tdma.slot_s - tdma.needed_s
    findings.note(f"slots: {len(order)} x {tdma.slot_s:g} s = a cycle of {cycle_s:g} s")
    findings.note(
        f"slots: a packet needs {tdma.needed_s:.1f} s of its slot with guards and travel time ({spare:.1f} s spare)"
    )
    if longest_s is not None:
        findings.note(f"slots: each vehicle can send {counted(int(longest_s // cycle_s), 'packet')} in the mission")
    expiry = min(own.planner.plan_expiry_s for own in settings.vehicles)
    if expiry < 2.0 * cycle_s and findings.usable("planner.plan_expiry_s"):
        findings.warning(
            f"planner.plan_expiry_s: {expiry:g} s does not survive one lost packet; use at least two cycles, "
            f"{2.0 * cycle_s:g} s"
        )
    return cycle_s


def _check_packet(settings: Settings, cycle_s: float, findings: Findings) -> None:
    own = settings.vehicles[0]
    try:
        planner = own.planner.complete()
    except ValueError as error:
        findings.error(f"{settings.where}: {error}")
        return
    actions = planner.horizon or 1
    tour = math.ceil(settings.mission.steps / _STEPS_PER_SEGMENT) if planner.family.sends_tours else 0
    reserve, navigation = settings.packet.reserve, MAX_BYTES if settings.packet.navigation else 0
    least = capacity(actions, reserve, min(tour, 64), navigation)
    if tour:  # a bent path is sent as actions
        bent = min(settings.mission.steps, MAX_EXPLICIT_ACTIONS)
        paired = are_paired([MotionTable(settings.motion).actions - 1] * bent)
        least = min(least, capacity(bent, reserve, 0, navigation, paired))
    most = capacity(actions, reserve, 0, navigation)
    if least < 1:
        findings.error(
            f"packet: a plan of {actions} actions leaves no room for samples; use a smaller planner.horizon, or "
            "no packet.tag"
        )
        return
    every_s = settings.sim.altimeter.sounding_every_s if own.link.kind == "direct" else own.link.sounding_every_s
    soundings = cycle_s / max(every_s, 0.1)
    nth = max(1, math.ceil(soundings / least))
    apart = nth * max(every_s, 0.1) * own.vehicle.speed_mps
    room = counted(least, "sample") if least == most else f"{least} to {most} samples (more as the path gets shorter)"
    tag = f", a tag of {counted(settings.packet.reserve, 'byte')}" if settings.packet.reserve else ""
    which = "every one" if nth == 1 else f"one in {nth}"
    findings.note(f"packet: the path's start, {counted(actions, 'action')}{', a tour' if tour else ''}{tag} and {room}")
    findings.note(f"packet: of {soundings:.0f} soundings in a cycle {which} is sent. Sent ones are {apart:.0f} m apart")
