"""Decentralized MCTS (Best, Cliff, Patten, Mettu, Fitch 2019), the paper's alternative to the sequential order.

No vehicle comes before another. Each keeps a distribution over its own plans, sends it to the others, and searches its
tree against plans drawn from theirs. Here, as a packet has room for one plan:

- A packet carries one plan *drawn* from the sender's distribution, instead of the best one. A receiver's last
  `KEPT_PLANS` different plans of a team mate, newer ones weighing more, stand for the mate's distribution.
- The search values a sequence by its mean over `JOINT_DRAWS` joint draws of the team mates' plans. The reward is what
  the sequence adds beyond them (credit "beyond"), so it is the local utility of the paper.
- The own distribution is q(x) ~ exp(value(x) / temperature) over the best sequences of the search: the minimum of the
  free energy that Dec-MCTS descends to, for the others' distributions as they stand. The temperature falls from step to
  step (`COOLING`). The vehicle itself travels the best sequence.

It plans by the path's reward.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.sequences import PathSequences
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, run_search
from auv_lse_planner.situation import Proposal, Situation

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

    def __init__(self, draws: list[PathSequences]) -> None:
        """Takes the values of sequences against each draw; all of them know the same naive paths."""
        self._draws = draws

    def __call__(self, sequences: Sequence[Actions]) -> Array:
        """Mean values (B,) of sequences of the same length."""
        by_naive_path = np.mean([draw.by_naive_path(sequences) for draw in self._draws], axis=0)
        return self._draws[0].take_best(sequences, by_naive_path)

    def naive_path(self, sequence: Actions) -> int:
        """The naive path that continues a valued sequence best; `NONE` where there is none."""
        return self._draws[0].naive_path[sequence]


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
        situation: State and parameters; the iterations are shared among the draws.
        space: Where to go.
        rollout: Follows plans to the mission's end.
        posterior: The data; planned places are left alone.
        level_set: Level and costs.
        draws: Places that the team mates still visit in each draw, shape (O, 2) each.

    Returns:
        The best sequence found; for the team, the plan drawn from the own distribution.
    """
    s, planner = situation, situation.planner
    valuers = []
    for places in draws:
        against = posterior.copy()
        against.plan(places)
        valuers.append(PathSequences(PathReward(against, level_set, "beyond"), rollout, s.step, s.state, s.naive_paths))
    joint = JointDraws(valuers)
    budget = max(planner.batch, planner.iterations // len(valuers))
    promising = valuers[0].promising(space, s.horizon, budget // 6, 2)
    tree = ActionTree(space, s.state, s.horizon, planner.exploration)
    result = run_search(tree, joint, s.horizon, budget, planner.batch, s.rng, s.deadline, [*s.seeds, *promising])
    support = result.ranking[:SUPPORT]
    chances = distribution(np.array([value for _, value in support]), s.step)
    drawn = support[int(s.rng.choice(len(support), p=chances))][0]
    return Proposal(
        actions=result.actions,
        naive_path=joint.naive_path(result.actions),
        value=result.value,
        iterations=result.iterations,
        evaluations=result.evaluations,
        deadline_hit=result.deadline_hit,
        ranking=result.ranking,
        progress=result.progress,
        for_team=(drawn, joint.naive_path(drawn)),
    )
