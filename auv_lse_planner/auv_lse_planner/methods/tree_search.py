"""The paper's methods: Monte Carlo tree search on the path's reward (augmented, plain, exponential_quadratic).

They differ only in their parameters (`auv_lse_common.mission_file.methods`): the number of legs searched, whether a
naive path follows (paper: the augmented path), and the integral of the expected risk.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auv_lse_planner.methods.method import Choice, PlanningContext, Situation
from auv_lse_planner.methods.path_method import PathMethod
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import Proposal, search_path
from auv_lse_planner.search.uct import Actions

#: Number of sequences of a search that the next search tries first.
SEEDS = 4


class TreeSearch(PathMethod):
    """Proposes the best sequence of a tree search; the next search starts from its best sequences."""

    def __init__(self, context: PlanningContext) -> None:
        super().__init__(context)
        self.seeds: list[Actions] = []

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """See `PathMethod`."""
        problem = self.context.search_problem(situation, self.seeds)
        return search_path(problem, self.context.space, self.context.rollout, reward)

    def remember(self, situation: Situation, proposal: Proposal, choice: Choice) -> None:
        """Keeps the rest of the best sequences that begin with the decided leg."""
        actions = tuple(int(a) for a in choice.chosen.path.actions)
        ranking = proposal.found.ranking
        self.seeds = [a[1:] for a, _ in ranking if len(a) > 1 and a[0] == actions[0]][:SEEDS]
        if choice.chosen is choice.incumbent:
            self.seeds.insert(0, actions[1 : 1 + situation.planner.horizon])

    def snapshot(self) -> dict[str, Any]:
        """See `Method`."""
        return {"seeds": [[int(a) for a in actions] for actions in self.seeds]}

    def restore(self, values: Mapping[str, Any]) -> None:
        """See `Method`."""
        self.seeds = [tuple(actions) for actions in values["seeds"]]
