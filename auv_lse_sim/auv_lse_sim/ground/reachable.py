"""Ground that vehicles can reach from their starts by feasible actions.

The flood keeps the first state found in each bin of location and heading, and expands it by its feasible actions.
States are not rounded, so whatever is flooded can be reached: also ground behind a strait that a single leg crosses.
Ground counts as reached within the margin and a turning loop's reach of a flooded state, along ways inside the area.

A vehicle can move turning loops through connected water that is wide enough for them (*open water*). So all of it is
reached as soon as the loop of one state lies in it, with every heading that the actions lead to.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace, end_of_leg, escape_action, feasible_mask, is_feasible

#: Bins of the flood: their size (m), its limit as a share of the shortest leg, and the number of headings.
BIN_M, BIN_SHARE, HEADINGS = 4.0, 0.2, 72
#: Clearance of the loops' centers in open water / a turning loop's reach. With at most this many headings it must have
#: room for a leg, too: a loop is moved by legs, and few headings may fit along no narrow water.
OPEN, FEW_HEADINGS = 1.25, 36
#: Loops to the other side count if their reach is at most this multiple of the tightest one's.
LOOPS_ALIKE = 1.1
#: Layers of the flood before the first check whether everything is reached, and their growth from check to check: in a
#: large area a check takes longer than many layers.
FIRST_CHECK, CHECK_GROWTH = 8, 1.5
#: States that are expanded at once.
BLOCK = 20_000
#: The neighbors of a node.
_SQUARE = np.ones((3, 3), dtype=bool)
#: Maximum number of escapes of a vehicle from its start: one that needs more is circling.
MAX_ESCAPES = 100


@dataclass(frozen=True, slots=True)
class UnreachedPart:
    """A connected part of the area that no vehicle can reach.

    Attributes:
        nodes: Its nodes of the free space's raster, shape (N, E).
        area_m2: Its size.
        reached: The nodes that vehicles can reach, (N, E).
    """

    nodes: Mask
    area_m2: float
    reached: Mask


def unreached_parts(space: FreeSpace, starts: Array) -> list[UnreachedPart]:
    """The parts of the area that no action leads to, the largest first; empty if everything can be reached.

    Parts smaller than a turning loop are not counted. Without a start inside the area the result is empty, too.

    Args:
        space: The free space; shallow ground of a map is ignored.
        starts: Initial states of the vehicles, shape (V, 3).
    """
    inside = space.area_raster > -space.margin_m
    if not math.isfinite(_reach_m(space)):
        return []
    reached = _flooded(space, inside, starts)
    if not reached.any():
        return []
    labels, parts = _missing(space, inside & ~_widened(reached, inside, _count_nodes(space, _beyond_m(space))))
    sizes_m2 = np.bincount(labels.ravel()) * space.cell_m**2
    return [UnreachedPart(labels == number, float(sizes_m2[number]), reached) for number in parts]


def _reach_m(space: FreeSpace) -> float:
    return float(space.motion.loops_m[:, 2].min())


def _beyond_m(space: FreeSpace) -> float:
    """Distance (m) from a vehicle's positions within which ground counts as reached."""
    return space.margin_m + _reach_m(space)


def _count_nodes(space: FreeSpace, distance_m: float) -> int:
    return math.ceil(distance_m / space.cell_m)


def _widened(mask: Mask, inside: Mask, nodes: int) -> Mask:
    """The mask and what lies within that many nodes of it, along ways inside."""
    shape = (mask.shape[0] + 2, mask.shape[1] + 2)
    wider, free = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    wider[1:-1, 1:-1], free[1:-1, 1:-1] = mask, inside
    wide, row = wider.ravel(), shape[1]
    free_there = (free & ~wider).ravel()
    cross = np.array([-row, -1, 1, row])
    square = np.append(cross, [-row - 1, -row + 1, row - 1, row + 1])
    before, last = np.zeros(0, dtype=np.int64), np.flatnonzero(wider & ndimage.binary_dilation(free & ~wider, _SQUARE))
    for i in range(nodes):  # alternating: an octagon, close to a circle
        rim = np.concatenate([before, last])  # a cross leaves out diagonal neighbors
        near = np.unique((rim[:, None] + (cross if i % 2 else square)).ravel())
        before, last = last, near[free_there[near]]
        if not len(before) and not len(last):
            break  # everything that can be reached
        wide[last], free_there[last] = True, False
    return wider[1:-1, 1:-1].copy()


