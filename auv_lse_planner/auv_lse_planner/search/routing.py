"""Routes over the ground: nodes spread over it, and the order in which a vehicle visits them.

Nodes are centroidal (Lloyd's algorithm) over the ground that a vehicle can reach. Distances lead around land. The order
is found by ruin and recreate (Christiaens and Vanden Berghe 2020, Slack induction by string removals): each iteration
removes a node and its neighbors from the route and reinserts them where that costs least. What exceeds the budget
stays out.

All arithmetic is in integers (centimetres), with random numbers of its own, so that a route is the same on every
machine.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import itertools
import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace

#: Iterations of Lloyd's algorithm, and of ruin and recreate.
LLOYD_ITERATIONS = 40
ITERATIONS = 10_000
#: Most nodes removed at once.
MAX_REMOVED = 12
#: Cost of leaving a node of mean weight out, in spacings of the nodes.
COST_OF_OMISSION = 6
#: Largest number of locations over which nodes are spread, and of locations of the grid of ways.
MAX_LOCATIONS, MAX_WAY_LOCATIONS = 4000, 6000
#: Multiplier and modulus of the random numbers (Park and Miller 1988).
MULTIPLIER, MODULUS = 48271, 2147483647


@compiled
def lloyd(locations, count, iterations):
    """Nodes (count, 2) in the middle of the locations (P, 2) nearest to them; integers."""
    nodes = np.empty((count, 2), dtype=np.int64)
    state = 1 + count
    for i in range(count):
        state = state * MULTIPLIER % MODULUS
        nodes[i] = locations[state % locations.shape[0]]
    sums, numbers = np.zeros((count, 2), dtype=np.int64), np.zeros(count, dtype=np.int64)
    for _ in range(iterations):
        sums[:] = 0
        numbers[:] = 0
        for p in range(locations.shape[0]):
            nearest, least = 0, 1 << 62
            for i in range(count):
                north, east = locations[p, 0] - nodes[i, 0], locations[p, 1] - nodes[i, 1]
                square = north * north + east * east
                if square < least:
                    nearest, least = i, square
            sums[nearest] += locations[p]
            numbers[nearest] += 1
        for i in range(count):
            if numbers[i]:
                nodes[i, 0], nodes[i, 1] = sums[i, 0] // numbers[i], sums[i, 1] // numbers[i]
            else:
                state = state * MULTIPLIER % MODULUS
                nodes[i] = locations[state % locations.shape[0]]
    return nodes


@compiled
def insert_best(node, route, size, length, budget, distance, state):
    """Inserts a node where that costs least within the budget.

    Returns:
        Whether it fits, the route's new size and length, and the random state.
    """
    best, best_at = 1 << 62, 0
    for at in range(1, size + 1):
        state = state * MULTIPLIER % MODULUS
        if state % 100 == 0:  # a blink: an insertion is sometimes skipped
            continue
        before = route[at - 1]
        extra = distance[before, node]
        if at < size:
            after = route[at]
            extra += distance[node, after] - distance[before, after]
        if extra < best and length + extra <= budget:
            best, best_at = extra, at
    if best_at == 0:
        return False, size, length, state
    for at in range(size, best_at, -1):
        route[at] = route[at - 1]
    route[best_at] = node
    return True, size + 1, length + best, state


@compiled
def ruin_and_recreate(distance, near, penalty, budget, iterations, hot):
    """A route (n,) over some of the nodes 0 to N - 1, from node N.

    Args:
        distance: Between nodes, shape (N + 1, N + 1); the last one is the start.
        near: For each node the others by distance, shape (N, N).
        penalty: Cost of leaving each node out, shape (N,).
        budget: Largest length of the route.
        hot: Largest increase of the cost that is accepted at first; it falls to 0.
    """
    count = penalty.shape[0]
    route, size, length = np.full(count + 1, count, dtype=np.int64), 1, 0
    absent = np.ones(count, dtype=np.bool_)
    cost = np.sum(penalty)
    best_route, best_size, best = route.copy(), size, cost
    old_route, old_size, old_length, old_absent = route.copy(), size, length, absent.copy()
    waiting = np.empty(count, dtype=np.int64)
    state = 4711
    for iteration in range(iterations):
        state = state * MULTIPLIER % MODULUS
        seed = state % count
        state = state * MULTIPLIER % MODULUS
        removed = 1 + state % MAX_REMOVED
        if iteration:
            for i in range(min(removed, count)):
                absent[near[seed, i]] = True
        kept = 1
        for at in range(1, size):
            if not absent[route[at]]:
                route[kept] = route[at]
                kept += 1
        size, length = kept, 0
        for at in range(1, kept):
            length += distance[route[at - 1], route[at]]
        total = 0
        for i in range(count):
            if absent[i]:
                waiting[total] = i
                total += 1
        for i in range(total - 1, 0, -1):  # in random order
            state = state * MULTIPLIER % MODULUS
            j = state % (i + 1)
            waiting[i], waiting[j] = waiting[j], waiting[i]
        for i in range(total):
            fits, size, length, state = insert_best(waiting[i], route, size, length, budget, distance, state)
            absent[waiting[i]] = not fits
        new = length
        for i in range(count):
            if absent[i]:
                new += penalty[i]
        state = state * MULTIPLIER % MODULUS
        if new <= cost + hot * (iterations - iteration) // iterations * (state % 1000) // 1000:
            cost = new
            old_route[:], old_size, old_length, old_absent[:] = route, size, length, absent
            if new < best:
                best, best_size = new, size
                best_route[:] = route
        else:
            route[:], size, length, absent[:] = old_route, old_size, old_length, old_absent
    return best_route[:best_size]


def free_area_m2(space: FreeSpace) -> float:
    """Size of the area without no-go areas; 0 if a vehicle can be nowhere in it."""
    inside = space.area_raster > -space.margin_m
    return float(np.count_nonzero(inside)) * space.cell_m**2 if (space.area_raster >= 0.0).any() else 0.0


class Ground:
    """Locations of the free space as integers, and ways between them around land."""

    def __init__(self, space: FreeSpace) -> None:
        self._space = space
        inside, free = space.area_raster > -space.margin_m, space.area_raster >= 0.0
        self.area_m2 = free_area_m2(space)
        self.locations_cm = self._thinned(inside, MAX_LOCATIONS)[1]
        self._ways, self._ways_cm = self._thinned(free, MAX_WAY_LOCATIONS)
        self._graph: coo_array | None = None

    def _thinned(self, mask: Mask, most: int) -> tuple[Ints, Ints]:
        """Rows and columns (M, 2) of about `most` nodes of a mask, evenly spaced, and their locations (cm)."""
        every = max(1, round(float(np.sqrt(np.count_nonzero(mask) / most)) + 0.499))
        thin = np.zeros_like(mask)
        thin[::every, ::every] = mask[::every, ::every]
        nodes = np.argwhere(thin)
        space = self._space
        cm = 100.0 * (np.array([space.north0_m, space.east0_m]) + nodes * space.cell_m)
        return nodes, np.rint(cm).astype(np.int64)

    def nodes_cm(self, count: int) -> Ints:
        """Centroidal nodes (N, 2) on free ground, without duplicates."""
        nodes = lloyd(self.locations_cm, min(count, len(self.locations_cm)), LLOYD_ITERATIONS)
        return np.unique(self._ways_cm[self._nearest(nodes)], axis=0)

    def _nearest(self, locations_cm: Ints) -> Ints:
        """Index of the location on a way nearest to each location (P, 2)."""
        off = locations_cm[:, None, :] - self._ways_cm[None]
        return np.asarray(np.argmin(np.einsum("pwi,pwi->pw", off, off), axis=1))

    def distances_cm(self, locations_cm: Ints) -> tuple[Ints, dict[tuple[int, int], Ints]]:
        """Distances (P, P) between locations, around land, and the locations on the way where it is not straight."""
        off = (locations_cm[:, None] - locations_cm[None]).astype(float)
        straight = np.rint(np.hypot(off[..., 0], off[..., 1])).astype(np.int64)
        blocked = ~self._in_sight(locations_cm)
        if not blocked.any():
            return straight, {}
        indices = self._nearest(locations_cm)
        around, before = dijkstra(self._ways_graph(), directed=False, indices=indices, return_predecessors=True)
        between = around[:, indices]
        far = 10.0 * float(np.ptp(self._ways_cm, axis=0).sum())
        lengths = np.rint(np.where(np.isfinite(between), between, far)).astype(np.int64)
        lengths = np.maximum(np.where(blocked, np.maximum(lengths, lengths.T), straight), straight)
        bends = {}
        for i, j in np.argwhere(blocked & np.isfinite(between)):
            way, at = [], int(indices[j])
            while at >= 0 and at != indices[i]:
                way.append(at)
                at = int(before[i, at])
            bends[int(i), int(j)] = self._ways_cm[way[::-1][:-1]]
        return lengths, bends

    def _in_sight(self, locations_cm: Ints) -> Mask:
        """Whether the straight line between two locations stays on free ground, (P, P); none is outside the raster."""
        space = self._space
        raster = np.pad(space.area_raster, 1, constant_values=-math.inf)
        shares = np.linspace(0.0, 1.0, 65)[:, None]
        seen = np.ones((len(locations_cm), len(locations_cm)), dtype=bool)
        for i, location in enumerate(locations_cm):
            line = 0.01 * (location + shares[None] * (locations_cm[:, None] - location))
            row = np.rint((line[..., 0] - space.north0_m) / space.cell_m).astype(np.int64)
            column = np.rint((line[..., 1] - space.east0_m) / space.cell_m).astype(np.int64)
            row, column = np.clip(row + 1, 0, len(raster) - 1), np.clip(column + 1, 0, len(raster[0]) - 1)
            seen[i] = (raster[row, column] >= -0.5 * space.cell_m).all(axis=1)
        return seen & seen.T

    def _ways_graph(self) -> coo_array:
        if self._graph is None:
            rows = self._ways
            step = int(np.diff(np.unique(rows[:, 0])).min()) if len(np.unique(rows[:, 0])) > 1 else 1
            number = np.full(np.array(self._space.area_raster.shape) + 4 * step, -1)
            number[rows[:, 0], rows[:, 1]] = np.arange(len(rows))
            cm = step * self._space.cell_m * 100.0
            links = []
            for north, east in ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)):
                other = number[rows[:, 0] + step * north, rows[:, 1] + step * east]
                own = np.flatnonzero(other >= 0)
                links.append((own, other[own], np.full(len(own), np.rint(cm * np.hypot(north, east)))))
            i, j, length = (np.concatenate(part) for part in zip(*links, strict=True))
            ends = i.astype(np.int32), j.astype(np.int32)  # SciPy 1.11's dijkstra reads no others
            self._graph = coo_array((length, ends), shape=(len(rows), len(rows))).tocsr()
        return self._graph


def route_m(ground: Ground, start_m: Array, weights_at: Array, length_m: float, count: int) -> Array:
    """A route from a start, a polyline (n + 1, 2) of at most `length_m`.

    Args:
        start_m: North and east, shape (2,).
        weights_at: Importance of the ground's locations (P,); any unit.
        length_m: Largest length of the route.
    """
    nodes = ground.nodes_cm(count)
    start = np.rint(100.0 * np.asarray(start_m, dtype=float)).astype(np.int64)
    locations = np.concatenate([nodes, start[None]])
    distance, bends = ground.distances_cm(locations)
    off = ground.locations_cm[:, None] - nodes[None]
    nearest = np.argmin(np.einsum("pni,pni->pn", off, off), axis=1)
    weight = np.bincount(nearest, weights=weights_at, minlength=len(nodes))
    spacing = round(100.0 * float(np.sqrt(ground.area_m2 / len(nodes))))
    share = np.rint(1000.0 * weight / max(float(weight.mean()), 1e-300)).astype(np.int64)
    near = np.argsort(distance[:-1, :-1], axis=1, kind="stable")
    penalty = COST_OF_OMISSION * spacing * share // 1000
    route = ruin_and_recreate(distance, near, penalty, round(100.0 * length_m), ITERATIONS, spacing)
    line = [start[None]]
    for i, j in itertools.pairwise(route):
        line += [bends.get((int(i), int(j)), np.empty((0, 2), dtype=np.int64)), locations[j][None]]
    if len(route) == 1:  # no node: it stays near the start
        line.append(nodes[np.argmin(((nodes - start) ** 2).sum(axis=1))][None])
    return np.asarray(0.01 * np.concatenate(line), dtype=np.float64)
