"""The receding horizon (paper, section 6): one decision of a vehicle, step by step.

Situation: the state to plan from, the horizon, the naive paths. Proposal: the method's new plan. Incumbent: the last
plan, continued; if the method keeps it, it is valued on the same data and given up only for a plan worth more, or when
the map shows its next legs to be infeasible. Choice: one of the two. Account: what it promises, and the lower bound.

An incumbent stays anchored at the state it was made from (its packet too), so that every receiver builds the same path.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.methods.account import Account, BoundRecord
from auv_lse_planner.methods.decision import Decision, Statistics
from auv_lse_planner.methods.proposals import naive_only, one_leg, search_path
from auv_lse_planner.methods.team import Team
from auv_lse_planner.methods.touring import OWN_PLACES, Touring
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.reward.doubt import doubt
from auv_lse_planner.reward.fix import worth_of_fix
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.dec_mcts import JOINT_DRAWS, search_dec_mcts
from auv_lse_planner.search.situation import Proposal, Situation
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Legs of a continued plan that must be feasible on the map, at least.
LOOK_AHEAD = 3
#: Sequences of a search that the next search tries first.
SEEDS = 4
#: Best sequences of a search that head a tour, and from which share of the mission on: before it none was ever chosen.
HEADS = 3
HEADS_FROM = 0.4


@dataclass(frozen=True, slots=True)
class Incumbent:
    """The last plan, continued.

    Attributes:
        plan: The plan.
        path: Its path from the present step on.
        value: Its value on today's data.
        infeasible: Whether the map forbids its next legs.
    """

    plan: Plan
    path: PlannedPath
    value: float
    infeasible: bool


@dataclass(frozen=True, slots=True)
class Weighing:
    """What a surfacing brings, and what it costs, both in the unit of the map's risk.

    Attributes:
        brings: Drop of what is lost by places in doubt.
        costs: Drop of the map's expected risk by the legs that are then missing.
    """

    brings: float
    costs: float

    @property
    def pays(self) -> bool:
        """Whether it brings more than it costs."""
        return self.brings > self.costs


@dataclass(frozen=True, slots=True)
class Choice:
    """The plan that is followed.

    Attributes:
        plan: The plan.
        path: Its path from the present step on.
        value: Its value.
        kept: Whether it is the incumbent.
    """

    plan: Plan
    path: PlannedPath
    value: float
    kept: bool


class RecedingHorizon:
    """Decides leg by leg for one vehicle.

    Attributes:
        planner: The parameters of the next decision, complete.
        path: The path of the plan that is followed, from the last decision's step on; None before the first decision.
    """

    def __init__(
        self,
        vehicle: int,
        settings: PlannerSettings,
        space: FreeSpace,
        rollout: Rollout,
        posterior: Posterior,
        team: Team,
        map_grid: Grid,
        coarse_grid: Grid,
        rng: np.random.Generator,
    ) -> None:
        """Sets up before the first decision.

        Args:
            vehicle: Number of the vehicle, from 1.
            settings: All parameters.
            space: Where to go.
            rollout: Follows plans to the mission's end.
            posterior: The map, with the team mates' places planned when a decision is asked for.
            team: Team mates.
            map_grid: Places over which the map's risk is summed.
            coarse_grid: Places over which it is summed where only its gradient counts.
            rng: Random stream; every choice by chance is drawn from it.
        """
        self.planner: PlannerConfig = settings.planner.complete()
        self.path: PlannedPath | None = None
        self._plan: Plan | None = None
        self._vehicle, self._settings = vehicle, settings
        self._space, self._rollout, self._posterior, self._team = space, rollout, posterior, team
        self._map_grid, self._coarse_grid, self._rng = map_grid, coarse_grid, rng
        self._account = Account()
        self._map: CachedPoints | None = None
        self._coarse: CachedPoints | None = None
        self._touring = Touring(vehicle, settings.mission.vehicles, space, rollout)
        self._seeds: list[Actions] = []

    def decide(
        self,
        now_s: float,
        step: int,
        state: Array,
        reanchored: bool,
        team_places: int,
        deadline: Callable[[], bool] | None,
    ) -> Decision:
        """Decides the leg of mission step `step`.

        Args:
            now_s: Mission time.
            step: Mission step planned from.
            state: State planned from, shape (3,).
            reanchored: Whether it comes from odometry: the last plan then leads from elsewhere and is given up.
            team_places: Number of places that team mates' plans still hold.
            deadline: Says when to stop searching; None: never.
        """
        if self.planner.proposals == "tour":
            return self._tour(now_s, step, state, reanchored, deadline)
        situation = self._situation(step, state, deadline)
        escape = not self._space.feasible(state).size
        reward = self._reward()
        incumbent = None if reanchored else self._incumbent(situation, reward)
        proposal = self._propose(now_s, situation, reward)
        choice = self._choose(situation, reward, proposal, incumbent)
        bound = self._enter(now_s, reward, proposal, incumbent, choice)
        self._plan, self.path = choice.plan, choice.path
        self._seeds = self._promising(proposal, choice)
        leg = self._rollout.motion.leg(step, choice.path.states[0], int(choice.path.actions[0]))
        for_team = choice.plan
        if proposal.for_team is not None and not choice.kept:
            for_team = Plan.at(step, state, *proposal.for_team)
        statistics = Statistics(
            centers=len(self._posterior.centers),
            team_places=team_places,
            evaluations=proposal.evaluations,
            best_new_value=proposal.value,
            progress=proposal.progress,
            escape=escape,
            reanchored=reanchored,
            incumbent_infeasible=incumbent is not None and incumbent.infeasible,
        )
        return Decision(plan=for_team, leg=leg, bound=bound, statistics=statistics)

    def snapshot(self) -> dict[str, Any]:
        """The plan, the account and the random stream, for a journal. The map is not in it."""
        plan = None
        if self._plan is not None and self.path is not None:
            plan = {"plan": dataclasses.asdict(self._plan), "step": self.path.step}
        return {
            "followed": plan,
            "account": self._account.snapshot(),
            "touring": self._touring.snapshot(),
            "seeds": [[int(a) for a in actions] for actions in self._seeds],
            "random": self._rng.bit_generator.state,
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Goes on from what `snapshot` gave."""
        if values["followed"] is not None:
            self.adopt(Plan.from_mapping(values["followed"]["plan"]), values["followed"]["step"])
        self._account.restore(values["account"])
        self._touring.restore(values["touring"])
        self._seeds = [tuple(actions) for actions in values["seeds"]]
        self._rng.bit_generator.state = values["random"]

    def adopt(self, plan: Plan, step: int) -> None:
        """Goes on from another plan than the one just decided for mission step `step`; the account stays."""
        self._plan, self.path = plan, self._rollout.follow(plan).from_step(step)

    def weigh_surfacing(self, now_s: float, legs: int) -> Weighing:
        """What a fix at the end of the leg just decided would bring, and what the last `legs` of the plan would."""
        if self.path is None:
            return Weighing(0.0, 0.0)
        brings = worth_of_fix(self._map_columns(), self._settings.level_set)
        reward = self._anytime(now_s, self.path.step)
        each = max(OWN_PLACES, self._rollout.samples_per_leg)
        places = self._rollout.leg_places(self.path.states[:-1], self.path.actions, each)
        left = max(len(places) - legs, 0)
        return Weighing(brings, reward.value(places).end - reward.value(places[:left]).end)

    def charge(self, weighing: Weighing, bound: BoundRecord) -> BoundRecord:
        """Enters a surfacing into the account of `tour`: the record of the decision that it belongs to, as it is then.

        What it costs is taken from the account. What the account does not hold, the bound loses.
        """
        if self.planner.family.bound_of != "map":
            return bound
        self._touring.balance = max(0.0, self._touring.balance - weighing.costs)
        jbar, account = bound.jbar - weighing.costs, self._touring.balance
        return dataclasses.replace(
            bound,
            jbar=jbar,
            account=account,
            naive_part=jbar - account,
            lower_bound=bound.reward_so_far + jbar - account,
            promised=bound.reward_so_far + jbar,
        )

    def delay(self, legs: int, told: Plan) -> Plan:
        """The vehicle stops for the time of so many legs: its path goes on as many steps later, and ends as it must.

        A naive path may be made for the legs that are left, and lead elsewhere with fewer. Then the plan goes on by
        the actions of the path: to choose anew would begin the lanes and the account again.

        Args:
            legs: How many.
            told: The plan that the team was to be told.

        Returns:
            What it is told in its place.
        """
        if self._plan is None or self.path is None:
            return told
        own = told == self._plan
        rest = self.path.from_step(self.path.step + 1)
        plan = dataclasses.replace(self._plan, step=self._plan.step + legs)
        path = self._rollout.follow(plan).from_step(self.path.step + legs)
        if not np.allclose(path.states[min(1, len(path))], rest.states[0], atol=1e-6):
            actions = tuple(int(action) for action in rest.actions[: max(len(rest) - legs, 0)])
            plan = Plan.at(rest.step + legs, rest.states[0], actions, NONE)
            path = self._rollout.follow(plan)
        self._plan, self.path = plan, path
        self.delayed(legs)
        return plan if own else dataclasses.replace(told, step=told.step + legs)

    def delayed(self, legs: int) -> None:
        """The plan that is followed goes on so many legs later than the one decided; less than 0: earlier."""
        self._touring.delay(legs)

    def _tour(
        self, now_s: float, step: int, state: Array, reanchored: bool, deadline: Callable[[], bool] | None
    ) -> Decision:
        """A decision of the method `tour` (`touring.py`)."""
        escape = not self._space.feasible(state).size
        last = None if self._plan is None or self.path is None else (self._plan, self.path.from_step(step))
        void = "off the plan" if reanchored and last is not None else ""
        if last is not None and not void and not self._space.path_feasible(state, last[1].actions, LOOK_AHEAD):
            void = "shallow ground"
        reward = self._anytime(now_s, step)
        mates = reward.mates
        self._account.measure(reward.risk_before)
        planned = np.concatenate([np.empty((0, 2)), *(places for _, places in mates)])
        due = last is not None and self._touring.due(self.planner, step, bool(void))
        heads = self._heads(step, state, planned, deadline) if due else []
        choice = self._touring.decide(
            self.planner,
            step,
            state,
            reward,
            last,
            bool(void),
            heads,
            lambda paths: self._own(planned, paths),
            deadline,
        )
        chosen, incumbent = choice.chosen, choice.incumbent
        so_far, jbar, account = self._account.reward_so_far, chosen.value.end, self._touring.balance
        lower, largest = self._account.bound(jbar - account)
        bound = BoundRecord(
            step=step,
            now_s=now_s,
            jbar=jbar,
            naive_part=jbar - account,
            reward_so_far=so_far,
            lower_bound=lower,
            lower_bound_max=largest,
            promised=so_far + jbar,
            incumbent_value=math.nan if incumbent is None else incumbent.value.end,
            incumbent_kept=chosen is incumbent,
            iterations=choice.iterations,
            deadline_hit=choice.deadline_hit,
            method=self.planner.method,
            account=account,
            void=void,
        )
        self._plan, self.path = chosen.plan, chosen.path
        leg = self._rollout.motion.leg(step, chosen.path.states[0], int(chosen.path.actions[0]))
        statistics = Statistics(
            centers=len(self._posterior.centers),
            team_places=sum(len(places) for _, places in mates),
            evaluations=choice.evaluations,
            best_new_value=max((c.value.end for c in choice.new), default=math.nan),
            escape=escape,
            reanchored=reanchored,
            incumbent_infeasible=void == "shallow ground",
        )
        return Decision(plan=chosen.plan, leg=leg, bound=bound, statistics=statistics)

    def _anytime(self, now_s: float, step: int) -> AnytimeReward:
        """What paths from mission step `step` on bring to the map, beside the team mates' plans."""
        steps = self._settings.mission.steps
        return AnytimeReward(
            self._map_columns(),
            self._settings.level_set,
            self._team.in_time_order(now_s + self.planner.replan_lead_s),
            steps - step,
            step,
            steps,
            self.planner.anytime_weight,
            self._coarse_columns(),
            doubt(self._posterior),
        )

    def _heads(self, step: int, state: Array, planned_m: Array, deadline: Callable[[], bool] | None) -> list[Actions]:
        """The best sequences of a tree search on the own places' reward, beyond what is planned at `planned_m`."""
        early = step < HEADS_FROM * self._settings.mission.steps
        if early or not self.planner.tour_interval or (deadline is not None and deadline()):
            return []
        self._posterior.plan(planned_m)
        try:
            own = PathReward(self._posterior, self._settings.level_set, self.planner.credit)
            found = search_path(self._situation(step, state, deadline), self._space, self._rollout, own)
        finally:
            self._posterior.forget_planned()
        self._seeds = [a[1:] for a, _ in found.ranking if len(a) > 1][:SEEDS]
        return [a for a, _ in found.ranking[:HEADS]]

    def _own(self, planned_m: Array, paths: Sequence[PlannedPath]) -> list[float]:
        """What the next legs of paths bring at their own places, beyond what is planned at `planned_m`."""
        self._posterior.plan(planned_m)
        try:
            own = PathReward(self._posterior, self._settings.level_set, self.planner.credit)
            legs = self.planner.horizon
            return [own.value(self._posterior.at(p.leg_places_m[:legs].reshape(-1, 2))) for p in paths]
        finally:
            self._posterior.forget_planned()

    def _coarse_columns(self) -> CachedPoints:
        if self._coarse is None:
            self._coarse = CachedPoints(self._posterior, self._coarse_grid.places_m)
        return self._coarse

    def _situation(self, step: int, state: Array, deadline: Callable[[], bool] | None) -> Situation:
        left = self._settings.mission.steps - step
        horizon = min(self.planner.horizon, left)
        continued = self.planner.augmented and left > horizon
        return Situation(
            planner=self.planner,
            step=step,
            state=state,
            horizon=horizon,
            naive_paths=self._rollout.naive.different(self.planner.naive_paths) if continued else (),
            rng=self._rng,
            deadline=deadline,
            seeds=self._seeds,
            grid=self._map_grid,
        )

    def _reward(self) -> PathReward:
        level_set = self._settings.level_set
        if self.planner.entry.risk_integral:
            level_set = dataclasses.replace(level_set, method=self.planner.entry.risk_integral)
        return PathReward(self._posterior, level_set, self.planner.credit)

    def _map_columns(self) -> CachedPoints:
        if self._map is None:
            self._map = CachedPoints(self._posterior, self._map_grid.places_m)
        return self._map

    def _incumbent(self, s: Situation, reward: PathReward) -> Incumbent | None:
        if self._plan is None or self.path is None:
            return None
        path = self.path.from_step(s.step)
        if not len(path):
            return None
        feasible = self._space.path_feasible(path.states[0], path.actions, max(LOOK_AHEAD, s.horizon))
        return Incumbent(self._plan, path, reward.value(self._posterior.at(path.places_m)), not feasible)

    def _propose(self, now_s: float, s: Situation, reward: PathReward) -> Proposal:
        """The method's new plan."""
        space, rollout = self._space, self._rollout
        if self.planner.coordination == "dec_mcts":
            draws = [self._team.draw(now_s, self._rng) for _ in range(JOINT_DRAWS)]
            return search_dec_mcts(s, space, rollout, self._posterior, reward.level_set, draws)
        if self.planner.proposals == "naive":
            ids = self.planner.naive_paths
            return naive_only(s, space, rollout, reward, ids[(self._vehicle - 1) % len(ids)])
        if self.planner.proposals != "path":
            return one_leg(s, space, rollout, reward)
        return search_path(s, space, rollout, reward)

    def _choose(self, s: Situation, reward: PathReward, proposal: Proposal, incumbent: Incumbent | None) -> Choice:
        """The incumbent, if it may stay and the proposal is not worth more; a naive path is never exchanged."""
        plan = Plan.at(s.step, s.state, proposal.actions, proposal.naive_path)
        path, value = self._rollout.follow(plan), proposal.value
        if proposal.for_team is not None:  # valued against draws; from here on against the team mates' last plans
            value = reward.value(self._posterior.at(path.places_m))
        may_stay = incumbent is not None and self.planner.incumbent and not incumbent.infeasible
        if incumbent is not None and may_stay and (self.planner.proposals == "naive" or incumbent.value >= value):
            return Choice(incumbent.plan, incumbent.path, incumbent.value, True)
        return Choice(plan, path, value, False)

    def _enter(
        self,
        now_s: float,
        reward: PathReward,
        proposal: Proposal,
        incumbent: Incumbent | None,
        choice: Choice,
    ) -> BoundRecord:
        """Enters the choice into the account."""
        columns, leg_places = self._posterior.at(choice.path.places_m), self._rollout.samples_per_leg
        own_places = choice.path.own * leg_places
        gains = reward.contributions(columns)
        naive_part, of_leg = float(gains[own_places:].sum()), float(gains[:leg_places].sum())
        so_far = self._account.reward_so_far
        lower, largest = self._account.bound(naive_part)
        self._account.credit(of_leg)
        return BoundRecord(
            step=choice.path.step,
            now_s=now_s,
            jbar=choice.value,
            naive_part=naive_part,
            reward_so_far=so_far,
            lower_bound=lower,
            lower_bound_max=largest,
            promised=so_far + choice.value,
            incumbent_value=math.nan if incumbent is None else incumbent.value,
            incumbent_kept=choice.kept,
            iterations=proposal.iterations,
            deadline_hit=proposal.deadline_hit,
            method=self.planner.method,
        )

    def _promising(self, proposal: Proposal, choice: Choice) -> list[Actions]:
        """Sequences for the next search to try first: this search's best that begin with the leg decided."""
        actions = tuple(int(a) for a in choice.path.actions)
        seeds = [a[1:] for a, _ in proposal.ranking if len(a) > 1 and a[0] == actions[0]][:SEEDS]
        return [actions[1 : 1 + self.planner.horizon], *seeds] if choice.kept else seeds