def _missing(space: FreeSpace, rest: Mask) -> tuple[NDArray[np.int32], list[int]]:
    """Labels (N, E) of the connected parts of a mask, and the numbers of those that count, the largest first."""
    labels, count = ndimage.label(rest)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:] * space.cell_m**2
    order = np.argsort(-sizes, kind="stable")
    return labels, [int(i) + 1 for i in order if sizes[i] >= math.pi * _reach_m(space) ** 2]


def _nodes_at(space: FreeSpace, locations_m: Array) -> tuple[Ints, Ints]:
    """Rows and columns of the raster's nodes nearest to locations (P, 2)."""
    row = np.rint((locations_m[:, 0] - space.north0_m) / space.cell_m).astype(np.int64)
    column = np.rint((locations_m[:, 1] - space.east0_m) / space.cell_m).astype(np.int64)
    return np.clip(row, 0, len(space.area_raster) - 1), np.clip(column, 0, len(space.area_raster[0]) - 1)


@compiled
def node_at(space, north, east):
    """Row and column of the raster's node nearest to a location."""
    row = math.floor((north - space.north0) / space.cell + 0.5)
    column = math.floor((east - space.east0) / space.cell + 0.5)
    return min(max(row, 0), space.raster.shape[0] - 1), min(max(column, 0), space.raster.shape[1] - 1)


@compiled
def water_of(space, open_water, heading, north, east):
    """Number of the open water that has the center of one of a state's tightest turning loops, 0 if none has."""
    least = min(space.loops[0, 2], space.loops[1, 2])
    cos_h, sin_h = math.cos(heading), math.sin(heading)
    water = 0
    for side in range(2):
        if space.loops[side, 2] > LOOPS_ALIKE * least:
            continue
        ahead, starboard = space.loops[side, 0], space.loops[side, 1]
        row, column = node_at(
            space, north + cos_h * ahead - sin_h * starboard, east + sin_h * ahead + cos_h * starboard
        )
        water = max(water, open_water[row, column])
    return water


@compiled
def waters_of(space, open_water, states):
    """`water_of` of each state, (S, 3) -> (S,)."""
    waters = np.empty(states.shape[0], dtype=np.int32)
    for s in range(states.shape[0]):
        waters[s] = water_of(space, open_water, states[s, 0], states[s, 1], states[s, 2])
    return waters


@compiled
def escapes(space, heading, north, east, most):
    """The states (S, 3) of a vehicle from its start to the first state with a feasible action, by up to `most` escapes.

    Bins would merge some of them, above all outside the area's raster.
    """
    states = np.empty((most + 1, 3))
    for i in range(most + 1):
        states[i, 0], states[i, 1], states[i, 2] = heading, north, east
        if feasible_mask(space, heading, north, east).any():
            return states[: i + 1].copy()
        heading, north, east = end_of_leg(space, heading, north, east, escape_action(space, heading, north, east))
    return states


