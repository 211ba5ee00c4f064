"""References of the search in plain Python: a tree of objects, UCT on it, and the search of all sequences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_planner.search.uct import Actions, SearchResult, Valuer, run_search


@dataclass(slots=True)
class _Node:
    state: Array
    untried: list[int]
    children: dict[int, _Node] = field(default_factory=dict)
    visits: int = 0
    valued: int = 0
    total: float = 0.0


class ObjectTree:
    """A `Tree` of Python objects over any states and actions, simple and slow: the tests hold `ActionTree` to it."""

    def __init__(
        self,
        choices: Callable[[Array], Ints],
        end_state: Callable[[Array, int], Array],
        state: Array,
        horizon: int,
        exploration: float,
        complete: Callable[[Array, Array], Ints] | None = None,
    ) -> None:
        """Makes the tree of `state` alone; the other arguments are those of `TreeSearch`."""
        self._choices, self._end_state = choices, end_state
        self._complete = complete or self._complete_by_choices
        self._horizon, self._exploration = horizon, exploration
        self._low, self._high = math.inf, -math.inf
        self._root = self._node(np.asarray(state, dtype=float), 0)
        self._paths: list[list[_Node]] = []

    def admissible(self, actions: Actions) -> bool:
        """See `Tree`."""
        return self._leads_on(self._root.state, actions[: self._horizon])

    def grow(self, forced: Ints, randoms: Array) -> Ints:
        """See `Tree`."""
        self._paths = []
        return np.array([self._descend([int(a) for a in f if a >= 0], r) for f, r in zip(forced, randoms, strict=True)])

    def back_up(self, values: Array) -> None:
        """See `Tree`."""
        for path, value in zip(self._paths, values, strict=True):
            for node in path:
                node.valued += 1
                node.total += float(value)
        self._low, self._high = min(self._low, float(values.min())), max(self._high, float(values.max()))

    def changes(self, sequence: Actions) -> Ints:
        """See `Tree`."""
        found: list[Actions] = []
        state = self._root.state
        for i, old in enumerate(sequence):
            for action in self._choices(state):
                if action != old and self._leads_on(self._end_state(state, int(action)), sequence[i + 1 :]):
                    found.append((*sequence[:i], int(action), *sequence[i + 1 :]))
            state = self._end_state(state, old)
        return np.array(found, dtype=np.int64).reshape(-1, len(sequence))

    def _leads_on(self, state: Array, actions: Actions) -> bool:
        for action in actions:
            if action not in self._choices(state):
                return False
            state = self._end_state(state, action)
        return True

    def _node(self, state: Array, depth: int) -> _Node:
        return _Node(state, [int(a) for a in self._choices(state)] if depth < self._horizon else [])

    def _descend(self, forced: list[int], randoms: Array) -> list[int]:
        node, path = self._root, [self._root]
        node.visits += 1
        actions: list[int] = []
        used = 0
        while len(actions) < self._horizon and not used:
            if len(actions) < len(forced):
                action = forced[len(actions)]
                if action in node.untried:
                    node.untried.remove(action)
            elif node.untried:
                action = node.untried.pop(_pick(randoms[0], len(node.untried)))
                used = 1
            else:
                action = self._select(node)
            if action not in node.children:
                node.children[action] = self._node(self._end_state(node.state, action), len(actions) + 1)
            node = node.children[action]
            node.visits += 1
            actions.append(action)
            path.append(node)
        self._paths.append(path)
        missing = self._horizon - len(actions)
        return [*actions, *(int(a) for a in self._complete(node.state, randoms[used : used + missing]))]

    def _complete_by_choices(self, state: Array, randoms: Array) -> Ints:
        actions = np.empty(len(randoms), dtype=np.int64)
        for i, random in enumerate(randoms):
            options = self._choices(state)
            actions[i] = options[_pick(random, len(options))]
            state = self._end_state(state, int(actions[i]))
        return actions

    def _select(self, node: _Node) -> int:
        spread = self._high - self._low
        log_visits = math.log(max(node.visits, 1))
        best, best_score = -1, -math.inf
        for action, child in sorted(node.children.items()):
            mean = (child.total / child.valued - self._low) / spread if child.valued and spread > 0.0 else 0.5
            mean *= child.valued / child.visits if child.visits else 1.0  # visits without a value yet count as 0
            score = mean + self._exploration * math.sqrt(log_visits / max(child.visits, 1))
            if score > best_score:
                best, best_score = action, score
        return best


def _pick(random: float, count: int) -> int:
    return min(int(random * count), count - 1)


class TreeSearch:
    """UCT over any states and actions, in plain Python: `run_search` on an `ObjectTree`."""

    def __init__(
        self,
        choices: Callable[[Array], Ints],
        end_state: Callable[[Array, int], Array],
        valuer: Valuer,
        horizon: int,
        exploration: float,
        batch: int,
        rng: np.random.Generator,
        complete: Callable[[Array, Array], Ints] | None = None,
    ) -> None:
        """Sets up a search.

        Args:
            choices: Actions that may be taken in a state, in ascending order; never empty.
            end_state: State after an action.
            valuer: Values sequences of `horizon` actions.
            horizon: Length of the sequences.
            exploration: Exploration constant, on values scaled to 0..1.
            batch: Sequences valued together.
            rng: Random stream.
            complete: Actions by chance from a state, one for each of the uniform numbers; by default one after another
                from `choices`.
        """
        self._choices, self._end_state, self._valuer, self._complete = choices, end_state, valuer, complete
        self._horizon, self._exploration, self._batch, self._rng = horizon, exploration, max(1, batch), rng

    def run(
        self,
        state: Array,
        iterations: int,
        deadline: Callable[[], bool] | None = None,
        seeds: Sequence[Actions] = (),
    ) -> SearchResult:
        """Searches from `state` (3,); see `run_search`."""
        tree = ObjectTree(self._choices, self._end_state, state, self._horizon, self._exploration, self._complete)
        return run_search(tree, self._valuer, self._horizon, iterations, self._batch, self._rng, deadline, seeds)


def exhaustive_search(
    choices: Callable[[Array], Ints],
    end_state: Callable[[Array, int], Array],
    valuer: Valuer,
    state: Array,
    horizon: int,
    batch: int = 64,
) -> SearchResult:
    """Values every admissible sequence: the yardstick of the tree search (A^m sequences)."""
    frontier: list[tuple[Actions, Array]] = [((), np.asarray(state, dtype=float))]
    for _ in range(horizon):
        frontier = [((*p, int(a)), end_state(s, int(a))) for p, s in frontier for a in choices(s)]
    sequences = [p for p, _ in frontier]
    values = np.concatenate([valuer(sequences[i : i + batch]) for i in range(0, len(sequences), batch)])
    order = np.argsort(-values, kind="stable")
    ranking = [(sequences[i], float(values[i])) for i in order[:64]]
    return SearchResult(*ranking[0], len(sequences), len(sequences), False, ranking)
