"""contours.geojson: depth contours at the levels of --contours and --contour-interval."""

import math

import numpy as np

from auv_lse_gp.level_set.lines import contours
from auv_lse_shore.export.content import Export
from auv_lse_shore.judge.isobath import length_m, write_geojson

#: Largest number of levels that an interval may give.
MAX_LEVELS = 1000


def write(export: Export) -> str:
    """Writes a feature for each level that the map has."""
    path, field = export.folder / "contours.geojson", export.team.field
    levels, every = _levels(export)
    if not levels:
        export.discard(path.name)
        return "contours.geojson: skipped; give --contours or --contour-interval"
    features, informed = [], field.informed(export.team.settings.gp.signal_std_m)
    for level in levels:
        lines = contours(field.grid.north_m, field.grid.east_m, field.mean_m, level, informed)
        if lines:
            properties = {"name": f"{level:g} m contour", "depth_m": level, "length_m": round(length_m(lines), 1)}
            features.append((properties, lines))
    write_geojson(path, features, export.reference.origin, export.metadata())
    thinned = f"; --contour-interval gives more than {MAX_LEVELS}, so one in {every} is written" if every > 1 else ""
    return f"contours.geojson ({len(features)} of {len(levels)} levels are on the map{thinned})"


def _levels(export: Export) -> tuple[list[float], int]:
    """Depths of the contours (m): those given, and the multiples of the interval within the map's depths.

    Returns:
        The depths, and n if only every n-th multiple is among them (1: all).
    """
    levels, interval = set(export.survey.contour_levels_m), export.survey.contour_interval_m
    depths = export.team.field.mean_m[np.isfinite(export.team.field.mean_m)]
    step = 1
    if interval > 0.0 and len(depths):
        first, last = math.ceil(depths.min() / interval), math.floor(depths.max() / interval)
        step = max(1, math.ceil((last - first + 1) / MAX_LEVELS))
        levels |= {round(number * interval, 9) for number in range(first, last + 1, step)}
    return sorted(levels), step
