"""Free space of a vehicle: the operating area without ground that the map shows as too shallow.

The clearance is the distance to the nearest forbidden location, negative inside forbidden ground. It is kept on a
raster and read by bilinear interpolation. Theory of operation:

- A leg is *free* if the clearance along its sampled track is at least half a sample spacing. With
  `motion.straight_legs` the same holds for the straight line from its start to its end, which autopilots travel.
- A state is *safe* if a closed turning loop (`MotionTable.loops_m`) to one of its sides is free. The vehicle can then
  stay there forever by repeating one turn, so it is never trapped. By default the loop is the circle of the 90 degree
  turns.
- An action is *feasible* if its leg is free and its end state safe. From a safe state the turn of the free loop is
  feasible, because the next state has the same loop. A vehicle that takes only feasible actions therefore always has
  one.
- If no action is feasible (a start in a corner, a current, newly detected shallow ground), the vehicle takes the
  *escape*: the action with a safe end whose track keeps the largest clearance. If no end is safe, the escape is the
  action whose end state is nearest to being safe. It also brings back a vehicle that has left the area.
- A vehicle more than `HOLD_BEYOND_M` outside circles, since its position is then most likely wrong.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from auv_lse_common.mission_file.operating_area import UNREACHABLE, OperatingArea
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.motion import MotionTable, advance

#: A vehicle farther outside the area than this (m) holds.
HOLD_BEYOND_M = 5000.0


class Space(NamedTuple):
    """Free space and motion as arguments of the compiled functions.

    Attributes:
        raster: Clearance (m) at the nodes, shape (N, E).
        north0, east0, cell: North and east of the first node, and spacing of the nodes (m).
        tracks: Body-frame locations of the actions that must be free, shape (A, C, 2): first those of the track.
        spacing: Spacing of the track's locations (m).
        longest: Length of the longest leg (m).
        loops: Center (ahead, starboard) and reach of the turning loops, shape (2, 3).
        turns: Heading change of each action (rad), shape (A,).
        steps: Displacement (ahead, starboard) of each action (m), shape (A, 2).
    """

    raster: Array
    north0: float
    east0: float
    cell: float
    tracks: Array
    spacing: float
    longest: float
    loops: Array
    turns: Array
    steps: Array


@compiled
def bilinear(field, x, y):
    """Cell of a field (N, E) at node coordinates x, y: row, column, fractions u, v, and the values low, high.

    The field's value there is low (1 - u) + high u.
    """
    i = min(int(x), field.shape[0] - 2)
    j = min(int(y), field.shape[1] - 2)
    u = x - i
    v = y - j
    low = field[i, j] * (1.0 - v) + field[i, j + 1] * v
    high = field[i + 1, j] * (1.0 - v) + field[i + 1, j + 1] * v
    return i, j, u, v, low, high


@compiled
def clearance_at(space, north, east):
    """Bilinear clearance (m) at a location; outside the raster the nearest node's, minus the distance to it."""
    raster = space.raster
    x = (north - space.north0) / space.cell
    y = (east - space.east0) / space.cell
    rows, columns = raster.shape
    if not (x >= 0.0 and y >= 0.0 and x <= rows - 1 and y <= columns - 1):
        row = min(max(x, 0.0), rows - 1.0)
        column = min(max(y, 0.0), columns - 1.0)
        return raster[int(row), int(column)] - space.cell * math.hypot(x - row, y - column)
    _, _, u, _, low, high = bilinear(raster, x, y)
    return low * (1.0 - u) + high * u


@compiled
def leg_clearance(space, heading, north, east, action):
    """Smallest clearance (m) along the leg of an action.

    It skips track locations where the clearance is large. Since clearance is 1-Lipschitz, the error is at most half the
    spacing if the leg is nearly blocked.
    """
    c, s = math.cos(heading), math.sin(heading)
    track, spacing = space.tracks[action], space.spacing
    least = 1.0e9
    i = 0
    while i < track.shape[0]:
        ahead, starboard = track[i, 0], track[i, 1]
        here = clearance_at(space, north + c * ahead - s * starboard, east + s * ahead + c * starboard)
        least = min(least, here)
        # a blocked track needs only the sign, so a rough value is enough
        i += 1 if here < 0.5 * spacing else max(1, int(here / spacing))
    return least


@compiled
def loop_clearance(space, heading, north, east, side):
    """Clearance (m) of the turning loop to port (side 0) or starboard (1) of a state."""
    c, s = math.cos(heading), math.sin(heading)
    ahead, starboard = space.loops[side, 0], space.loops[side, 1]
    there = clearance_at(space, north + c * ahead - s * starboard, east + s * ahead + c * starboard)
    return there - space.loops[side, 2]


