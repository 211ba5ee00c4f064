"""Draws a mission file: what `auv_lse check --map` shows."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke

from auv_lse_common.mission_file.operating_area import UNREACHABLE, OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.judge.planned_paths import PlannedPaths
from auv_lse_shore.report.figures import MAX_ASPECT, WIDTH_IN, axis_label, map_shape, new_figure, styled, vehicle_style
from auv_lse_shore.report.map_marks import add_graticule, add_scale_bar

_WATER, _BORDER, _NO_GO, _FREE, _SHORE = "#dcebf5", "#2b5d80", "#b03a2e", "#5f8fae", "#8c6d31"
#: Looks of no-go areas, and of ground that no vehicle can reach.
_KEPT_OUT: dict[str, Any] = {"facecolor": "#f6ddd9", "edgecolor": _NO_GO, "hatch": "////", "lw": 1.0}
_UNREACHABLE: dict[str, Any] = {"facecolor": "#e3e3e3", "edgecolor": "#7d7d7d", "hatch": "....", "lw": 0.8}
#: Length of a line of the notes, in characters.
_NOTE_WIDTH = 120
#: Points of the line of a leg with an arc.
_POINTS_PER_LEG = 8
#: With more no-go areas than this, as of a lake's islands, their names would cover the map.
_MAX_NAMES = 8
_CASING = [withStroke(linewidth=2.5, foreground="white")]


@styled
def mission_figure(settings: Settings, title: str, notes: Sequence[str] = ()) -> Figure:
    """Area, no-go areas, margin, starts with headings, lawnmower paths and recovery positions on a map.

    Args:
        settings: The mission; the parameters of area, motion and vehicles are usable.
        notes: Sentences below the title.

    Raises:
        ParameterError: if the area is impossible.
    """
    area = OperatingArea(settings.area)
    positions = np.vstack([area.polygon, *_marked_positions(settings)])
    low, high = positions.min(axis=0), positions.max(axis=0)
    sides = high - low
    pad = 0.04 * np.maximum(sides, sides.max() / MAX_ASPECT)
    (south, west), (north, east) = low - pad, high + pad
    aspect, stretch = map_shape((west, east, south, north))
    height = min(max((WIDTH_IN - 1.2) * aspect, 2.0), 8.0)
    lines = [line for note in notes for line in textwrap.wrap(note, _NOTE_WIDTH)]
    figure = new_figure(WIDTH_IN, height + 1.2 + 0.13 * len(lines))
    axis = figure.subplots()
    axis.set_aspect(stretch)
    axis.set_xlim(west, east)
    axis.set_ylim(south, north)
    _draw_area(axis, area)
    _draw_lanes(axis, settings, area)
    _draw_vehicles(axis, settings)
    lat, lon = settings.area.origin_lat_deg, settings.area.origin_lon_deg
    add_graticule(axis, None if lat is None or lon is None else (lat, lon))
    add_scale_bar(axis, np.vstack(_marked_positions(settings)))
    figure.suptitle(title, x=0.02, ha="left", fontsize=10.0)
    axis.set_title("\n".join(lines), fontsize=7.5, color="#444444")
    axis.set_xlabel(axis_label("east", 1.0 / stretch))
    axis.set_ylabel(axis_label("north", stretch))
    figure.legend(handles=_handles(settings, area), loc="outside lower center", ncols=4, handlelength=2.0)
    return figure


def _marked_positions(settings: Settings) -> list[Array]:
    """Positions (n, 2) north, east (m) of the starts and the recovery positions."""
    starts = [(own.vehicle.start_north_m, own.vehicle.start_east_m) for own in settings.vehicles]
    return [np.array(starts), *(np.array([position]) for position in _recoveries(settings))]


def _recoveries(settings: Settings) -> dict[tuple[float, float], list[int]]:
    """The vehicles of each recovery position (north, east in m)."""
    positions: dict[tuple[float, float], list[int]] = {}
    for number, own in enumerate(settings.vehicles, 1):
        north, east = own.vehicle.recovery_north_m, own.vehicle.recovery_east_m
        if north is not None and east is not None:
            positions.setdefault((north, east), []).append(number)
    return positions


def _draw_area(axis: Any, area: OperatingArea) -> None:
    axis.add_patch(Polygon(area.polygon[:, ::-1], facecolor=_WATER, edgecolor=_BORDER, lw=1.4, zorder=1))
    are_named = sum(not name.startswith(UNREACHABLE) for name in area.no_go) <= _MAX_NAMES
    for name, ring in area.no_go.items():
        look = _UNREACHABLE if name.startswith(UNREACHABLE) else _KEPT_OUT
        axis.add_patch(Polygon(ring[:, ::-1], zorder=2, **look))
        if are_named and look is _KEPT_OUT:
            at = ring.mean(axis=0)[::-1]
            axis.text(*at, name, color=_NO_GO, ha="center", va="center", fontsize=8, zorder=6, path_effects=_CASING)
    for line in area.config.shore.values():
        corners = np.reshape(line, (-1, 2))
        axis.plot(corners[:, 1], corners[:, 0], color=_SHORE, lw=1.8, zorder=2.5)
    for edge in _margin_lines(area):
        axis.plot(edge[:, 1], edge[:, 0], color=_FREE, ls="dashed", lw=0.8, zorder=2, label="margin")


def _margin_lines(area: OperatingArea) -> list[Array]:
    """The lines (n, 2) north, east (m) at the margin from the borders; none without a margin."""
    import shapely  # slow to import

    if area.margin_m <= 0.0:
        return []
    free = shapely.make_valid(shapely.Polygon(area.polygon))
    free = free.difference(shapely.union_all([shapely.make_valid(shapely.Polygon(r)) for r in area.no_go.values()]))
    rings = shapely.get_parts(shapely.boundary(free.buffer(-area.margin_m)))
    return [np.asarray(shapely.get_coordinates(ring)) for ring in rings]


def _draw_lanes(axis: Any, settings: Settings, area: OperatingArea) -> None:
    """Draws each vehicle's lawnmower path, the same as the planner's first candidate."""
    for number, own in enumerate(settings.vehicles, 1):
        start = np.array([own.vehicle.start_heading_rad, own.vehicle.start_north_m, own.vehicle.start_east_m])
        if not area.contains(start[None, 1:])[0]:
            continue
        rollout = PlannedPaths(settings.planner_settings(number), area).rollout
        path = rollout.path(0, start, (), FITTED[(number - 1) % len(FITTED)])
        points = 1 if settings.motion.straight_legs else _POINTS_PER_LEG
        line = MotionTable(settings.motion).line(path.states, path.actions, points)
        axis.plot(line[:, 1], line[:, 0], lw=0.9, alpha=0.75, zorder=3, **vehicle_style(number - 1))


def _draw_vehicles(axis: Any, settings: Settings) -> None:
    """Draws starts as arrows along the heading, and recovery positions as crosses; both with their vehicles."""
    starts: dict[tuple[float, float], list[int]] = {}
    length = 0.06 * float(np.ptp(axis.get_xlim()))
    for number, own in enumerate(settings.vehicles, 1):
        v = own.vehicle
        way = np.array([math.sin(v.start_heading_rad), math.cos(v.start_heading_rad)])
        ahead = way * length / math.hypot(way[0], way[1] * axis.get_aspect())
        color = vehicle_style(number - 1)["color"]
        arrow = {"arrowstyle": "-|>", "lw": 2.0, "color": color, "shrinkA": 0.0, "shrinkB": 0.0}
        position = (v.start_east_m, v.start_north_m)
        axis.annotate("", (position[0] + ahead[0], position[1] + ahead[1]), position, zorder=5, arrowprops=arrow)
        axis.plot(*position, "o", ms=5.0, mfc="white", mec="black", mew=0.9, zorder=5.5)
        starts.setdefault(position, []).append(number)
    for (east, north), numbers in starts.items():
        _name(axis, north, east, _vehicles(numbers), below=True)
    for (north, east), numbers in _recoveries(settings).items():
        axis.plot(east, north, "P", ms=8.0, mfc="#009E73", mec="white", mew=0.8, zorder=5.5)
        all_of_them = len(numbers) == settings.mission.vehicles
        text = "recovery" if all_of_them else f"recovery {_vehicles(numbers)}"
        _name(axis, north, east, text, below=False)


def _vehicles(numbers: Sequence[int]) -> str:
    return ", ".join(f"auv{number}" for number in numbers)


def _name(axis: Any, north: float, east: float, text: str, *, below: bool) -> None:
    look = {"fontsize": 8.0, "zorder": 6, "path_effects": _CASING, "textcoords": "offset points", "ha": "center"}
    axis.annotate(text, (east, north), (0.0, -6.0 if below else 6.0), va="top" if below else "bottom", **look)


def _handles(settings: Settings, area: OperatingArea) -> list[Any]:
    """The entries of the legend."""
    handles: list[Any] = [Patch(facecolor=_WATER, edgecolor=_BORDER, label="operating area")]
    kinds = [name.startswith(UNREACHABLE) for name in area.no_go]
    if False in kinds:
        handles.append(Patch(**_KEPT_OUT, label="no-go area"))
    if True in kinds:
        handles.append(Patch(**_UNREACHABLE, label="cannot be reached"))
    if area.config.shore:
        handles.append(Line2D([], [], color=_SHORE, lw=1.8, label="shore"))
    if area.margin_m > 0.0:
        handles.append(Line2D([], [], color=_FREE, ls="--", lw=0.8, label=f"margin, {area.margin_m:g} m"))
    handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec="black", label="start and heading"))
    if _recoveries(settings):
        handles.append(Line2D([], [], ls="", marker="P", ms=7, mfc="#009E73", mec="white", label="recovery position"))
    handles.append(Line2D([], [], lw=1.0, color="#777777", label="lawnmower, for comparison"))
    return handles
