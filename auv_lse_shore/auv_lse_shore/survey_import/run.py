"""The run folder of an imported survey: its recording, its soundings, a mission file for a dive, and a picture."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.vehicle import LEAST_SEPARATION_M, VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.atomic_files import written_whole
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import brief
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.covariance.likelihood import TREND_EXTENTS, fit
from auv_lse_gp.thinning import one_of_each_cell, soundings_to_fit
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_record.run_writer import write_mission_file, write_run
from auv_lse_shore.survey_import.area import SurveyedArea, surveyed_area
from auv_lse_shore.survey_import.picture import draw_survey
from auv_lse_shore.survey_import.survey_log import LogError
from auv_lse_shore.survey_import.team import FIX_EVERY_S
from auv_lse_shore.survey_import.words import DIVE, PICTURE, SOUNDINGS

#: Maximum number of soundings in the table, and length of a leg (m) from which a dive's steps are proposed.
MOST_SOUNDINGS, LEG_M = 200_000, 23.6
#: Smallest cell (m) of a thinned table, and how much larger the next ones are.
SMALLEST_CELL_M, COARSER = 0.5, 1.5
#: Number of soundings and of starts with which the Gaussian process is learned.
FITTED, STARTS = 5_000, 2
#: Cells along the survey's extent, of which each counts once in the mean depth, however long the boat was there.
MEAN_CELLS = 50
#: Number of cells of the map, and of kernel centers, beyond which both get coarser.
MAX_CELLS, MAX_CENTERS = 100_000, 1_500
#: Least standard deviation of a sounding (m): the resolution of sounders, and waves.
LEAST_NOISE_M = 0.05
#: Lanes of a proposed dive are at least this far (m) apart, a little more than a turning circle.
LANE_M = 32.0
#: Water (m) that a proposed dive keeps below a vehicle at least, and has to spare where it crosses the isobath: more in
#: deep water, lest the isobath be the border of what it can reach.
LEAST_WATER_M, ROOM_M, ROOM_SHARE = 0.5, 0.2, 0.2
#: Minimum number of soundings for a map.
LEAST_SOUNDINGS = 10
#: Positions come from GPS or an estimator: they have neither a heading's nor a log's errors. Where depths differ at a
#: crossing, the water level is more likely to have changed than a position by metres. The first fix is their start.
_NO_DRIFT = {
    "start_std_m": 100.0,
    "terrain": False,
    "heading_std_deg": 0.01,
    "harmonic_std_deg": 0.01,
    "scale_std": 1e-5,
    "heading_walk_deg_rth": 0.0,
}


def survey_run(
    vehicles: Sequence[VehicleRun],
    origin: tuple[float, float] | None,
    level_m: float | None,
    depth_std_m: float = 0.0,
    draught_m: float = 0.0,
) -> tuple[RunData, SurveyedArea]:
    """The run of a survey, with a mission file for its area and a prior learned from it; and the area.

    Args:
        vehicles: Tracks and soundings.
        origin: Latitude and longitude (deg) of north = east = 0; None if unknown.
        level_m: Depth of the isobath (m); None: the median depth.
        depth_std_m: Least standard deviation of a sounding that the logs allow (m).
        draught_m: Depth of the transducer (m) where no track has it.

    Raises:
        LogError: if there are too few soundings to learn from.
    """
    points = np.concatenate([vehicle.soundings.points_m for vehicle in vehicles])
    if len(points) < LEAST_SOUNDINGS:
        raise LogError(f"The survey has {counted(len(points), 'usable sounding')}, and a map needs {LEAST_SOUNDINGS}.")
    level_m = round(float(np.median(points[:, 2])), 1) if level_m is None else level_m
    learned = _learned(points, max(depth_std_m, LEAST_NOISE_M))
    area = surveyed_area(points[:, :2], learned["length_scale_m"])
    parameters = {
        "/**": {
            "mission": {"vehicles": len(vehicles), "steps": 1},
            "level_set": {"level_m": level_m},
            "area": area.section(origin),
            "vehicle": {"depth_m": draught_m},
            "gp": {**learned, **_sizes(points, area, learned["length_scale_m"])},
            "positions": {**_NO_DRIFT, "position_walk_m_rts": _walk_m_rts(vehicles)},
        }
    }
    last_s = max(float(max(v.soundings.stamp_s.max(), *v.odometry[-1:, 0], 0.0)) for v in vehicles)
    return RunData(parameters=parameters, vehicles=list(vehicles), origin=origin, end_s=last_s), area


def _walk_m_rts(vehicles: Sequence[VehicleRun]) -> float:
    """The random walk (m/sqrt(s)) of positions whose error lasts `FIX_EVERY_S`."""
    stds_m = [fix.std_m for vehicle in vehicles for fix in vehicle.fixes]
    return round(max(stds_m, default=0.0) * math.sqrt(2.0 / FIX_EVERY_S), 5)


def _learned(points: Array, least_noise_m: float) -> dict[str, Any]:
    """Kernel and hyperparameters of section `gp`, learned from the soundings.

    The likeliest mean of a bowl is none of its depths, so theirs is taken, all parts of the survey counting alike.
    A length scale of more than half the survey would describe a trend. At that limit a smooth slope needs hardly any
    variance, so the standard deviation is at least that of the depths about the mean.
    """
    extent_m = float(np.ptp(points[:, :2], axis=0).max())
    mean_m = float(points[one_of_each_cell(points[:, :2], extent_m / MEAN_CELLS or 1.0), 2].mean())
    drawn, _ = soundings_to_fit(points, FITTED)
    try:
        fitted = fit(drawn[:, :2], drawn[:, 2], mean_depth_m=mean_m, max_extents=TREND_EXTENTS, restarts=STARTS)
    except ValueError as error:
        raise LogError(f"No Gaussian process fits the soundings: {brief(error)}") from error
    config, names = fitted.config, ("signal_std_m", "length_scale_m", "noise_std_m", "mean_depth_m")
    learned: dict[str, Any] = {name: float(f"{getattr(config, name):.5g}") for name in names}
    learned["noise_std_m"] = max(learned["noise_std_m"], least_noise_m)
    if learned["length_scale_m"] > 0.99 * TREND_EXTENTS * float(np.ptp(drawn[:, :2], axis=0).max()):
        spread_m = math.sqrt(float(np.mean((points[:, 2] - learned["mean_depth_m"]) ** 2)))
        learned["signal_std_m"] = max(learned["signal_std_m"], float(f"{spread_m:.5g}"))
    return {"kernel": config.kernel, **learned}


def _sizes(points: Array, area: SurveyedArea, length_scale_m: float) -> dict[str, float]:
    """Cells and spacing of centers of section `gp` that suit the survey's size."""
    fine_m = max(length_scale_m / 6.0, 1.0)
    spacing_m = min(GpConfig().min_spacing_m, fine_m)
    centers = points[one_of_each_cell(points[:, :2], spacing_m), :2]
    while len(centers) > MAX_CENTERS:
        spacing_m *= 1.25
        centers = centers[one_of_each_cell(centers, spacing_m)]
    cell_m = max(min(GpConfig().map_resolution_m, fine_m), math.sqrt(area.area_m2 / MAX_CELLS), area.finest_cell_m)
    return {"min_spacing_m": round(spacing_m, 1), "map_resolution_m": round(cell_m, 1)}


