"""Monte Carlo tree search (UCT) over actions, and the exhaustive search that it is measured against.

The tree's nodes are sequences of actions from the root state. An iteration descends by UCB on values scaled to 0..1
by the least and largest seen, adds one node, completes the sequence to the horizon by random feasible actions, and
has it valued. Sequences are valued in batches (one call of linear algebra for several): within a batch a node that
was just chosen counts as visited without a value yet, which spreads the batch over the tree.

The last part of the budget (`POLISH`) is spent on the best sequences found: all that differ from one in a single action
are valued, and the best of them is gone on from, until none is better. Values are exact and actions a few degrees
apart, so this finds what random completion only comes near. The best sequence ever valued is the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Actions = tuple[int, ...]

#: Share of the iterations that goes to changing single actions of the best sequences.
POLISH = 0.4
#: Only up to this horizon: over many legs the best printed reward is not the best path (docs/planner.md).
POLISH_UP_TO = 4

#: Values a list of sequences: an array of as many values.
Valuer = Callable[[list[Actions]], Array]


@dataclass(slots=True)
class _Node:
    state: Array
    untried: list[int]
    children: dict[int, _Node] = field(default_factory=dict)
    visits: int = 0
    valued: int = 0
    total: float = 0.0


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


class TreeSearch:
    """UCT from one root state."""

    def __init__(
        self,
        choices: Callable[[Array], NDArray[np.int64]],
        end_state: Callable[[Array, int], Array],
        valuer: Valuer,
        horizon: int,
        exploration: float,
        batch: int,
        rng: np.random.Generator,
        complete: Callable[[Array, int, np.random.Generator], NDArray[np.int64]] | None = None,
    ) -> None:
        """Sets up a search.

        Args:
            choices: Actions that may be taken in a state; never empty.
            end_state: State after an action.
            valuer: Values sequences of `horizon` actions.
            horizon: Length of the sequences.
            exploration: Exploration constant, on values scaled to 0..1.
            batch: Sequences valued together.
            rng: Random stream.
            complete: So many actions by chance from a state; by default one after another from `choices`.
        """
        self._complete = complete or self._complete_by_choices
        self._choices, self._end_state, self._valuer = choices, end_state, valuer
        self._horizon, self._exploration, self._batch, self._rng = horizon, exploration, max(1, batch), rng
        self._memo: dict[Actions, float] = {}
        self._low, self._high = math.inf, -math.inf
        self._progress: list[tuple[int, float]] = []

    def run(
        self,
        state: Array,
        iterations: int,
        deadline: Callable[[], bool] | None = None,
        seeds: Sequence[Actions] = (),
    ) -> SearchResult:
        """Searches from `state` (3,).

        Args:
            state: Root state.
            iterations: Budget.
            deadline: Says when to stop; asked between batches, after the first.
            seeds: Sequences tried first (the last search's best, moved on); infeasible ones are skipped, short ones
                completed at random.

        Returns:
            The best sequence; there always is one, as the first batch is valued whatever the deadline says.
        """
        root = self._node(np.asarray(state, dtype=float), ())
        done = 0
        hit = False
        starts = [s for s in seeds if self._admissible(root, s)]
        polish = POLISH if self._horizon <= POLISH_UP_TO else 0.0
        grown = max(1, iterations - int(polish * iterations))
        while done < grown:
            if done and deadline is not None and deadline():
                hit = True
                break
            # the first batch is small, so that a short deadline still finds something
            size = min(self._batch if done else min(self._batch, max(2, len(starts))), grown - done)
            chosen = [self._descend(root, starts.pop(0) if starts else ()) for _ in range(size)]
            self._value([actions for _, actions in chosen], done)
            for path, actions in chosen:
                value = self._memo[actions]
                for node in path:
                    node.valued += 1
                    node.total += value
            done += size
        if not hit and polish > 0.0:
            done, hit = self._polish(root.state, done, iterations, deadline)
        ranking = sorted(self._memo.items(), key=lambda item: (-item[1], item[0]))[:64]
        best, value = ranking[0]
        return SearchResult(best, value, done, len(self._memo), hit, ranking, self._progress)

    def _polish(
        self, state: Array, done: int, iterations: int, deadline: Callable[[], bool] | None
    ) -> tuple[int, bool]:
        """Single changes of the best sequences until the budget is spent; returns iterations done and deadline hit."""
        finished: set[Actions] = set()
        while done < iterations:
            open_ = [s for s in self._memo if s not in finished]
            if not open_:
                break
            current = max(open_, key=lambda s: self._memo[s])
            finished.add(current)
            changes = [s for s in self._changes(state, current) if s not in self._memo]
            changes = [changes[i] for i in self._rng.permutation(len(changes))][: iterations - done]
            for begin in range(0, len(changes), self._batch):
                if deadline is not None and deadline():
                    return done, True
                part = changes[begin : begin + self._batch]
                self._value(part, done)
                done += len(part)
        return done, False

    def _changes(self, state: Array, sequence: Actions) -> list[Actions]:
        """Admissible sequences that differ from `sequence` in one action."""
        states = [state]
        for action in sequence:
            states.append(self._end_state(states[-1], action))
        found = []
        for i, old in enumerate(sequence):
            options = self._choices(states[i])
            for action in options:
                if action == old:
                    continue
                changed = (*sequence[:i], int(action), *sequence[i + 1 :])
                at, admissible = self._end_state(states[i], int(action)), True
                for later in sequence[i + 1 :]:
                    if later not in self._choices(at):
                        admissible = False
                        break
                    at = self._end_state(at, later)
                if admissible:
                    found.append(changed)
        return found

    def _node(self, state: Array, prefix: Actions) -> _Node:
        actions = self._choices(state)
        untried = [int(a) for a in self._rng.permutation(actions)] if len(prefix) < self._horizon else []
        return _Node(state, untried)

    def _admissible(self, root: _Node, actions: Actions) -> bool:
        state = root.state
        for action in actions[: self._horizon]:
            if action not in self._choices(state):
                return False
            state = self._end_state(state, action)
        return True

    def _descend(self, root: _Node, forced: Actions) -> tuple[list[_Node], Actions]:
        node, path = root, [root]
        node.visits += 1
        actions: list[int] = []
        added = False
        while len(actions) < self._horizon and not added:
            if len(actions) < len(forced):
                action = forced[len(actions)]
                if action in node.untried:
                    node.untried.remove(action)
            elif node.untried:
                action = node.untried.pop()
                added = True
            else:
                action = self._select(node)
            if action not in node.children:
                node.children[action] = self._node(self._end_state(node.state, action), (*actions, action))
            node = node.children[action]
            node.visits += 1
            actions.append(action)
            path.append(node)
        missing = self._horizon - len(actions)
        if missing:
            actions.extend(int(a) for a in self._complete(node.state, missing, self._rng))
        return path, tuple(actions)

    def _complete_by_choices(self, state: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        actions = np.empty(count, dtype=np.int64)
        for i in range(count):
            options = self._choices(state)
            actions[i] = options[int(rng.integers(len(options)))]
            state = self._end_state(state, int(actions[i]))
        return actions

    def _select(self, node: _Node) -> int:
        spread = self._high - self._low
        log_visits = math.log(max(node.visits, 1))
        best, best_score = -1, -math.inf
        for action, child in node.children.items():
            mean = (child.total / child.valued - self._low) / spread if child.valued and spread > 0.0 else 0.5
            mean *= child.valued / child.visits if child.visits else 1.0  # visits without a value yet count as 0
            score = mean + self._exploration * math.sqrt(log_visits / max(child.visits, 1))
            if score > best_score:
                best, best_score = action, score
        return best

    def _value(self, sequences: list[Actions], done: int) -> None:
        new = [s for s in dict.fromkeys(sequences) if s not in self._memo]
        if not new:
            return
        for sequence, value in zip(new, self._valuer(new), strict=True):
            self._memo[sequence] = float(value)
            self._low = min(self._low, float(value))
            if value > self._high:
                self._high = float(value)
                self._progress.append((done, self._high))


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
