"""Fits a mission to the ground: operating area, starts, and the length of the paths.

Land, unknown ground, and water shallower than the deepest vehicle's depth plus its minimum water are not navigable. The
navigable rest of the requested polygon becomes the operating polygon; holes in it become no-go areas. If it consists of
separate parts, one part is kept. Ground that vehicles cannot reach from their starts is left out. The contour of the
least navigable depth becomes the shore (`area.shore`), unless the mission has one. Every change is reported.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from scipy import ndimage

from auv_lse_common.mission_file.goals import MAX_LINE_LEGS, coverage, line_method
from auv_lse_common.mission_file.operating_area import OperatingArea, free_m2
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.support.plurals import area_size, counted
from auv_lse_common.vocabulary.frames import FAR_M, geodetic_from_local, local_from_geodetic
from auv_lse_gp.covariance.prior_mean import MAX_LEVEL_SIGMAS, excluded_level
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.ground.ground import Ground, GroundError
from auv_lse_sim.ground.local_frame import prior_fits
from auv_lse_sim.ground.reach import clip_to_reachable, without_unreachable
from auv_lse_sim.ground.shore import shore_of

#: Maximum number of cells of the area's raster; larger areas get larger cells.
MAX_CELLS = 400_000
#: Maximum number of cells in which the area's depths are checked.
WARNING_CELLS = 40_000
#: Beginning of a note on a start that was moved.
START_MOVED = "start of "
#: Parts smaller than this fraction of the largest part are never selected.
LEAST_PART = 0.25
#: An area is too large for a chart if paths cover less than this share of it. There the goal `line` locates more of the
#: isobath than `chart` (docs/evidence/planner.md).
CHART_COVERAGE = 0.5
#: Maximum number of corners of an outline.
MAX_CORNERS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Raster:
    """The navigable cells of an area.

    Attributes:
        north_m: Row centers (ny,).
        east_m: Column centers (nx,).
        wanted: Cells in the requested polygon and outside the mission's no-go areas (ny, nx).
        deep: Cells that are known and deep enough at center and corners (ny, nx).
        step_m: Cell size.
    """

    north_m: Array
    east_m: Array
    wanted: Mask
    deep: Mask
    step_m: float

    @property
    def free(self) -> Mask:
        """Wanted and deep."""
        return self.wanted & self.deep


def fit_to_ground(settings: Settings, ground: Ground, area_given: bool = False) -> tuple[Settings, list[str]]:
    """Fits operating area and starts to the ground.

    Args:
        area_given: Whether the user requested `settings.area.polygon_m`; any polygon other than the default counts as
            requested. With the default polygon the mission covers the whole extent of a bathymetry file.

    Returns:
        The adjusted settings, and notes on what was changed and what to expect.

    Raises:
        GroundError: if no part of the area can be navigated, a vehicle can turn nowhere in it, or starts far from it.
    """
    settings = without_unreachable(settings)
    notes = [ground.describe()]
    asked = (settings.area.origin_lat_deg, settings.area.origin_lon_deg)
    settings, wanted_by = _wanted_area(settings, ground, area_given)
    origin = (settings.area.origin_lat_deg, settings.area.origin_lon_deg)
    # 1e-5 deg is about a metre: origins computed from soundings are no more accurate than that.
    if None not in asked and not np.allclose(np.array(asked, float), np.array(origin, float), rtol=0.0, atol=1e-5):
        texts = [f"{lat:.5f}, {lon:.5f} deg" for lat, lon in (asked, origin)]
        if prior := ", ".join(sorted({own.gp.mean for own in settings.vehicles if not prior_fits(own.gp, origin)})):
            raise GroundError(
                f"area.origin is {texts[0]}, and the ground's {texts[1]}; the prior (gp.mean: {prior}) would stay. If "
                "its metres are relative to the ground's origin, set area.origin_lat_deg, origin_lon_deg to it; "
                "else take a ground without an origin of its own, such as a table with lat and lon alone"
            )
        notes.append(
            f"origin: area.origin {texts[0]} is replaced by the origin of the ground, {texts[1]}; area, starts and "
            "recovery positions are converted"
        )
    limit = max(own.vehicle.depth_m + own.vehicle.min_water_m for own in settings.vehicles)
    raster = rasterize(settings.area, ground, limit)
    settings, part_notes = _navigable_part(settings, raster, limit, wanted_by)
    notes += part_notes
    if part_notes and not settings.area.shore:
        settings, shore_notes = _with_shore(settings, raster, ground, limit)
        notes += shore_notes
    settings, start_notes = _move_starts(settings)
    notes += start_notes
    settings, reach_notes = clip_to_reachable(settings)
    notes += reach_notes
    notes += depth_warnings(settings, ground)
    notes += expectations(settings)
    return settings, notes


def _wanted_area(settings: Settings, ground: Ground, area_given: bool) -> tuple[Settings, str]:
    overrides: dict[str, Any] = {}
    given = area_given or settings.area.polygon_m != AreaConfig().polygon_m
    wanted_by = "the requested area" if given else "the default area"
    if not given and settings.sim.bathymetry.file:
        e = ground.extent
        overrides["area.polygon_m"] = [
            e.north_min_m, e.east_min_m, e.north_max_m, e.east_min_m, e.north_max_m, e.east_max_m, e.north_min_m,
            e.east_max_m,
        ]  # fmt: skip
        wanted_by = "the file's extent"
    origin = ground.origin
    asked = (settings.area.origin_lat_deg, settings.area.origin_lon_deg)
    if origin is not None and asked != origin:
        overrides["area.origin_lat_deg"], overrides["area.origin_lon_deg"] = origin
        if asked[0] is not None and asked[1] is not None and given:
            overrides.update(_converted(settings, (asked[0], asked[1]), origin))
            _check_overlap(overrides["area.polygon_m"], ground, (asked[0], asked[1]), origin)
    return (settings.with_overrides(overrides) if overrides else settings), wanted_by


def _check_overlap(
    polygon_m: list[float], ground: Ground, asked: tuple[float, float], origin: tuple[float, float]
) -> None:
    """Checks that a converted area lies on the ground."""
    low, high = np.reshape(polygon_m, (-1, 2)).min(axis=0), np.reshape(polygon_m, (-1, 2)).max(axis=0)
    e = ground.extent
    if high[0] < e.north_min_m or low[0] > e.north_max_m or high[1] < e.east_min_m or low[1] > e.east_max_m:
        raise GroundError(
            f"area.origin_lat_deg, origin_lon_deg: {asked[0]:.5f}, {asked[1]:.5f} puts the area off the ground, "
            f"whose origin is {origin[0]:.5f}, {origin[1]:.5f}. Correct the origin, or remove it to use the "
            "ground's"
        )


def _converted(settings: Settings, old: tuple[float, float], new: tuple[float, float]) -> dict[str, Any]:
    """The locations of a mission relative to another origin (deg), {parameter: value}."""

    def moved(flat: tuple[float, ...]) -> list[float]:
        locations = np.reshape(flat, (-1, 2))
        north, east = local_from_geodetic(*geodetic_from_local(locations[:, 0], locations[:, 1], *old), *new)
        return [round(float(v), 2) for v in np.column_stack([north, east]).ravel()]

    area = settings.area
    found: dict[str, Any] = {"area.polygon_m": moved(area.polygon_m)}
    found.update({f"area.no_go.{name}": moved(flat) for name, flat in area.no_go.items()})
    found.update({f"area.shore.{name}": moved(flat) for name, flat in area.shore.items()})
    for number, own in enumerate(settings.vehicles, 1):
        v = own.vehicle
        for name, location in (
            ("start", (v.start_north_m, v.start_east_m)),
            ("recovery", (v.recovery_north_m, v.recovery_east_m)),
        ):
            if location[0] is not None and location[1] is not None:
                north, east = moved((location[0], location[1]))
                found[f"auv{number}.vehicle.{name}_north_m"] = north
                found[f"auv{number}.vehicle.{name}_east_m"] = east
    return found


def _polygon(flat: tuple[float, ...]) -> shapely.Polygon:
    """Converts a flat north, east, ... polygon to a Shapely polygon in (east, north)."""
    corners = np.reshape(flat, (-1, 2))
    return shapely.Polygon(corners[:, ::-1])


def rasterize(area: AreaConfig, ground: Ground, limit_m: float) -> Raster:
    """Divides the area into cells of about 5 m and checks the depths at their centers and corners.

    Args:
        limit_m: Minimum navigable water depth.
    """
    shape = _polygon(area.polygon_m)
    west, south, east, north = shape.bounds
    # At most half of the margin where possible, so that features between a cell's corners stay within the margin.
    step = max(min(5.0, max(area.margin_m / 2.0, 2.0)), math.sqrt((north - south) * (east - west) / MAX_CELLS))
    rows = south + step * (np.arange(max(1, math.ceil((north - south) / step))) + 0.5)
    columns = west + step * (np.arange(max(1, math.ceil((east - west) / step))) + 0.5)
    n, e = np.meshgrid(rows, columns, indexing="ij")
    wanted = shapely.contains_xy(shape, e, n)
    for flat in area.no_go.values():
        wanted &= ~shapely.contains_xy(_polygon(flat), e, n)
    # Depth at the corners and the center of every cell.
    corner_n, corner_e = np.meshgrid(
        np.append(rows - step / 2.0, rows[-1] + step / 2.0), np.append(columns - step / 2.0, columns[-1] + step / 2.0),
        indexing="ij",
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        ok = ground.depth_m(corner_n, corner_e) >= limit_m
        deep = ground.depth_m(n, e) >= limit_m
    deep &= ok[:-1, :-1] & ok[1:, :-1] & ok[:-1, 1:] & ok[1:, 1:]
    return Raster(north_m=rows, east_m=columns, wanted=wanted, deep=deep, step_m=step)


def _navigable_part(settings: Settings, raster: Raster, limit_m: float, wanted_by: str) -> tuple[Settings, list[str]]:
    area, step = settings.area, raster.step_m
    wanted_m2, free = float(raster.wanted.sum()) * step**2, raster.free
    if area.no_go and not raster.wanted.any():
        raise GroundError(
            f"area: the no-go areas {', '.join(area.no_go)} cover all of {wanted_by}. Make them smaller, or choose "
            "another area"
        )
    if not free.any():
        raise GroundError(
            f"area: {wanted_by} ({area_size(wanted_m2)}) has no known water of {limit_m:g} m or more (deepest "
            "vehicle's depth plus its minimum water). Choose another area, or shallower vehicles"
        )
    if free[raster.wanted].all():
        return settings, []
    # A part is a region in which a vehicle can travel within its margin: erode, label, grow back.
    padded = np.pad(free, 1)
    inner = ndimage.distance_transform_edt(padded)[1:-1, 1:-1] * step > area.margin_m + step
    labels, count = ndimage.label(inner, structure=np.ones((3, 3)))
    if count == 0:
        raise GroundError(
            f"area: no water of {limit_m:g} m or more in {wanted_by} is wide enough for margin_m = "
            f"{area.margin_m:g} m on either side. Choose a smaller margin, or another area"
        )
    sizes = np.bincount(labels.ravel())[1:]
    first = settings.vehicle(1).vehicle
    away = np.hypot(
        *np.meshgrid(raster.north_m - first.start_north_m, raster.east_m - first.start_east_m, indexing="ij")
    )
    nearest = ndimage.minimum(away, labels, np.arange(1, count + 1))
    eligible = np.flatnonzero(sizes >= LEAST_PART * sizes.max())
    chosen = int(eligible[np.argmin(np.asarray(nearest)[eligible])]) + 1
    grown = ndimage.distance_transform_edt(labels != chosen) * step <= area.margin_m + 2.0 * step
    region = ndimage.label(grown & free)[0]
    region = region == np.bincount(region[labels == chosen]).argmax()
    polygon = _outline(region, raster)
    outer = _flat(np.asarray(polygon.exterior.coords))
    no_go = {name: list(flat) for name, flat in area.no_go.items()}
    no_go.update({f"ground_{i}": _flat(np.asarray(ring.coords)) for i, ring in enumerate(polygon.interiors, 1)})
    overrides: dict[str, Any] = {"area.polygon_m": outer}
    if no_go:
        overrides["area"] = {"no_go": no_go}
    notes = [
        f"area: of {wanted_by} ({_km2(wanted_m2)}), {_km2(polygon.area)} can be navigated: known ground under "
        f"at least {limit_m:g} m of water, in one part"
        + (f", around {islands} no-go area{'s' * (islands > 1)}" if (islands := len(polygon.interiors)) else "")
    ]
    left_out = (float(free.sum()) - float(region.sum())) * step**2 / 1e6
    if count > 1 and left_out > 0.005:
        parts = counted(count - 1, "other part")
        notes.append(f"area: {left_out:.2f} km2 of navigable water in {parts} cannot be reached and is left out")
    return settings.with_overrides(overrides), notes


def _with_shore(settings: Settings, raster: Raster, ground: Ground, limit_m: float) -> tuple[Settings, list[str]]:
    depth = ground.depth_m(*np.meshgrid(raster.north_m, raster.east_m, indexing="ij"))
    shore = shore_of(raster.north_m, raster.east_m, depth, limit_m, _operating_shape(settings.area))
    if not shore:
        return settings, []
    length_m = sum(float(np.hypot(*np.diff(np.reshape(flat, (-1, 2)), axis=0).T).sum()) for flat in shore.values())
    note = f"shore: {length_m / 1e3:.1f} km, where the depth falls to {limit_m:g} m; maps and plans use it (area.shore)"
    return settings.with_overrides({"area": {"shore": shore}, "area.shore_depth_m": limit_m}), [note]


def _outline(region: Mask, raster: Raster) -> shapely.Polygon:
    """The region's outline with its holes, simplified but inside the region."""
    from contourpy import contour_generator

    step = raster.step_m
    padded = np.pad(region.astype(float), 1)
    north = np.concatenate([[raster.north_m[0] - step], raster.north_m, [raster.north_m[-1] + step]])
    east = np.concatenate([[raster.east_m[0] - step], raster.east_m, [raster.east_m[-1] + step]])
    # At 0.5, half-way between the middles of free and blocked cells: the cells' own border.
    rings = [shapely.Polygon(line) for line in contour_generator(east, north, padded).lines(0.5) if len(line) >= 4]
    outer = max(rings, key=lambda ring: ring.area)
    holes = [ring for ring in rings if ring is not outer and outer.contains(ring.representative_point())]
    # Moving the outline inward (holes: outward) by the tolerance first keeps the simplified outline inside.
    for tolerance in (0.5 * step, step, 1.5 * step, 2.5 * step):
        result = _simplified(outer, holes, tolerance)
        if shapely.get_num_coordinates(result) <= MAX_CORNERS:
            break
    return result


