"""Monte Carlo tree search (UCT) over actions, and the exhaustive search that it is measured against.

The tree's nodes are sequences of actions from the root state. An iteration descends by UCB on values scaled to 0..1
by the least and largest seen, adds one node, completes the sequence to the horizon by random feasible actions, and
has it valued. Sequences are valued in batches (one call of linear algebra for several): within a batch a node that
was just chosen counts as visited without a value yet, which spreads the batch over the tree.

The last part of the budget (`POLISH`) is spent on the best sequences found: all that differ from one in a single action
are valued, and the best of them is gone on from, until none is better. Values are exact and actions a few degrees
apart, so this finds what random completion only comes near. The best sequence ever valued is the result.

`run_search` drives any `Tree`: `action_tree.ActionTree`, compiled, for the actions of a vehicle, and here `ObjectTree`,
in plain Python for any states and actions, which it is tested against. Random numbers are drawn beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Actions = tuple[int, ...]

#: Share of the iterations that goes to changing single actions of the best sequences.
POLISH = 0.4
#: Only up to this horizon: over many legs the best printed reward is not the best path (docs/planner.md).
POLISH_UP_TO = 4
#: Sequences in a ranking.
RANKED = 64

#: Values a list of sequences: an array of as many values.
Valuer = Callable[[list[Actions]], Array]


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What a search found.

    Attributes:
        actions: Best sequence.
        value: Its value.
        iterations: Iterations done.
        evaluations: Different sequences valued.
        deadline_hit: Whether the deadline ended the search before its budget.
        ranking: Valued sequences with their values, best first (at most 64).
        progress: (iteration, best value so far) at every improvement.
    """

    actions: Actions
    value: float
    iterations: int
    evaluations: int
    deadline_hit: bool
    ranking: list[tuple[Actions, float]]
    progress: list[tuple[int, float]]


class Tree(Protocol):
    """What `run_search` needs of a tree: where to descend, and which sequences there are."""

    def admissible(self, actions: Actions) -> bool:
        """Whether the actions, up to the horizon, may be taken one after another from the root."""

    def grow(self, forced: Ints, randoms: Array) -> Ints:
        """Descends once for each row, one after another, each adding a node.

        Args:
            forced: Actions to begin with, -1 after their end, shape (B, horizon); they are admissible.
            randoms: Uniform numbers in [0, 1), shape (B, horizon): the first that is needed picks the node to add
                among those untried, the others complete the sequence.

        Returns:
            Sequences, shape (B, horizon).
        """

    def credit(self, values: Array) -> None:
        """Takes the values (B,) of the sequences that the last `grow` gave."""

    def changes(self, sequence: Actions) -> Ints:
        """Admissible sequences (M, horizon) that differ from `sequence` in one action."""


def run_search(
    tree: Tree,
    valuer: Valuer,
    horizon: int,
    iterations: int,
    batch: int,
    rng: np.random.Generator,
    deadline: Callable[[], bool] | None = None,
    seeds: Sequence[Actions] = (),
) -> SearchResult:
    """Searches for the sequence of the largest value.

    Args:
        tree: Fresh tree of the root state.
        valuer: Values sequences of `horizon` actions.
        horizon: Length of the sequences.
        iterations: Budget.
        batch: Sequences valued together.
        rng: Random stream.
        deadline: Says when to stop; asked between batches, after the first.
        seeds: Sequences tried first (the last search's best, moved on); infeasible ones are skipped, short ones
            completed at random.

    Returns:
        The best sequence; there always is one, as the first batch is valued whatever the deadline says.
    """
    done, hit = 0, False
    memo = _Memo(valuer)
    polish = POLISH if horizon <= POLISH_UP_TO else 0.0
    grown = max(1, iterations - int(polish * iterations))
    starts = [s[:horizon] for s in seeds if tree.admissible(s)][:grown]
    forced = np.full((grown, horizon), -1, dtype=np.int64)
    for row, start in zip(forced, starts, strict=False):
        row[: len(start)] = start
    randoms = rng.random((grown, horizon))
    while done < grown:
        if done and deadline is not None and deadline():
            hit = True
            break
        # the first batch is small, so that a short deadline still finds something
        size = min(batch if done else min(batch, max(2, len(starts))), grown - done)
        sequences = tree.grow(forced[done : done + size], randoms[done : done + size])
        tree.credit(memo.value([tuple(s) for s in sequences.tolist()], done))
        done += size
    if not hit and polish > 0.0:
        done, hit = _polish(tree, memo, done, iterations, batch, rng, deadline)
    ranking = sorted(memo.values.items(), key=lambda item: (-item[1], item[0]))[:RANKED]
    best, value = ranking[0]
    return SearchResult(best, value, done, len(memo.values), hit, ranking, memo.progress)


class _Memo:
    """Values of sequences, each asked for once, and the improvements."""

    def __init__(self, valuer: Valuer) -> None:
        self._valuer = valuer
        self.values: dict[Actions, float] = {}
        self.progress: list[tuple[int, float]] = []

    def value(self, sequences: list[Actions], done: int) -> Array:
        new = [s for s in dict.fromkeys(sequences) if s not in self.values]
        if new:
            for sequence, value in zip(new, self._valuer(new).tolist(), strict=True):
                self.values[sequence] = value
                if not self.progress or value > self.progress[-1][1]:
                    self.progress.append((done, value))
        return np.array([self.values[s] for s in sequences])


def _polish(
    tree: Tree,
    memo: _Memo,
    done: int,
    iterations: int,
    batch: int,
    rng: np.random.Generator,
    deadline: Callable[[], bool] | None,
) -> tuple[int, bool]:
    """Single changes of the best sequences until the budget is spent; returns iterations done and deadline hit."""
    finished: set[Actions] = set()
    while done < iterations:
        unfinished = [s for s in memo.values if s not in finished]
        if not unfinished:
            break
        current = max(unfinished, key=lambda s: memo.values[s])
        finished.add(current)
        changes = [s for s in map(tuple, tree.changes(current).tolist()) if s not in memo.values]
        changes = [changes[i] for i in rng.permutation(len(changes))][: iterations - done]
        for begin in range(0, len(changes), batch):
            if deadline is not None and deadline():
                return done, True
            part = changes[begin : begin + batch]
            memo.value(part, done)
            done += len(part)
    return done, False


@dataclass(slots=True)
class _Node:
    state: Array
    untried: list[int]
    children: dict[int, _Node] = field(default_factory=dict)
    visits: int = 0
    valued: int = 0
    total: float = 0.0


class ObjectTree:
    """A `Tree` of Python objects over any states and actions: simple and slow."""

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

    def credit(self, values: Array) -> None:
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
    choices: Callable[[Array], NDArray[np.int64]],
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
    return SearchResult(*ranking[0], len(sequences), len(sequences), False, ranking, [(0, ranking[0][1])])
