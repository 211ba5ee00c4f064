"""The map's messages: the one place where north/east becomes x/y (ENU) for gp_node."""

from __future__ import annotations

import array
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from geometry_msgs.msg import Point, Pose
from nav_msgs.msg import MapMetaData, OccupancyGrid
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from auv_lse_common.topics.ros_conversions import doubles, floats, header, stamp
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.map.depth_map import DepthField, Isobath
from auv_lse_msgs.msg import KernelCenters, LevelSetField, SampleArray

_BAND_COLORS = {"lines": (0.0, 0.0, 0.0), "shallow_edge": (0.9, 0.6, 0.0), "deep_edge": (0.0, 0.45, 0.7)}


def sample_rows(message: SampleArray) -> NDArray[np.float64]:
    """North, east, depth (m), shape (n, 3), of a SampleArray.

    Raises:
        ValueError: if its three fields differ in length.
    """
    columns = [np.asarray(c, dtype=float) for c in (message.north_m, message.east_m, message.depth_m)]
    if len({len(c) for c in columns}) != 1:
        raise ValueError(
            f"SampleArray of vehicle {message.source}: north_m, east_m, depth_m have {[len(c) for c in columns]} "
            f"values; expected the same number of each"
        )
    return np.column_stack(columns)


def centers_message(now_s: float, revision: int, centers: Centers) -> KernelCenters:
    """KernelCenters of the map's centers."""
    effect = centers.place_effect_m
    return KernelCenters(
        header=header(now_s),
        revision=revision,
        north_m=doubles(centers.places_m[:, 0]),
        east_m=doubles(centers.places_m[:, 1]),
        depth_m=doubles(centers.depths_m),
        noise_std_m=doubles(centers.noise_std_m),
        place_modes=0 if effect is None else effect.shape[1],
        place_effect_m=floats(np.zeros(0) if effect is None else effect.ravel()),
    )


def centers_from_message(message: KernelCenters) -> Centers:
    """The map's centers of a KernelCenters.

    Raises:
        ValueError: if its fields differ in length.
    """
    columns = [np.asarray(c) for c in (message.north_m, message.east_m, message.depth_m, message.noise_std_m)]
    if len({len(c) for c in columns}) != 1:
        raise ValueError(
            f"KernelCenters: north_m, east_m, depth_m, noise_std_m have {[len(c) for c in columns]} "
            f"values; expected the same number of each"
        )
    modes, effect = message.place_modes, np.asarray(message.place_effect_m, dtype=float)
    if len(effect) != modes * len(columns[0]):
        raise ValueError(
            f"KernelCenters: place_effect_m has {len(effect)} values; expected place_modes = {modes} for each of "
            f"{len(columns[0])} centers"
        )
    return Centers(np.column_stack(columns[:2]), columns[2], columns[3], effect.reshape(-1, modes) if modes else None)


def field_message(now_s: float, field: DepthField, level_m: float) -> LevelSetField:
    """LevelSetField of a field."""
    grid = field.grid
    return LevelSetField(
        header=header(now_s),
        south_m=float(grid.north_m[0]),
        west_m=float(grid.east_m[0]),
        resolution_m=_resolution(grid.north_m, grid.east_m),
        rows=len(grid.north_m),
        columns=len(grid.east_m),
        level_m=level_m,
        variance_scale=field.variance_scale,
        mean_m=floats(field.mean_m.ravel()),
        std_m=floats(field.std_m.ravel()),
        risk=floats(field.risk.ravel()),
        p_safe=floats(field.p_safe.ravel()),
    )


def risk_map_message(now_s: float, field: DepthField, largest_risk: float) -> OccupancyGrid:
    """Bayes risk as an OccupancyGrid: 0 no risk, 100 the largest risk there can be, -1 outside of the area.

    Args:
        now_s: Stamp (s).
        field: The field, rows south to north, columns west to east, as an OccupancyGrid has them in ENU.
        largest_risk: The risk that becomes 100, c1 c2 / (c1 + c2).
    """
    grid = field.grid
    resolution = _resolution(grid.north_m, grid.east_m)
    percent = np.clip(np.round(100.0 * np.nan_to_num(field.risk) / largest_risk), 0, 100)
    cells = np.where(np.isnan(field.risk), -1, percent).astype(np.int8)
    origin = Pose()
    origin.position.x = float(grid.east_m[0]) - resolution / 2.0
    origin.position.y = float(grid.north_m[0]) - resolution / 2.0
    origin.orientation.w = 1.0
    return OccupancyGrid(
        header=header(now_s),
        info=MapMetaData(
            map_load_time=stamp(now_s),
            resolution=resolution,
            width=len(grid.east_m),
            height=len(grid.north_m),
            origin=origin,
        ),
        data=array.array("b", cells.tobytes()),
    )


def isobath_markers(now_s: float, isobath: Isobath, level_m: float) -> list[Marker]:
    """The estimated contour and the two edges of its band, each a LINE_LIST in the map frame at z = -level."""
    return [
        _line_list(now_s, number, name, getattr(isobath, name), level_m, color)
        for number, (name, color) in enumerate(_BAND_COLORS.items())
    ]


def _line_list(
    now_s: float, number: int, name: str, lines: Sequence[NDArray[np.float64]], level_m: float, color: tuple[float, ...]
) -> Marker:
    marker = Marker(header=header(now_s), ns=name, id=number, type=Marker.LINE_LIST, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.scale.x = 1.0
    marker.color = ColorRGBA(r=color[0], g=color[1], b=color[2], a=1.0)
    ends: list[Point] = []
    for line in lines:
        points = [Point(x=east, y=north, z=-level_m) for north, east in line.tolist()]
        for begin, end in pairwise(points):
            ends += [begin, end]
    marker.points = ends  # once: the message checks all of its points whenever it is given some
    return marker


def _resolution(north_m: NDArray[np.float64], east_m: NDArray[np.float64]) -> float:
    axis = north_m if len(north_m) > 1 else east_m
    return float(axis[1] - axis[0])