def _simplified(outer: shapely.Polygon, holes: list[shapely.Polygon], tolerance_m: float) -> shapely.Polygon:
    body = outer.buffer(-tolerance_m).simplify(tolerance_m)
    body = max(getattr(body, "geoms", [body]), key=lambda part: part.area)
    blocked = shapely.union_all([hole.buffer(tolerance_m).simplify(tolerance_m) for hole in holes])
    result = body.difference(blocked.buffer(0.0)) if not blocked.is_empty else body
    result = max(getattr(result, "geoms", [result]), key=lambda part: part.area)
    return shapely.Polygon(result.exterior, [r for r in result.interiors if shapely.Polygon(r).area > 1.0])


def _flat(ring: Array) -> list[float]:
    """Converts a ring of (east, north) corners to north, east, ... rounded to centimetres, without the repeated one."""
    return [round(float(v), 2) for v in ring[:-1, ::-1].ravel()]


def _move_starts(settings: Settings) -> tuple[Settings, list[str]]:
    """Moves starts without room to turn to locations where a vehicle can turn to both sides, or at least to one."""
    area = OperatingArea(settings.area)
    motion, margin = MotionTable(settings.motion), settings.area.margin_m
    reach = float(np.abs(motion.loops_m[:, 2]).max())
    grid = area.grid(area.cell_m(max(5.0, settings.area.raster_m)))
    locations, clearance = grid.locations_m, area.clearance_m(grid.locations_m)
    for needed in (margin + 2.0 * reach, margin + reach):
        if (clearance >= needed).any():
            break
    else:
        raise GroundError(
            f"area: the widest location is only {max(float(clearance.max()), 0.0):.0f} m from its border, less "
            f"than {margin + reach:.0f} m (margin_m and a turning circle). Choose a larger area, or less "
            "motion.turn_radius_m or area.margin_m"
        )
    fit, roomy = locations[clearance >= needed], clearance[clearance >= needed]
    overrides: dict[str, Any] = {}
    notes: list[str] = []
    for number, v in enumerate((own.vehicle for own in settings.vehicles), 1):
        start = np.array([v.start_north_m, v.start_east_m])
        if float(area.clearance_m(start[None])[0]) >= margin + 0.5 and can_turn(
            area, motion, v.start_heading_rad, start
        ):
            continue
        distance = np.hypot(*(fit - start).T)
        best = np.lexsort((-roomy, np.round(distance)))[0]
        (north, east), text = fit[best].tolist(), f"auv{number}: north {start[0]:g}, east {start[1]:g} m"
        if distance[best] > FAR_M:
            raise GroundError(
                f"start of {text} is {distance[best] / 1e3:.0f} km from the area's water: it is relative to another "
                "origin, or its numbers are exchanged. Correct vehicle.start_north_m, start_east_m (or start_deg)"
            )
        overrides[f"auv{number}.vehicle"] = {"start_north_m": north, "start_east_m": east}
        notes.append(
            f"{START_MOVED}{text} has no room to turn in navigable water; moved {distance[best]:.0f} m to north "
            f"{north:g}, east {east:g} m"
        )
    if len(notes) > 1 and len({note.split(": ", 1)[1] for note in notes}) == 1:
        notes = [notes[0].replace(f"{START_MOVED}auv1", f"{START_MOVED}every vehicle")]
    return (settings.with_overrides(overrides) if overrides else settings), notes