@compiled
def room_to_loop(space, heading, north, east):
    """Clearance (m) of the freer turning loop of a state; the state is safe if it is at least half a spacing."""
    return max(loop_clearance(space, heading, north, east, 0), loop_clearance(space, heading, north, east, 1))


@compiled
def safe_reach(space):
    """Clearance (m) that makes every action feasible: an upper bound of the reach of a leg and of its end's loops.

    Clearance is 1-Lipschitz; its bilinear interpolation is sqrt(2)-Lipschitz.
    """
    leg = space.longest
    reach = 1.5 * leg + 0.5 * space.spacing
    for side in range(2):
        center = math.hypot(space.loops[side, 0], space.loops[side, 1])
        reach = max(reach, 1.5 * (leg + center) + space.loops[side, 2] + 0.5 * space.spacing)
    return reach


@compiled
def end_of_leg(space, heading, north, east, action):
    """The state after an action: heading (rad), north, east (m)."""
    return advance(heading, north, east, space.turns[action], space.steps[action, 0], space.steps[action, 1])


@compiled
def is_feasible(space, heading, north, east, action):
    """Whether the leg of `action` is free and its end state safe."""
    h, n, e = end_of_leg(space, heading, north, east, action)
    if room_to_loop(space, h, n, e) < 0.5 * space.spacing:
        return False
    return leg_clearance(space, heading, north, east, action) >= 0.5 * space.spacing


@compiled
def escape_action(space, heading, north, east):
    """The action to take if none is feasible; see the module's theory of operation."""
    if clearance_at(space, north, east) < -HOLD_BEYOND_M:
        return np.argmax(np.abs(space.turns))  # repeated, it is the tightest loop
    best = 0
    best_safe = False
    best_room = -1.0e18
    for action in range(space.turns.shape[0]):
        h, n, e = end_of_leg(space, heading, north, east, action)
        room = room_to_loop(space, h, n, e)
        safe = room >= 0.5 * space.spacing
        if safe:
            room = leg_clearance(space, heading, north, east, action)
        if (safe and not best_safe) or (safe == best_safe and room > best_room):
            best = action
            best_safe = safe
            best_room = room
    return best


@compiled
def cheapest_action(space, heading, north, east, costs, roomy):
    """The feasible action with the lowest of `costs` (A,), which are overwritten; the escape if none is feasible.

    `roomy`: the location's clearance is at least `safe_reach`, so that all actions are feasible.
    """
    for _ in range(costs.shape[0]):
        action = int(np.argmin(costs))
        if roomy or is_feasible(space, heading, north, east, action):
            return action
        costs[action] = np.inf
    return escape_action(space, heading, north, east)


@compiled
def feasible_mask(space, heading, north, east):
    """Whether each action (A,) is feasible in a state."""
    mask = np.zeros(space.turns.shape[0], dtype=np.bool_)
    for action in range(mask.shape[0]):
        mask[action] = is_feasible(space, heading, north, east, action)
    return mask


@compiled
def random_actions(space, heading, north, east, randoms):
    """Random feasible actions, one for each uniform number in `randoms` (the escape if no action is feasible).

    Uses rejection: most actions are feasible, and testing one is cheaper than testing all.
    """
    kinds = space.turns.shape[0]
    actions = np.zeros(randoms.shape[0], dtype=np.int64)
    untested = np.ones(kinds, dtype=np.bool_)
    for index in range(randoms.shape[0]):
        untested[:] = True
        action = -1
        r = randoms[index]
        for remaining in range(kinds, 0, -1):
            pick = min(int(r * remaining), remaining - 1)
            r = r * remaining - pick
            for a in range(kinds):
                if untested[a]:
                    if pick == 0:
                        action = a
                        break
                    pick -= 1
            if is_feasible(space, heading, north, east, action):
                break
            untested[action] = False
            action = -1
        if action < 0:
            action = escape_action(space, heading, north, east)
        actions[index] = action
        heading, north, east = end_of_leg(space, heading, north, east, action)
    return actions


