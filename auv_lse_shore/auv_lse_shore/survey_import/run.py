"""The run folder of an imported survey: its mission file, its recording, and a summary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.atomic_files import written_whole
from auv_lse_common.support.missing_packages import missing
from auv_lse_gp.covariance.likelihood import fit
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_record.run_writer import write_run
from auv_lse_shore.survey_import.survey_log import LogError

Array = NDArray[np.float64]

#: The operating area ends this far (m) from the outermost soundings.
MARGIN_M = 25.0
#: Number of soundings and of starts with which the Gaussian process is learned.
FITTED, STARTS = 300, 3
#: Number of cells of the map, and of kernel centers, beyond which both get coarser.
MAX_CELLS, MAX_CENTERS = 100_000, 1_500
#: Least standard deviation of a sounding (m): the resolution of sounders, and waves.
LEAST_NOISE_M = 0.05
#: Fewest soundings of a map.
LEAST_SOUNDINGS = 10
#: Positions come from GPS or an estimator: they have neither a heading's nor a log's errors.
_NO_DRIFT = {
    "heading_std_deg": 0.01,
    "harmonic_std_deg": 0.01,
    "scale_std": 1e-5,
    "heading_walk_deg_rth": 0.0,
}


def survey_run(
    vehicle: VehicleRun, origin: tuple[float, float] | None, level_m: float | None, depth_std_m: float = 0.0
) -> RunData:
    """The run of a survey, with a mission file for its area and a prior learned from it.

    Args:
        vehicle: Track and soundings.
        origin: Latitude and longitude (deg) of north = east = 0; None if unknown.
        level_m: Depth of the isobath (m); None: the median depth.
        depth_std_m: Least standard deviation of a sounding that the logs allow (m).

    Raises:
        LogError: if there are too few soundings to learn from.
    """
    points = vehicle.soundings.points_m
    if len(points) < LEAST_SOUNDINGS:
        raise LogError(f"survey: got {len(points)} usable soundings; expected at least {LEAST_SOUNDINGS}")
    level_m = round(float(np.median(points[:, 2])), 1) if level_m is None else level_m
    area, area_m2 = _area(points[:, :2])
    if origin is not None:
        area |= {"origin_lat_deg": origin[0], "origin_lon_deg": origin[1]}
    parameters = {
        "/**": {
            "mission": {"vehicles": 1, "steps": 1},
            "level_set": {"level_m": level_m},
            "area": area,
            "gp": _gp(points, area_m2, max(depth_std_m, LEAST_NOISE_M)),
            "positions": dict(_NO_DRIFT),
        }
    }
    last_s = float(max(vehicle.soundings.stamp_s.max(), *vehicle.odometry[-1:, 0], 0.0))
    return RunData(parameters=parameters, vehicles=[vehicle], origin=origin, sim_s=last_s)


def _area(locations_m: Array) -> tuple[dict[str, Any], float]:
    """Section `area`: around all positions; and its size (m2)."""
    try:
        from shapely import MultiPoint
    except ImportError as error:
        raise missing(error, "operating areas") from error
    polygon = MultiPoint(locations_m).convex_hull.buffer(MARGIN_M, quad_segs=2).simplify(2.0)
    corners = [round(float(value), 1) for east_north in polygon.exterior.coords[:-1] for value in east_north]
    low, high = locations_m.min(axis=0), locations_m.max(axis=0)
    raster_m = max(2.0, round(float((high - low).max()) / 1000.0, 1))
    return {"polygon_m": corners, "raster_m": raster_m}, float(polygon.area)


def _gp(points: Array, area_m2: float, least_noise_m: float) -> dict[str, Any]:
    """Section `gp`: learned from some of the soundings, with cells and centers that suit the survey's size."""
    rng = np.random.default_rng(0)
    chosen = np.sort(rng.choice(len(points), min(FITTED, len(points)), replace=False))
    try:
        config = fit(points[chosen, :2], points[chosen, 2], restarts=STARTS, rng=rng).config
    except ValueError as error:
        raise LogError(f"survey: no Gaussian process fits the soundings: {error}") from error
    names = ("signal_std_m", "length_scale_m", "noise_std_m", "mean_depth_m")
    learned = {name: float(f"{getattr(config, name):.5g}") for name in names}
    learned["noise_std_m"] = max(learned["noise_std_m"], least_noise_m)
    fine_m = max(learned["length_scale_m"] / 6.0, 1.0)
    spacing_m = min(GpConfig().min_spacing_m, fine_m)
    while len(np.unique(np.floor(points[:, :2] / spacing_m), axis=0)) > MAX_CENTERS:
        spacing_m *= 1.25
    cell_m = max(min(GpConfig().map_resolution_m, fine_m), math.sqrt(area_m2 / MAX_CELLS))
    sizes = {"min_spacing_m": round(spacing_m, 1), "map_resolution_m": round(cell_m, 1)}
    return {"kernel": config.kernel, **learned, **sizes}


def check_free(folder: Path) -> None:
    """Raises LogError if a run is in a folder."""
    for name in ("mission.yaml", "bag"):
        if (folder / name).exists():
            raise LogError(f"--out {folder}: got a folder with {name}; expected a new one. Choose another name")


def write_survey(run: RunData, folder: Path, summary: Sequence[str]) -> None:
    """Writes mission file, recording and `import.md`; all of them or nothing.

    Raises:
        OSError: if the folder cannot be written.
        RecordingError: if the message definitions are missing.
    """
    is_new = not folder.exists()
    try:
        with written_whole(folder) as part:
            write_run(run, part)
            (part / "import.md").write_text("# Imported survey\n\n" + "\n".join(summary) + "\n")
    except BaseException:
        if is_new and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise
