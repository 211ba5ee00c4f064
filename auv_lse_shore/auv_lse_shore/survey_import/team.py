"""From placed logs to vehicles: a sounding in two files counts once, and times stay UTC.

Logs that follow each other are of one vehicle. A log of another boat at the same time is another vehicle. Logs without
a date follow each other from time 0.
"""

from collections.abc import Sequence

import numpy as np

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record.run_data import VehicleRun
from auv_lse_shore.survey_import.survey_log import LogError
from auv_lse_shore.survey_import.track import PlacedLog

#: Positions count as fixes at this interval (s): GPS errors last about ten minutes, so closer fixes share one.
FIX_EVERY_S = 600.0
#: Time between two logs without dates in the run (s).
BETWEEN_LOGS_S = 60.0
#: Two soundings nearer than this in time (s) and position (m) are the same.
SAME_S, SAME_M = 0.75, 5.0
#: Reason why a sounding is left out here.
REPEATED = "soundings that another file has, too"
#: Maximum number of vehicles in a run.
MOST_VEHICLES = 20


def without_repetitions(logs: Sequence[PlacedLog]) -> list[PlacedLog]:
    """The logs without the soundings that an earlier file has, too, and without logs that have nothing else."""
    kept: list[PlacedLog] = []
    for log in sorted(logs, key=lambda log: float(log.track[0, 0])):
        for other in kept:
            if not len(log.soundings):
                break
            same = _repeated(log, other)
            log.left_out[REPEATED] += int(same.sum())
            if same.any() and log.is_utc and other.is_utc:
                rows = ~_is_same(log.track[:, :3], other.track[:, :3])
                log.track, log.track_std_m = log.track[rows], log.track_std_m[rows]
            log.soundings = log.soundings[~same]
        if len(log.soundings) and len(log.track):
            kept.append(log)
    return kept


def _repeated(log: PlacedLog, other: PlacedLog) -> Mask:
    """Mask of a log's soundings that another one has."""
    if log.is_utc and other.is_utc:
        return _is_same(log.soundings, other.soundings)
    first = 0 if log.has_time and other.has_time else 1
    keys = [{tuple(row) for row in np.round(part.soundings[:, first:], 3).tolist()} for part in (log, other)]
    if not keys[0] & keys[1]:
        return np.zeros(len(log.soundings), dtype=bool)
    return np.array([tuple(row) in keys[1] for row in np.round(log.soundings[:, first:], 3).tolist()])


def _is_same(rows: Array, others: Array) -> Mask:
    """Mask of the rows (time s, north, east m, ...) that have one of the others at the same time and position."""
    after = np.searchsorted(others[:, 0], rows[:, 0])
    same = np.zeros(len(rows), dtype=bool)
    for near in (others[after.clip(max=len(others) - 1)], others[(after - 1).clip(0)]):
        apart_m = np.hypot(near[:, 1] - rows[:, 1], near[:, 2] - rows[:, 2])
        same |= (np.abs(near[:, 0] - rows[:, 0]) <= SAME_S) & (apart_m <= SAME_M)
    return same


def vehicles_of(logs: Sequence[PlacedLog], position_std_m: float) -> list[VehicleRun]:
    """The recordings of the vehicles, with times in UTC if all logs have it, else from 0.

    Positions are the raw track, and every `FIX_EVERY_S` a fix. Positions with standard deviations of their own are
    estimates: their errors have too much in common to count as fixes, and only the estimated track is kept. Logs
    without times have soundings only.

    Raises:
        LogError: if only some logs state standard deviations, or too many logs are of the same time.
    """
    names = ", ".join(log.name for log in logs if log.is_estimated)
    if names and not all(log.is_estimated for log in logs):
        raise LogError(f"{names} states standard deviations of its positions, and others do not. Import it alone.")
    in_order = sorted(logs, key=lambda log: float(log.track[0, 0]))
    if not all(log.is_utc for log in logs):
        return [_vehicle(1, _one_after_the_other(in_order), position_std_m)]
    boats: list[list[PlacedLog]] = []
    for log in [log for log in in_order if log.has_time] or in_order[:1]:
        free = next((boat for boat in boats if boat[-1].track[-1, 0] < log.track[0, 0]), None)
        if free is None:
            boats.append(free := [])
        free.append(log)
    boats[0] += [log for log in in_order if not log.has_time and log is not boats[0][0]]
    if len(boats) > MOST_VEHICLES:
        raise LogError(f"{len(boats)} logs are of the same time. Import at most {MOST_VEHICLES} boats at once.")
    return [_vehicle(number, boat, position_std_m) for number, boat in enumerate(boats, 1)]


def _one_after_the_other(logs: Sequence[PlacedLog]) -> list[PlacedLog]:
    start_s = 0.0
    for log in logs:
        shift_s = start_s - float(log.track[0, 0])
        log.track[:, 0] += shift_s
        log.soundings[:, 0] += shift_s
        start_s = float(log.track[-1, 0]) + BETWEEN_LOGS_S
    return list(logs)


def _vehicle(number: int, logs: Sequence[PlacedLog], position_std_m: float) -> VehicleRun:
    """One vehicle's recording."""
    rows, fixes = [], []
    for log in logs:
        is_raw = log.has_time and not log.is_estimated
        raw = log.soundings[:, 1:3] if is_raw else np.full((len(log.soundings), 2), np.nan)
        rows.append(np.column_stack([log.soundings, raw]))
        periods = np.round((log.track[:, 0] - log.track[0, 0]) / FIX_EVERY_S)
        first = np.unique(periods, return_index=True)[1]
        for stamp_s, north, east, _, _ in log.track[first].tolist() if is_raw else ():
            position = dict.fromkeys(("north_m", "raw_north_m"), north) | dict.fromkeys(("east_m", "raw_east_m"), east)
            fixes.append(Fix(stamp_s=stamp_s, std_m=position_std_m, **position))
    timed = [log for log in logs if log.has_time]
    track = np.concatenate([log.track for log in timed]) if timed else np.empty((0, 5))
    return VehicleRun(
        vehicle=number,
        odometry=track[:, :4],
        position_std_m=np.concatenate([log.track_std_m for log in timed]) if timed else np.empty((0, 2)),
        dead_reckoning=np.empty((0, 5)) if any(log.is_estimated for log in logs) else track,
        soundings=Soundings.from_rows(np.concatenate(rows)).in_order(),
        fixes=fixes,
    )
