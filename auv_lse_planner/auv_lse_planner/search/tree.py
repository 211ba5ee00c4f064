"""The search tree over the actions of a `FreeSpace`, as arrays and compiled functions: microseconds per sequence."""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from typing import Any, NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace, end_of_leg, escape_action, is_feasible, random_actions

#: Values of `children` for actions without a node: admissible but untried, or inadmissible.
UNTRIED = -1
FORBIDDEN = -2


@compiled
def mark_choices(space, heading, north, east, children):
    """Marks the admissible actions of a state in `children` (A,): the feasible ones, else the escape alone."""
    none = True
    for action in range(children.shape[0]):
        children[action] = FORBIDDEN
        if is_feasible(space, heading, north, east, action):
            children[action] = UNTRIED
            none = False
    if none:
        children[escape_action(space, heading, north, east)] = UNTRIED


@compiled
def is_choice(space, heading, north, east, action):
    """Whether an action is admissible in a state: feasible, or the escape if no action is feasible."""
    if is_feasible(space, heading, north, east, action):
        return True
    for other in range(space.turns.shape[0]):
        if is_feasible(space, heading, north, east, other):
            return False
    return action == escape_action(space, heading, north, east)


@compiled
def admissible(space, state, actions):
    """Whether `actions` (L,) are admissible one after another from `state` (3,)."""
    h, n, e = state[0], state[1], state[2]
    for a in actions:
        if not is_choice(space, h, n, e, a):
            return False
        h, n, e = end_of_leg(space, h, n, e, a)
    return True


@compiled
def single_changes(space, state, sequence):
    """Admissible sequences (M, L) from `state` (3,) that differ from `sequence` (L,) in one action, in order."""
    kinds, length = space.turns.shape[0], sequence.shape[0]
    found = np.empty((length * kinds, length), dtype=np.int64)
    count = 0
    choices = np.empty(kinds, dtype=np.int64)
    h, n, e = state[0], state[1], state[2]
    for i in range(length):
        mark_choices(space, h, n, e, choices)
        old = sequence[i]
        for a in range(kinds):
            if a == old or choices[a] == FORBIDDEN:
                continue
            end = np.array(end_of_leg(space, h, n, e, a))
            if admissible(space, end, sequence[i + 1 :]):
                found[count] = sequence
                found[count, i] = a
                count += 1
        h, n, e = end_of_leg(space, h, n, e, old)
    return found[:count]


@compiled
def every_sequence(space, state, horizon):
    """All admissible sequences (N, horizon) from `state` (3,), in lexicographic order."""
    kinds = space.turns.shape[0]
    sequences = np.empty((1, 0), dtype=np.int64)
    states = np.empty((1, 3))
    states[0] = state
    choices = np.empty(kinds, dtype=np.int64)
    for depth in range(horizon):
        longer = np.empty((len(sequences) * kinds, depth + 1), dtype=np.int64)
        ends = np.empty((len(sequences) * kinds, 3))
        count = 0
        for i in range(len(sequences)):
            h, n, e = states[i, 0], states[i, 1], states[i, 2]
            mark_choices(space, h, n, e, choices)
            for a in range(kinds):
                if choices[a] == UNTRIED:
                    longer[count, :depth] = sequences[i]
                    longer[count, depth] = a
                    ends[count] = end_of_leg(space, h, n, e, a)
                    count += 1
        sequences, states = longer[:count].copy(), ends[:count].copy()
    return sequences


class Nodes(NamedTuple):
    """The nodes of a tree; the root is number 0.

    Attributes:
        children: Node that each action leads to, UNTRIED or FORBIDDEN, shape (N, A).
        states: State of each node, shape (N, 3).
        visits, valued, totals: Visits, visits with a value, and sum of values of each node, shape (N,).
    """

    children: Ints
    states: Array
    visits: Ints
    valued: Ints
    totals: Array


@compiled
def select(nodes, node, low, high, exploration):
    """The tried action of a node with the largest upper confidence bound; values are scaled from [low, high]."""
    spread = high - low
    log_visits = math.log(max(nodes.visits[node], 1))
    best, best_score = -1, -math.inf
    for action in range(nodes.children.shape[1]):
        child = nodes.children[node, action]
        if child < 0:
            continue
        visits, valued = nodes.visits[child], nodes.valued[child]
        mean = 0.5
        if valued > 0 and spread > 0.0:
            mean = (nodes.totals[child] / valued - low) / spread
        if visits > 0:
            mean *= valued / visits  # visits without a value yet count as 0
        score = mean + exploration * math.sqrt(log_visits / max(visits, 1))
        if score > best_score:
            best, best_score = action, score
    return best


@compiled
def untried_action(children, random):
    """A random untried action of a node, from its `children` (A,); -1 if there is none."""
    count = 0
    for child in children:
        if child == UNTRIED:
            count += 1
    pick = min(int(random * count), count - 1)
    for action in range(children.shape[0]):
        if children[action] == UNTRIED:
            if pick == 0:
                return action
            pick -= 1
    return -1


