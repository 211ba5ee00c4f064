"""Isobaths as lines: traced on a grid, compared with the true one, written as GeoJSON."""

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.level_set.lines import FOUND_WITHIN_M, resample


def trace(north_m: Array, east_m: Array, depth_m: Array, level_m: float) -> list[Array]:
    """Lines along which a gridded depth equals a level.

    Args:
        north_m: North of the rows, shape (R,).
        east_m: East of the columns, shape (C,).
        depth_m: Depth (m), shape (R, C); no line is drawn beside NaN.

    Returns:
        Lines, each of shape (n, 2): north, east (m). The deeper side is on the same side of all of them.
    """
    import contourpy

    generator = contourpy.contour_generator(east_m, north_m, np.ma.masked_invalid(depth_m), name="serial")
    return [np.asarray(line, dtype=float)[:, ::-1] for line in generator.lines(level_m) if len(line) > 1]


def length_m(lines: Sequence[Array]) -> float:
    """Total length (m) of lines of locations (n, 2)."""
    return float(sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in lines))


@dataclass(frozen=True, slots=True, kw_only=True)
class IsobathError:
    """Distance between an estimated and the true isobath; NaN where one of the two does not exist.

    Attributes:
        mean_m: Mean distance between the two lines: half the mean from the estimate's points to the nearest of the
            truth, half the mean from the truth's points to the nearest of the estimate. Missing pieces count in the
            second half, invented pieces in the first.
        percentile_95_m: 95th percentile of the distances of both directions together.
        estimate_mean_m: Mean distance of the estimate's points from the truth.
        estimate_percentile_95_m: 95th percentile of it.
        found: Share of the true isobath within `FOUND_WITHIN_M` of the estimate.
        made_up: Share of the estimate farther than that from every true isobath.
    """

    mean_m: float = math.nan
    percentile_95_m: float = math.nan
    estimate_mean_m: float = math.nan
    estimate_percentile_95_m: float = math.nan
    found: float = math.nan
    made_up: float = math.nan


def compare(estimate: Sequence[Array], truth: Sequence[Array], around: Sequence[Array] = ()) -> IsobathError:
    """Distance between two isobaths, each a list of lines (n, 2) of north, east (m).

    Args:
        around: True isobath outside of the evaluated cells, as between a steep shore and the first cell of water. The
            estimate need not find it, but pieces near it are not made up.
    """
    a, b, everywhere = resample(estimate), resample(truth), resample([*truth, *around])
    if len(a) == 0 or len(everywhere) == 0:
        return IsobathError(found=0.0 if len(b) else math.nan, made_up=1.0 if len(a) else math.nan)
    to_truth = cKDTree(everywhere).query(a)[0]
    to_estimate = cKDTree(a).query(b)[0] if len(b) else np.full(1, math.nan)
    return IsobathError(
        mean_m=float(0.5 * (to_truth.mean() + to_estimate.mean())),
        percentile_95_m=float(np.percentile(np.concatenate([to_truth, to_estimate]), 95.0)),
        estimate_mean_m=float(to_truth.mean()),
        estimate_percentile_95_m=float(np.percentile(to_truth, 95.0)),
        found=float(np.mean(to_estimate <= FOUND_WITHIN_M)) if len(b) else math.nan,
        made_up=float(np.mean(to_truth > FOUND_WITHIN_M)),
    )


def geojson_of(
    features: Sequence[tuple[Mapping[str, Any], Sequence[Array]]],
    origin: tuple[float, float] | None,
    metadata: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Lines as GeoJSON (RFC 7946).

    With an origin, coordinates are WGS84 longitude, latitude, as the standard demands, and lines are cut at the
    antimeridian. Without one they are local metres, east then north, as every feature's property `coordinates` states.

    Args:
        features: Pairs of properties and the lines (n, 2) of north, east (m) that they describe.
        origin: Latitude and longitude (deg) of north = east = 0, or None.
        metadata: Further member of the collection.
    """
    collection: dict[str, Any] = {"type": "FeatureCollection", "features": []}
    if metadata:
        collection["metadata"] = dict(metadata)
    for properties, lines in features:
        coordinates = []
        for line in lines:
            if origin is None:
                coordinates.append(np.round(line[:, [1, 0]], 2).tolist())
                continue
            latitude, longitude = geodetic_from_local(line[:, 0], line[:, 1], *origin)
            coordinates += [np.round(part, 7).tolist() for part in _cut(np.column_stack([longitude, latitude]))]
        system = "WGS84 longitude, latitude (deg)" if origin else "local metres: east, north of the mission's origin"
        collection["features"].append(
            {
                "type": "Feature",
                "properties": {**properties, "coordinates": system},
                "geometry": {"type": "MultiLineString", "coordinates": coordinates},
            }
        )
    return collection


def _cut(line: Array) -> list[Array]:
    """The parts of a line (n, 2) of longitude, latitude (deg) on either side of the antimeridian."""
    parts, first = [], line[:0]
    crossings = np.flatnonzero(np.abs(np.diff(line[:, 0])) > 180.0) + 1
    for start, end in itertools.pairwise([0, *crossings.tolist()]):
        (before, lat), (after, next_lat) = line[end - 1], line[end]
        edge = math.copysign(180.0, before)
        share = (edge - before) / (after + 2.0 * edge - before)
        cut_lat = lat + share * (next_lat - lat)
        parts.append(np.vstack([first, line[start:end], [[edge, cut_lat]]]))
        first = np.array([[-edge, cut_lat]])
    last = int(crossings[-1]) if len(crossings) else 0
    return [*parts, np.vstack([first, line[last:]])]


def write_geojson(
    path: Path,
    features: Sequence[tuple[Mapping[str, Any], Sequence[Array]]],
    origin: tuple[float, float] | None,
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Writes the file with what `geojson_of` returns."""
    path.write_text(json.dumps(geojson_of(features, origin, metadata), allow_nan=False, indent=1))