class FreeSpace:
    """Clearance of the operating area and of known shallow ground, and the feasible actions in it.

    Attributes:
        raster: Clearance (m) at the nodes, shape (N, E).
        north0_m: North of the first row.
        east0_m: East of the first column.
        cell_m: Spacing of the nodes.
        margin_m: Distance kept from the border; clearance is measured from there.
        outline_m: Locations (n, 2) that span the ground: the polygon's corners, or the nodes in the area if some of the
            polygon cannot be reached.
    """

    def __init__(self, area: OperatingArea, motion: MotionTable, cell_m: float = 2.0) -> None:
        corners = np.asarray(area.polygon, dtype=float).reshape(-1, 2)
        low, high = corners.min(axis=0) - 2.0 * cell_m, corners.max(axis=0) + 2.0 * cell_m
        counts = np.ceil((high - low) / cell_m).astype(int) + 1
        self.motion = motion
        self.margin_m = area.margin_m
        self.north0_m, self.east0_m, self.cell_m = float(low[0]), float(low[1]), cell_m
        north = self.north0_m + cell_m * np.arange(counts[0])
        east = self.east0_m + cell_m * np.arange(counts[1])
        self._nodes_north, self._nodes_east = north, east
        grid = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
        self.area_raster: Array = np.ascontiguousarray(
            area.clearance_m(grid).reshape(counts[0], counts[1]) - area.margin_m, dtype=float
        )
        self.raster: Array = self.area_raster
        nodes = grid[self.area_raster.ravel() > -area.margin_m]
        is_clipped = any(name.startswith(UNREACHABLE) for name in area.no_go)
        self.outline_m: Array = nodes if is_clipped and len(nodes) else corners

    def set_shallow(self, locations_m: Array, shallow: Mask, spacing_m: float) -> None:
        """Blocks ground that is known to be too shallow, in addition to the area's limits.

        Args:
            locations_m: Locations of a regular grid, shape (P, 2); elsewhere only the area's limits apply.
            shallow: Whether the ground there is too shallow, shape (P,).
            spacing_m: Spacing of that grid: a shallow location blocks everything within half of it (per axis).
        """
        if not shallow.any():
            self.raster = self.area_raster
            return
        rows = np.rint((locations_m[:, 0] - self.north0_m) / self.cell_m).astype(int)
        columns = np.rint((locations_m[:, 1] - self.east0_m) / self.cell_m).astype(int)
        half = max(0, round(0.5 * spacing_m / self.cell_m))
        top, bottom = max(int(rows.min()) - half, 0), int(rows.max()) + half + 1
        left, right = max(int(columns.min()) - half, 0), int(columns.max()) + half + 1
        window = np.s_[top:bottom, left:right]  # the part of the raster that the locations cover
        there = self.area_raster[window]
        blocked = np.zeros_like(there, dtype=bool)
        for i in range(-half, half + 1):
            for j in range(-half, half + 1):
                at_row = np.clip(rows[shallow] + i - top, 0, len(there) - 1)
                at_column = np.clip(columns[shallow] + j - left, 0, len(there[0]) - 1)
                blocked[at_row, at_column] = True
        outside = distance_transform_edt(~blocked, sampling=self.cell_m)
        inside = distance_transform_edt(blocked, sampling=self.cell_m)
        self.raster = self.area_raster.copy()
        self.raster[window] = np.minimum(there, outside - inside)

    def arguments(self, static: bool = False) -> Space:
        """Arguments of the compiled functions; `static`: without this vehicle's known shallow ground."""
        m = self.motion
        return Space(
            self.area_raster if static else self.raster,
            self.north0_m,
            self.east0_m,
            self.cell_m,
            m.checked_m,
            m.spacing_m,
            float(m.lengths_m.max()),
            m.loops_m,
            m.turns_rad,
            m.steps_m,
        )

    def clearance_m(self, north_m: float, east_m: float) -> float:
        """Distance (m) of a location to the border of the area without its margin, negative outside."""
        return float(clearance_at(self.arguments(static=True), north_m, east_m))

    def feasible(self, state: Array) -> Ints:
        """Indices of the feasible actions of a state (3,), ascending; empty if there are none."""
        return np.flatnonzero(feasible_mask(self.arguments(), state[0], state[1], state[2])).astype(np.int64)

    def choices(self, state: Array) -> Ints:
        """The feasible actions of a state, or the escape alone if there are none; never empty."""
        actions = self.feasible(state)
        return actions if actions.size else np.array([self.escape(state)], dtype=np.int64)

    def escape(self, state: Array) -> int:
        """The action to take in a state without feasible actions."""
        return int(escape_action(self.arguments(), state[0], state[1], state[2]))

    def path_feasible(self, state: Array, actions: Ints | tuple[int, ...], legs: int, static: bool = False) -> bool:
        """Whether the first `legs` of `actions` from `state` are feasible one after another (`static`: in the area)."""
        a = self.arguments(static)
        for action in actions[:legs]:
            if not is_feasible(a, state[0], state[1], state[2], int(action)):
                return False
            state = self.motion.end_state(state, int(action))
        return True