def can_turn(area: OperatingArea, motion: MotionTable, heading_rad: float, location: Array) -> bool:
    """Whether a vehicle at `location` (2,) has room for a turning circle to one side."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    for ahead, starboard, radius in motion.loops_m:
        center = location + np.array([c * ahead - s * starboard, s * ahead + c * starboard])
        if float(area.clearance_m(center[None])[0]) >= radius + area.margin_m:
            return True
    return False


def depth_warnings(settings: Settings, ground: Ground) -> list[str]:
    """Warns if the operating area has no isobath, or a bottom beyond the DVL's range."""
    shape = _operating_shape(settings.area)
    west, south, east, north = shape.bounds
    finest = min(5.0, 0.05 * min(north - south, east - west))
    step = max(finest, math.sqrt((north - south) * (east - west) / WARNING_CELLS))
    n, e = np.meshgrid(
        np.arange(south + step / 2.0, north, step), np.arange(west + step / 2.0, east, step), indexing="ij"
    )
    inside = shapely.contains_xy(shape, e, n)
    depth = ground.depth_m(n[inside], e[inside])
    depth = depth[np.isfinite(depth)]
    if not depth.size:
        return []
    notes = []
    level = settings.level_set.level_m
    deeper = float((depth > level).mean())
    if deeper in (0.0, 1.0):
        notes.append(
            f"level: no {level:g} m isobath in the area: all of it is {'deeper' if deeper else 'shallower'} "
            f"({depth.min():.1f} to {depth.max():.1f} m); choose another level_m or area"
        )
    dvl = settings.sim.dvl
    if not (dvl.ideal or settings.sim.ideal):
        depths = [own.vehicle.depth_m for own in settings.vehicles]
        reach = dvl.max_altitude_m + min(depths)
        beyond = float((depth > reach).mean())
        if beyond > 0.0:
            notes.append(
                f"dvl: {100.0 * beyond:.3g} % of the area is deeper than {reach:g} m, the reach "
                f"of auv{depths.index(min(depths)) + 1} (depth_m {min(depths):g} m and sim.dvl.max_altitude_m "
                f"{dvl.max_altitude_m:g} m): no soundings and no bottom track there"
            )
    return notes


