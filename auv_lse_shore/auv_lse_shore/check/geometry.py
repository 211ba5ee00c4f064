"""Checks area, starts, lanes and depths of a mission."""

import math

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.table import VehicleSections
from auv_lse_common.mission_file.sections.vehicle import LEAST_SEPARATION_M, SHALLOWEST_M
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.leg import arc_stray_m, corner_stray_m
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.safety import Safety
from auv_lse_shore.check.findings import Findings
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import can_turn, expectations, fit_to_ground
from auv_lse_sim.ground.reach import clip_to_reachable

#: Parameters of the operating area in local coordinates.
_SHAPE = ("area.polygon_m", "area.no_go", "area.margin_m", "area.raster_m")
_START = ("vehicle.start_north_m", "vehicle.start_east_m", "vehicle.start_heading_rad")
#: Parameters of a vehicle's depth and of the water below it.
_DEPTHS = (
    "level_set.level_m",
    *(f"vehicle.{name}" for name in ("depth_m", "min_water_m", "min_altitude_m")),
    *(f"safety.{name}" for name in ("max_depth_m", "depth_response", "min_altitude_m", "altitude_response")),
)

#: Water that a vehicle has to spare over the isobath, as a share of the level and in metres, below which the isobath is
#: the edge of what it reaches.
EDGE_SHARE, EDGE_M = 0.1, 1.0


def check_geometry(settings: Settings, findings: Findings) -> Settings:
    """Checks starts, lanes, depths, origin, and whether vehicles can reach the area and cross the isobath.

    Each check runs if the parameters that it reads are usable.

    Returns:
        The mission fitted to its ground, without what cannot be reached.
    """
    area = motion = None
    if findings.usable(*_SHAPE):
        try:
            area = OperatingArea(settings.area)
        except ParameterError as error:
            findings.refuse("area", f"{settings.where}: {error}")
    if findings.usable("motion"):
        try:
            motion = MotionTable(settings.motion)
        except ParameterError as error:
            findings.refuse("motion", f"{settings.where}: {error}")
    if area is not None:
        _check_starts(settings, area, motion, findings)
        _check_cells(settings, area, findings)
        _check_no_go(area, findings)
    _check_recovery(settings, findings)
    if area is not None and motion is not None and findings.usable("planner.lane_spacing_m"):
        _check_lanes(settings, area, motion, findings)
    if findings.usable("area.margin_m", "motion", "link"):
        _check_straight_legs(settings, findings)
    _check_depths(settings, findings)
    read = ("area", "motion", "mission", *_START)
    if not settings.sim.bathymetry.file and findings.usable(*read):  # else as a part of fitting to the ground
        settings, texts = clip_to_reachable(settings)
        for text in texts:
            findings.warning(text)
    settings = _check_ground(settings, findings)
    if findings.usable("link", "area"):
        try:
            settings.check_origin()
        except ParameterError as error:
            findings.error(str(error))
    read = ("area.polygon_m", "area.no_go", "motion", "mission", "gp", "level_set")
    if findings.usable(*read, "vehicle.speed_mps", "sim.dynamics", "sim.current", "sim.ideal"):
        for text in expectations(settings):
            (findings.warning if " is too " in text or text.startswith("level_set") else findings.note)(text)
    return settings


def _check_cells(settings: Settings, area: OperatingArea, findings: Findings) -> None:
    sizes = {"gp.map_resolution_m": {own.gp.map_resolution_m for own in settings.vehicles}}
    sizes["planner.map_spacing_m"] = {own.planner.map_spacing_m for own in settings.vehicles}
    for name in filter(findings.usable, sizes):
        for size_m in sizes[name]:
            try:
                area.grid(size_m, name)
            except ParameterError as error:
                findings.refuse(name, f"{settings.where}: {error}")


def _check_no_go(area: OperatingArea, findings: Findings) -> None:
    if not area.no_go:
        return
    from shapely import LinearRing, Polygon  # slow to import, and rarely needed

    polygon = Polygon(area.polygon)
    for name, ring in area.no_go.items():
        if not polygon.intersects(LinearRing(ring)):
            findings.warning(f"area.no_go.{name} lies outside the operating area and changes nothing; is it misplaced?")


