"""Decentralized MCTS (Best, Cliff, Patten, Mettu, Fitch 2019), the paper's alternative to the sequential order.

Vehicles have no order. Each one keeps a distribution over its plans, sends it to the others, and searches its tree
against plans drawn from theirs. A packet has room for one plan only, so this implementation differs:

- A packet carries one plan *drawn* from the sender's distribution instead of the best plan. A receiver represents the
  distribution of a team mate by its last different plans, with larger weights for newer ones.
- The search evaluates a sequence by its mean over `JOINT_DRAWS` joint draws of the team mates' plans: by the drop of
  the map's risk that it adds to theirs, which is the local utility of the paper. Evaluation at the path's own places,
  as in the paper's other searches, gives a 50 % higher loss (docs/design/planner.md, "Team").
- This vehicle's distribution is q(x) ~ exp(value(x) / temperature) over the best sequences of the search. It minimizes
  the free energy of Dec-MCTS for the others' current distributions. The temperature decreases every step (`COOLING`).
  The vehicle itself follows the best sequence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_planner.methods.method import Situation
from auv_lse_planner.methods.tree_search import TreeSearch
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import Proposal, SearchProblem
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, run_search

Array = NDArray[np.float64]

#: Number of joint draws of the team mates' plans against which a sequence is evaluated.
JOINT_DRAWS = 3
#: Number of sequences in this vehicle's distribution.
SUPPORT = 10
#: Temperature at the first step, relative to the best value, and its factor per step.
TEMPERATURE = 0.02
COOLING = 0.97


def distribution(values: Array, step: int) -> Array:
    """Probabilities of sequences with these values at mission step `step`."""
    temperature = max(TEMPERATURE * COOLING**step * max(float(values.max()), 1e-12), 1e-12)
    weights = np.exp((values - values.max()) / temperature)
    return np.asarray(weights / weights.sum())


class JointDraws:
    """Mean values of action sequences over joint draws of the team mates' plans.

    A sequence is continued by the same naive path in all draws: the one with the best mean.

    Attributes:
        naive_path: The best naive path for every evaluated sequence; `NONE` without naive paths.
    """

    def __init__(self, rewards: list[AnytimeReward], rollout: Rollout, problem: SearchProblem) -> None:
        """Sets up the evaluation.

        Args:
            rewards: For each draw, the map reward of paths from the current step: over the sequences' length without
                naive paths, else to the mission's end.
            problem: State, and naive paths that may continue a sequence.
        """
        self._rewards, self._rollout, self._problem = rewards, rollout, problem
        self.naive_path: dict[Actions, int] = {}

    def __call__(self, sequences: Sequence[Actions]) -> Array:
        """Mean values (B,) of sequences of the same length."""
        return np.array([self._value(sequence) for sequence in sequences])

    def _value(self, sequence: Actions) -> float:
        p, values, ids = self._problem, [], self._problem.naive_paths or (NONE,)
        for naive_path in ids:
            places = self._rollout.path(p.step, p.state, sequence, naive_path).places_m
            values.append(float(np.mean([reward.coarse_value(places) for reward in self._rewards])))
        best = int(np.argmax(values))
        self.naive_path[sequence] = ids[best]
        return values[best]


class DecMcts(TreeSearch):
    """Searches against joint draws of the team mates' plans, and sends them a plan drawn from its own."""

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """See `PathMethod`."""
        draws = [self.draw(situation.now_s) for _ in range(JOINT_DRAWS)]
        return self.search(self.context.search_problem(situation, self.seeds), reward, draws)

    def draw(self, now_s: float) -> Array:
        """Places (P, 2) ahead of all team mates, from one randomly drawn plan of each.

        A plan is twice as likely as the one received before it.
        """
        places = [np.empty((0, 2))]
        for kept in self.context.team.recent_places(now_s):
            weights = 0.5 ** np.arange(len(kept))
            places.append(kept[int(self.context.rng.choice(len(kept), p=weights / weights.sum()))])
        return np.concatenate(places)

    def search(self, problem: SearchProblem, reward: PathReward, draws: list[Array]) -> Proposal:
        """Searches against draws of the team mates' places, shape (O, 2) each."""
        p, planner, context = problem, problem.planner, self.context
        legs = context.rollout.steps - p.step if p.naive_paths else p.horizon
        rewards = []
        for places in draws:
            points = CachedPoints(context.posterior.with_planned(places), context.map_grid.places_m)
            rewards.append(AnytimeReward(points, reward.level_set, (), Weighting(legs, p.step, context.rollout.steps)))
        joint = JointDraws(rewards, context.rollout, p)
        budget = max(planner.batch, planner.iterations // len(draws))  # shared among the draws
        tree = ActionTree(context.space, p.state, p.horizon, planner.exploration)
        found = run_search(tree, joint, p.horizon, budget, planner.batch, p.rng, p.deadline, p.seeds)
        support = found.ranking[:SUPPORT]
        chances = distribution(np.array([value for _, value in support]), p.step)
        drawn = support[int(p.rng.choice(len(support), p=chances))][0]
        return Proposal(found, joint.naive_path[found.actions], team_plan=(drawn, joint.naive_path[drawn]))