def _operating_shape(area: AreaConfig) -> shapely.Geometry:
    """The polygon without its no-go areas, in (east, north)."""
    shape = _polygon(area.polygon_m)
    for flat in area.no_go.values():
        shape = shape.difference(_polygon(flat).buffer(0.0))
    return shape


def prior_warnings(settings: Settings) -> list[str]:
    """Warns if a constant or plane prior mean is so far from the level that the prior nearly excludes the isobath."""
    gp, level = settings.common.gp, settings.level_set.level_m
    found = excluded_level(gp, level, np.reshape(settings.area.polygon_m, (-1, 2)))
    if found is None:
        return []
    return [
        f"level_set.level_m: {level:g} m is {found.sigmas:.1f} standard deviations (gp.signal_std_m "
        f"{gp.signal_std_m:g} m) from the nearest prior mean, {found.nearest_m:.3g} m, more than "
        f"{MAX_LEVEL_SIGMAS:g}. The prior nearly excludes this isobath, so map risk starts too low and the "
        f"lawnmower bound misleads. Set gp.signal_std_m to {found.wide_enough_m:g} or more, or fit with --mean "
        "plane"
    ]


def expectations(settings: Settings) -> list[str]:
    """What to expect of paths in the area (a lawnmower's lanes, coverage), of turns, of the current and the prior."""
    return [_coverage(settings), *_turn_warnings(settings), *_current_warnings(settings), *prior_warnings(settings)]


