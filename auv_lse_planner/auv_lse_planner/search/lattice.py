"""UCT with the surrogate of the map's reward, compiled: thousands of iterations in the time of one exact value.

The same search as `search.py` (values scaled to 0..1, UCB, random completion) on arrays instead of objects. Random
numbers are drawn beforehand from the caller's Generator, so the compiled and the plain function do the same.
"""

from __future__ import annotations

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace, random_actions
from auv_lse_planner.paths.motion import advance
from auv_lse_planner.reward.surrogate import Surrogate, value_of
from auv_lse_planner.search.tree import FORBIDDEN, UNTRIED, mark_choices
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Iterations between two looks at the deadline.
CHUNK = 100


@compiled
def run_chunk(
    space,
    surrogate,
    samples,
    tree,
    children,
    node_states,
    limits,
    horizon,
    exploration,
    randoms,
    seeds,
    sequences,
    values,
    begin,
    end,
):
    """Iterations `begin` to `end` of the search.

    Args:
        space: `FreeSpace.arguments()`.
        surrogate: `Surrogate.arguments()`.
        samples: Body-frame measurement places of each action, shape (A, s, 2).
        tree: visits and total of each node, shape (N, 2).
        children: Number of the child by action, UNTRIED or FORBIDDEN, shape (N, A).
        node_states: State of each node, shape (N, 3).
        limits: Number of nodes, least value, largest value: shape (3,), changed.
        horizon: Length of sequences.
        exploration: Exploration constant.
        randoms: Uniform numbers, shape (iterations, 2 horizon).
        seeds: Sequences tried first, shape (S, horizon), -1 after their end.
        sequences: Receives each iteration's sequence, shape (iterations, horizon).
        values: Receives each iteration's value, shape (iterations,).
        begin, end: Range of iterations.
    """
    turns, steps = space.turns, space.steps
    kinds = turns.shape[0]
    count = int(limits[0])
    path = np.zeros(horizon + 1, dtype=np.int64)
    best = np.zeros(surrogate[5].shape[0], dtype=np.float32)
    places = np.zeros((horizon * samples.shape[1], 2))
    for iteration in range(begin, end):
        node = 0
        depth = 0
        path[0] = 0
        used = 0
        added = False
        # ---- down the tree, one new node
        while depth < horizon and not added:
            action = -1
            if iteration < seeds.shape[0] and seeds[iteration, depth] >= 0:
                wanted = seeds[iteration, depth]
                if children[node, wanted] != FORBIDDEN:
                    action = wanted
            if action < 0:
                untried = 0
                for a in range(kinds):
                    if children[node, a] == UNTRIED:
                        untried += 1
                if untried > 0:
                    pick = min(int(randoms[iteration, used] * untried), untried - 1)
                    used += 1
                    for a in range(kinds):
                        if children[node, a] == UNTRIED:
                            if pick == 0:
                                action = a
                                break
                            pick -= 1
                    added = True
                else:
                    spread = limits[2] - limits[1]
                    log_visits = math.log(max(tree[node, 0], 1.0))
                    top = -1.0e18
                    for a in range(kinds):
                        child = children[node, a]
                        if child >= 0:
                            mean = tree[child, 1] / tree[child, 0]
                            scaled = (mean - limits[1]) / spread if spread > 0.0 else 0.5
                            score = scaled + exploration * math.sqrt(log_visits / tree[child, 0])
                            if score > top:
                                top = score
                                action = a
            if children[node, action] == UNTRIED:
                s = node_states[node]
                h, n, e = advance(s[0], s[1], s[2], turns[action], steps[action, 0], steps[action, 1])
                node_states[count, 0], node_states[count, 1], node_states[count, 2] = h, n, e
                mark_choices(space, h, n, e, children[count])
                tree[count, 0] = 0.0
                tree[count, 1] = 0.0
                children[node, action] = count
                count += 1
            sequences[iteration, depth] = action
            node = children[node, action]
            depth += 1
            path[depth] = node
        tree_depth = depth
        if depth < horizon:  # random completion
            h, n, e = node_states[node, 0], node_states[node, 1], node_states[node, 2]
            rest = randoms[iteration, used : used + horizon - depth]
            sequences[iteration, depth:] = random_actions(space, h, n, e, rest)
        # ---- value
        best[:] = 0.0
        h, n, e = node_states[0, 0], node_states[0, 1], node_states[0, 2]
        count_places = 0
        for i in range(horizon):
            a = sequences[iteration, i]
            c = math.cos(h)
            s = math.sin(h)
            for k in range(samples.shape[1]):
                ahead = samples[a, k, 0]
                starboard = samples[a, k, 1]
                places[count_places, 0] = n + c * ahead - s * starboard
                places[count_places, 1] = e + s * ahead + c * starboard
                count_places += 1
            h, n, e = advance(h, n, e, turns[a], steps[a, 0], steps[a, 1])
        value = value_of(surrogate, places, best)
        values[iteration] = value
        limits[1] = min(limits[1], value)
        limits[2] = max(limits[2], value)
        for i in range(tree_depth + 1):
            tree[path[i], 0] += 1.0
            tree[path[i], 1] += value
    limits[0] = count


