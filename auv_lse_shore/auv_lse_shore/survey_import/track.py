"""From the positions and depths of logs to one vehicle's track and soundings.

Each log's track is freed of jumps, and its depths are placed on it: interpolated in time, moved from the antenna to the
transducer, and added to the depths of transducer and vehicle. As during a mission, pings are combined to one sounding
per second, and the gate of implausible soundings follows (`auv_lse_common.vocabulary.sounding_gate`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_common.vocabulary.pings import by_period, sounding_of
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_record.run_data import VehicleRun
from auv_lse_shore.survey_import.survey_log import LogError, SurveyLog

Array = NDArray[np.float64]

#: A depth needs positions before and after it, not farther apart than this (s).
MAX_GAP_S = 5.0
#: Faster than this (m/s), beyond `JUMP_M`, the track jumps; pieces between jumps need `LEAST_POSITIONS`.
MAX_SPEED_MPS, JUMP_M, LEAST_POSITIONS = 20.0, 5.0, 5
#: The course comes from positions at least this far apart (m).
COURSE_M = 2.0
#: Period of soundings and of the track (s).
EVERY_S = 1.0
#: Positions count as fixes this far apart (s): nearer ones have the same error.
FIX_EVERY_S = 60.0
#: Time between two logs in the run (s).
BETWEEN_LOGS_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """How depths are placed.

    Attributes:
        forward_m, starboard_m: The transducer's position relative to the antenna.
        draught_m: The transducer's depth below the surface, or below a submarine's barometer.
        position_std_m: Standard deviation of a position, each axis.
        start_s, end_s: Part of each log to use, from its first position.
    """

    forward_m: float = 0.0
    starboard_m: float = 0.0
    draught_m: float = 0.0
    position_std_m: float = 1.5
    start_s: float = 0.0
    end_s: float = math.inf


@dataclass(slots=True, kw_only=True)
class PlacedLog:
    """One log on the local plane.

    Attributes:
        track: Rows (time s, north m, east m, course rad, depth of the vehicle m), about one per second.
        soundings: Rows (time s, north m, east m, depth m).
        left_out: Number of positions and depths left out, by reason.
        has_time: Whether the log has times.
        position_std_m: Standard deviations north and east (m) of the track's rows, (n, 2), if the log states them.
    """

    name: str
    track: Array
    soundings: Array
    left_out: Counter[str]
    has_time: bool
    position_std_m: Array | None = None


def local_origin(logs: Sequence[SurveyLog]) -> tuple[float, float] | None:
    """The first position (deg) of the first log that does not jump; None for logs in metres.

    Raises:
        LogError: if only some logs are in degrees.
    """
    if len({log.is_geodetic for log in logs}) > 1:
        names = ", ".join(log.name for log in logs if not log.is_geodetic)
        raise LogError(f"{names}: got metres; expected latitude and longitude, as in the other logs. Import it alone")
    if not logs[0].is_geodetic:
        return None
    log = logs[0]
    first = log.positions[0]
    north, east = local_from_geodetic(log.positions[:, 1], log.positions[:, 2], float(first[1]), float(first[2]))
    kept = log.positions[_steady(log.positions[:, 0], north, east, log.has_time)]
    return float(kept[0, 1]), float(kept[0, 2])


def position(log: SurveyLog, origin: tuple[float, float] | None, how: Placement) -> PlacedLog:
    """Positions a log's depths.

    Raises:
        LogError: if no sounding remains.
    """
    left_out = Counter(log.left_out)
    chosen, times, track = _track(log, origin, how, left_out)
    pings = _pings(log, times, track, how, left_out)
    gate = SoundingGate()
    rows = gate.passed([tuple(sounding_of(group).tolist()) for group in by_period(pings, EVERY_S)])
    for reason, count in gate.counts.items():
        left_out[f"soundings: {reason}"] += count
    if not rows:
        reasons = ", ".join(f"{count} {reason}" for reason, count in left_out.items()) or "there are none"
        raise LogError(f"{log.name}: got no usable sounding ({reasons}); expected depths at known positions")
    stated = log.position_std_m is not None and log.has_time
    rows_kept = np.arange(len(times)) if stated else _first_of_each(times, EVERY_S)
    return PlacedLog(
        name=log.name,
        track=np.column_stack([times, track])[rows_kept],
        soundings=np.array(rows, dtype=float),
        left_out=left_out,
        has_time=log.has_time,
        position_std_m=log.position_std_m[chosen] if log.position_std_m is not None and log.has_time else None,
    )


def _first_of_each(times: Array, period_s: float) -> NDArray[np.int64]:
    """Numbers of the first time in each period that has any, and of the last time."""
    first = np.unique(np.floor((times - times[0]) / period_s), return_index=True)[1]
    return np.unique(np.append(first, len(times) - 1))


def _track(
    log: SurveyLog, origin: tuple[float, float] | None, how: Placement, left_out: Counter[str]
) -> tuple[NDArray[np.int64], Array, Array]:
    """Which positions are used, their times (s), and rows (north m, east m, course rad, depth of the vehicle m)."""
    times, north, east = log.positions.T
    if origin is not None:
        north, east = local_from_geodetic(north, east, *origin)
    known = np.isfinite(north) & np.isfinite(east)
    known &= (times >= times[0] + how.start_s) & (times <= times[0] + how.end_s)
    steady = _steady(times, north, east, log.has_time)
    left_out["positions that jump"] += int((known & ~steady).sum())
    chosen = np.flatnonzero(known & steady)
    chosen = chosen[np.append(True, np.diff(times[chosen]) > 0.0)] if len(chosen) else chosen
    if not len(chosen):
        raise LogError(f"{log.name}: got no position in the chosen time; expected some. Check --from and --to")
    times, north, east = times[chosen], north[chosen], east[chosen]
    immersion = np.zeros(len(times))
    if len(log.immersion):
        immersion = np.interp(times, log.immersion[:, 0], log.immersion[:, 1])
    return chosen, times, np.column_stack([north, east, _course(north, east), immersion])


def _steady(times: Array, north: Array, east: Array, has_time: bool) -> NDArray[np.bool_]:
    """Whether each position belongs to a piece of track between jumps that is long enough."""
    if not has_time or len(times) < 2:
        return np.ones(len(times), dtype=bool)
    jumps = np.hypot(np.diff(north), np.diff(east)) > MAX_SPEED_MPS * np.diff(times) + JUMP_M
    piece = np.append(0, np.cumsum(jumps))
    sizes = np.bincount(piece)
    steady: NDArray[np.bool_] = sizes[piece] >= min(LEAST_POSITIONS, int(sizes.max()))
    return steady


def _course(north: Array, east: Array) -> Array:
    """Course (rad) at each position; while the vehicle stands still, the last one."""
    moved = np.append(0.0, np.cumsum(np.hypot(np.diff(north), np.diff(east))))
    before = np.searchsorted(moved, moved - COURSE_M, side="right") - 1
    after = np.searchsorted(moved, moved + COURSE_M)
    before, after = before.clip(0), after.clip(max=len(moved) - 1)
    course: Array = np.arctan2(east[after] - east[before], north[after] - north[before])
    return course


def _pings(log: SurveyLog, times: Array, track: Array, how: Placement, left_out: Counter[str]) -> Array:
    """Rows (time s, north m, east m, depth of water m) of the depths that can be used."""
    stamps, depths = log.depths.T
    within = (stamps >= log.positions[0, 0] + how.start_s) & (stamps <= log.positions[0, 0] + how.end_s)
    left_out["depths outside of --from and --to"] += int((~within).sum())
    echo = np.isfinite(depths) & (depths > 0.0)
    left_out["depths of 0 or less: no echo"] += int((within & ~echo).sum())
    after = np.searchsorted(times, stamps).clip(0, len(times) - 1)
    before = np.where(times[after] == stamps, after, after - 1)
    placed = (before >= 0) & (times[after] >= stamps) & (times[after] - times[before.clip(0)] <= MAX_GAP_S)
    left_out[f"depths without positions within {MAX_GAP_S:g} s"] += int((within & echo & ~placed).sum())
    use = within & echo & placed
    stamps, depths = stamps[use], depths[use]
    north, east, immersion = (np.interp(stamps, times, track[:, column]) for column in (0, 1, 3))
    course = track[after[use], 2]
    north += how.forward_m * np.cos(course) - how.starboard_m * np.sin(course)
    east += how.forward_m * np.sin(course) + how.starboard_m * np.cos(course)
    return np.column_stack([stamps, north, east, depths + how.draught_m + immersion])


def vehicle_of(logs: Sequence[PlacedLog], position_std_m: float) -> VehicleRun:
    """All logs as one vehicle's recording, one after the other, from time 0.

    Positions are the raw track, and every `FIX_EVERY_S` a fix. Positions with standard deviations of their own are
    estimates: their errors have too much in common to count as fixes, and only the estimated track is kept. Logs
    without times have soundings only.

    Raises:
        LogError: if only some logs state standard deviations.
    """
    stated = [log.position_std_m is not None for log in logs]
    if any(stated) and not all(stated):
        names = ", ".join(log.name for log in logs if log.position_std_m is not None)
        raise LogError(f"{names}: got north_std_m and east_std_m; expected them in all logs or none. Import it alone")
    rows, tracks, stds, fixes, start_s = [], [], [], [], 0.0
    for log in sorted(logs, key=lambda log: float(log.track[0, 0])):
        shift_s = start_s - float(log.track[0, 0])
        soundings, track = log.soundings.copy(), log.track.copy()
        soundings[:, 0] += shift_s
        track[:, 0] += shift_s
        is_raw = log.has_time and log.position_std_m is None
        raw = soundings[:, 1:3] if is_raw else np.full((len(soundings), 2), np.nan)
        rows.append(np.column_stack([soundings, raw]))
        start_s = float(track[-1, 0]) + BETWEEN_LOGS_S
        if not log.has_time:
            continue
        tracks.append(track)
        stds.append(np.full((len(track), 2), position_std_m) if log.position_std_m is None else log.position_std_m)
        for stamp_s, north, east, _, _ in track[_first_of_each(track[:, 0], FIX_EVERY_S)].tolist() if is_raw else ():
            position = dict.fromkeys(("north_m", "raw_north_m"), north) | dict.fromkeys(("east_m", "raw_east_m"), east)
            fixes.append(Fix(stamp_s=stamp_s, std_m=position_std_m, **position))
    track = np.concatenate(tracks) if tracks else np.empty((0, 5))
    return VehicleRun(
        vehicle=1,
        odometry=track[:, :4],
        position_std_m=np.concatenate(stds) if stds else np.empty((0, 2)),
        dead_reckoning=np.empty((0, 5)) if any(stated) else track,
        soundings=Soundings.from_rows(np.concatenate(rows)),
        fixes=fixes,
    )
