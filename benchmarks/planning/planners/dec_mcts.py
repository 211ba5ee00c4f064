"""Dec-MCTS: Best, Cliff, Patten, Mettu, Fitch 2019, Dec-MCTS: Decentralized planning for multi-robot active perception.

Each robot grows a tree of its own action sequences by discounted UCT. It keeps a few of the best sequences with a
probability each, sends them, and updates the probabilities against those of its mates. The value of a sequence is the
paper's local utility: what it adds to the objective with the mates' sequences given. The objective is the expected drop
of the number of misclassified cells, which is the Bayes risk with equal costs.

The paper bounds discount and exploration only (1/2 < gamma < 1, c_p > 1 / sqrt(8)), so the values of gamma, c_p, alpha
and beta are those of public implementations by others: JennyLynnFletcher/Dec-MCTS (`PARAMETERS`) and, with more
exploration, ywu26/DEC-MCTS_experiment (`WIDE`). Deviations:

- A packet has one plan, so the distribution of a mate is the plan heard last, with probability 1. The expectations over
  the mates are then exact, and nothing is sampled.
- A decision starts a new tree, and looks `HORIZON` legs ahead instead of to the end of the mission.
- Values are divided by the largest one found, because the paper's lie in [0, 1].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular

from auv_lse_common.support.arrays import Array
from auv_lse_gp.level_set.bayes_risk import LevelSet
from benchmarks.planning.planners.interface import View

Actions = tuple[int, ...]

#: Legs that a sequence has.
HORIZON = 10
#: Rounds of growing the tree and updating the distribution, and rollouts in each.
ROUNDS, ROLLOUTS = 10, 20
#: Number of sequences with a probability.
SUPPORT = 10
#: Range (m) beyond its locations in which a sequence changes the map.
NEAR_M = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Parameters that the paper leaves open.

    Attributes:
        discount: Of old rollouts (gamma).
        exploration: c_p.
        step: Of the distribution (alpha).
        temperature: beta of the first round.
        cooling: Factor on the temperature for each round.
    """

    discount: float
    exploration: float
    step: float
    temperature: float
    cooling: float


PARAMETERS = Parameters(discount=0.9, exploration=0.5, step=0.01, temperature=0.1, cooling=0.9)
WIDE = Parameters(discount=0.95, exploration=1.0, step=0.1, temperature=10.0, cooling=1.0)


class MarginalRisk:
    """Gain of measurements in the expected drop of the number of misclassified cells, given the mates' plans."""

    def __init__(self, view: View, reach_m: float) -> None:
        """Counts the cells that are at most `reach_m` from the vehicle."""
        self._posterior = view.posterior.with_planned(np.concatenate([np.empty((0, 2)), *view.mates_m]))
        self._cells = self._posterior.at(view.cells_m[np.hypot(*(view.cells_m - view.position_m).T) <= reach_m])
        self._level = LevelSet(level_m=view.level_m, cost_false_safe=1.0, cost_false_unsafe=1.0)
        self._before = self._risk(self._cells.planned_var_m2)

    def __call__(self, locations_m: Array) -> float:
        """Drop (cells) by measurements at locations (L, 2)."""
        path = self._posterior.at(locations_m)
        lower = np.linalg.cholesky(self._posterior.measured_covariance(path))  # which reads the lower triangle
        white = solve_triangular(lower, self._posterior.covariance(path, self._cells), lower=True)
        return self._before - self._risk(np.maximum(self._cells.planned_var_m2 - (white**2).sum(axis=0), 0.0))

    def _risk(self, left_m2: Array) -> float:
        std_of_mean = np.sqrt(np.maximum(self._cells.data_var_m2 - left_m2, 0.0))
        return float(self._level.expected_risk(self._cells.mean_m, std_of_mean, np.sqrt(left_m2)).sum())


@dataclass(slots=True)
class _Node:
    """A sequence of actions; `visits` and `total` are discounted, as of iteration `seen`."""

    actions: Actions
    state: Array
    untried: list[int]
    parameters: Parameters
    children: list[_Node] = field(default_factory=list)
    visits: float = 0.0
    total: float = 0.0
    seen: int = 0
    best: tuple[float, Actions] = (-math.inf, ())

    def visits_at(self, now: int) -> float:
        """Discounted number of rollouts at iteration `now`."""
        return self.visits * self.parameters.discount ** (now - self.seen)

    def child(self, now: int, scale: float) -> _Node:
        """The child of the largest upper confidence bound (D-UCB), its values divided by `scale`."""
        visits = [child.visits_at(now) for child in self.children]
        wide = math.sqrt(max(math.log(sum(visits)), 0.0))
        bounds = [
            child.total / (child.visits * scale) + 2.0 * self.parameters.exploration * wide / math.sqrt(n)
            for child, n in zip(self.children, visits, strict=True)
        ]
        return self.children[int(np.argmax(bounds))]

    def back_up(self, now: int, value: float, sequence: Actions) -> None:
        """Counts a rollout."""
        fade = self.parameters.discount ** (now - self.seen)
        self.visits, self.total, self.seen = self.visits * fade + 1.0, self.total * fade + value, now
        self.best = max(self.best, (value, sequence))


