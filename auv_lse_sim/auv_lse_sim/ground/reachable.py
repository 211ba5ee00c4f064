"""Ground that vehicles can reach from their starts by feasible actions.

The flood keeps the first state found in each bin of location and heading, and expands it by its feasible actions.
States
are not rounded, so whatever is flooded can be reached: also ground behind a strait that one leg bridges, from a
location
with room for a turn to another. Ground counts as reached within the margin and a turning loop's reach of a flooded
state, along ways inside the area.

An area that consists of open water alone, which is wide enough for a turning loop everywhere, needs no flood.
"""

from __future__ import annotations

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import (
    FreeSpace,
    clearance_at,
    end_of_leg,
    escape_action,
    is_feasible,
    loop_clearance,
    safe_reach,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Size of the flood's bins: location (m), and heading. Bins are larger where all actions are feasible.
BIN_M, HEADINGS = 4.0, 72
ROOMY_BINS, ROOMY_HEADINGS = 4, 12
#: Maximum number of bins; larger areas get larger ones.
MAX_BINS = 2.0e7
#: Clearance (m) beyond a turning loop's reach at which ground is open water.
OPEN_M = 4.0
#: Layers of the flood between checks whether everything is reached.
LAYERS_PER_CHECK = 8


@dataclass(frozen=True, slots=True)
class UnreachedPart:
    """A connected part of the area that no vehicle can reach.

    Attributes:
        nodes: Its nodes of the free space's raster, shape (N, E).
        area_m2: Its size.
        strait_m: North and east of the narrowest location on the widest way to it, shape (2,).
        strait_width_m: Width of the water there; 0 if land separates the part.
    """

    nodes: Mask
    area_m2: float
    strait_m: Array
    strait_width_m: float


def unreached_parts(space: FreeSpace, starts: Array) -> list[UnreachedPart]:
    """The parts of the area that no action leads to, the largest first; empty if everything can be reached.

    Parts smaller than a turning loop are not counted. Without a start inside the area the result is empty, too.

    Args:
        space: The free space; shallow ground of a map is ignored.
        starts: Initial states of the vehicles, shape (V, 3).
    """
    inside = space.area_raster > -space.margin_m
    if not math.isfinite(_reach_m(space)) or _is_open_water(space, inside, starts):
        return []
    reached = _flooded(space, inside, starts)
    if not reached.any():
        return []
    labels, parts = _missing(space, inside & ~_widened(reached, inside, _count_nodes(space, _beyond_m(space))))
    return [_part(space, labels == number, reached) for number in parts]


def _reach_m(space: FreeSpace) -> float:
    return float(space.motion.loops_m[:, 2].min())


def _beyond_m(space: FreeSpace) -> float:
    """Distance (m) from a vehicle's positions within which ground counts as reached."""
    return space.margin_m + _reach_m(space)


def _count_nodes(space: FreeSpace, distance_m: float) -> int:
    return math.ceil(distance_m / space.cell_m)


def _widened(mask: Mask, inside: Mask, nodes: int) -> Mask:
    """The mask and what lies within that many nodes of it, along ways inside."""
    cross, square = ndimage.generate_binary_structure(2, 1), np.ones((3, 3), dtype=bool)
    for i in range(nodes):  # alternating: an octagon, close to a circle
        mask = ndimage.binary_dilation(mask, cross if i % 2 else square, mask=inside)
    return mask


def _missing(space: FreeSpace, rest: Mask) -> tuple[NDArray[np.int32], list[int]]:
    """Labels (N, E) of the connected parts of a mask, and the numbers of those that count, the largest first."""
    labels, count = ndimage.label(rest)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:] * space.cell_m**2
    order = np.argsort(-sizes, kind="stable")
    return labels, [int(i) + 1 for i in order if sizes[i] >= math.pi * _reach_m(space) ** 2]


def _is_open_water(space: FreeSpace, inside: Mask, starts: Array) -> bool:
    """Whether the area has a single part that is wide enough for turning loops, next to all ground and all starts."""
    labels, count = ndimage.label(space.area_raster >= _reach_m(space) + OPEN_M)
    if count != 1:
        return False
    near = _widened(labels > 0, inside, _count_nodes(space, _beyond_m(space) + _reach_m(space)))
    arguments = space.arguments(static=True)
    safe = [
        max(loop_clearance(arguments, h, n, e, side) for side in (0, 1)) >= 0.5 * space.motion.spacing_m
        for h, n, e in starts
    ]
    return bool(near[_nodes_at(space, starts[:, 1:])].all()) and all(safe) and not _missing(space, inside & ~near)[1]