def check_free(folder: Path) -> None:
    """Raises LogError if a run is in a folder."""
    for name in ("mission.yaml", "bag"):
        if (folder / name).exists():
            raise LogError(f"--out {folder} has a {name} already. Choose another name.")


def write_survey(
    run: RunData,
    area: SurveyedArea,
    table: Array,
    dive: dict[str, dict[str, Any]],
    folder: Path,
    summary: Sequence[str],
) -> None:
    """Writes mission files, recording, soundings, picture and `import.md`; all of them or nothing.

    Args:
        table: The rows of `survey_table`.
        dive: The result of `dive_parameters`.
        summary: The lines of `import.md`.

    Raises:
        OSError: if the folder cannot be written.
        RecordingError: if the message definitions are missing.
    """
    with written_whole(folder) as part:
        write_run(run, part)
        (part / "import.md").write_text("# Imported survey\n\n" + "\n".join(summary) + "\n")
        _write_soundings(table, run.origin, part / SOUNDINGS)
        write_mission_file(part / DIVE, dive)
        draw_survey(run, area, part / PICTURE)


def dive_parameters(run: RunData, area: SurveyedArea, soundings: Path) -> dict[str, dict[str, Any]]:
    """The mission file of a dive in the surveyed area, with the soundings as prior mean.

    Args:
        area: Its area. Vehicles start inside of it, as near to its first sounding as they can turn.
    """
    own = run.parameters["/**"]
    steps = min(4.0 * math.sqrt(area.area_m2), area.area_m2 / (2.0 * LANE_M)) / LEG_M
    steps = int(np.clip(round(steps), 10, 200))
    prior = {name: own["gp"][name] for name in ("kernel", "signal_std_m", "length_scale_m", "noise_std_m")}
    shared = {
        "mission": {"vehicles": 2, "steps": steps},
        "level_set": dict(own["level_set"]),
        "area": dict(own["area"]),
        "gp": {**prior, "mean_depth_m": own["gp"]["mean_depth_m"], "mean": "survey", "survey_file": str(soundings)},
    }
    finest_m = area.finest_cell_m
    if finest_m > GpConfig().map_resolution_m:
        shared["gp"]["map_resolution_m"] = finest_m
    if finest_m > PlannerConfig().map_spacing_m:
        shared["planner"] = {"map_spacing_m": finest_m}
    points = run.vehicles[0].soundings.points_m
    shallow_m = round(float(np.clip(0.3 * np.quantile(points[:, 2], 0.05), 0.5, 3.0)), 1)
    apart_m = max(0.5 * shallow_m, LEAST_SEPARATION_M)
    level_m = own["level_set"]["level_m"]
    water_m = (
        level_m - (shallow_m + apart_m) - max(ROOM_M, ROOM_SHARE * level_m)
    )  # below the deeper vehicle on the isobath
    if water_m < VehicleConfig().min_water_m:
        shared["vehicle"] = {"min_water_m": round(max(water_m, LEAST_WATER_M), 1)}
    parameters: dict[str, dict[str, Any]] = {"/**": shared}
    for number, (north_m, east_m) in enumerate(area.starts(points[0, :2], 2), 1):
        start = {"start_north_m": round(north_m, 1), "start_east_m": round(east_m, 1)}
        parameters[f"/auv{number}/**"] = {"vehicle": {**start, "depth_m": round(shallow_m + (number - 1) * apart_m, 1)}}
    return parameters