def _check_starts(settings: Settings, area: OperatingArea, motion: MotionTable | None, findings: Findings) -> None:
    margin = settings.area.margin_m
    for number, own in enumerate(settings.vehicles, 1):
        if not findings.usable(*_START, vehicle=number):
            continue
        v = own.vehicle
        start = np.array([v.start_north_m, v.start_east_m])
        position = f"auv{number}: vehicle.start_north_m, start_east_m = {start[0]:g}, {start[1]:g} m"
        clearance = float(area.clearance_m(start[None])[0])
        if not area.contains(start[None])[0]:
            findings.error(f"{position} is outside the operating area or in a no-go area; choose a start inside")
        elif clearance < margin:
            findings.warning(f"{position} is {clearance:.0f} m from the border, less than area.margin_m ({margin:g} m)")
        elif motion is not None and not can_turn(area, motion, v.start_heading_rad, start):
            findings.warning(
                f"{position} has no room for a turning circle (motion.turn_radius_m "
                f"{settings.motion.turn_radius_m:g} m, area.margin_m {margin:g} m); choose a start farther "
                "inside, or another vehicle.start_heading_rad"
            )


def _check_recovery(settings: Settings, findings: Findings) -> None:
    for number in range(1, settings.mission.vehicles + 1):
        if not findings.usable("area.polygon_m", "vehicle", "safety", vehicle=number):
            continue
        name = f"/auv{number}/safety_node"
        try:
            safety = Safety.of(parameters_for(settings.to_patterns(), name), f"{settings.where} (auv{number})", number)
        except ParameterError as error:
            findings.error(str(error))
            continue
        if findings.usable("mission.steps", "motion"):
            refusal, warning = safety.battery.answer_go(1.0)
            for text, add in ((refusal, findings.error), (warning, findings.warning)):
                if text:
                    add(f"auv{number}: {text}")