@compiled
def expand(space, states, bins, open_water, entered, heading0, seen):
    """The states after one feasible action from `states` (S, 3), of bins that are not yet in `seen` (B, H).

    Each row (M, 5) has the state and the middle of the leg to it: heading, north, east, north, east.

    Args:
        space: `FreeSpace.arguments(static=True)`.
        bins: Number of each raster node's bin (N, E).
        open_water: Number of the open water of each raster node (N, E), 0 elsewhere.
        entered: Whether each open water was reached already, (W,); set for those that the states lead to.
        heading0: Heading (rad) of the first bin.
    """
    kinds, headings, middle = space.turns.shape[0], seen.shape[1], int(0.5 * space.longest / space.spacing + 0.5)
    found = np.empty((states.shape[0] * kinds, 5))
    count = 0
    for s in range(states.shape[0]):
        heading, north, east = states[s, 0], states[s, 1], states[s, 2]
        stuck = True
        for k in range(kinds + 1):
            if k == kinds:
                if not stuck:
                    break
                action = escape_action(space, heading, north, east)
            else:
                action = k
            h, n, e = end_of_leg(space, heading, north, east, action)
            row, column = node_at(space, n, e)
            number = math.floor((h - heading0) / (2.0 * math.pi) * headings + 0.5) % headings
            water = water_of(space, open_water, h, n, e)
            if entered[water] or seen[bins[row, column], number]:
                stuck = False  # only feasible actions lead to a seen bin, or none that matters
                continue
            if k < kinds and not is_feasible(space, heading, north, east, action):
                continue
            stuck = False
            seen[bins[row, column], number] = True
            entered[water] = water > 0
            found[count, 0], found[count, 1], found[count, 2] = h, n, e
            ahead, starboard = space.tracks[action, middle, 0], space.tracks[action, middle, 1]
            cos_h, sin_h = math.cos(heading), math.sin(heading)
            found[count, 3] = north + cos_h * ahead - sin_h * starboard
            found[count, 4] = east + sin_h * ahead + cos_h * starboard
            count += 1
    return found[:count].copy()


def _nodes_per_bin(space: FreeSpace) -> int:
    """Number of the raster's nodes along a side of the flood's bins."""
    leg_m = float(np.hypot(*space.motion.steps_m.T).min())
    return max(1, math.floor(min(BIN_M, BIN_SHARE * leg_m) / space.cell_m))


