import functools
import itertools

import numpy as np
import pytest
from planner_helpers import actions_by_chance, world
from reference_tree import ObjectTree

from auv_lse_common.support.compiled import plain
from auv_lse_planner.search import tree as module
from auv_lse_planner.search.tree import ActionTree, every_sequence
from auv_lse_planner.search.uct import run_search

# open water, beside the border, in a corner where only the escape is left
STATES = [np.array([0.3, 150.0, 150.0]), np.array([1.2, 30.0, 440.0]), np.array([-2.4, -15.0, -15.0])]


def _trees(space, state, horizon, exploration=0.4):
    complete = functools.partial(actions_by_chance, space)
    return (
        ActionTree(space, state, horizon, exploration),
        ObjectTree(space.choices, space.motion.end_state, state, horizon, exploration, complete),
    )


def _worth(sequences):
    """A made-up value with few ties."""
    return np.array([np.sin(np.dot(s, 1.7 ** np.arange(len(s)))) for s in sequences])


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("horizon", [3, 10])
def test_compiled_and_reference_tree_grow_the_same_sequences(state, horizon):
    _, _, space, _ = world()
    rng = np.random.default_rng(horizon)
    ours, reference = _trees(space, state, horizon)
    for size in (2, 8, 8, 1, 40, 8, 60):  # with repeats inside a batch, and beyond the arrays' first size
        randoms = rng.random((size, horizon))
        forced = np.full((size, horizon), -1)
        forced[0, :2] = ObjectTree(space.choices, space.motion.end_state, state, 2, 0.0).grow(
            np.full((1, 2), -1), rng.random((1, 2))
        )
        expected = reference.grow(forced, randoms)
        sequences = ours.grow(forced, randoms)
        assert (sequences == expected).all()
        values = _worth(sequences)
        ours.back_up(values)
        reference.back_up(values)


@pytest.mark.parametrize("state", STATES)
def test_compiled_and_reference_tree_search_have_the_same_result(state):
    _, _, space, _ = world()
    seeds = [(5, 5, 5), (4, 6), (0, 0, 0), (99, 0, 0), (-1, 0, 0), ()]
    results = [
        run_search(tree, _worth, 3, 150, 8, np.random.default_rng(5), None, seeds) for tree in _trees(space, state, 3)
    ]
    assert results[0] == results[1]


@pytest.mark.parametrize("state", STATES)
def test_admissible_and_changed_sequences(state):
    _, _, space, _ = world()
    ours, reference = _trees(space, state, 2)
    sequences = list(itertools.product(range(space.motion.actions), repeat=2))
    allowed = [s for s in sequences if reference.admissible(s)]
    assert [s for s in sequences if ours.admissible(s)] == allowed
    assert every_sequence(space.arguments(), state, 2).tolist() == [list(s) for s in allowed]
    for sequence in allowed[::7]:
        changes = ours.changes(sequence)
        assert (changes == reference.changes(sequence)).all()
        assert {tuple(c) for c in changes} == {s for s in allowed if (s[0] == sequence[0]) != (s[1] == sequence[1])}


def test_tree_without_numba_is_the_same(monkeypatch):
    _, _, space, _ = world()
    rng = np.random.default_rng(1)
    rounds = [(np.full((8, 4), -1), rng.random((8, 4))) for _ in range(10)]

    def sequences():
        tree, found = ActionTree(space, STATES[1], 4, 0.4), []
        for forced, randoms in rounds:
            found.append(tree.grow(forced, randoms).tolist())
            tree.back_up(_worth(np.array(found[-1])))
        return found

    compiled = sequences()
    monkeypatch.setattr(module, "grow", plain(module.grow))
    monkeypatch.setattr(module, "back_up", plain(module.back_up))
    assert sequences() == compiled
