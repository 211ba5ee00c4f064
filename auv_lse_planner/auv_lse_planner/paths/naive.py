"""Naive paths: deterministic continuations of a plan to the mission's end, named by an id in the packet.

| id | path |
|---|---|
| 0xF0, 0xF1 | lawnmower, lanes along the main axis with `lane_spacing_m`, sweeping to starboard or to port first |
| 0xF2, 0xF3 | the same with lanes across the main axis |
| 0xF4 .. 0xF7 | as 0xF0 .. 0xF3, with the lane spacing at which the remaining steps just cover the area |
| 0xF8 | straight on, turning as little as possible at the border |
| 0xF9 | hold: the tightest loop |
| 0xFA .. 0xFE | as 0xF4, over strip 1 to 5; the area has one strip for each vehicle (at most 5) |
| 0xE0 .. 0xE4 | straight lanes fitted to strip 1 to 5 and to the path's length (`fitted_lanes.py`) |
| 0xFF | none |

A lawnmower consists of feasible actions and can start from any state:

1. It follows the lane through its start, in the direction nearer to its heading. At the lane's end it makes a U-turn to
   the sweep's side.
2. When that side of the area is done, it goes back to the lane next to the first one and sweeps the other side.
3. When both sides are done, it returns over the area midway between the lanes.

For each leg it takes the feasible action that, with the best next one, comes nearest to the lane (distance +
`HEADING_WEIGHT_M` x heading error). The path depends on the area but not on the map, and all arithmetic is scalar. An
id and a state therefore give every receiver of a packet an identical path.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.compiled import compiled
from auv_lse_common.vocabulary.frames import wrap_pi
from auv_lse_common.vocabulary.naive_ids import FITTED, HOLD, IDS, LAWNMOWERS, MOWING, STRAIGHT_ON, STRIPS
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_planner.paths.fitted_lanes import LOCATIONS, fitted_points
from auv_lse_planner.paths.free_space import (
    FreeSpace,
    bilinear,
    cheapest_action,
    clearance_at,
    end_of_leg,
    is_feasible,
    loop_clearance,
    safe_reach,
)
from auv_lse_planner.paths.steering import Steering

#: Distance from the lane (m) that costs as much as a heading error of one radian.
HEADING_WEIGHT_M = 20.0
#: Number of cached fits: a decision requests the same fit of each vehicle several times, and a fit takes 2 ms.
CACHED_FITS = 32


class Lanes(NamedTuple):
    """The lanes of a lawnmower.

    Attributes:
        axis: Their direction (rad, clockwise from north).
        spacing: Distance between them (m).
        low, high: Range of their positions across the axis (m, to starboard of the axis).
    """

    axis: float
    spacing: float
    low: float
    high: float


@compiled
def _wrap(angle):
    while angle >= math.pi:
        angle -= 2.0 * math.pi
    while angle < -math.pi:
        angle += 2.0 * math.pi
    return angle


@compiled
def next_lane(lanes, lane, first, side, sweeps):
    """The next lane, the side of the sweep, and the number of sweeps done.

    Sweep 0 covers one side of the first lane, sweep 1 the other. Later sweeps lead back between the lanes.
    """
    lane += side * lanes.spacing
    low, high = lanes.low - 0.25 * lanes.spacing, lanes.high + 0.25 * lanes.spacing
    if lane > high or lane < low:
        sweeps += 1
        if sweeps == 1:
            side = -side
            lane = first + side * lanes.spacing
            if lane > high or lane < low:
                sweeps = 2
                lane = (lanes.high if side < 0 else lanes.low) + 0.5 * side * lanes.spacing
        else:
            lane -= 0.5 * side * lanes.spacing
            side = -side
    return min(max(lane, lanes.low), lanes.high), side, sweeps


@compiled
def lane_costs(space, offset, error, work, costs):
    """Writes the costs (A,) of the actions, given the offset to starboard of a lane (m) and the heading error (rad).

    Looks two legs ahead. `work` is scratch memory of shape (6, A); its last two rows are the turns' cosines and sines.
    """
    turns, steps = space.turns, space.steps
    o1, e1, c1, s1, cos_t, sin_t = work[0], work[1], work[2], work[3], work[4], work[5]
    c0, s0 = math.cos(error), math.sin(error)
    for a in range(turns.shape[0]):
        o1[a] = offset + s0 * steps[a, 0] + c0 * steps[a, 1]
        c1[a] = c0 * cos_t[a] - s0 * sin_t[a]
        s1[a] = s0 * cos_t[a] + c0 * sin_t[a]
        e1[a] = _wrap(error + turns[a])
        costs[a] = 1e18
    for b in range(turns.shape[0]):
        ahead, starboard, turn = steps[b, 0], steps[b, 1], turns[b]
        for a in range(turns.shape[0]):  # no branch: this loop runs in vectors
            o2 = o1[a] + s1[a] * ahead + c1[a] * starboard
            e2 = e1[a] + turn
            e2 = e2 - 2.0 * math.pi if e2 >= math.pi else (e2 + 2.0 * math.pi if e2 < -math.pi else e2)
            cost = abs(o2) + HEADING_WEIGHT_M * abs(e2)
            costs[a] = cost if cost < costs[a] else costs[a]
    for a in range(turns.shape[0]):
        costs[a] += 0.25 * (abs(o1[a]) + HEADING_WEIGHT_M * abs(e1[a]))


@compiled
def lawnmower(space, state, count, lanes, side, straight):
    """Actions of a lawnmower.

    Args:
        space: `FreeSpace.arguments(static=True)`.
        state: Heading, north, east, shape (3,).
        side: Side to sweep to first: +1 to starboard of the axis, -1 to port.
    """
    actions = np.zeros(count, dtype=np.int64)
    costs, work = np.empty(space.turns.shape[0]), np.empty((6, space.turns.shape[0]))
    work[4], work[5] = np.cos(space.turns), np.sin(space.turns)
    heading, north, east = state[0], state[1], state[2]
    axis_c, axis_s = math.cos(lanes.axis), math.sin(lanes.axis)
    first = min(max(-north * axis_s + east * axis_c, lanes.low), lanes.high)
    lane, sweeps, settled = first, 0, False
    direction = 1.0 if math.cos(heading - lanes.axis) >= 0.0 else -1.0
    reach = safe_reach(space)
    for index in range(count):
        course = lanes.axis if direction > 0.0 else _wrap(lanes.axis + math.pi)
        across = -north * axis_s + east * axis_c
        error = _wrap(heading - course)
        roomy = clearance_at(space, north, east) >= reach
        settled = settled or (abs(across - lane) < 0.5 * lanes.spacing and abs(error) < 0.8)
        # the lane ends where a straight leg in its direction is not feasible
        if settled and not (roomy or is_feasible(space, course, north, east, straight)):
            direction, settled = -direction, False
            course = lanes.axis if direction > 0.0 else _wrap(lanes.axis + math.pi)
            error = _wrap(heading - course)
            lane, side, sweeps = next_lane(lanes, lane, first, side, sweeps)
        if settled and abs(across - lane) < 1.5 and abs(error) < 0.009:
            action = straight  # on the lane, and feasible as checked above
        else:
            lane_costs(space, (across - lane) * direction, error, work, costs)
            action = cheapest_action(space, heading, north, east, costs, roomy)
        actions[index] = action
        heading, north, east = end_of_leg(space, heading, north, east, action)
    return actions


@compiled
def lawnmowers(space, states, count, lanes, sides, straight):
    """Actions (B, count) of a `lawnmower` from each of `states` (B, 3), sweeping to each of `sides` (B,) first."""
    actions = np.empty((states.shape[0], count), dtype=np.int64)
    for b in range(states.shape[0]):
        actions[b] = lawnmower(space, states[b], count, lanes, sides[b], straight)
    return actions


@compiled
def sums_along(space, states, actions, field, north0, east0, cell):
    """Sums (B,) of a gridded field, bilinear and clamped at its border, at the ends of legs from states (B, 3)."""
    sums = np.zeros(states.shape[0])
    for b in range(states.shape[0]):
        heading, north, east = states[b, 0], states[b, 1], states[b, 2]
        for action in actions[b]:
            heading, north, east = end_of_leg(space, heading, north, east, action)
            x = min(max((north - north0) / cell, 0.0), field.shape[0] - 1.001)
            y = min(max((east - east0) / cell, 0.0), field.shape[1] - 1.001)
            _, _, u, _, low, high = bilinear(field, x, y)
            sums[b] += low * (1.0 - u)
            sums[b] += high * u
    return sums


@compiled
def turn_least(space, state, count, ranks):
    """Actions (count,): on each leg the feasible one with the lowest of `ranks` (A,)."""
    actions = np.zeros(count, dtype=np.int64)
    heading, north, east = state[0], state[1], state[2]
    for index in range(count):
        action = cheapest_action(space, heading, north, east, ranks.copy(), False)
        actions[index] = action
        heading, north, east = end_of_leg(space, heading, north, east, action)
    return actions


@dataclass(frozen=True, slots=True)
class LaneFrame:
    """Direction of lanes and the range of their positions.

    Attributes:
        axis_rad: Direction of the lanes (rad, clockwise from north).
        low_m: Smallest position across the lanes, to starboard of the axis.
        high_m: Largest position.
        area_m2: Area of the free space.
    """

    axis_rad: float
    low_m: float
    high_m: float
    area_m2: float


class NaivePaths:
    """The naive paths of one operating area."""

    def __init__(self, space: FreeSpace, config: PlannerConfig, polygon_m: Array, vehicles: int = 1) -> None:
        """Prepares the lanes along and across the main axis of `polygon_m` (V, 2), for strips of `vehicles` vehicles.

        The main axis is the direction of the polygon's longest side.
        """
        self.space = space
        self._spacing_m = config.lane_spacing_m
        self._arguments = space.arguments(static=True)
        sides = np.roll(polygon_m, -1, axis=0) - polygon_m
        longest = sides[int(np.argmax(np.hypot(sides[:, 0], sides[:, 1])))]
        axis = math.atan2(longest[1], longest[0])
        self._frames = [self._frame(float(wrap_pi(axis))), self._frame(float(wrap_pi(axis + math.pi / 2.0)))]
        self._strips = min(vehicles, len(STRIPS))
        fitted = min(vehicles, len(FITTED))
        self._strip_locations = [self._locations_of_strip(number, fitted) for number in range(fitted)]
        self._fits: dict[tuple[int, float, float, int], Array] = {}  # the cached fits, oldest first
        self._steering = Steering(space)
        order = np.argsort(np.abs(space.motion.turns_rad), kind="stable")
        self._by_size = np.argsort(order).astype(float)  # rank of each action by the size of its turn

    def _frame(self, axis: float) -> LaneFrame:
        space = self.space
        reach = space.motion.loops_m[:, 2].min()
        north, east = np.meshgrid(space._nodes_north, space._nodes_east, indexing="ij")
        across = -north * math.sin(axis) + east * math.cos(axis)
        roomy = space.area_raster >= 0.5 * space.motion.spacing_m
        area = float(np.count_nonzero(roomy)) * space.cell_m**2
        usable = across[roomy] if roomy.any() else across.ravel()
        low, high = float(usable.min()) + 0.25 * reach, float(usable.max()) - 0.25 * reach
        if low > high:
            low = high = 0.5 * (low + high)
        return LaneFrame(axis, low, high, area)

    def actions(self, state: Array, naive_path: int, steps: int, around_shallows: bool = False) -> Ints:
        """Actions of a naive path over `steps` legs from a state (3,).

        Args:
            around_shallows: Whether to avoid ground that this vehicle's map shows as too shallow; other vehicles then
                cannot rebuild the path.

        Raises:
            ValueError: for an unknown id.
        """
        if steps <= 0 or naive_path == NONE:
            return np.empty(0, dtype=np.int64)
        state = np.asarray(state, dtype=float)
        motion = self.space.motion
        space = self.space.arguments(static=not around_shallows)
        if naive_path in FITTED:
            points = self._fitted(state, naive_path, steps)
            return self._steering.actions(state, points, 1, steps, around_shallows)
        if naive_path in MOWING:
            lanes, side = self._lanes(state, naive_path, steps)
            return np.asarray(lawnmower(space, state, steps, lanes, side, motion.straight_on))
        if naive_path == STRAIGHT_ON:
            return np.asarray(turn_least(space, state, steps, self._by_size))
        if naive_path == HOLD:
            ranks, freer = self._by_size.copy(), self._freer_side(state)
            ranks[motion.loop_actions[1 - freer]] = -1.0
            ranks[motion.loop_actions[freer]] = -2.0
            return np.asarray(turn_least(space, state, steps, ranks))
        raise ValueError(f"naive_path must be 0xff or one of {[hex(i) for i in IDS]}, not {naive_path:#04x}")

    def actions_from(self, states: Array, naive_path: int, steps: int) -> Ints:
        """Actions (B, steps) of a naive path from each of many states (B, 3): the batch version of `actions`."""
        states = np.ascontiguousarray(states, dtype=float)
        if naive_path not in MOWING or naive_path in FITTED or steps <= 0:
            rows = [self.actions(state, naive_path, steps) for state in states]
            return np.array(rows, dtype=np.int64).reshape(len(states), -1)
        own = [self._lanes(state, naive_path, steps) for state in (states if naive_path in STRIPS else states[:1])]
        sides = np.array([side for _, side in own]) if len(own) == len(states) else np.full(len(states), own[0][1])
        straight = self.space.motion.straight_on
        return np.asarray(lawnmowers(self._arguments, states, steps, own[0][0], sides, straight))

    def _lanes(self, state: Array, naive_path: int, steps: int) -> tuple[Lanes, float]:
        """Lanes of a lawnmower and the side of its first sweep; only the side of a strip depends on the state."""
        motion = self.space.motion
        kind = (naive_path - LAWNMOWERS[0]) % 4 if naive_path not in STRIPS else 0
        frame = self._frames[kind // 2]
        side = 1.0 if kind % 2 == 0 else -1.0
        spacing, low, high = self._spacing_m, frame.low_m, frame.high_m
        if naive_path not in LAWNMOWERS:
            spacing = frame.area_m2 / (steps * motion.leg_length_m)
        if naive_path in STRIPS and self._strips > 1:
            spacing /= self._strips
            width = (high - low) / self._strips
            number = (naive_path - STRIPS[0]) % self._strips
            inset = min(0.5 * spacing, 0.5 * width)
            low, high = low + number * width + inset, low + (number + 1) * width - inset
            across = -state[1] * math.sin(frame.axis_rad) + state[2] * math.cos(frame.axis_rad)
            side = 1.0 if across < 0.5 * (low + high) else -1.0  # away from the near side
        spacing = max(spacing, 2.0 * motion.radius_m)
        return Lanes(frame.axis_rad, spacing, low, high), side

    def _fitted(self, state: Array, naive_path: int, steps: int) -> Array:
        """Points one leg apart along the lanes fitted to a strip and to `steps` legs from a state."""
        strip = FITTED.index(naive_path) % len(self._strip_locations)
        key = strip, float(state[1]), float(state[2]), steps
        if key not in self._fits:
            if len(self._fits) >= CACHED_FITS:
                del self._fits[next(iter(self._fits))]
            locations, grid = self._strip_locations[strip]
            leg_m = self.space.motion.leg_length_m
            self._fits[key] = fitted_points(locations, grid, self._frames[0].axis_rad, state[1:], leg_m, steps)
        return self._fits[key]

    def _locations_of_strip(self, number: int, strips: int) -> tuple[Array, Array]:
        """Locations (M, 2) of one of some strips along and across the main axis, and their spacing (2,)."""
        space, axis = self.space, self._frames[0].axis_rad
        c, s = math.cos(axis), math.sin(axis)
        outline_m = space.outline_m
        corners = np.column_stack(
            [outline_m[:, 0] * c + outline_m[:, 1] * s, outline_m[:, 1] * c - outline_m[:, 0] * s]
        )
        low, high = corners.min(axis=0), corners.max(axis=0)
        width = (high[1] - low[1]) / strips
        low[1], high[1] = low[1] + number * width, low[1] + (number + 1) * width
        size = np.maximum(high - low, 1e-3)
        counts = np.maximum(np.floor(size / math.sqrt(size[0] * size[1] / LOCATIONS)), 1.0)
        grid = size / counts
        own = [low[k] + (np.arange(int(counts[k])) + 0.5) * grid[k] for k in (0, 1)]
        along, across = (x.ravel() for x in np.meshgrid(*own, indexing="ij"))
        row = np.rint((along * c - across * s - space.north0_m) / space.cell_m).astype(np.int64)
        column = np.rint((along * s + across * c - space.east0_m) / space.cell_m).astype(np.int64)
        rows, columns = space.area_raster.shape
        # With a slanted main axis the strip's box extends beyond the raster.
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        inside[inside] = space.area_raster[row[inside], column[inside]] >= -space.margin_m
        locations = np.column_stack([along, across])
        return (locations[inside] if inside.any() else locations), grid

    def sums_along(self, states: Array, naive_path: int, steps: int, field: Array, grid: Grid) -> Array:
        """Sum of a gridded field over the leg ends of a naive path from each of many states (B, 3).

        Args:
            field: Values at the nodes of `grid`, shape (N, E); read by bilinear interpolation.
        """
        north0, east0, cell = float(grid.north_m[0]), float(grid.east_m[0]), float(grid.resolution_m)
        actions = self.actions_from(states, naive_path, steps)
        return np.asarray(sums_along(self._arguments, states, actions, field, north0, east0, cell))

    def distinct(self, naive_paths: tuple[int, ...]) -> tuple[int, ...]:
        """`naive_paths` without ids that stand for the same strip as an earlier one (with fewer strips than ids)."""
        named = (*(STRIPS[: self._strips] if self._strips > 1 else ()), *FITTED[: len(self._strip_locations)])
        return tuple(h for h in naive_paths if h not in (*STRIPS, *FITTED) or h in named) or naive_paths[:1]

    def _freer_side(self, state: Array) -> int:
        """0 if the loop to port has more room than the one to starboard, else 1."""
        rooms = [loop_clearance(self._arguments, state[0], state[1], state[2], side) for side in (0, 1)]
        return int(rooms[1] > rooms[0])
