"""The import's output: the soundings found, those left out and why, and the next commands."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.plurals import counted, counted_as
from auv_lse_record.run_data import RunData
from auv_lse_shore.survey_import.area import SurveyedArea
from auv_lse_shore.survey_import.survey_log import SurveyLog
from auv_lse_shore.survey_import.track import PlacedLog

#: Files of the run folder: soundings, the proposed mission file of a dive, the picture.
SOUNDINGS, DIVE, PICTURE = "soundings.csv", "dive.yaml", "survey.png"
#: Size (m2) from which sounded ground apart from the area is worth a line.
_WORTH_M2 = 2_500.0
#: A survey extends over at least this many standard deviations of its positions.
_LEAST_EXTENT = 10.0


def log_lines(log: SurveyLog, found: PlacedLog) -> Iterator[str]:
    """What was found in a log, and what was left out."""
    placed = f"{counted(len(found.soundings), 'sounding')} of {counted(len(log.depths), 'depth')}"
    yield "; ".join([f"{log.name}: {placed}", *log.notes])
    first_s, last_s = float(log.positions[0, 0]), float(log.positions[-1, 0])
    if log.has_time:
        start = f"{datetime.fromtimestamp(first_s, tz=UTC):%Y-%m-%d %H:%M:%S} UTC, " if log.is_utc else ""
        yield f"- {start}{(last_s - first_s) / 60.0:.1f} min"
    else:
        yield "- no times: auv_lse adjust cannot move these soundings"
    if found.combined:
        yield f"- pings of each second are one sounding: {counted(found.combined, 'ping')}"
    for reason, count in sorted(found.left_out.items()):
        if count:
            yield f"- left out: {counted_as(count, reason)}"
    for question in log.questions:
        yield f"- question: {question}"


def survey_lines(run: RunData, area: SurveyedArea) -> list[str]:
    """The survey as a whole: soundings, uncertainty, prior and area."""
    points = np.concatenate([vehicle.soundings.points_m for vehicle in run.vehicles])
    gp, level = run.parameters["/**"]["gp"], run.parameters["/**"]["level_set"]
    spans = [f"{span:.0f} m" for span in np.ptp(points, axis=0)[:2]]
    origin = "" if run.origin is None else f"; origin {run.origin[0]:.6f}, {run.origin[1]:.6f} deg"
    lines = [
        f"{counted(len(points), 'sounding')} over {spans[0]} north-south, {spans[1]} east-west; "
        f"{points[:, 2].min():.1f} to {points[:, 2].max():.1f} m deep{origin}",
    ]
    if len(run.vehicles) > 1:
        lines.append(f"{len(run.vehicles)} boats, because their logs are of the same time")
    stds = [np.hypot(*vehicle.position_std_at(vehicle.soundings.stamp_s).T) for vehicle in run.vehicles]
    known = np.concatenate(stds)
    known = known[np.isfinite(known)]
    if len(known):
        lines.append(
            f"positions of soundings: standard deviation {np.median(known):.1f} m (largest {known.max():.1f} m), with "
            "the sounder's delay and the positions' spacing"
        )
        if float(np.ptp(points[:, :2], axis=0).max()) < _LEAST_EXTENT * float(np.median(known)):
            lines.append("the boat hardly moved: the prior describes its sounder and not the ground. Take a longer log")
    lines += [
        f"prior: mean {gp['mean_depth_m']:.1f} m, standard deviation {gp['signal_std_m']:.2g} m, length scale "
        f"{gp['length_scale_m']:.3g} m, noise {gp['noise_std_m']:.2f} m",
        f"isobath {level['level_m']:g} m in an area of {len(area.polygon)} corners, {area.area_m2 / 1e4:.1f} ha",
    ]
    if area.no_go:
        lines.append(f"{counted(len(area.no_go), 'piece')} of it without soundings became no-go areas")
    if others := [size for size in area.others if size > _WORTH_M2]:
        lines.append(f"not in the area: {counted(len(others), 'piece')} of sounded ground apart, "
                     f"{sum(others) / 1e4:.1f} ha")  # fmt: skip
    return lines


def next_lines(folder: Path, dive: Mapping[str, Any], note: str) -> Sequence[str]:
    """What was written, with a note on the table, and the commands from here to a mission with paths filled in.

    Args:
        dive: Parameters of the proposed dive, those of all vehicles.
        note: A sentence about the table; "" without.
    """
    level_m, least_m = dive["level_set"]["level_m"], dive.get("vehicle", {}).get("min_water_m")
    at, file, soundings = (shlex.quote(str(path)) for path in (folder, folder / DIVE, folder / SOUNDINGS))
    lake = shlex.quote(f"{folder}-dive")
    return [
        f"written: {folder} (import.md repeats this; {PICTURE} shows tracks, depths and area)",
        *([note] if note else []),
        "next:",
        f"  auv_lse fit {soundings} --level {level_m:g} --out {shlex.quote(str(folder / 'gp.yaml'))}",
        f"  auv_lse check {file} --map {shlex.quote(str(folder / 'dive-map.png'))}",
        f"  auv_lse mission {file} --bathymetry {soundings} --out {lake}",
        f"  auv_lse export {at}",
        f"prior for the dive: {DIVE} has gp.mean: survey and gp.survey_file: {SOUNDINGS}; change area, vehicles "
        "and steps there",
        *([] if least_m is None else [f"shallow water: in {DIVE}, vehicle.min_water_m is {least_m:g} m"]),
    ]
