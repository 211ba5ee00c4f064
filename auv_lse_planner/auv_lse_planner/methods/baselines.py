"""Baseline methods: one naive path (the lawnmower), and greedy selection of the next leg."""

from __future__ import annotations

import numpy as np

from auv_lse_common.vocabulary.naive_ids import id_in_plan
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_planner.methods.method import Situation
from auv_lse_planner.methods.path_method import PathMethod
from auv_lse_planner.paths.steering import DETOUR_LEGS
from auv_lse_planner.reward.anytime import Value
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import Proposal
from auv_lse_planner.search.uct import Actions, SearchResult


class NaivePath(PathMethod):
    """Follows one naive path to the mission's end. Vehicle i uses the i-th id of `planner.naive_paths`, cyclically."""

    def keeps(self, incumbent: Value, new: Value) -> bool:
        """Always keeps the incumbent: a naive path is never replaced."""
        return True

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """The naive path from the current state.

        If it would cross shallow ground, its first legs detour around it as explicit actions, because other vehicles do
        not have this map.
        """
        s, rollout, ids = situation, self.context.rollout, situation.planner.naive_paths
        vehicle, left = self.context.vehicle, rollout.steps - s.step
        naive_path = id_in_plan(ids[(vehicle - 1) % len(ids)], vehicle)
        actions: Actions = ()
        if not self.context.space.path_feasible(s.state, rollout.naive.actions(s.state, naive_path, left), DETOUR_LEGS):
            around = rollout.naive.actions(s.state, naive_path, left, around_shallows=True)
            actions = tuple(int(a) for a in around[:DETOUR_LEGS])
        locations = rollout.path(s.step, s.state, actions, naive_path).locations_m
        return Proposal(SearchResult(actions, reward.value(reward.posterior.at(locations))), naive_path)


class OneLeg(PathMethod):
    """The next leg with the best score at its end; the method's family selects the score."""

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """The best leg."""
        s, space, level = situation, self.context.space, reward.level_set
        choices = space.choices(s.state)
        points = reward.posterior.at(np.array([space.motion.end_state(s.state, a)[1:] for a in choices]))
        std = np.sqrt(points.planned_var_m2)
        family = s.planner.family_name
        if family == "variance":
            scores = std
        elif family == "straddle":  # Bryan et al. 2006
            scores = 1.96 * std - np.abs(points.mean_m - level.level_m)
        elif family == "benefit":
            scores = PathReward(reward.posterior, level).values_of_equal(points, 1)
        else:
            scores = self.context.rng.random(len(choices))
        action = int(choices[int(np.argmax(scores))])
        locations = self.context.rollout.path(s.step, s.state, (action,), NONE).locations_m
        return Proposal(SearchResult((action,), reward.value(reward.posterior.at(locations))), NONE)