def _turn_warnings(settings: Settings) -> list[str]:
    """Warns, for each speed, if the simulated vehicle cannot turn as tightly as the legs."""
    dynamics, radius_m = settings.sim.dynamics, settings.motion.turn_radius_m
    if dynamics.ideal or settings.sim.ideal:
        return []
    names: dict[float, list[str]] = {}
    for number, own in enumerate(settings.vehicles, 1):
        if own.link.kind == "direct":  # else an autopilot turns
            names.setdefault(own.vehicle.speed_mps, []).append(f"auv{number}")
    tightest_m = {speed: speed / math.radians(dynamics.turn_rate_max_dps) for speed in names}
    return [
        f"motion.turn_radius_m: {radius_m:g} m is too small for {', '.join(names[speed])} at {speed:g} m/s, which "
        f"would turn by {math.degrees(speed / radius_m):.0f} deg/s (sim.dynamics.turn_rate_max_dps: "
        f"{dynamics.turn_rate_max_dps:g}). Use at least {math.ceil(10.0 * least_m) / 10.0:g} m, or less "
        "vehicle.speed_mps"
        for speed, least_m in tightest_m.items()
        if radius_m < least_m
    ]


def _current_warnings(settings: Settings) -> list[str]:
    """Warns if the simulated current can be as fast as a vehicle."""
    current = settings.sim.current
    if current.ideal or settings.sim.ideal:
        return []
    heading = math.radians(current.tide_heading_deg)
    tide_n, tide_e = current.tide_mps * math.cos(heading), current.tide_mps * math.sin(heading)
    fastest_mps = max(
        math.hypot(current.north_mps + sign * tide_n, current.east_mps + sign * tide_e) for sign in (1.0, -1.0)
    )
    names = [f"auv{k}" for k, own in enumerate(settings.vehicles, 1) if own.vehicle.speed_mps <= fastest_mps]
    if not names:
        return []
    return [
        f"sim.current: {fastest_mps:.3g} m/s is too fast for {', '.join(names)} to travel against it "
        "(vehicle.speed_mps): expect vehicles outside the area. Choose a slower current or faster vehicles"
    ]


