"""Decentralized MCTS (Best, Cliff, Patten, Mettu, Fitch 2019), the paper's alternative to the sequential order.

No vehicle comes before another. Each keeps a distribution over its own plans, tells the others of it, and searches its
tree against plans drawn from theirs. Here, under the packet budget of one plan in each packet:

- A packet carries one plan *drawn* from the sender's distribution, instead of the best one. A receiver's last
  `KEPT_PLANS` different plans of a team mate, newer ones weighing more, stand for the mate's distribution.
- The search values a sequence by its mean over `JOINT_DRAWS` joint draws of the team mates' plans. The reward is what
  the sequence adds beyond them (credit "beyond"), so it is the local utility of the paper.
- The own distribution is q(x) ~ exp(value(x) / temperature) over the best sequences of the search: the minimum of the
  free energy that Dec-MCTS descends to, for the others' distributions as they stand. The temperature falls from step to
  step (`cooling`). The vehicle itself travels the best sequence.

It plans by the path's reward; the compiled search on the map's reward has no joint draws.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.plan import NONE
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.proposals import Proposal, Situation
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.sequences import PathSequences
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


def search_dec_mcts(
    situation: Situation,
    space: FreeSpace,
    naive: NaivePaths,
    posterior: Posterior,
    level_set: LevelSet,
    draws: list[Array],
    step: int,
) -> tuple[Proposal, tuple[Actions, int]]:
    """Searches against joint draws of the team mates' plans.

    Args:
        situation: State and budget; the iterations are shared among the draws.
        space: Where to go.
        naive: Naive paths.
        posterior: The data; planned places are left alone.
        level_set: Level and costs.
        draws: Places that the team mates still visit in each draw, shape (O, 2) each.
        step: Mission step.

    Returns:
        The best sequence found; and the plan (actions, naive path) drawn from the own distribution, to be sent.
    """
    s = situation
    valuers = []
    for places in draws:
        against = posterior.copy()
        against.plan(places)
        reward = PathReward(against, level_set, "beyond")
        valuers.append(
            PathSequences(reward, space.motion, naive, s.state, s.steps_left, s.naive_paths, s.samples_per_leg)
        )

    def mean(sequences: list[Actions]) -> Array:
        return np.asarray(np.mean([valuer(sequences) for valuer in valuers], axis=0))

    budget = max(s.batch, s.iterations // len(valuers))
    heads = valuers[0].promising(space, s.horizon, budget // 6, 2)
    tree = ActionTree(space, s.state, s.horizon, s.exploration)
    result = run_search(tree, mean, s.horizon, budget, s.batch, s.rng, s.deadline, [*s.seeds, *heads])
    support = result.ranking[:SUPPORT]
    chances = distribution(np.array([value for _, value in support]), step)
    drawn = support[int(s.rng.choice(len(support), p=chances))][0]
    tails = valuers[0].continuations
    proposal = Proposal(
        actions=result.actions,
        naive_path=tails[result.actions].naive_path if s.naive_paths else NONE,
        value=result.value,
        iterations=result.iterations,
        evaluations=result.evaluations,
        deadline_hit=result.deadline_hit,
        ranking=result.ranking,
        progress=result.progress,
    )
    return proposal, (drawn, tails[drawn].naive_path if s.naive_paths else NONE)
