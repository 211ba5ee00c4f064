"""Values of action sequences from one state. Converts the actions of the search to the locations of the reward."""

from collections.abc import Callable, Sequence

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.point_posteriors import PointPool, PointPosteriors, join_by_path
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.prefixes import Prefixes
from auv_lse_planner.search.tree import every_sequence
from auv_lse_planner.search.uct import Actions

#: Largest number of sequences that `promising` evaluates.
MAX_PREFIXES = 1500
#: Number of sequences evaluated together.
PREFIXES_AT_ONCE = 256
#: Number of naive paths estimated between two checks of the deadline.
GUESSES_AT_ONCE = 64


class PathSequences:
    """Path reward of action sequences, each continued by the best of the naive paths.

    The posterior at locations of a common prefix is computed once.
    """

    def __init__(
        self,
        reward: PathReward,
        rollout: Rollout,
        step: int,
        state: Array,
        naive_paths: tuple[int, ...],
        grid: Grid | None = None,
    ) -> None:
        """Prepares for sequences from `state`.

        Args:
            state: Root state, shape (3,).
            naive_paths: Ids of the naive paths to choose from; empty for none.
            grid: Grid of locations over the area, to estimate the reward of naive paths; None: no estimate.
        """
        self._reward, self._rollout, self._grid = reward, rollout, grid
        self._steps_left, self._naive_paths, self._samples = rollout.steps - step, naive_paths, rollout.samples_per_leg
        self._root = np.array(state, dtype=float)
        self._prefixes = Prefixes(rollout.motion, self._root)
        self._pool = PointPool(len(reward.posterior))
        #: The best naive path for every evaluated sequence; `NONE` without naive paths.
        self.naive_path: dict[Actions, int] = {}

    def promising(
        self,
        space: FreeSpace,
        horizon: int,
        overall: int,
        per_first: int,
        deadline: Callable[[], bool] | None = None,
    ) -> list[Actions]:
        """The most promising sequences, for a search to try first.

        Evaluates all sequences exactly, if there are at most `MAX_PREFIXES` (three legs of eleven actions). The reward
        of a naive path is estimated as the current risk along it, since little risk remains at a measured location.

        Args:
            horizon: Length of the sequences.
            overall: Number of best sequences to return.
            per_first: Number of best sequences to return for each first action.
            deadline: Returns whether to stop estimating, checked after the first batch. Sequences without an estimate
                are then omitted.

        Returns:
            Sequences, best first; none if there are too many to evaluate.
        """
        if self._rollout.motion.actions**horizon > MAX_PREFIXES or (deadline is not None and deadline()):
            return []
        prefixes = np.asarray(every_sequence(space.arguments(), self._root, horizon))
        numbers, new = self._numbered(prefixes)
        self._pool.add(self._reward.posterior.at(new))
        values = np.concatenate(
            [self._prefix_values(numbers[i : i + PREFIXES_AT_ONCE]) for i in range(0, len(prefixes), PREFIXES_AT_ONCE)]
        )
        order = np.argsort(-values, kind="stable")
        if self._naive_paths and self._grid is not None and not (deadline is not None and deadline()):
            risk = self._grid.fill(self._reward.before(self._reward.posterior.at(self._grid.locations_m)), outside=0.0)
            every = len(prefixes) if deadline is None else GUESSES_AT_ONCE
            guessed = 0
            while guessed < len(prefixes) and (guessed == 0 or deadline is None or not deadline()):
                part = order[guessed : guessed + every]
                values[part] += self._estimate_naive(self._prefixes.states(numbers[part, -1]), horizon, risk)
                guessed += len(part)
            order = order[:guessed][np.argsort(-values[order[:guessed]], kind="stable")]
        chosen = dict.fromkeys(tuple(h) for h in prefixes[order[:overall]].tolist())
        taken = np.zeros(self._rollout.motion.actions, dtype=int)
        for prefix in prefixes[order].tolist():
            if taken[prefix[0]] < per_first:
                taken[prefix[0]] += 1
                chosen[tuple(prefix)] = None
        return list(chosen)

    def _estimate_naive(self, states: Array, legs: int, risk: Array) -> Array:
        """Current risk along the best naive path from each of `states` (B, 3), after `legs` legs."""
        assert self._grid is not None
        left = self._steps_left - legs
        rough = [self._rollout.naive.sums_along(states, h, left, risk, self._grid) for h in self._naive_paths]
        return np.asarray(self._samples * np.max(rough, axis=0))

    def _numbered(self, sequences: Ints) -> tuple[Ints, Array]:
        """Numbers (B, L) of all prefixes of sequences (B, L), and the locations (P, 2) of those that are new."""
        first = self._prefixes.count
        numbers = self._prefixes.enter(sequences)
        states, actions, ends = self._prefixes.last_legs(first)
        if self._samples == 1:
            return numbers, ends[:, 1:]
        return numbers, self._rollout.leg_locations(states, actions).reshape(-1, 2)

    def _prefix_columns(self, numbers: Ints) -> PointPosteriors:
        """The posterior at the B * L * samples locations of sequences, given by the numbers (B, L) of their
        prefixes."""
        legs = (numbers - 1) * self._samples  # the empty prefix has no location
        return self._pool.take((legs[:, :, None] + np.arange(self._samples)).ravel())

    def _prefix_values(self, numbers: Ints) -> Array:
        return self._reward.values_of_equal(self._prefix_columns(numbers), numbers.shape[1] * self._samples)

    def _by_naive_path(self, sequences: Sequence[Actions]) -> Array:
        """Values (H, B) of sequences of the same length with each naive path after them; (1, B) without naive paths."""
        actions = np.array(sequences, dtype=np.int64)
        numbers, new = self._numbered(actions)
        ends = self._prefixes.states(numbers[:, -1])
        left = self._steps_left - actions.shape[1]
        naive = [self._rollout.naive_locations(ends, h, left) for h in self._naive_paths]
        columns = self._reward.posterior.at(np.concatenate([new, *(p.reshape(-1, 2) for p in naive)]))
        self._pool.add(columns.slice(0, len(new)))
        if not naive:
            return self._prefix_values(numbers)[None]
        prefixes = self._prefix_columns(numbers)
        values = np.empty((len(naive), len(actions)))
        begin = len(new)
        for row, locations in zip(values, naive, strict=True):
            end = begin + locations.shape[0] * locations.shape[1]
            joined = join_by_path(prefixes, columns.slice(begin, end), len(actions))
            row[:] = self._reward.values_of_equal(joined, len(joined) // len(actions))
            begin = end
        return values

    def __call__(self, sequences: Sequence[Actions]) -> Array:
        """Values (B,) of sequences of the same length, each continued by its best naive path."""
        values, ids = self._by_naive_path(sequences), self._naive_paths or (NONE,)
        self.naive_path.update(zip(sequences, (ids[i] for i in values.argmax(axis=0)), strict=True))
        best: Array = values.max(axis=0)
        return best
