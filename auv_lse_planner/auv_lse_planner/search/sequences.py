"""Values of action sequences from one state: the bridge between the search (actions) and the reward (places)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.plan import NONE
from auv_lse_gp.area import Grid
from auv_lse_gp.columns import ColumnPool, Columns, join_by_path
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.prefixes import Prefixes
from auv_lse_planner.search.tree import every_sequence

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Actions = tuple[int, ...]

#: Most sequences that `promising` values.
MOST_HEADS = 1500
#: How many of them are valued together.
HEADS_AT_ONCE = 256
#: How many naive paths are guessed between two looks at the deadline.
GUESSES_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Continuation:
    """A sequence with the naive path that suits it best.

    Attributes:
        value: Value of both together.
        naive_path: Id of the naive path, 0xFF if none.
    """

    value: float
    naive_path: int


class PathSequences:
    """Path reward of action sequences, each continued by the best of the naive paths.

    Places that sequences share (a common beginning) are looked up once.
    """

    def __init__(
        self,
        reward: PathReward,
        motion: MotionTable,
        naive: NaivePaths,
        state: Array,
        steps_left: int,
        naive_paths: tuple[int, ...],
        samples_per_leg: int,
        grid: Grid | None = None,
    ) -> None:
        """Prepares for sequences from `state`.

        Args:
            reward: Reward, with data and team mates' places fixed.
            motion: Actions.
            naive: Naive paths.
            state: Root state, shape (3,).
            steps_left: Steps to the mission's end.
            naive_paths: Ids of the naive paths to choose from; empty for none.
            samples_per_leg: Measurement places on a leg.
            grid: Grid of places over the area, to guess what naive paths bring; None: not guessed.
        """
        self._grid = grid
        self._reward, self._motion, self._naive = reward, motion, naive
        self._steps_left, self._naive_paths, self._samples = steps_left, naive_paths, samples_per_leg
        self._root = np.array(state, dtype=float)
        self._prefixes = Prefixes(motion, self._root)
        self._pool = ColumnPool(len(reward.posterior))
        self.continuations: dict[Actions, Continuation] = {}

    def promising(
        self,
        space: FreeSpace,
        horizon: int,
        overall: int,
        per_first: int,
        deadline: Callable[[], bool] | None = None,
    ) -> list[Actions]:
        """Sequences that promise most: what a search should try first.

        All of them are valued, together and exactly, which costs about as much as ten with naive paths; so only where
        there are not more than `MOST_HEADS` (three legs of eleven actions). What the naive paths add is guessed as the
        risk in hand along them: little of it is left at a place that is measured.

        Args:
            space: Where to go.
            horizon: Length of the sequences.
            overall: How many of the best.
            per_first: How many of the best of each first action.
            deadline: Says when to stop guessing; what is not guessed by then is left out, unless nothing is.

        Returns:
            Sequences, best first; none if there would be too many to value.
        """
        if self._motion.actions**horizon > MOST_HEADS or (deadline is not None and deadline()):
            return []
        heads = np.asarray(every_sequence(space.arguments(), self._root, horizon))
        numbers, new = self._numbered(heads)
        self._pool.add(self._reward.posterior.columns(new))
        values = np.concatenate(
            [self._head_values(numbers[i : i + HEADS_AT_ONCE]) for i in range(0, len(heads), HEADS_AT_ONCE)]
        )
        order = np.argsort(-values, kind="stable")
        if self._naive_paths and self._grid is not None and not (deadline is not None and deadline()):
            risk = self._grid.fill(
                self._reward.before(self._reward.posterior.columns(self._grid.places_m)), outside=0.0
            )
            every = len(heads) if deadline is None else GUESSES_AT_ONCE
            guessed = 0
            while guessed < len(heads) and (guessed == 0 or deadline is None or not deadline()):
                part = order[guessed : guessed + every]
                values[part] += self._tails_roughly(self._prefixes.states(numbers[part, -1]), horizon, risk)
                guessed += len(part)
            order = order[:guessed][np.argsort(-values[order[:guessed]], kind="stable")]
        chosen = dict.fromkeys(tuple(h) for h in heads[order[:overall]].tolist())
        taken = np.zeros(self._motion.actions, dtype=int)
        for head in heads[order].tolist():
            if taken[head[0]] < per_first:
                taken[head[0]] += 1
                chosen[tuple(head)] = None
        return list(chosen)

    def _tails_roughly(self, states: Array, legs: int, risk: Array) -> Array:
        """Risk in hand along the best of the naive paths from each of `states` (B, 3), after so many legs."""
        assert self._grid is not None
        left = self._steps_left - legs
        rough = [self._naive.sums_along(states, h, left, risk, self._grid) for h in self._naive_paths]
        return np.asarray(self._samples * np.max(rough, axis=0))

    def _numbered(self, sequences: Ints) -> tuple[Ints, Array]:
        """Numbers (B, L) of all beginnings of sequences (B, L), and the places (P, 2) of those that are new."""
        first = self._prefixes.count
        numbers = self._prefixes.enter(sequences)
        return numbers, self._prefixes.leg_places(first, self._samples)

    def _heads(self, numbers: Ints) -> Columns:
        """Places of sequences given by the numbers of their beginnings, (B, L): B * L * samples of them."""
        legs = (numbers - 1) * self._samples  # the empty beginning has no place
        return self._pool.take((legs[:, :, None] + np.arange(self._samples)).ravel())

    def _head_values(self, numbers: Ints) -> Array:
        return self._reward.values_of_equal(self._heads(numbers), numbers.shape[1] * self._samples)

    def path_places(self, sequence: Actions, naive_path: int) -> Array:
        """Measurement places (P, 2) of a sequence continued by a naive path."""
        states = self._motion.roll(self._root, sequence)
        tail = self._naive.actions(states[-1], naive_path, self._steps_left - len(sequence))
        actions = np.concatenate([np.array(sequence, dtype=np.int64), tail])
        states = self._motion.roll(self._root, actions)
        return self._motion.sample_places(states[:-1], actions, self._samples)

    def __call__(self, sequences: Sequence[Actions]) -> Array:
        """Values (B,) of sequences of the same length."""
        actions = np.array(sequences, dtype=np.int64)
        numbers, new = self._numbered(actions)
        ends = self._prefixes.states(numbers[:, -1])
        left = self._steps_left - actions.shape[1]
        tails = [self._naive.places_from(ends, h, left, self._samples) for h in self._naive_paths]
        columns = self._reward.posterior.columns(np.concatenate([new, *(t.reshape(-1, 2) for t in tails)]))
        self._pool.add(columns.slice(0, len(new)))
        if not tails:
            alone = self._head_values(numbers)
            for sequence, value in zip(sequences, alone.tolist(), strict=True):
                self.continuations[sequence] = Continuation(value, NONE)
            return alone
        heads = self._heads(numbers)
        values = np.empty((len(tails), len(actions)))
        begin = len(new)
        for row, tail in zip(values, tails, strict=True):
            end = begin + tail.shape[0] * tail.shape[1]
            joined = join_by_path(heads, columns.slice(begin, end), len(actions))
            row[:] = self._reward.values_of_equal(joined, len(joined) // len(actions))
            begin = end
        best: Array = values.max(axis=0)
        for i, sequence in enumerate(sequences):
            self.continuations[sequence] = Continuation(float(best[i]), self._naive_paths[int(values[:, i].argmax())])
        return best