class LatticeSearch:
    """UCT that maximizes the surrogate."""

    def __init__(self, space: FreeSpace, surrogate: Surrogate, samples_per_leg: int) -> None:
        """Takes where to go, the surrogate, and the measurement places on a leg."""
        self._space, self._surrogate = space, surrogate
        motion = space.motion
        fractions = np.arange(1, samples_per_leg + 1) / samples_per_leg
        at = np.zeros(3)
        self._samples = np.stack([motion.along(at, a, fractions * motion.lengths_m[a]) for a in range(motion.actions)])
        if samples_per_leg == 1:
            self._samples[:, 0] = motion.steps_m

    def run(
        self,
        state: Array,
        horizon: int,
        iterations: int,
        exploration: float,
        rng: np.random.Generator,
        deadline: Callable[[], bool] | None,
        seeds: list[Actions],
    ) -> tuple[list[tuple[Actions, float]], int, bool]:
        """Searches from `state` (3,).

        Returns:
            Sequences with surrogate values, best first, each once; iterations done; whether the deadline hit.
        """
        kinds = self._space.motion.actions
        nodes = iterations + horizon * (len(seeds) + 1) + 2
        tree = np.zeros((nodes, 2))
        children = np.full((nodes, kinds), UNTRIED, dtype=np.int64)
        states = np.zeros((nodes, 3))
        states[0] = state
        arguments = self._space.arguments()
        mark_choices(arguments, states[0, 0], states[0, 1], states[0, 2], children[0])
        limits = np.array([1.0, np.inf, -np.inf])
        randoms = rng.random((iterations, 2 * horizon))
        seed_array = np.full((len(seeds), horizon), -1, dtype=np.int64)
        for i, seed in enumerate(seeds):
            cut = seed[:horizon]
            seed_array[i, : len(cut)] = cut
        sequences = np.zeros((iterations, horizon), dtype=np.int64)
        values = np.zeros(iterations)
        done, hit = 0, False
        while done < iterations:
            if done and deadline is not None and deadline():
                hit = True
                break
            end = min(done + CHUNK, iterations)
            run_chunk(
                arguments,
                self._surrogate.arguments(),
                self._samples,
                tree,
                children,
                states,
                limits,
                horizon,
                exploration,
                randoms,
                seed_array,
                sequences,
                values,
                done,
                end,
            )
            done = end
        order = np.argsort(-values[:done], kind="stable")
        ranking: dict[Actions, float] = {}
        for i in order:
            ranking.setdefault(tuple(int(a) for a in sequences[i]), float(values[i]))
            if len(ranking) >= 64:
                break
        return list(ranking.items()), done, hit
