"""Gives the depths of a log their positions on the local plane, with uncertainties.

The track is freed of jumps and of positions that only repeat an old one. Depths are interpolated between positions in
time, moved from the antenna to the transducer, and added to the depth of a vehicle. As during a mission, pings are
combined to one sounding per second, and the gate of implausible soundings follows
(`auv_lse_common.vocabulary.sounding_gate`).
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.support.plurals import counted_as
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_common.vocabulary.pings import period_of
from auv_lse_common.vocabulary.sounding_gate import AGREEING, passing
from auv_lse_gp.soundings import longitude_180
from auv_lse_shore.survey_import.survey_log import JUMP_M, MAX_SPEED_MPS, LogError, SurveyLog

#: A depth needs positions before and after it, not farther apart than `GAPS` times their usual spacing, and this (s).
GAPS, LEAST_GAP_S, LARGEST_GAP_S = 3.0, 5.0, 120.0
#: Least number of positions of a piece of track between jumps.
LEAST_POSITIONS = 5
#: Number of positions among which the first one that does not jump usually is.
_FIRST_POSITIONS = 10_000
#: A repeated position is stale if the step after it is this many times as fast as the boat.
STALE = 1.6
#: The course comes from positions at least this far apart (m).
COURSE_M = 2.0
#: Period of soundings and of the track (s).
EVERY_S = 1.0
#: Positions farther than this (m) from the origin are of another survey, or wrong.
FARTHEST_M = 200_000.0
#: A log holds two boats if this share of positions is this far (m) from both neighbors, which are near each other. Two
#: receivers of one boat are closer.
_SWINGS, _BOATS_APART_M = 0.3, 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """How depths are placed.

    Attributes:
        forward_m, starboard_m: The transducer's position relative to the antenna.
        position_std_m: Standard deviation of a position, each axis.
        lag_s: Time (s) by which a depth is stamped after its measurement.
        start_s, end_s: Part of each log to use, from its first position.
    """

    forward_m: float = 0.0
    starboard_m: float = 0.0
    position_std_m: float = 1.5
    lag_s: float = 0.0
    start_s: float = 0.0
    end_s: float = math.inf


@dataclass(slots=True, kw_only=True)
class PlacedLog:
    """One log on the local plane.

    Attributes:
        track: Rows (time s, north m, east m, course rad, depth of the vehicle m), about one per second.
        track_std_m: Standard deviations north and east (m) of a sounding at the track's rows, (n, 2).
        soundings: Rows (time s, north m, east m, depth m).
        combined: Number of pings of which the soundings were made; 0 if each is a sounding.
        left_out: Number of positions and depths left out, by reason.
        has_time: Whether the log has times.
        is_utc: Whether they are UTC.
        is_estimated: Whether its positions are estimates with standard deviations of their own.
    """

    name: str
    track: Array
    track_std_m: Array
    soundings: Array
    combined: int
    left_out: Counter[str]
    has_time: bool
    is_utc: bool
    is_estimated: bool


def local_origin(logs: Sequence[SurveyLog]) -> tuple[float, float] | None:
    """The first position (deg) of the first log that does not jump; None for logs in metres.

    Raises:
        LogError: if only some logs are in degrees.
    """
    if len({log.is_geodetic for log in logs}) > 1:
        names = ", ".join(log.name for log in logs if not log.is_geodetic)
        raise LogError(f"{names}: positions are metres, and latitude and longitude in the other logs. Import it alone.")
    if not logs[0].is_geodetic:
        return None
    middle = np.median(logs[0].positions[:, 1:], axis=0)
    for positions in (logs[0].positions[:_FIRST_POSITIONS], logs[0].positions):
        times, north, east = positions.T
        north, east = local_from_geodetic(north, east, float(middle[0]), float(middle[1]))
        kept = positions[_steady(times, north, east, logs[0].has_time)]
        if len(kept) >= LEAST_POSITIONS:  # fewer are a fallback: no piece is long enough
            break
    return float(kept[0, 1]), longitude_180(float(kept[0, 2]))


def placed_log(log: SurveyLog, origin: tuple[float, float] | None, how: Placement) -> PlacedLog:
    """Gives a log's depths their positions.

    Raises:
        LogError: if no sounding remains; names what was left out and why.
    """
    left_out = log.left_out
    chosen, times, track = _track(log, origin, how)
    pings = _pings(log, times, track, how)
    is_fast = log.has_time and len(pings) > 1 and bool(np.median(np.diff(pings[:, 0])) < 0.5 * EVERY_S)
    soundings = combined(pings) if is_fast else pings
    if not log.is_checked:
        soundings = _plausible(soundings, left_out)
    if not len(soundings):
        reasons = (
            "; ".join(counted_as(count, reason) for reason, count in left_out.items() if count) or "there are none"
        )
        raise LogError(f"{log.name}: none of {len(log.depths)} depths has a usable position ({reasons}).")
    stated = log.position_std_m is not None and log.has_time
    if stated:
        assert log.position_std_m is not None
        stds = log.position_std_m[chosen]
    else:
        kept = _first_of_each(times, EVERY_S)
        times, track = times[kept], track[kept]
        times, track, stds = _with_uncertainty(times, track, soundings[:, 0], log.lag_std_s, how.position_std_m)
    return PlacedLog(
        name=log.name,
        track=np.column_stack([times, track]),
        track_std_m=stds,
        soundings=soundings,
        combined=len(pings) if is_fast else 0,
        left_out=left_out,
        has_time=log.has_time,
        is_utc=log.is_utc,
        is_estimated=stated,
    )


def _first_of_each(times: Array, period_s: float) -> Ints:
    """Numbers of the first of the rising times (n,) in each period that has any, and of the last."""
    is_first = np.append(True, np.diff(np.floor((times - times[0]) / period_s)) != 0.0)[: len(times)]
    is_first[-1:] = True
    return np.flatnonzero(is_first)


def _track(log: SurveyLog, origin: tuple[float, float] | None, how: Placement) -> tuple[Ints, Array, Array]:
    """Numbers of the positions used, their times (s), and rows (north m, east m, course rad, vehicle's depth m)."""
    left_out = log.left_out
    times, north, east = log.positions.T
    if origin is not None:
        north, east = local_from_geodetic(north, east, *origin)
    known = np.isfinite(north) & np.isfinite(east) & np.isfinite(times)
    left_out["positions that are not numeric"] += int((~known).sum())
    near = known & (np.abs(north) < FARTHEST_M) & (np.abs(east) < FARTHEST_M)
    left_out[f"positions farther than {FARTHEST_M / 1000.0:g} km from the origin"] += int((known & ~near).sum())
    known = near & (times >= times[0] + how.start_s) & (times <= times[0] + how.end_s)
    if log.has_time:
        _check_one_boat(log.name, times[known], north[known], east[known])
    steady = _steady(times, north, east, log.has_time)
    left_out["positions that jump"] += int((known & ~steady).sum())
    chosen = np.flatnonzero(known & steady)
    later = np.append(True, np.diff(times[chosen]) > 0.0)[: len(chosen)]
    left_out["positions at the time of the one before, or earlier"] += int((~later).sum())
    chosen = chosen[later]
    if not len(chosen):
        if reasons := "; ".join(counted_as(count, reason) for reason, count in left_out.items() if count):
            raise LogError(f"{log.name} has no usable position ({reasons}).")
        raise LogError(f"{log.name} has no position in the chosen time. Check --from and --to.")
    if log.has_time:
        fresh = _fresh(times[chosen], north[chosen], east[chosen])
        left_out["positions that only repeat an old one"] += int((~fresh).sum())
        chosen = chosen[fresh]
    times, north, east = times[chosen], north[chosen], east[chosen]
    immersion = np.zeros(len(times))
    if len(log.immersion):
        immersion = np.interp(times, log.immersion[:, 0], log.immersion[:, 1])
    return chosen, times, np.column_stack([north, east, _course(north, east), immersion])


def _check_one_boat(name: str, times: Array, north: Array, east: Array) -> None:
    """Checks that positions (n,) do not swing between two boats, as in joined logs of the same time."""
    if len(times) < LEAST_POSITIONS:
        return
    steps_m, twice_m = (np.hypot(north[k:] - north[:-k], east[k:] - east[:-k]) for k in (1, 2))
    far = steps_m > MAX_SPEED_MPS * np.diff(times) + _BOATS_APART_M
    is_back = twice_m <= MAX_SPEED_MPS * (times[2:] - times[:-2]) + JUMP_M
    if (far[:-1] & far[1:] & is_back).mean() > _SWINGS:
        raise LogError(
            f"{name}: its positions swing to and fro by {np.median(steps_m[far]):,.0f} m: it may hold the logs of "
            "two boats at the same time. Split it into one file each."
        )


def _steady(times: Array, north: Array, east: Array, has_time: bool) -> Mask:
    """Whether each position belongs to a piece of track between jumps that is long enough."""
    if not has_time or len(times) < 2:
        return np.ones(len(times), dtype=bool)
    jumps = ~(np.hypot(np.diff(north), np.diff(east)) <= MAX_SPEED_MPS * np.diff(times) + JUMP_M)
    piece = np.append(0, np.cumsum(jumps))
    sizes = np.bincount(piece)
    steady: Mask = sizes[piece] >= min(LEAST_POSITIONS, int(sizes.max()))
    return steady


def _fresh(times: Array, north: Array, east: Array) -> Mask:
    """Whether each position is new, or repeated because the boat stands still.

    Loggers repeat the last position with each depth until the next one arrives. Such a run of equal positions ends
    with a step that is faster than the boat; then only its first position is real. A boat that stands for long, with
    positions in whole metres, makes small steps.
    """
    is_new = np.append(True, (np.diff(north) != 0.0) | (np.diff(east) != 0.0))
    starts = np.flatnonzero(is_new)
    if len(starts) in (1, len(times)):
        return np.ones(len(times), dtype=bool)
    ends = np.append(starts[1:], len(times)) - 1
    moved = np.append(np.hypot(np.diff(north[starts]), np.diff(east[starts])), 0.0)
    until = np.append(times[starts[1:]], times[-1])
    whole, last = until - times[starts], until - times[ends]
    speed = float(np.median(moved[:-1] / np.maximum(whole[:-1], 1e-9)))
    stood = (whole > LEAST_GAP_S) & (moved <= COURSE_M)
    is_stale = (ends > starts) & (moved > STALE * speed * last) & ~stood
    fresh: Mask = is_new | ~np.repeat(is_stale, ends - starts + 1)
    return fresh


def _course(north: Array, east: Array) -> Array:
    """Course (rad) at each position; while the vehicle stands still, the last one."""
    moved = np.append(0.0, np.cumsum(np.hypot(np.diff(north), np.diff(east))))
    before = np.searchsorted(moved, moved - COURSE_M, side="right") - 1
    after = np.searchsorted(moved, moved + COURSE_M)
    before, after = before.clip(0), after.clip(max=len(moved) - 1)
    course: Array = np.arctan2(east[after] - east[before], north[after] - north[before])
    return course


def largest_gap_s(times: Array) -> float:
    """The longest time (s) between two positions over which depths are interpolated."""
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return min(max(GAPS * usual, LEAST_GAP_S), LARGEST_GAP_S)


def _pings(log: SurveyLog, times: Array, track: Array, how: Placement) -> Array:
    """Rows (time s, north m, east m, depth of water m) of the depths that can be used."""
    left_out, first_s = log.left_out, float(log.positions[0, 0])
    stamps, depths = log.depths[:, 0] - how.lag_s, log.depths[:, 1]
    within = (stamps >= first_s + how.start_s) & (stamps <= first_s + how.end_s)
    if how.start_s <= 0.0:
        within |= stamps < first_s
    left_out["depths outside of --from and --to"] += int((~within).sum())
    gap_s = largest_gap_s(times) if log.has_time else LEAST_GAP_S
    after = np.searchsorted(times, stamps).clip(0, len(times) - 1)
    before = np.where(times[after] == stamps, after, after - 1)
    placed = (before >= 0) & (times[after] >= stamps) & (times[after] - times[before.clip(0)] <= gap_s)
    near = f"within {gap_s:g} s" if log.has_time else "in their rows"
    left_out[f"depths without positions {near}"] += int((within & ~placed).sum())
    use = within & placed & np.isfinite(depths)
    left_out["depths that are not numeric"] += int((within & placed & ~use).sum())
    stamps, depths = stamps[use], depths[use]
    north, east, immersion = (np.interp(stamps, times, track[:, column]) for column in (0, 1, 3))
    course = track[after[use], 2]
    north += how.forward_m * np.cos(course) - how.starboard_m * np.sin(course)
    east += how.forward_m * np.sin(course) + how.starboard_m * np.cos(course)
    return np.column_stack([stamps, north, east, depths if log.is_immersion_added else depths + immersion])


def combined(pings: Array) -> Array:
    """One sounding of the pings (n, 4) of each second: the median depth, and means of the rest."""
    periods = period_of(pings[:, 0], EVERY_S)
    starts = np.flatnonzero(np.append(True, np.diff(periods) != 0.0))
    counts = np.diff(np.append(starts, len(pings)))
    soundings: Array = np.add.reduceat(pings - pings[0], starts, axis=0) / counts[:, None] + pings[0]
    depths = pings[np.lexsort((pings[:, 3], np.repeat(np.arange(len(starts)), counts))), 3]
    soundings[:, 3] = 0.5 * (depths[starts + (counts - 1) // 2] + depths[starts + counts // 2])
    return soundings


def _plausible(soundings: Array, left_out: Counter[str]) -> Array:
    """The soundings (n, 4) that pass the gate, without the first few if more would pass after them.

    The gate accepts the first sounding unchecked. If that is wrong, correct ones after it are rejected.
    """
    passes, counts = passing(soundings)
    begin = int(np.argmin(passes)) if len(passes) else 0
    if 0 < begin < AGREEING:
        later, others = passing(soundings[begin:])
        if later.sum() > passes.sum():
            passes, counts = np.append(np.zeros(begin, dtype=bool), later), others + Counter(jump=begin)
    for reason, count in counts.items():
        left_out[f"soundings: {reason}"] += count
    return soundings[passes]


def _with_uncertainty(
    times: Array, track: Array, stamps: Array, lag_std_s: float, position_std_m: float
) -> tuple[Array, Array, Array]:
    """The track with rows at soundings between slow positions, and standard deviations (n, 2) north and east.

    A sounding's variance adds those of the position, of the distance covered during the sounder's unknown delay, and of
    the interpolation between two positions. The last error is taken as half the error of interpolating over two
    intervals, which the position between them shows.
    """
    if len(times) < 3:
        return times, track, np.full((len(times), 2), position_std_m)
    steps = np.diff(times)
    share = steps[:-1] / (steps[:-1] + steps[1:])
    missed = track[1:-1, :2] - track[:-2, :2] - share[:, None] * (track[2:, :2] - track[:-2, :2])
    close = steps[:-1] + steps[1:] <= 2.0 * largest_gap_s(times)
    line_std = 0.5 * np.sqrt(np.mean(missed[close] ** 2, axis=0)) if close.any() else np.zeros(2)
    if float(np.median(steps)) > 1.5 * EVERY_S:
        more = np.setdiff1d(stamps[(stamps > times[0]) & (stamps < times[-1])], times)
        merged = np.sort(np.concatenate([times, more]))
        track = np.column_stack([np.interp(merged, times, track[:, c]) for c in (0, 1, 3)])
        track = np.column_stack([track[:, :2], _course(track[:, 0], track[:, 1]), track[:, 2]])
        before = (np.searchsorted(times, merged, side="right") - 1).clip(0, len(times) - 2)
        inside = ((merged - times[before]) / (times[before + 1] - times[before])).clip(0.0, 1.0)
        times = merged
    else:
        inside = np.full(len(times), 0.5)
    velocity = np.column_stack([np.gradient(track[:, c], times) for c in (0, 1)]).clip(-MAX_SPEED_MPS, MAX_SPEED_MPS)
    line = 4.0 * (inside * (1.0 - inside))[:, None] * line_std
    return times, track, np.sqrt(position_std_m**2 + (lag_std_s * velocity) ** 2 + line**2)