def _check_lanes(settings: Settings, area: OperatingArea, motion: MotionTable, findings: Findings) -> None:
    south, north, west, east = area.extent_m
    wide, margin = min(north - south, east - west), settings.area.margin_m
    across = wide - 2.0 * margin
    circle = 2.0 * settings.motion.turn_radius_m
    spacing = settings.common.planner.lane_spacing_m
    if across < circle:
        narrow = f"area.polygon_m is {wide:.0f} m wide, and area.margin_m ({margin:g} m) on both sides leaves "
        if across <= 0.0:
            findings.error(f"{narrow}nothing. Choose a smaller margin or a wider area")
        else:
            findings.error(
                f"{narrow}{across:.3g} m, but a turning circle takes {circle:g} m. Choose a motion.turn_radius_m of "
                f"at most {across / 2.0:.3g} m, a smaller margin or a wider area"
            )
        return
    if spacing < circle:
        findings.warning(
            f"planner.lane_spacing_m: {spacing:g} m is too narrow to turn from one lane into the next; use at "
            f"least {circle:g} m, twice motion.turn_radius_m"
        )
    lanes = max(1, int(across // spacing))
    if lanes < 2:
        findings.warning(
            f"planner.lane_spacing_m: with {spacing:g} m only one lane fits into the width of {across:.0f} m; "
            f"use less than {across / 2.0:.0f} m"
        )
    inner = (north - south - 2.0 * settings.area.margin_m) * (east - west - 2.0 * settings.area.margin_m)
    if not findings.usable("mission"):
        return
    needed = math.ceil(inner / spacing / motion.leg_length_m / settings.mission.vehicles)
    findings.note(
        f"lanes: {lanes} with planner.lane_spacing_m = {spacing:g} m. Mowing the whole area takes each vehicle about "
        f"{counted(needed, 'leg')}; the mission has {settings.mission.steps}"
    )


def _check_straight_legs(settings: Settings, findings: Findings) -> None:
    """Compares the margin with how far vehicles whose autopilots travel straight to a leg's end stray from it."""
    links = [settings.vehicle(k).link for k in range(1, settings.mission.vehicles + 1)]
    early_m = max((link.acceptance_m for link in links if link.kind == "mavlink"), default=0.0)
    if early_m == 0.0:
        return
    turn_rad = max(abs(math.radians(action)) for action in settings.motion.actions_deg)
    lines = "straight lines that the planner keeps free"
    stray_m = corner_stray_m(turn_rad, early_m)
    if not settings.motion.straight_legs:
        lines = "planned arcs"
        stray_m = arc_stray_m(turn_rad, settings.motion.turn_radius_m, early_m)
    if stray_m > settings.area.margin_m:
        findings.warning(
            f"area.margin_m is {settings.area.margin_m:g} m, and an autopilot that travels straight to each leg's end, "
            f"as ArduSub, strays up to {stray_m:.1f} m from the {lines}. Raise it, or lower motion.turn_radius_m or "
            "link.acceptance_m."
        )


def _check_depths(settings: Settings, findings: Findings) -> None:
    numbered = list(enumerate((own.vehicle for own in settings.vehicles), 1))
    groups: list[list[tuple[float, int]]] = []  # vehicles of close depths, from each to the next deeper one
    for depth_m, number in sorted((v.depth_m, k) for k, v in numbered if findings.usable("vehicle.depth_m", vehicle=k)):
        if groups and depth_m - groups[-1][-1][0] < LEAST_SEPARATION_M - 1e-6:
            groups[-1].append((depth_m, number))
        else:
            groups.append([(depth_m, number)])
    for group in groups:
        if len(group) > 1:
            names = ", ".join(f"auv{k}" for k in sorted(k for _, k in group))
            close_m = sorted({depth_m for depth_m, _ in group})
            findings.warning(
                f"{names}: vehicle.depth_m: {' and '.join(f'{depth_m:g}' for depth_m in close_m)} m "
                f"{'are' if len(close_m) > 1 else 'each is'} too close, because only depth keeps vehicles apart; use a "
                f"difference of at least {LEAST_SEPARATION_M:g} m"
            )
    for number, own in enumerate(settings.vehicles, 1):
        _check_own_depth(number, own, settings.level_set.level_m, findings)


def _check_own_depth(number: int, own: VehicleSections, level_m: float, findings: Findings) -> None:
    """Compares a vehicle's depth with its limits, and the water that it needs with the isobath's depth."""
    if not findings.usable(*_DEPTHS, vehicle=number):
        return
    vehicle, safety = own.vehicle, own.safety
    deepest_m = safety.deepest_m(vehicle.depth_m)
    if deepest_m <= vehicle.depth_m:
        (findings.warning if safety.depth_response == "warn" else findings.error)(
            f"auv{number}: safety.max_depth_m {deepest_m:g} is not deeper than vehicle.depth_m {vehicle.depth_m:g}, "
            f"so that the response ({safety.depth_response}) comes at travel depth; choose more, or leave it out"
        )
    own_depth = f"vehicle.depth_m {vehicle.depth_m:g}"
    climbed_m = min(vehicle.depth_m, SHALLOWEST_M)
    climbed = own_depth if climbed_m == vehicle.depth_m else f"{climbed_m:g} m, to which it climbs,"
    climbs = vehicle.min_altitude_m > 0.0 and climbed_m < vehicle.depth_m
    name = "min_altitude_m" if climbs or vehicle.min_altitude_m > vehicle.min_water_m else "min_water_m"
    text = f"{climbed if climbs else own_depth} + vehicle.{name} {getattr(vehicle, name):g}"
    needs = [(vehicle.shallowest_ground_m, text)]
    least_m = safety.min_altitude_m
    if safety.altitude_response == "climb":
        needs.append((climbed_m + least_m, f"{climbed} + safety.min_altitude_m {least_m:g}"))
    elif safety.altitude_response != "warn" and not (climbs and vehicle.min_altitude_m >= least_m):
        needs.append((vehicle.depth_m + least_m, f"{own_depth} + safety.min_altitude_m {least_m:g}"))
    needed_m, text = max(needs)
    if needed_m >= level_m:
        findings.warning(
            f"auv{number}: {text} = {needed_m:g} m of water are too much to cross the isobath; stay below "
            f"level_set.level_m ({level_m:g} m)"
        )
    elif needed_m > (most_m := level_m - min(EDGE_SHARE * level_m, EDGE_M)):
        findings.warning(
            f"auv{number}: {text} = {needed_m:g} m of water are barely less than level_set.level_m ({level_m:g} m): "
            f"the isobath is the edge of what it can reach, seen from one side. Stay below {most_m:g} m"
        )


def _check_ground(settings: Settings, findings: Findings) -> Settings:
    read = ("sim.bathymetry", "sim.dvl", "sim.ideal", "area", "motion", "mission", "vehicle", "level_set", "planner")
    if not settings.sim.bathymetry.file or not findings.usable(*read, "gp.length_scale_m"):
        return settings
    try:
        fitted, notes = fit_to_ground(settings, ground_of(settings))
    except (GroundError, ParameterError, OSError) as error:
        findings.error(f"{settings.where}: {error}")
        return settings
    changed = fitted.area != settings.area or fitted.vehicles != settings.vehicles
    expected = expectations(fitted)  # reported by the caller
    for text in notes:
        if text not in expected:
            (findings.warning if changed or text.startswith(("level", "dvl")) else findings.note)(text)
    return fitted