def updated(chances: Array, values: Array, temperature: float, step: float) -> Array:
    """Probabilities (n,) after a step of the paper's gradient descent: q -= alpha q ((E f - f) / beta + H(q) + ln q).

    Args:
        chances: Probabilities q (n,).
        values: Expected local utility f (n,) of each sequence, the mates' distributions given.
        temperature: beta.
        step: alpha.
    """
    logs = np.log(chances)
    slope = (chances @ values - values) / temperature - chances @ logs + logs
    new = np.maximum(chances * (1.0 - step * slope), 1e-12)
    return np.asarray(new / new.sum())


class DecMcts:
    """Plans the next legs; asked again after each."""

    replan_legs: int | None = 1

    def __init__(self, parameters: Parameters = PARAMETERS) -> None:
        """Sets the parameters that the paper leaves open."""
        self._parameters = parameters

    def path(self, view: View) -> Array:
        """Ends (n, 2) of the legs of the most probable sequence."""
        state = np.array([view.heading_rad, *view.position_m])
        legs = min(HORIZON, view.legs_left)
        value = MarginalRisk(view, legs * view.leg_m + NEAR_M)
        chosen = self._parameters
        root = _Node((), state, _feasible(view, state), chosen)
        if not root.untried:
            return view.position_m[None] + view.leg_m * np.array([[math.cos(state[0]), math.sin(state[0])]])
        nodes, scale, temperature = [root], 1e-12, chosen.temperature
        support: list[tuple[float, Actions]] = []
        chances = np.empty(0)
        for number in range(ROUNDS):
            for now in range(number * ROLLOUTS + 1, (number + 1) * ROLLOUTS + 1):
                branch = _grow(view, root, nodes, now, scale)
                sequence = _rollout(view, branch[-1], legs)
                gain = value(view.motion.roll(state, sequence)[1:, 1:])
                scale = max(scale, gain)
                for node in branch:
                    node.back_up(now, gain, sequence)
            ranked = sorted(nodes[1:], key=lambda node: -node.total / node.visits)
            new = list(dict.fromkeys(node.best for node in ranked))[:SUPPORT]
            if new != support:
                support, chances = new, np.full(len(new), 1.0 / len(new))
            chances = updated(chances, np.array([f for f, _ in support]) / scale, temperature, chosen.step)
            temperature *= chosen.cooling
        return view.motion.roll(state, support[int(np.argmax(chances))][1])[1:, 1:]


def _grow(view: View, root: _Node, nodes: list[_Node], now: int, scale: float) -> list[_Node]:
    """The nodes from the root to a new one; to a known one where the sequence cannot go on."""
    branch = [root]
    while not branch[-1].untried and branch[-1].children:
        branch.append(branch[-1].child(now, scale))
    last = branch[-1]
    if last.untried and len(last.actions) < min(HORIZON, view.legs_left):
        action = last.untried.pop(int(view.rng.integers(len(last.untried))))
        state = view.motion.end_state(last.state, action)
        new = _Node((*last.actions, action), state, _feasible(view, state), root.parameters)
        last.children.append(new)
        nodes.append(new)
        branch.append(new)
    return branch


def _rollout(view: View, node: _Node, legs: int) -> Actions:
    """The node's actions and random ones, up to `legs` or until none is feasible."""
    actions, state, feasible = node.actions, node.state, _feasible(view, node.state)
    while len(actions) < legs and feasible:
        actions = (*actions, feasible[int(view.rng.integers(len(feasible)))])
        state = view.motion.end_state(state, actions[-1])
        feasible = _feasible(view, state)
    return actions


def _feasible(view: View, state: Array) -> list[int]:
    """The actions whose legs stay in the area, its margin kept."""
    tracks = view.motion.tracks_m[:, ::-6]  # the end of each leg, and a location every 6 m
    c, s = math.cos(state[0]), math.sin(state[0])
    north, east = state[1] + tracks @ [c, -s], state[2] + tracks @ [s, c]
    clear = view.area.clearance_m(np.stack([north, east], axis=-1).reshape(-1, 2)) >= view.area.margin_m
    return np.flatnonzero(clear.reshape(tracks.shape[:2]).all(axis=1)).tolist()
