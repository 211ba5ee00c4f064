"""Optimizes a tour: the waypoints of the rest of a mission, by gradient ascent on the tour's reward.

The measurement locations lie at fixed arc lengths along the polyline from the vehicle through the waypoints: p_i = P((i
- 1/2) leg / n). They avoid the corners, which the steered path cuts. The polyline ends with the mission, so its length
needs no penalty: an early detour costs the reward of the last legs. For a location at arc length a, let w_k be the
corner before it, S_k the arc length of that corner, u_k and l_k the direction and length of the segment, and
t = (a - S_k) / l_k. Then

    p = w_k + (a - S_k) u_k,    dp = (1 - t) dw_k + t dw_k+1  across u_k, dw_k - u_k dS_k along it,

and dS_k is the sum of the length changes of all segments before it. `pull_back` uses this to convert the gradient dJ/dp
with respect to locations to one with respect to waypoints. L-BFGS-B moves the waypoints within the bounding box of the
free area. A penalty on missing clearance pushes locations away from forbidden ground.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_common.vocabulary.plan import MAX_SEGMENTS, Tour, length_m
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.polyline import SHORTEST_M, locations_along, pull_back
from auv_lse_planner.paths.position_margin import EXACT, LEGS, PositionMargin, room_shortfall
from auv_lse_planner.reward.anytime import AnytimeReward

#: Clearance (m) that a tour's locations should keep, to leave room for turns.
ROOM_M = 6.0
#: Penalty per square metre of missing clearance at a location, relative to the tour's value.
ROOM_WEIGHT = 1e-4
#: Penalty of a segment of twice the nominal length, relative to the tour's value.
EVEN_WEIGHT = 3e-2
#: Penalty of a displacement that changes by a segment's length from one segment to the next, relative to the tour's
#: value.
BEND_WEIGHT = 3e-3
#: An optimization of waypoints, or of a bend, stops at the first iteration with a lower gain, relative to the tour's
#: value. Bends often improve again after iterations of little gain.
MIN_GAIN, MIN_BEND_GAIN = 1e-6, 1e-7
#: Largest ratio of a polyline's length to that of its tour of equal segments, which cuts the corners.
MAX_CORNER_RATIO = 1.25
#: Largest number of segments of an optimized tour; a packet with it and preceding actions also holds 15 samples.
MAX_OPTIMIZED_SEGMENTS = 50


@compiled
def unevenness(waypoints, length):
    """Sum of the squared relative deviations of the segments from `length` (m), and its gradient (n + 1, 2)."""
    total = 0.0
    gradient = np.zeros(waypoints.shape)
    for k in range(waypoints.shape[0] - 1):
        north, east = waypoints[k + 1, 0] - waypoints[k, 0], waypoints[k + 1, 1] - waypoints[k, 1]
        own = max(math.sqrt(north * north + east * east), SHORTEST_M)
        off = own / length - 1.0
        total += off * off
        slope = 2.0 * off / (length * own)
        gradient[k + 1, 0] += slope * north
        gradient[k + 1, 1] += slope * east
        gradient[k, 0] -= slope * north
        gradient[k, 1] -= slope * east
    return total, gradient


class OutOfTimeError(Exception):
    """The deadline has passed; the search returns the best polyline so far."""


@dataclass(frozen=True, slots=True)
class Found:
    """The result of an optimization.

    Attributes:
        waypoints_m: The polyline, shape (n + 1, 2), including the start.
        evaluations: Number of values with gradients computed.
    """

    waypoints_m: Array
    value: float
    evaluations: int
    deadline_hit: bool


@dataclass(frozen=True, slots=True)
class Deformation:
    """The deformation of a polyline by the variables of an optimization.

    Attributes:
        first: Initial variables, of order 1.
        corners_of: Returns the polyline (n + 1, 2) for given variables.
        penalized: Takes variables and the gradient with respect to corners (n + 1, 2). Returns the shape's penalty,
            relative to the value, and the gradient of the penalized value with respect to the variables.
        min_gain: The optimization stops at the first iteration with a lower relative gain.
        bounds: Bounds of the variables; None: none.
    """

    first: Array
    corners_of: Callable[[Array], Array]
    penalized: Callable[[Array, Array], tuple[float, Array]]
    min_gain: float
    bounds: list[tuple[float, float]] | None


class TourSearch:
    """Optimizes waypoints and creates the initial tours."""

    def __init__(self, space: FreeSpace, samples_per_leg: int) -> None:
        self._space = space
        self._leg_m = space.motion.leg_length_m
        self._samples = samples_per_leg
        free = space.area_raster >= ROOM_M
        if not free.any():
            free = space.area_raster >= space.area_raster.max()
        rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
        self._low = np.array(
            [space.north0_m + rows[0] * space.cell_m, space.east0_m + columns[0] * space.cell_m], dtype=float
        )
        self._high = np.array(
            [space.north0_m + rows[-1] * space.cell_m, space.east0_m + columns[-1] * space.cell_m], dtype=float
        )

    def segment_legs(self, legs: int) -> int:
        """Length of a segment (legs) of a tour over `legs` legs: two, or more if the tour would not fit a packet."""
        return max(2, math.ceil(legs / MAX_OPTIMIZED_SEGMENTS))

    def resampled(self, waypoints_m: Array, legs: int) -> Array:
        """A polyline over `legs` legs along `waypoints_m`, with corners at equal arc lengths, including the start."""
        every = self.segment_legs(legs)
        count = math.ceil(legs / every)
        spacing = every * self._leg_m
        locations, _, _ = locations_along(np.ascontiguousarray(waypoints_m, dtype=float), spacing, spacing, count)
        return np.concatenate([waypoints_m[:1], np.clip(locations, self._low, self._high)])

    def lanes(self, start_m: Array, legs: int, axis_rad: float, count: int, strip: tuple[int, int]) -> Array:
        """Boustrophedon of `count` lanes over one of several strips of the area, from its nearest corner.

        Args:
            start_m: Start of the tour, shape (2,).
            legs: Length of the tour, in legs.
            axis_rad: Direction of the lanes (rad): 0 north, pi / 2 east.
            strip: Number of the strip, from 0, and the number of strips.
        """
        north_wise = abs(math.cos(axis_rad)) > 0.5
        along, across = (0, 1) if north_wise else (1, 0)
        number, strips = strip
        width = (self._high[across] - self._low[across]) / strips
        low = self._low[across] + number * width
        lanes = low + (np.arange(count) + 0.5) * width / count
        if start_m[across] > low + 0.5 * width:
            lanes = lanes[::-1]
        inset = min(0.5 * width / count, 0.25 * (self._high[along] - self._low[along]))
        ends = [self._low[along] + inset, self._high[along] - inset]
        if abs(start_m[along] - ends[0]) > abs(start_m[along] - ends[1]):
            ends = ends[::-1]
        corners = [np.asarray(start_m, dtype=float)]
        back = lanes[::-1] + 0.5 * (lanes[0] - lanes[-1]) / max(1, count - 1)  # over the area between the lanes
        for lane in [*lanes, *back[:-1]]:
            for end in ends:
                corner = np.empty(2)
                corner[along], corner[across] = end, lane
                corners.append(corner)
            ends = ends[::-1]
        return self.resampled(np.array(corners), legs)

    def starts(self, start_m: Array, legs: int, vehicle: int, vehicles: int) -> list[Array]:
        """Initial tours: lanes along and across, over this vehicle's strip and over the whole area.

        The number of lanes is what the tour's length allows, minus one to plus two.
        """
        tours = []
        strips = [(0, 1)] if vehicles == 1 else [((vehicle - 1) % vehicles, vehicles), (0, 1)]
        size = self._high - self._low
        for strip in strips:
            for axis, along, across in ((0.0, 0, 1), (0.5 * math.pi, 1, 0)):
                width = size[across] / strip[1]
                fitting = (legs * self._leg_m - width) / max(size[along], 1.0)
                for count in sorted({max(1, math.floor(fitting) + extra) for extra in (-1, 0, 1, 2)}):
                    tours.append(self.lanes(start_m, legs, axis, count, strip))
        return tours

    def tour(self, waypoints_m: Array, legs: int) -> Tour:
        """The tour along a polyline, about `legs` legs long; after the polyline's end it continues straight."""
        every, total_m = self.segment_legs(legs), legs * self._leg_m
        segments = min(MAX_SEGMENTS, math.ceil(legs / every))
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(waypoints_m, axis=0).T))])
        longer_m = min(MAX_CORNER_RATIO * total_m, (MAX_SEGMENTS - 1) * every * self._leg_m)
        kept = waypoints_m[: max(2, int(np.searchsorted(at, longer_m)) + 1)]
        last, before = kept[-1], kept[-2]
        ahead = (last - before) / max(float(np.hypot(*(last - before))), SHORTEST_M)
        rest_m = longer_m - at[len(kept) - 1]
        if rest_m < 0.0:
            kept = np.concatenate([kept[:-1], [last + rest_m * ahead]])
        elif rest_m > 0.0:
            kept = np.concatenate([kept, [last + rest_m * ahead]])
        tour = Tour.through(kept, every, self._leg_m)
        short = segments - len(tour.bearings)
        return replace(tour, bearings=(*tour.bearings[:segments], *tour.bearings[-1:] * max(0, short)))

    def locations(self, waypoints_m: Array, legs: int) -> Array:
        """Measurement locations (legs * n, 2) along a polyline."""
        spacing = self._leg_m / self._samples
        return np.asarray(locations_along(waypoints_m, 0.5 * spacing, spacing, legs * self._samples)[0])

    def improve(
        self,
        waypoints_m: Array,
        legs: int,
        reward: AnytimeReward,
        iterations: int,
        deadline: Callable[[], bool] | None = None,
        margin: PositionMargin | None = None,
    ) -> Found:
        """Optimizes the waypoints of a polyline, except its start, with at most `iterations` iterations.

        Args:
            margin: Margin of the next legs; None: `area.margin_m`.
        """
        start = np.array(waypoints_m[0], dtype=float)
        shape = (len(waypoints_m) - 1, 2)
        length, unit = self.segment_legs(legs) * self._leg_m, self._leg_m

        def corners(x: Array) -> Array:
            return np.concatenate([start[None], unit * x.reshape(shape)])

        def penalized(x: Array, up: Array) -> tuple[float, Array]:
            uneven, even = unevenness(corners(x), length)
            return EVEN_WEIGHT * uneven, unit * (up - EVEN_WEIGHT * even)[1:].ravel()

        first = np.clip(waypoints_m[1:], self._low, self._high).ravel() / unit
        bounds = [(low / unit, high / unit) for low, high in zip(self._low, self._high, strict=True)] * shape[0]
        deformation = Deformation(first, corners, penalized, MIN_GAIN, bounds)
        return self._maximize(deformation, self._leg_m, legs, reward, iterations, deadline, margin)

    def bend(
        self,
        line_m: Array,
        legs: int,
        reward: AnytimeReward,
        iterations: int,
        deadline: Callable[[], bool] | None = None,
        *,
        fixed_end: bool = False,
        margin: PositionMargin | None = None,
    ) -> Found:
        """Bends a path: displaces it at equally spaced knots, with linear interpolation in between.

        Unlike `improve` it preserves the path's shape, including narrow turns, where a displacement gains nothing.

        Args:
            line_m: The path as a fine polyline with the same number of segments on each leg, shape (n + 1, 2).
            legs: Length of the path, in legs.
            fixed_end: Whether the path's end stays where it is.
            margin: Margin of the next legs; None: `area.margin_m`.
        """
        line = np.ascontiguousarray(line_m, dtype=float)
        each, every = (len(line) - 1) // legs, self.segment_legs(legs)
        knots = math.ceil(legs / every)
        at = np.arange(len(line)) / (each * every)  # arc length, in units of the knots' spacing
        left = np.minimum(at.astype(int), knots - 1)
        share = np.minimum(at - left, 1.0)[:, None]
        length, unit = every * self._leg_m, self._leg_m

        free = knots - 1 if fixed_end else knots

        def moves(x: Array) -> Array:
            return np.concatenate([np.zeros((1, 2)), unit * x.reshape(free, 2), np.zeros((knots - free, 2))])

        def corners(x: Array) -> Array:
            moved = moves(x)
            return np.asarray(line + (1.0 - share) * moved[left] + share * moved[left + 1])

        def penalized(x: Array, up: Array) -> tuple[float, Array]:
            slope = np.zeros((knots + 1, 2))
            np.add.at(slope, left, (1.0 - share) * up)
            np.add.at(slope, left + 1, share * up)
            steps = np.diff(moves(x), axis=0) / length
            slope[1:] -= 2.0 * BEND_WEIGHT / length * steps
            slope[1:-1] += 2.0 * BEND_WEIGHT / length * steps[1:]
            return BEND_WEIGHT * float(np.sum(steps * steps)), unit * slope[1 : free + 1].ravel()

        deformation = Deformation(np.zeros(2 * free), corners, penalized, MIN_BEND_GAIN, None)
        return self._maximize(deformation, length_m(line) / legs, legs, reward, iterations, deadline, margin)

    def _maximize(
        self,
        deformation: Deformation,
        leg_m: float,
        legs: int,
        reward: AnytimeReward,
        iterations: int,
        deadline: Callable[[], bool] | None,
        margin: PositionMargin | None,
    ) -> Found:
        """The best polyline that L-BFGS-B evaluates; a leg covers `leg_m` of its arc."""
        d = deformation
        spacing, count = leg_m / self._samples, legs * self._samples
        room = self._space.arguments()
        near = LEGS * self._samples if margin is not None and margin.is_wider(self._space) else 0
        best, best_m = -math.inf, d.corners_of(d.first)
        scale, calls = 0.0, 0

        def loss(x: Array) -> tuple[float, Array]:
            nonlocal best, best_m, scale, calls
            if deadline is not None and calls and deadline():
                raise OutOfTimeError
            calls += 1
            corners = d.corners_of(x)
            locations, segments, along = locations_along(corners, 0.5 * spacing, spacing, count)
            value, gradient = reward.value_and_gradient(locations)
            if not scale:
                scale = max(abs(value), 1e-9)
            shortfall_m2, push = room_shortfall(room, ROOM_M, locations, self._space.margin_m, EXACT)
            if near and margin is not None:
                more, there = margin.shortfall_m2(self._space, locations[:near], ROOM_M)
                shortfall_m2 += more
                push[:near] += there
            up = pull_back(corners, segments, along, gradient / scale - ROOM_WEIGHT * push)
            penalty, slope = d.penalized(x, up)
            value = value / scale - ROOM_WEIGHT * shortfall_m2 - penalty
            if value > best:
                best, best_m = value, corners
            return -value, -slope

        hit = False
        try:
            options = {"maxiter": iterations, "maxfun": 2 * iterations + 2, "ftol": d.min_gain, "gtol": 1e-7}
            minimize(loss, d.first, jac=True, method="L-BFGS-B", bounds=d.bounds, options=options)
        except OutOfTimeError:
            hit = True
        return Found(best_m, best * scale, calls, hit)