def _nodes_at(space: FreeSpace, locations_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the raster's nodes nearest to locations (P, 2)."""
    row = np.rint((locations_m[:, 0] - space.north0_m) / space.cell_m).astype(np.int64)
    column = np.rint((locations_m[:, 1] - space.east0_m) / space.cell_m).astype(np.int64)
    return np.clip(row, 0, len(space.area_raster) - 1), np.clip(column, 0, len(space.area_raster[0]) - 1)


@compiled
def expand(space, states, origin, bin_m, roomy_m, seen):
    """The states after one feasible action from `states` (S, 3), of bins that are not yet in `seen` (R, C, H).

    Each row (M, 5) has the state and the middle of the leg to it: heading, north, east, north, east.

    Args:
        space: `FreeSpace.arguments(static=True)`.
        origin: Heading (rad), north and east (m) of the first bin, shape (3,).
        bin_m: Size of a bin.
        roomy_m: Clearance from which all actions are feasible (`safe_reach`).
    """
    kinds, headings, middle = space.turns.shape[0], seen.shape[2], int(0.5 * space.longest / space.spacing + 0.5)
    found = np.empty((states.shape[0] * kinds, 5))
    count = 0
    for s in range(states.shape[0]):
        heading, north, east = states[s, 0], states[s, 1], states[s, 2]
        roomy = clearance_at(space, north, east) >= roomy_m
        stuck = True
        for k in range(kinds + 1):
            if k == kinds:
                if not stuck:
                    break
                action = escape_action(space, heading, north, east)
            else:
                action = k
            h, n, e = end_of_leg(space, heading, north, east, action)
            row = min(max(int((n - origin[1]) / bin_m), 0), seen.shape[0] - 1)
            column = min(max(int((e - origin[2]) / bin_m), 0), seen.shape[1] - 1)
            number = math.floor((h - origin[0]) / (2.0 * math.pi) * headings + 0.5) % headings
            if clearance_at(space, n, e) >= roomy_m:
                row -= row % ROOMY_BINS
                column -= column % ROOMY_BINS
                number -= number % ROOMY_HEADINGS
            if seen[row, column, number]:
                stuck = False  # only feasible actions lead to a seen bin, or none that matters
                continue
            if k < kinds and not (roomy or is_feasible(space, heading, north, east, action)):
                continue
            stuck = False
            seen[row, column, number] = True
            found[count, 0], found[count, 1], found[count, 2] = h, n, e
            ahead, starboard = space.tracks[action, middle, 0], space.tracks[action, middle, 1]
            cos_h, sin_h = math.cos(heading), math.sin(heading)
            found[count, 3] = north + cos_h * ahead - sin_h * starboard
            found[count, 4] = east + sin_h * ahead + cos_h * starboard
            count += 1
    return found[:count].copy()


def _flooded(space: FreeSpace, inside: Mask, starts: Array) -> Mask:
    """Nodes (N, E) at the ends and middles of feasible legs from the starts; ends early if they are near all ground."""
    arguments = space.arguments(static=True)
    extent = np.array(inside.shape) * space.cell_m
    bin_m = max(BIN_M, math.sqrt(float(extent.prod()) * HEADINGS / MAX_BINS))
    rows, columns = (math.ceil(size / bin_m) + 1 for size in extent)
    seen = np.zeros((rows, columns, HEADINGS), dtype=np.bool_)
    origin = np.array([starts[0, 0], space.north0_m, space.east0_m])
    reached, layers = np.zeros_like(inside), 0
    states = np.ascontiguousarray(starts, dtype=float)
    reached[_nodes_at(space, states[:, 1:])] = True
    while len(states):
        found = expand(arguments, states, origin, bin_m, safe_reach(arguments), seen)
        states = np.ascontiguousarray(found[:, :3])
        for locations in (found[:, 1:3], found[:, 3:]):
            reached[_nodes_at(space, locations)] = True
        layers += 1
        if layers % LAYERS_PER_CHECK == 0:
            near = _widened(reached, inside, _count_nodes(space, _beyond_m(space)))
            if not _missing(space, inside & ~near)[1]:
                break
    return reached & inside


def _part(space: FreeSpace, nodes: Mask, reached: Mask) -> UnreachedPart:
    """Describes a part: finds the narrowest location on the widest way from the reached ground to it."""
    raster = space.area_raster
    ends = [np.unravel_index(np.argmax(np.where(mask, raster, -np.inf)), raster.shape) for mask in (reached, nodes)]
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
    strait_m = np.array([space.north0_m + row * space.cell_m, space.east0_m + column * space.cell_m])
    width_m = max(0.0, 2.0 * (float(levels[low]) + space.margin_m))
    return UnreachedPart(nodes, float(nodes.sum()) * space.cell_m**2, strait_m, width_m)