@compiled
def grow(space, nodes, count, ucb, forced, randoms, paths, out):
    """Descends once for each row of `forced` (B, H) and `randoms` (B, H); returns the new number of nodes.

    Args:
        space: `FreeSpace.arguments()`.
        nodes: `Nodes`, with room for all new nodes.
        ucb: Smallest and largest value so far, exploration constant.
        forced: First actions of each descent, -1 after their end.
        randoms: Uniform numbers in [0, 1).
        paths: Receives the nodes of each descent after the root, -1 after their end, shape (B, H).
        out: Receives the sequences, shape (B, H).
    """
    low, high, exploration = ucb
    children, states = nodes.children, nodes.states
    horizon = out.shape[1]
    paths[:] = -1
    for b in range(out.shape[0]):
        node, depth, used = 0, 0, 0
        added = False
        nodes.visits[0] += 1
        while depth < horizon and not added:
            action = forced[b, depth]
            if action < 0:
                action = untried_action(children[node], randoms[b, used])
                if action >= 0:
                    used += 1
                    added = True
                else:
                    action = select(nodes, node, low, high, exploration)
            if children[node, action] < 0:
                h, n, e = end_of_leg(space, states[node, 0], states[node, 1], states[node, 2], action)
                states[count, 0], states[count, 1], states[count, 2] = h, n, e
                if depth + 1 < horizon:
                    mark_choices(space, h, n, e, children[count])
                children[node, action] = count
                count += 1
            node = children[node, action]
            nodes.visits[node] += 1
            out[b, depth] = action
            paths[b, depth] = node
            depth += 1
        if depth < horizon:
            h, n, e = states[node, 0], states[node, 1], states[node, 2]
            out[b, depth:] = random_actions(space, h, n, e, randoms[b, used : used + horizon - depth])
    return count


@compiled
def back_up(nodes, paths, values):
    """Adds values (B,) to the nodes of their descents, `paths` (B, H), and to the root."""
    for b in range(paths.shape[0]):
        nodes.valued[0] += 1
        nodes.totals[0] += values[b]
        for node in paths[b]:
            if node >= 0:
                nodes.valued[node] += 1
                nodes.totals[node] += values[b]


def grown(array: Any, rows: int, fill: int = 0) -> Any:
    """Returns an array (N, ...) with room for `rows` rows: itself, or a copy of at least twice the length."""
    if rows <= len(array):
        return array
    more = max(rows, 2 * len(array)) - len(array)
    return np.concatenate([array, np.full((more, *array.shape[1:]), fill, array.dtype)])


class ActionTree:
    """The tree of action sequences from a state in a free space."""

    def __init__(self, space: FreeSpace, state: Array, horizon: int, exploration: float) -> None:
        self._space = space.arguments()
        self._state = np.array(state, dtype=float)
        self._horizon, self._exploration = horizon, exploration
        self._count = 1
        self._low, self._high = math.inf, -math.inf
        counts = np.zeros(64, dtype=np.int64)
        children = np.full((64, space.motion.actions), FORBIDDEN, dtype=np.int64)
        self._nodes = Nodes(children, np.zeros((64, 3)), counts, counts.copy(), np.zeros(64))
        self._nodes.states[0] = self._state
        self._paths = np.empty((0, horizon), dtype=np.int64)
        mark_choices(self._space, *self._state, children[0])

    def admissible(self, actions: tuple[int, ...]) -> bool:
        """Whether the actions are admissible one after another from the root."""
        own = np.array(actions[: self._horizon], dtype=np.int64)
        return bool(((own >= 0) & (own < len(self._space.turns))).all() and admissible(self._space, self._state, own))

    def grow(self, forced: Ints, randoms: Array) -> Ints:
        """Descends once for each row; each descent adds a node.

        Args:
            forced: Admissible first actions of each descent, -1 after their end, shape (B, horizon).
            randoms: Uniform numbers in [0, 1), shape (B, horizon). They select the node to add and complete the
                sequence.

        Returns:
            Sequences, shape (B, horizon).
        """
        room = self._count + forced.size
        children, *rest = self._nodes
        self._nodes = Nodes(grown(children, room, FORBIDDEN), *(grown(array, room) for array in rest))
        sequences, self._paths = np.empty(forced.shape, dtype=np.int64), np.empty(forced.shape, dtype=np.int64)
        ucb = self._low, self._high, self._exploration
        self._count = grow(self._space, self._nodes, self._count, ucb, forced, randoms, self._paths, sequences)
        return sequences

    def back_up(self, values: Array) -> None:
        """Adds the values (B,) of the sequences from the last `grow`."""
        back_up(self._nodes, self._paths, values)
        self._low, self._high = min(self._low, float(values.min())), max(self._high, float(values.max()))

    def changes(self, sequence: tuple[int, ...]) -> Ints:
        """Admissible sequences (M, horizon) that differ from `sequence` in one action."""
        return np.asarray(single_changes(self._space, self._state, np.array(sequence, dtype=np.int64)))
