"""Certainty of an estimated isobath, piece by piece: found, likely, or guessed.

The mean depth of a Gaussian process crosses the level also where nothing was measured: there the line comes from the
prior, not from the lake. Where it could be anywhere, it is left out. The class of a location of the line follows from:

- *Horizontal error.* With a depth of standard deviation s (m) on ground of slope g (m per m), the standard deviation of
  the line's position across itself is s / g (m). The vehicles' own position error p (m), that of the nearest sounding,
  shifts the ground as a whole: together sqrt((s / g)^2 + p^2). Near a known shore it does not: the shore stays where it
  is, and a sounding on ground of slope q < g moves the line by q / g p. At a distance d beyond the area's last cells,
  where the mean is extrapolated, d / 2 is added likewise.
- *Sides.* Between soundings on both sides of the level within `VISITED_M`, the ground crosses it there. Elsewhere, at a
  distance d from the nearest sounding, s is mostly due to the slope that leads there, which is uncertain by s / d. With
  a slope of g - s / d the line is off by s / g / (1 - s / (g d)), which counts in place of s / g.
- *Data.* The share of the variance of open ground that the soundings and a known shore have removed, by the prior's own
  scale. Without it a steep prior mean, as of a chart, would find isobaths by itself.
- *Length.* A stretch shorter than `MIN_LENGTH_M` has no higher class than its neighbors.

A piece that is not found has a reason: `NOT_VISITED`, `POSITIONS_UNCERTAIN`, or `FLAT`.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.special import ndtr

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_gp.level_set.lines import BEYOND_CELLS, beyond_border
from auv_lse_gp.map.depth_map import INFORMED, DepthField

#: The classes of a piece, the most certain first.
FOUND, LIKELY, GUESSED = "found", "likely", "guessed"
CLASSES = (FOUND, LIKELY, GUESSED)

#: Largest horizontal standard deviation (m) of a piece of each class. A line more uncertain than a lake is large is not
#: even a guess: far from all soundings, a constant mean crosses the level by a millionth of a metre.
MAX_STD_M = {FOUND: 10.0, LIKELY: 30.0, GUESSED: 1e5}

#: Least share of the variance of open ground that the soundings, and a known shore, must have removed there.
MIN_INFORMED = {FOUND: 0.75, LIKELY: INFORMED}

#: A stretch shorter than this (m) takes the higher class of its two neighbors if that is lower than its own.
MIN_LENGTH_M = 15.0

#: Horizontal standard deviation of a line beyond the area's last cells, as a share of its distance from them: the slope
#: there is uncertain by half of it.
BEYOND_STD = 0.5

#: Least slope, as a share of the mean's, by which a line beyond the soundings is judged. So a line that would be found
#: with the mean's slope is at least likely.
LEAST_SLOPE = MAX_STD_M[FOUND] / MAX_STD_M[LIKELY]

#: Spacing (m) of the locations along a line at which its class is computed.
SPACING_M = 5.0

#: A location counts as visited if a sounding was made within this distance (m), on both sides of the line if needed.
VISITED_M = 20.0

#: Why a piece is not found: no sounding near it, or on one side only; soundings of uncertain position; ground so flat
#: there that a small error in depth moves the line far.
NOT_VISITED, POSITIONS_UNCERTAIN, FLAT = "not visited", "positions uncertain", "flat ground"
REASONS = (NOT_VISITED, POSITIONS_UNCERTAIN, FLAT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A stretch of the estimated isobath of one class.

    Attributes:
        line: Locations (n, 2): north, east (m).
        kind: `FOUND`, `LIKELY` or `GUESSED`.
        reason: Why it is not found, one of `REASONS`; "" if it is.
        std_m: Horizontal standard deviation (m) at each location, shape (n,).
    """

    line: Array
    kind: str
    reason: str
    std_m: Array

    @property
    def length_m(self) -> float:
        """Its length (m)."""
        return float(np.hypot(*np.diff(self.line, axis=0).T).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """Evidence for locations of a line; arrays (n,).

    Attributes:
        depth_std_m: Horizontal standard deviation (m) due to the depth's, to the slope's error and, beyond the area, to
            extrapolation.
        position_std_m: The vehicles' position error (m), per axis; 0 where it is unknown.
        informed: Share of the variance of open ground that the soundings, and a known shore, have removed.
        visited: Whether a sounding was made within `VISITED_M`, and extrapolation beyond it does not matter.
    """

    depth_std_m: Array
    position_std_m: Array
    informed: Array
    visited: Mask

    @property
    def std_m(self) -> Array:
        """Horizontal standard deviation (m) due to both."""
        return np.hypot(self.depth_std_m, self.position_std_m)


def classify(
    lines: Sequence[Array], field: DepthField, signal_std_m: float, soundings: Array, *, shore_known: bool = False
) -> list[Piece]:
    """Splits an estimated isobath into pieces of one class each.

    Args:
        lines: The isobath: lines, each of shape (n, 2): north, east (m).
        signal_std_m: Standard deviation of the depth of open ground before the first sounding, `gp.signal_std_m`.
        soundings: Where soundings were taken: north, east, position error per axis (m; NaN: unknown), shape (S, 3).
        shore_known: Whether the mission file has the shore (`area.shore`).
    """
    dense = [_densified(line) for line in lines]
    if not dense:
        return []
    # of all lines at once: the map is prepared once
    known = evidence(np.concatenate(dense), field, signal_std_m, soundings, shore_known=shore_known)
    std_m, ranks_alone = known.std_m, _rank(known.std_m, known.informed)
    pieces, first = [], 0
    for locations in dense:
        own = slice(first, first + len(locations))
        ranks = _without_short_stretches(ranks_alone[own], locations)
        edges = np.flatnonzero(np.diff(ranks)) + 1
        for start, stop in zip([0, *edges], [*edges, len(locations)], strict=True):
            if ranks[start] == len(CLASSES):
                continue
            stretch = slice(start, min(stop + 1, len(locations)))  # to the next stretch's first location: no gaps
            kind = CLASSES[ranks[start]]
            pieces.append(
                Piece(
                    line=locations[stretch],
                    kind=kind,
                    reason="" if kind == FOUND else _reason(known, slice(first + start, first + stop)),
                    std_m=std_m[own][stretch],
                )
            )
        first = own.stop
    return [piece for piece in pieces if len(piece.line) > 1]


def lines_of(pieces: Sequence[Piece], *kinds: str) -> list[Array]:
    """The lines of the pieces of these classes (of all, if none is named)."""
    return [piece.line for piece in pieces if piece.kind in (kinds or CLASSES)]


def length_of(pieces: Sequence[Piece], kind: str, reason: str | None = None) -> float:
    """Length (m) of the pieces of a class, and of one reason if that is named."""
    return sum((p.length_m for p in pieces if p.kind == kind and reason in (None, p.reason)), 0.0)


def found_within_m(pieces: Sequence[Piece]) -> float:
    """Distance (m) that 95 % of the line found is expected to be within of the true isobath; NaN if none is found.

    The line's error at a location is normal, of standard deviation `Piece.std_m`.
    """
    stds = [0.5 * (p.std_m[1:] + p.std_m[:-1]) for p in pieces if p.kind == FOUND]
    if not stds:
        return math.nan
    std = np.maximum(np.concatenate(stds), 1e-6)
    steps = np.concatenate([np.hypot(*np.diff(p.line, axis=0).T) for p in pieces if p.kind == FOUND])
    from scipy.optimize import brentq  # takes 30 ms, and a vehicle without mission.until needs none

    within = brentq(lambda d: float(np.average(2.0 * ndtr(d / std) - 1.0, weights=steps)) - 0.95, 0.0, 3.0 * std.max())
    return float(within)


def evidence(
    locations: Array, field: DepthField, signal_std_m: float, soundings: Array, *, shore_known: bool = False
) -> Evidence:
    """Evidence for locations (n, 2) of the isobath; other arguments as of `classify`."""
    grid, margin = field.grid, BEYOND_CELLS + 1
    origin_m = np.array([grid.north_m[0], grid.east_m[0]]) - margin * grid.resolution_m

    def value(values: Array, at_m: Array = locations) -> Array:
        at = ((at_m - origin_m) / grid.resolution_m).T
        return np.asarray(ndimage.map_coordinates(values, at, order=1, mode="nearest"), dtype=float)

    known, std, prior_std = (
        np.pad(values, margin, constant_values=np.nan) for values in (field.mean_m, field.std_m, field.prior_std_m)
    )
    # beyond the border, where lines continue, the ground keeps its slope, and the uncertainty does not shrink
    mean = _filled(beyond_border(known, margin))
    std = np.maximum(_filled(std), _filled(beyond_border(std, margin)))
    northward, eastward = np.gradient(mean, grid.resolution_m, axis=0), np.gradient(mean, grid.resolution_m, axis=1)
    slope = np.hypot(value(northward), value(eastward))
    here = value(std)
    beyond_m = grid.resolution_m * value(ndimage.distance_transform_edt(np.isnan(known)))
    with np.errstate(divide="ignore"):
        std_m = np.divide(here, slope, out=np.full_like(here, np.inf), where=slope > 0.0)
    position_std, depth_std_m, visited = np.zeros(len(locations)), std_m, np.zeros(len(locations), dtype=bool)
    if len(soundings):
        nearest, index = cKDTree(soundings[:, :2]).query(locations)
        position_std = np.nan_to_num(soundings[index, 2], nan=0.0)
        level_m = np.median(value(mean))  # the line is a contour of the mean
        depth_std_m = _extrapolated(
            std_m, nearest, _both_sides_m(locations, soundings, value(mean, soundings[:, :2]) > level_m)
        )
        visited = (nearest <= VISITED_M) & ((depth_std_m <= MAX_STD_M[FOUND]) | (std_m > MAX_STD_M[FOUND]))
        if shore_known:
            there = np.hypot(value(northward, soundings[index, :2]), value(eastward, soundings[index, :2]))
            position_std *= np.minimum(np.divide(there, slope, out=np.ones_like(slope), where=slope > 0.0), 1.0)
    return Evidence(
        depth_std_m=np.hypot(depth_std_m, BEYOND_STD * beyond_m),
        position_std_m=position_std,
        informed=1.0 - (value(_filled(prior_std)) / signal_std_m) ** 2,
        visited=visited,
    )


def _extrapolated(std_m: Array, nearest_m: Array, both_m: Array) -> Array:
    """Horizontal standard deviation (n,) with the slope's error, from s / g.

    Args:
        std_m: s / g (n,).
        nearest_m: Distance to the nearest sounding (n,).
        both_m: Distance within which soundings above and below the level are, (n,).
    """
    least = 1.0 - np.divide(std_m, nearest_m, out=np.ones_like(std_m), where=std_m < nearest_m)
    return np.where(both_m <= VISITED_M, std_m, std_m / np.maximum(least, LEAST_SLOPE))


def _both_sides_m(locations: Array, soundings: Array, deeper: Mask) -> Array:
    """Distance (n,) of locations from the farther of the nearest deeper and the nearest shallower sounding (m)."""
    if deeper.all() or not deeper.any():
        return np.full(len(locations), np.inf)
    apart = [cKDTree(soundings[side, :2]).query(locations)[0] for side in (deeper, ~deeper)]
    return np.asarray(np.max(apart, axis=0))


def _filled(values: Array) -> Array:
    """Values (R, C) with each NaN replaced by the nearest that is known, so that slopes exist up to the border."""
    unknown = np.isnan(values)
    if not unknown.any():
        return values
    nearest = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def _rank(std_m: Array, informed: Array) -> Ints:
    """Index into `CLASSES` at each location (n,); its length where there is no isobath."""
    rank = np.where(std_m <= MAX_STD_M[GUESSED], CLASSES.index(GUESSED), len(CLASSES))
    for kind in (LIKELY, FOUND):
        rank[(std_m <= MAX_STD_M[kind]) & (informed >= MIN_INFORMED[kind])] = CLASSES.index(kind)
    return rank


def _without_short_stretches(ranks: Ints, locations: Array) -> Ints:
    """Ranks (n,) in which no stretch shorter than `MIN_LENGTH_M` has a higher class than both of its neighbors."""
    ranks = ranks.copy()
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(locations, axis=0).T))])
    closed = bool(np.all(locations[0] == locations[-1]))
    for rank in range(len(CLASSES) - 1):
        edges = [0, *(np.flatnonzero(np.diff(ranks)) + 1), len(ranks)]
        runs = list(itertools.pairwise(edges))
        if len(runs) == 1:
            break
        for number, (start, stop) in enumerate(runs):
            ends = number in (0, len(runs) - 1)
            if ranks[start] != rank or along[min(stop, len(along) - 1)] - along[start] >= MIN_LENGTH_M:
                continue
            if ends and closed:
                continue  # the stretch continues at the other end of a closed line
            beside = [ranks[i] for i in (start - 1, stop) if 0 <= i < len(ranks)]
            ranks[start:stop] = max(rank, min(beside))
    return ranks


def _reason(known: Evidence, stretch: slice) -> str:
    """Why most of a stretch is not found."""
    visited = known.visited[stretch]
    sure = (known.depth_std_m[stretch] <= MAX_STD_M[FOUND]) & (known.informed[stretch] >= MIN_INFORMED[FOUND])
    reasons = np.where(sure, 1, np.where(visited, 2, 0))
    return REASONS[int(np.bincount(reasons, minlength=3).argmax())]


def _densified(line: Array) -> Array:
    """A line with locations added so that they are at most `SPACING_M` apart, and repeated locations removed."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.concatenate([[True], steps > 0.0])]
    if len(line) < 2:
        return line
    steps = steps[steps > 0.0]
    counts = np.maximum(1, np.ceil(steps / SPACING_M)).astype(int)
    steps_before = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (steps_before / np.repeat(counts, counts))[:, None]
    start, end = np.repeat(line[:-1], counts, axis=0), np.repeat(line[1:], counts, axis=0)
    return np.concatenate([start + (end - start) * share, line[-1:]])
