"""Numbers the prefixes of action sequences, so that shared prefixes are evaluated once."""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.motion import MotionTable, advance
from auv_lse_planner.search.tree import grown


@compiled
def enter(children, states, origins, count, turns, steps, sequences, numbers):
    """Writes the numbers of all prefixes of `sequences` (B, L) into `numbers` (B, L); returns the new prefix count.

    Args:
        children: Number of each prefix extended by each action, -1 if none yet, shape (N, A).
        states: State after each prefix, shape (N, 3).
        origins: Number of the prefix that is one action shorter, and that action, shape (N, 2).
        turns, steps: Turns and steps of the actions (`MotionTable`).
    """
    for b in range(sequences.shape[0]):
        at = 0
        for i in range(sequences.shape[1]):
            a = sequences[b, i]
            if children[at, a] < 0:
                h, n, e = states[at, 0], states[at, 1], states[at, 2]
                h, n, e = advance(h, n, e, turns[a], steps[a, 0], steps[a, 1])
                states[count, 0], states[count, 1], states[count, 2] = h, n, e
                origins[count, 0], origins[count, 1] = at, a
                children[at, a] = count
                count += 1
            at = children[at, a]
            numbers[b, i] = at
    return count


class Prefixes:
    """Numbers the prefixes of action sequences that start in one state; the empty prefix has number 0."""

    def __init__(self, motion: MotionTable, state: Array) -> None:
        self._motion = motion
        self._children = np.full((64, motion.actions), -1, dtype=np.int64)
        self._states = np.zeros((64, 3))
        self._states[0] = state
        self._origins = np.zeros((64, 2), dtype=np.int64)
        self.count = 1

    def enter(self, sequences: Ints) -> Ints:
        """Numbers (B, L) of all prefixes of sequences (B, L), new ones in the order of their first appearance."""
        room = self.count + sequences.size
        self._children, self._states = grown(self._children, room, -1), grown(self._states, room)
        self._origins = grown(self._origins, room)
        numbers = np.empty(sequences.shape, dtype=np.int64)
        turns, steps = self._motion.turns_rad, self._motion.steps_m
        self.count = enter(self._children, self._states, self._origins, self.count, turns, steps, sequences, numbers)
        return numbers

    def states(self, numbers: Ints) -> Array:
        """States (..., 3) after the prefixes with these numbers."""
        return self._states[numbers]

    def last_legs(self, first: int) -> tuple[Array, Ints, Array]:
        """The last legs of all prefixes from number `first` on, in order: start states, actions, end states.

        Returns:
            States (P, 3), actions (P,), states (P, 3).
        """
        origins = self._origins[first : self.count]
        return self._states[origins[:, 0]], origins[:, 1], self._states[first : self.count]
