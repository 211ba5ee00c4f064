"""Monte Carlo tree search (UCT) over actions, for any reward.

The tree defines the admissible actions, and the valuer evaluates sequences, for example `PathSequences`.

Nodes are sequences of actions from the root state. An iteration descends by UCB on values scaled to [0, 1], adds one
node, and completes the sequence to the horizon with random feasible actions. Sequences are evaluated in batches. Within
a batch, a node just selected counts as visited without a value, which spreads the batch over the tree.

The share `POLISH` of the iterations is a local search. It evaluates all sequences that differ in one action from the
best one, and continues with the next best until the budget is spent. The result is the best sequence evaluated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_planner.search.tree import ActionTree

Actions = tuple[int, ...]

#: Share of the iterations that change single actions of the best sequences.
POLISH = 0.4
#: Longest horizon with polishing: over many legs the path with the best paper reward does not give the best map.
POLISH_UP_TO = 4
#: Largest number of sequences in a ranking.
RANKED = 64

#: Returns the values (B,) of B sequences.
Valuer = Callable[[list[Actions]], Array]


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The result of a search.

    Attributes:
        actions: Best sequence.
        deadline_hit: Whether the deadline ended the search before its budget.
        ranking: Evaluated sequences with their values, best first (at most `RANKED`).
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
    """Searches for the sequence with the largest value.

    Args:
        tree: Fresh tree of the root state.
        valuer: Evaluates sequences of `horizon` actions.
        horizon: Length of the sequences.
        batch: Number of sequences evaluated together.
        deadline: Returns whether to stop; checked after each batch.
        seeds: Sequences to try first. Infeasible ones are skipped, short ones completed at random.

    Returns:
        The best sequence, at least of the first batch, which ignores the deadline.
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
    """Evaluates single changes of the best sequences within the budget; returns iterations done, deadline hit."""
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
