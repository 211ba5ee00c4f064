"""Monte Carlo tree search (UCT) over actions: one search for every reward.

The tree defines the admissible actions, the valuer evaluates sequences, and the batch is the number of sequences
evaluated together. `PathSequences` evaluates at the path's own places. `JointDraws` evaluates on the map, averaged over
the team mates' possible plans (Dec-MCTS).

The tree's nodes are sequences of actions from the root state. An iteration descends by UCB on values scaled to 0..1
by the least and largest seen, adds one node, completes the sequence to the horizon by random feasible actions, and
has it valued. Sequences are valued in batches (one call of linear algebra for several). Within a batch a node that
was just chosen counts as visited without a value yet, which spreads the batch over the tree.

The last part of the budget (`POLISH`) goes to the best sequences found. All sequences that differ from one of them in a
single action are valued; then the same is done with the best of all sequences, until none is better. Values are exact
and actions a few degrees apart, so this finds what random completion only comes near. The best sequence ever valued is
the result.

The tree is compiled (`tree.ActionTree`); the tests compare it with one of plain Python objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auv_lse_planner.search.tree import ActionTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Actions = tuple[int, ...]

#: Share of the iterations that goes to changing single actions of the best sequences.
POLISH = 0.4
#: Only up to this horizon: over many legs the path with the paper's best reward is not the best one
#: (docs/evidence/planner-trials.md).
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
    """

    actions: Actions
    value: float
    iterations: int = 0
    evaluations: int = 0
    deadline_hit: bool = False
    ranking: list[tuple[Actions, float]] = field(default_factory=list)


def run_search(
    tree: ActionTree,
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
        deadline: Returns whether to stop; checked between batches, after the first.
        seeds: Sequences tried first (the last search's best, moved on); infeasible ones are skipped, short ones
            completed at random.

    Returns:
        The best sequence. It always exists, since the first batch is evaluated regardless of the deadline.
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
        tree.back_up(memo.value([tuple(s) for s in sequences.tolist()]))
        done += size
    if not hit and polish > 0.0:
        done, hit = _polish(tree, memo, done, iterations, batch, rng, deadline)
    ranking = sorted(memo.values.items(), key=lambda item: (-item[1], item[0]))[:RANKED]
    best, value = ranking[0]
    return SearchResult(best, value, done, len(memo.values), hit, ranking)


class _Memo:
    """Values of sequences, each evaluated once."""

    def __init__(self, valuer: Valuer) -> None:
        self._valuer = valuer
        self.values: dict[Actions, float] = {}

    def value(self, sequences: list[Actions]) -> Array:
        new = [s for s in dict.fromkeys(sequences) if s not in self.values]
        if new:
            self.values.update(zip(new, self._valuer(new).tolist(), strict=True))
        return np.array([self.values[s] for s in sequences])


def _polish(
    tree: ActionTree,
    memo: _Memo,
    done: int,
    iterations: int,
    batch: int,
    rng: np.random.Generator,
    deadline: Callable[[], bool] | None,
) -> tuple[int, bool]:
    """Values single changes of the best sequences until the budget is spent; gives iterations done, deadline hit."""
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
            memo.value(part)
            done += len(part)
    return done, False
