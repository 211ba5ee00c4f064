"""Common base of the methods that maximize the paper's reward at the locations of one path (paper, section 6).

With data S, locations O on the plans of the team mates before this vehicle, and a path V:

1. Incumbent: the last plan, evaluated as J(V | S u O) on the current data; void if the map forbids its next legs.
2. Proposal: the method's new plan (`propose`).
3. Choice: the incumbent is replaced only by a plan with a higher value (`planner.incumbent`).
4. Bound: the reward so far plus the reward of the chosen plan's naive path (paper: the time-varying lower bound).
"""

from __future__ import annotations

import numpy as np

from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.methods.method import Candidate, Choice, Method, PlanningContext, Situation
from auv_lse_planner.paths.steering import LOOK_AHEAD
from auv_lse_planner.reward.anytime import Value
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import Proposal


class PathMethod(Method):
    """A method whose reward is that of this vehicle's path. Subclasses propose plans."""

    def __init__(self, context: PlanningContext) -> None:
        self.context = context

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """A new plan, evaluated by `reward`, whose posterior includes the team mates' positions."""
        raise NotImplementedError

    def keeps(self, incumbent: Value, new: Value) -> bool:
        """Whether to keep a feasible incumbent instead of the new plan."""
        return incumbent.expected_end >= new.expected_end

    def remember(self, situation: Situation, proposal: Proposal, choice: Choice) -> None:
        """Called after every choice, to prepare the next search."""

    def decide(self, situation: Situation) -> Choice:
        """See `Method`."""
        s, context = situation, self.context
        mates_m = self._locations_of_mates(s)
        reward = context.path_reward(s, mates_m)
        incumbent = self._incumbent(s, reward)
        infeasible = incumbent is not None and not self._is_feasible(s, incumbent)
        proposal = self.propose(s, reward)
        found = proposal.found
        plan = Plan.at(s.step, s.state, found.actions, proposal.naive_path)
        new = Candidate(plan, context.rollout.follow(plan), Value(found.value, found.value))
        chosen, may_stay = new, s.planner.incumbent and not infeasible
        if incumbent is not None and may_stay and self.keeps(incumbent.value, new.value):
            chosen = incumbent
        gains = reward.contributions(reward.posterior.at(chosen.path.locations_m))
        per_leg = context.rollout.samples_per_leg
        choice = Choice(
            chosen=chosen,
            incumbent=incumbent,
            assured=float(gains[chosen.path.own * per_leg :].sum()),
            leg_reward=float(gains[:per_leg].sum()),
            infeasible=infeasible,
            team_locations=len(mates_m),
            iterations=found.iterations,
            evaluations=found.evaluations,
            best_new_value=found.value,
            deadline_hit=found.deadline_hit,
        )
        self.remember(s, proposal, choice)
        return choice

    def _locations_of_mates(self, s: Situation) -> np.ndarray:
        """Locations (O, 2) ahead of the team mates whose plans are taken into account."""
        team = self.context.team
        mates = team.others if s.planner.family.all_mates else team.before
        return np.concatenate([np.empty((0, 2)), *(team.locations_ahead(s.now_s, mate) for mate in mates)])

    def _incumbent(self, s: Situation, reward: PathReward) -> Candidate | None:
        """The last plan with its value on the current data."""
        if s.off_plan or s.last is None or not len(s.last.path):
            return None
        value = reward.value(reward.posterior.at(s.last.path.locations_m))
        return Candidate(s.last.plan, s.last.path, Value(value, value))

    def _is_feasible(self, s: Situation, incumbent: Candidate) -> bool:
        path, left = incumbent.path, self.context.rollout.steps - s.step
        legs = max(LOOK_AHEAD, min(s.planner.horizon, left))
        return self.context.space.path_feasible(path.states[0], path.actions, legs)