def _bins(space: FreeSpace, used_nodes: Mask) -> NDArray[np.int32]:
    """Number of the flood's bin of each raster node (N, E), bin 0 where there is none."""
    side = _nodes_per_bin(space)
    rows, columns = (np.arange(size) // side for size in used_nodes.shape)
    used = np.zeros((rows[-1] + 1, columns[-1] + 1), dtype=bool)
    at = np.nonzero(used_nodes)
    used[rows[at[0]], columns[at[1]]] = True
    numbers = np.where(used, np.cumsum(used).reshape(used.shape), 0).astype(np.int32)
    return np.ascontiguousarray(numbers[rows][:, columns])


def _flooded(space: FreeSpace, inside: Mask, starts: Array) -> Mask:
    """Nodes (N, E) of open water and at the middles and ends of legs; ends early if they are near all ground."""
    arguments = space.arguments(static=True)
    reach_m, leg_m = _reach_m(space), float(space.motion.lengths_m.max())
    open_m = OPEN * reach_m
    if len(_headings(space, starts[:1, 0])) <= FEW_HEADINGS:
        open_m = max(open_m, reach_m + leg_m)
    open_water, count = ndimage.label(space.area_raster >= open_m)
    near_border = space.area_raster < open_m + reach_m  # farther away all loops' centers are in open water
    bins = _bins(space, near_border & (space.area_raster > -space.margin_m - leg_m))
    seen, entered = np.zeros((int(bins.max()) + 1, HEADINGS), dtype=np.bool_), np.zeros(count + 1, dtype=np.bool_)
    reached, layers, check_after = np.zeros_like(inside), 0, FIRST_CHECK
    ways = [escapes(arguments, float(h), float(n), float(e), MAX_ESCAPES) for h, n, e in starts]
    states = np.array([way[-1] for way in ways])
    reached[_nodes_at(space, np.concatenate(ways)[:, 1:])] = True
    while len(states):
        waters = waters_of(arguments, open_water, states)
        if waters.any():
            entered[waters[waters > 0]] = True
            opened = np.isin(np.arange(count + 1), waters[waters > 0])[open_water]
            reached |= _widened(opened, inside, _count_nodes(space, reach_m))
            check_after = layers
        if layers >= check_after:
            check_after = max(FIRST_CHECK, math.ceil(CHECK_GROWTH * layers))
            near = _widened(reached, inside, _count_nodes(space, _beyond_m(space)))
            if not _missing(space, inside & ~near)[1]:
                break
        if waters.any():
            rim = _at_rim(space, opened, inside & (open_water == 0), _headings(space, states[waters > 0, 0]))
            states = np.concatenate([states[waters == 0], rim])
        blocks = np.array_split(states, math.ceil(len(states) / BLOCK))
        found = np.concatenate([expand(arguments, s, bins, open_water, entered, starts[0, 0], seen) for s in blocks])
        states = np.ascontiguousarray(found[:, :3])
        for locations in (found[:, 1:3], found[:, 3:]):
            reached[_nodes_at(space, locations)] = True
        layers += 1
    return reached & inside


def _headings(space: FreeSpace, headings: Array) -> Array:
    """The headings (rad) that turning in open water leads to, each once."""
    bin_rad = 2.0 * math.pi / HEADINGS
    known: dict[int, float] = {}
    ahead = list(headings)
    while ahead:
        heading = ahead.pop()
        number = round(heading / bin_rad) % HEADINGS
        if number not in known:
            known[number] = heading
            ahead.extend(heading + space.motion.turns_rad)
    return np.array(list(known.values()))


def _at_rim(space: FreeSpace, opened: Mask, narrow: Mask, headings: Array) -> Array:
    """States (S, 3) with these headings on the turning loops along the border of open water."""
    nodes = np.argwhere(opened & ndimage.binary_dilation(narrow, _SQUARE))[:: _nodes_per_bin(space)]
    centers = np.repeat(np.array([space.north0_m, space.east0_m]) + space.cell_m * nodes, len(headings), axis=0)
    heading = np.tile(headings, len(nodes))
    cos_h, sin_h = np.cos(heading), np.sin(heading)
    tightest = space.motion.loops_m[space.motion.loops_m[:, 2] <= LOOPS_ALIKE * _reach_m(space)]
    return np.concatenate([
        np.column_stack([
            heading,
            centers[:, 0] - cos_h * ahead + sin_h * starboard,
            centers[:, 1] - sin_h * ahead - cos_h * starboard,
        ])
        for ahead, starboard, _ in tightest
    ])  # fmt: skip


def strait_to(space: FreeSpace, part: UnreachedPart) -> tuple[Array, float]:
    """The narrowest location on the widest way from the reached ground to a part.

    Returns:
        North and east (m), shape (2,), and the width (m) of the water there; 0 if land separates the part.
    """
    raster = space.area_raster
    masks = (part.reached, part.nodes)
    ends = [np.unravel_index(np.argmax(np.where(mask, raster, -np.inf)), raster.shape) for mask in masks]
    levels = np.unique(raster)
    # The largest clearance with a way between the two ends is levels[low].
    low, high = 0, int(np.searchsorted(levels, min(raster[end] for end in ends)))
    while low < high:
        middle = (low + high + 1) // 2
        labels, _ = ndimage.label(raster >= levels[middle])
        if labels[ends[0]] == labels[ends[1]] > 0:
            low = middle
        else:
            high = middle - 1
    narrow = raster == levels[low]
    wider, _ = ndimage.label(raster > levels[low])
    stretches, _ = ndimage.label(narrow)
    touching = []  # the narrow stretches next to either end's wider water
    for end in ends:
        own = wider == wider[end] if wider[end] else np.zeros_like(narrow)
        own[end] = True
        touching.append(narrow & np.isin(stretches, stretches[ndimage.binary_dilation(own)]))
    joining = next(m for m in (touching[0] & touching[1], touching[1], narrow) if m.any())
    row, column = np.argwhere(joining)[0]
    location_m = np.array([space.north0_m + row * space.cell_m, space.east0_m + column * space.cell_m])
    return location_m, max(0.0, 2.0 * (float(levels[low]) + space.margin_m))