def _km2(area_m2: float) -> str:
    return f"{area_m2 / 1e6:,.2f} km2" if area_m2 >= 1e4 else area_size(area_m2)


def _coverage(settings: Settings) -> str:
    area_m2, mission, motion = free_m2(settings.area), settings.mission, settings.motion
    path_m = mission.vehicles * mission.steps * motion.leg_length_m
    spacing = area_m2 / path_m
    covers = coverage(area_m2, mission, motion, settings.common.gp)
    path = f"{path_m / 1000.0:.1f} km" if path_m >= 100.0 else f"{path_m:.0f} m"
    lanes = f"{spacing:.{0 if spacing >= 10.0 else 1}f} m between lawnmower lanes"
    if spacing > math.sqrt(area_m2):
        lanes = "less than one lawnmower lane"
    text = (
        f"coverage: {counted(mission.vehicles, 'vehicle')} x {counted(mission.steps, 'step')}, {path} of path in "
        f"{_km2(area_m2)}, {lanes}. At most {100.0 * min(covers, 1.0):.0f} % of the area is within half a length scale "
        f"({settings.common.gp.length_scale_m / 2.0:.3g} m) of a path"
    )
    methods = sorted({own.planner.method for own in settings.vehicles})
    if covers < CHART_COVERAGE:
        text += (
            ". The area is too large for this mission: expect unmapped regions. Add steps or vehicles, or choose a "
            "smaller --area"
        )
        if mission.goal == "chart" and methods == ["tour"] and mission.steps <= MAX_LINE_LEGS:
            text += ". If the isobath matters more than the rest, mission.goal: line locates more of it on average"
    elif spacing < 2.0 * motion.turn_radius_m:
        text += (
            ". The area is too small for this mission: lanes closer than a turning circle "
            f"({2.0 * motion.turn_radius_m:g} m) add little. Use fewer steps or vehicles"
        )
    if settings.finds_method:
        text += f". mission.goal: line flies the method {settings.common.planner.method}"
    elif mission.goal == "line" and methods != [line_method(area_m2, mission, motion, settings.common.gp)]:
        text += f". mission.goal: line does not choose the method, because planner.method is set ({', '.join(methods)})"
    return text