def survey_table(run: RunData) -> tuple[Array, str]:
    """Rows (north m, east m, depth m) of the survey's table, and a sentence if some soundings are left out.

    The table is for `gp.survey_file` and `--bathymetry`. That of a large survey has one sounding of each cell.
    """
    points = np.concatenate([vehicle.soundings.points_m for vehicle in run.vehicles])
    chosen, cell_m = points, SMALLEST_CELL_M
    while len(chosen) > MOST_SOUNDINGS:
        chosen = chosen[one_of_each_cell(chosen[:, :2], cell_m)]
        cell_m *= COARSER
    if len(chosen) == len(points):
        return points, ""
    return chosen, (
        f"{SOUNDINGS} has {len(chosen):,} of {len(points):,} soundings, one of each cell of {cell_m / COARSER:.2g} m; "
        "the recording has all"
    )


def _write_soundings(rows: Array, origin: tuple[float, float] | None, path: Path) -> None:
    names, formats = "north_m,east_m,depth_m", "%.3f,%.3f,%.3f"
    if origin is not None:
        rows = np.column_stack([rows, *geodetic_from_local(rows[:, 0], rows[:, 1], *origin)])
        names, formats = names + ",lat,lon", formats + ",%.8f,%.8f"
    np.savetxt(path, rows, fmt=formats, header=names, comments="")
