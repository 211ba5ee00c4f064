"""Values of action sequences from one state: the bridge between the search (actions) and the reward (places)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.area import Grid
from auv_lse_planner.motion import MotionTable
from auv_lse_planner.naive import NONE, NaivePaths
from auv_lse_planner.path_reward import PathReward
from auv_lse_planner.posterior import ColumnPool, Columns, join

Array = NDArray[np.float64]

#: Most sequences that `promising` values.
MOST_HEADS = 1500
Actions = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Continuation:
    """A sequence with the naive path that suits it best.

    Attributes:
        value: Value of both together.
        heuristic: Id of the naive path, 0xFF if none.
    """

    value: float
    heuristic: int


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
        heuristics: tuple[int, ...],
        samples_per_leg: int,
        risk: tuple[Array, Grid] | None = None,
    ) -> None:
        """Prepares for sequences from `state`.

        Args:
            reward: Reward, with data and team mates' places fixed.
            motion: Actions.
            naive: Naive paths.
            state: Root state, shape (3,).
            steps_left: Steps to the mission's end.
            heuristics: Ids of the naive paths to choose from; empty for none.
            samples_per_leg: Measurement places on a leg.
            risk: Risk in hand on a grid (N, E), to guess what naive paths bring; None: not guessed.
        """
        self._risk = risk
        self._reward, self._motion, self._naive = reward, motion, naive
        self._steps_left, self._heuristics, self._samples = steps_left, heuristics, samples_per_leg
        self._states: dict[Actions, Array] = {(): np.asarray(state, dtype=float)}
        self._pool = ColumnPool(reward.posterior.data_rows + reward.posterior.planned_rows)
        self._numbers: dict[Actions, int] = {}  # of a leg's first place in the pool
        self.continuations: dict[Actions, Continuation] = {}

    def _state(self, prefix: Actions) -> Array:
        state = self._states.get(prefix)
        if state is None:
            state = self._motion.end_state(self._state(prefix[:-1]), prefix[-1])
            self._states[prefix] = state
        return state

    def promising(
        self,
        choices: Callable[[Array], NDArray[np.int64]],
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
            choices: Actions that may be taken in a state.
            horizon: Length of the sequences.
            overall: How many of the best.
            per_first: How many of the best of each first action.
            deadline: Says when to stop valuing and guessing; what is not done by then is left out.

        Returns:
            Sequences, best first; none if there would be too many to value.
        """
        if self._motion.actions**horizon > MOST_HEADS:
            return []
        heads: list[Actions] = [()]
        for _ in range(horizon):
            heads = [(*h, int(a)) for h in heads for a in choices(self._state(h))]
        if deadline is not None and deadline():
            return []
        self._look_up(list(dict.fromkeys(h[:i] for h in heads for i in range(1, horizon + 1))))
        values = np.concatenate([self._head_values(heads[i : i + 256]) for i in range(0, len(heads), 256)])
        if self._heuristics and self._risk is not None:
            every = len(heads) if deadline is None else 64
            order = np.argsort(-values, kind="stable")
            for begin in range(0, len(heads), every):
                if deadline is not None and deadline():
                    order = order[:begin]
                    break
                part = order[begin : begin + every]
                values[part] = self._with_tails_roughly([heads[i] for i in part], values[part])
            heads, values = [heads[i] for i in order], values[order]
        order = np.argsort(-values, kind="stable")
        chosen = dict.fromkeys(heads[i] for i in order[:overall])
        taken: dict[int, int] = {}
        for i in order:
            first = heads[i][0]
            if taken.get(first, 0) < per_first:
                taken[first] = taken.get(first, 0) + 1
                chosen[heads[i]] = None
        return list(chosen)

    def _with_tails_roughly(self, heads: list[Actions], values: Array) -> Array:
        """The heads with their values, and the risk in hand along the best of their naive paths added."""
        assert self._risk is not None
        field, grid = self._risk
        states = np.array([self._state(h) for h in heads])
        left = self._steps_left - len(heads[0])
        rough = [self._naive.sums_along(states, h, left, field, grid) for h in self._heuristics]
        return np.asarray(values + self._samples * np.max(rough, axis=0))

    def _head_values(self, heads: list[Actions]) -> Array:
        within = np.arange(self._samples)
        numbers = np.array([[self._numbers[h[:i]] for i in range(1, len(h) + 1)] for h in heads], dtype=np.int64)
        columns = self._pool.take((numbers[:, :, None] + within).ravel())
        return self._reward.values_with_tail(columns, numbers.shape[1] * self._samples, None)

    def _look_up(self, prefixes: list[Actions]) -> None:
        """Takes the places of new prefixes into the pool."""
        new = [p for p in prefixes if p not in self._numbers]
        if not new:
            return
        first = self._pool.add(self._reward.posterior.columns(np.concatenate([self._leg_places(p) for p in new])))
        for i, prefix in enumerate(new):
            self._numbers[prefix] = first + i * self._samples

    def _leg_places(self, prefix: Actions) -> Array:
        """Measurement places of the last leg of `prefix`."""
        if self._samples == 1:
            return self._state(prefix)[None, 1:]
        return self._motion.sample_places(self._state(prefix[:-1])[None], np.array(prefix[-1:]), self._samples)

    def path_places(self, sequence: Actions, heuristic: int) -> Array:
        """Measurement places (P, 2) of a sequence continued by a naive path."""
        state = self._state(sequence)
        tail = self._naive.actions(state, heuristic, self._steps_left - len(sequence))
        actions = np.concatenate([np.array(sequence, dtype=np.int64), tail])
        states = self._motion.roll(self._state(()), actions)
        return self._motion.sample_places(states[:-1], actions, self._samples)

    def __call__(self, sequences: list[Actions]) -> Array:
        """Values of sequences, shape (len(sequences),)."""
        wanted, sequences = sequences, list(dict.fromkeys(sequences))
        new = list(dict.fromkeys(s[:i] for s in sequences for i in range(1, len(s) + 1) if s[:i] not in self._numbers))
        tails = {
            (s, h): self._naive.path_places(self._state(s), h, self._steps_left - len(s), self._samples)
            for s in sequences
            for h in self._heuristics
        }
        legs = [self._leg_places(p) for p in new]
        places = np.concatenate([*legs, *tails.values()]) if legs or tails else np.empty((0, 2))
        columns = self._reward.posterior.columns(places)
        begin = len(new) * self._samples
        first = self._pool.add(columns.slice(0, begin))
        for i, prefix in enumerate(new):
            self._numbers[prefix] = first + i * self._samples
        paths: list[Columns] = []
        keys: list[tuple[Actions, int]] = []
        within = np.arange(self._samples)
        for s in sequences:
            numbers = np.array([self._numbers[s[:i]] for i in range(1, len(s) + 1)], dtype=np.int64)
            head = self._pool.take((numbers[:, None] + within).ravel())
            for h in self._heuristics or (NONE,):
                path = head
                if self._heuristics:
                    count = len(tails[(s, h)])
                    path = join([head, columns.slice(begin, begin + count)])
                    begin += count
                paths.append(path)
                keys.append((s, h))
        values = self._reward.values(paths)
        best: dict[Actions, float] = {}
        for (s, h), value in zip(keys, values, strict=True):
            if value > best.get(s, -np.inf):
                best[s] = float(value)
                self.continuations[s] = Continuation(float(value), h)
        return np.array([best[s] for s in wanted])
