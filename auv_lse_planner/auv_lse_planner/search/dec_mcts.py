"""Decentralized MCTS (Best, Cliff, Patten, Mettu, Fitch 2019), the paper's alternative to the sequential order.

No vehicle comes before another. Each keeps a distribution over its own plans, sends it to the others, and searches its
tree against plans drawn from theirs. Here, as a packet has room for one plan:

- A packet carries one plan *drawn* from the sender's distribution, instead of the best one. A receiver's last
  `KEPT_PLANS` different plans of a team mate, newer ones weighing more, stand for the mate's distribution.
- The search values a sequence by its mean over `JOINT_DRAWS` joint draws of the team mates' plans: by the drop of the
  map's risk that it adds to theirs, which is the local utility of the paper. By its own places, as the paper's other
  searches value it, it loses half as much again (docs/design/planner.md, "Team").
- The own distribution is q(x) ~ exp(value(x) / temperature) over the best sequences of the search: the minimum of the
  free energy that Dec-MCTS descends to, for the others' distributions as they stand. The temperature falls from step to
  step (`COOLING`). The vehicle itself travels the best sequence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.search.situation import Proposal, Situation
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, run_search

Array = NDArray[np.float64]

#: Different plans of a team mate that are kept.
KEPT_PLANS = 3
#: Joint draws of the team mates' plans that a sequence is valued against.
JOINT_DRAWS = 3
#: Sequences that the own distribution is over.
SUPPORT = 10
#: Temperature of the own distribution at the first step, as a share of the best value, and its fall per step.
TEMPERATURE = 0.02
COOLING = 0.97


def distribution(values: Array, step: int) -> Array:
    """Probabilities of sequences with these values at mission step `step`."""
    temperature = max(TEMPERATURE * COOLING**step * max(float(values.max()), 1e-12), 1e-12)
    weights = np.exp((values - values.max()) / temperature)
    return np.asarray(weights / weights.sum())


class JointDraws:
    """Values of action sequences in the mean over joint draws of the team mates' plans.

    A sequence is continued by one naive path in all draws: the one that is best in the mean.
    """

    def __init__(
        self, rewards: list[AnytimeReward], rollout: Rollout, step: int, state: Array, naive_paths: tuple[int, ...]
    ) -> None:
        """Takes what values a sequence against each draw.

        Args:
            rewards: Of each draw, what the map gains by paths from here on: of the sequences' length without naive
                paths, to the mission's end with them.
            rollout: Follows plans to the mission's end.
            step: Mission step planned from.
            state: State planned from, shape (3,).
            naive_paths: Ids of naive paths that may continue a sequence.
        """
        self._rewards, self._rollout = rewards, rollout
        self._root, self._ids = (step, state), naive_paths or (NONE,)
        #: Of every sequence valued, the naive path that suits it best; `NONE` where there is none.
        self.naive_path: dict[Actions, int] = {}

    def __call__(self, sequences: Sequence[Actions]) -> Array:
        """Mean values (B,) of sequences of the same length."""
        return np.array([self._value(sequence) for sequence in sequences])

    def _value(self, sequence: Actions) -> float:
        values = []
        for naive_path in self._ids:
            places = self._rollout.path(*self._root, sequence, naive_path).places_m
            values.append(float(np.mean([reward.coarse_value(places) for reward in self._rewards])))
        best = int(np.argmax(values))
        self.naive_path[sequence] = self._ids[best]
        return values[best]


def search_dec_mcts(
    situation: Situation,
    space: FreeSpace,
    rollout: Rollout,
    posterior: Posterior,
    level_set: LevelSet,
    draws: list[Array],
) -> Proposal:
    """Searches against joint draws of the team mates' plans.

    Args:
        situation: State, parameters, and the map's places; the iterations are shared among the draws.
        space: Where to go.
        rollout: Follows plans to the mission's end.
        posterior: The data; planned places are left alone.
        level_set: Level and costs.
        draws: Places that the team mates still visit in each draw, shape (O, 2) each.

    Returns:
        The best sequence found; for the team, the plan drawn from the own distribution.

    Raises:
        ValueError: for a situation without the map's places.
    """
    s, planner = situation, situation.planner
    if s.grid is None:
        raise ValueError("situation.grid: got None; expected the map's places")
    legs = rollout.steps - s.step if s.naive_paths else s.horizon
    rewards = []
    for places in draws:
        against = posterior.copy()
        against.plan(places)
        kept = CachedPoints(against, s.grid.places_m)
        rewards.append(AnytimeReward(kept, level_set, (), legs, s.step, rollout.steps, 0.0))
    joint = JointDraws(rewards, rollout, s.step, s.state, s.naive_paths)
    budget = max(planner.batch, planner.iterations // len(draws))
    tree = ActionTree(space, s.state, s.horizon, planner.exploration)
    result = run_search(tree, joint, s.horizon, budget, planner.batch, s.rng, s.deadline, s.seeds)
    support = result.ranking[:SUPPORT]
    chances = distribution(np.array([value for _, value in support]), s.step)
    drawn = support[int(s.rng.choice(len(support), p=chances))][0]
    return Proposal(
        actions=result.actions,
        naive_path=joint.naive_path[result.actions],
        value=result.value,
        iterations=result.iterations,
        evaluations=result.evaluations,
        deadline_hit=result.deadline_hit,
        ranking=result.ranking,
        progress=result.progress,
        for_team=(drawn, joint.naive_path[drawn]),
    )
