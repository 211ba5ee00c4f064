"""The operating area of a survey: ground that was sounded, with gaps left out."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameters import from_mapping
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.missing_packages import missing
from auv_lse_gp.thinning import one_of_each_cell

#: The area ends this far (m) from the outermost soundings.
MARGIN_M = 25.0
#: Ground is sounded if lanes lie on both sides within this distance (m), in any case and at most.
LEAST_REACH_M, LARGEST_REACH_M = 25.0, 150.0
#: Vehicles start this far (m) inside, to have room to turn, and from each other.
ROOM_M, APART_M = 50.0, 20.0
#: Reach of a sounding: the depth within this share of the length scale around it counts as known.
REACH = 0.5
#: Maximum numbers of positions from which the area is drawn, and of its corners.
_POSITIONS, _CORNERS = 6000, 600


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedArea:
    """The area in which soundings determine the depth.

    Attributes:
        polygon: Its corners north, east (m), shape (n, 2).
        no_go: Ground inside of it that was not sounded: corners of each piece, by name.
        area_m2: Its size without the pieces of `no_go`.
        others: Sizes (m2) of sounded ground apart from it, the largest first.
    """

    polygon: Array
    no_go: dict[str, Array] = field(default_factory=dict)
    area_m2: float = 0.0
    others: tuple[float, ...] = ()

    @property
    def finest_cell_m(self) -> float:
        """Size (m) of the smallest cells of a map of it."""
        return OperatingArea(from_mapping(AreaConfig, self.section(None), "area")).finest_cell_m

    def starts(self, first_m: Array, count: int) -> list[tuple[float, float]]:
        """Positions north, east (m) to start from: inside with room to turn, apart, and near `first_m`."""
        from shapely import Point, Polygon
        from shapely.ops import unary_union

        free = Polygon(self.polygon).difference(unary_union([Polygon(corners) for corners in self.no_go.values()]))
        room_m = ROOM_M
        while (inside := free.buffer(-room_m)).is_empty:
            room_m *= 0.7
        low, high = self.polygon.min(axis=0), self.polygon.max(axis=0)
        axes = [np.linspace(a, b, 60) for a, b in zip(low, high, strict=True)]
        candidates = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        candidates = np.vstack([candidates, np.array(inside.representative_point().coords)])
        chosen: list[tuple[float, float]] = []
        for at in np.argsort(np.hypot(*(candidates - first_m).T), kind="stable").tolist():
            candidate = (float(candidates[at, 0]), float(candidates[at, 1]))
            if all(math.dist(candidate, other) >= APART_M for other in chosen) and inside.covers(Point(candidate)):
                chosen.append(candidate)
                if len(chosen) == count:
                    break
        return chosen

    def section(self, origin: tuple[float, float] | None) -> dict[str, Any]:
        """Section `area` of a mission file."""
        spans = np.ptp(self.polygon, axis=0)
        section: dict[str, Any] = {
            "polygon_m": _flat(self.polygon),
            "raster_m": max(2.0, round(float(spans.max()) / 1000.0, 1)),
        }
        if self.no_go:
            section["no_go"] = {name: _flat(corners) for name, corners in self.no_go.items()}
        if origin is not None:
            section |= {"origin_lat_deg": origin[0], "origin_lon_deg": origin[1]}
        return section


def surveyed_area(locations_m: Array, length_scale_m: float) -> SurveyedArea:
    """The ground around soundings and between lanes that are not too far apart.

    Args:
        locations_m: North, east (m) of the soundings, shape (n, 2).
        length_scale_m: Length scale of the depth (m).

    Raises:
        MissingPackageError: if shapely is missing.
    """
    try:
        from shapely import Polygon, box, coverage_union_all
    except ImportError as error:
        raise missing(error, "operating areas") from error
    reach_m = float(np.clip(REACH * length_scale_m, LEAST_REACH_M, LARGEST_REACH_M))
    cell_m = reach_m / 6.0
    positions = locations_m[one_of_each_cell(locations_m, cell_m)]
    while len(positions) > _POSITIONS:
        cell_m *= 1.3
        positions = positions[one_of_each_cell(positions, cell_m)]
    reach_m = max(reach_m, 2.0 * cell_m)
    corners = np.floor(positions / cell_m) * cell_m
    cells = coverage_union_all(box(corners[:, 0], corners[:, 1], *(corners + cell_m).T))
    around = cells.buffer(reach_m, quad_segs=4)
    ground = around.buffer(min(MARGIN_M - reach_m, 0.0) - 0.5 * cell_m, quad_segs=4)
    pieces = sorted(getattr(ground, "geoms", [ground]), key=lambda piece: piece.area, reverse=True)
    piece, step_m = pieces[0], 1.0
    holes = [Polygon(ring) for ring in piece.interiors]
    holes = [hole for hole in holes if hole.buffer(-0.25 * reach_m).area > 0.0]
    outline = Polygon(piece.exterior)
    while True:
        simple = outline.simplify(step_m)
        voids = [hole.simplify(step_m) for hole in holes]
        if len(simple.exterior.coords) + sum(len(void.exterior.coords) for void in voids) <= _CORNERS:
            break
        step_m *= 1.5
    return SurveyedArea(
        polygon=np.array(simple.exterior.coords[:-1]),
        no_go={f"unsounded_{i}": np.array(void.exterior.coords[:-1]) for i, void in enumerate(voids, 1)},
        area_m2=float(simple.area - sum(void.area for void in voids)),
        others=tuple(float(other.area) for other in pieces[1:]),
    )


def _flat(corners: Array) -> list[float]:
    return [round(float(value), 1) for corner in corners for value in corner]
