import itertools

import numpy as np
from planner_helpers import world

from auv_lse_planner.search.prefixes import Prefixes

STATE = np.array([0.3, 150.0, 150.0])


def test_each_prefix_gets_one_number():
    _, motion, _, _ = world()
    prefixes = Prefixes(motion, STATE)
    sequences = np.array(list(itertools.product((0, 5, 7), repeat=3)))
    numbers = prefixes.enter(sequences)
    assert prefixes.count == 1 + 3 + 9 + 27
    assert sorted(set(numbers.ravel().tolist())) == list(range(1, 40))
    assert (prefixes.enter(sequences[::-1]) == numbers[::-1]).all()
    assert prefixes.count == 40
    for sequence, own in zip(sequences, numbers, strict=True):
        rolled = motion.roll(STATE, sequence)
        assert (prefixes.states(own) == rolled[1:]).all()
    states, actions, ends = prefixes.last_legs(1)
    rolled = motion.roll(STATE, sequences[0])
    assert np.array_equal(states[:3], rolled[:-1])
    assert actions[:3].tolist() == sequences[0].tolist()
    assert np.array_equal(ends[:3], rolled[1:])
