"""The interface of planning methods: their inputs, their result and their common base.

A method decides one leg after another (the receding horizon of the paper, section 6). `VehiclePlanner` calls it when a
decision is due, tracks the leg, and writes the bound record. The method keeps its optimizer state, its budget and its
copy of the posterior; it does not change the vehicle's posterior.

The incumbent is the last plan, continued. The plan and its packet keep the state from which the plan was made, so that
every receiver builds the same path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.methods import MAP_LOCATIONS_PER_LEG
from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.vocabulary.naive_ids import id_in_plan
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.methods.ground_window import GroundWindow
from auv_lse_planner.methods.horizon import Horizon
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.position_margin import PositionMargin
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.reward.anytime import NO_PREFERENCE, AnytimeReward, ConstantValue, Value, Weighting
from auv_lse_planner.reward.fix import gain_of_fix
from auv_lse_planner.reward.losses import Loss
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.reward.std_inflation import std_inflation
from auv_lse_planner.search.path_search import SearchProblem
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Largest number of mates' planned locations near the ground of a stage; three vehicles never have as many.
MAX_MATE_LOCATIONS = 800


@dataclass(frozen=True, slots=True)
class RemainingTour:
    """The rest of a long mission, after the legs that are planned in detail.

    Attributes:
        begin: Mission step at which it begins.
        locations_m: Locations after each of its legs, (P, 2).
        drop: Its part of the expected drop of the map's risk.
    """

    begin: int
    locations_m: Array
    drop: float


@dataclass(frozen=True, kw_only=True)
class PlanningContext:
    """The objects that all methods of one vehicle share.

    Attributes:
        vehicle: Number of the vehicle, from 1.
        horizon: The step that paths are planned to.
        window: The part of the map that the planner uses.
    """

    vehicle: int
    settings: PlannerSettings
    space: FreeSpace
    rollout: Rollout
    window: GroundWindow
    team: Team
    horizon: Horizon
    rng: np.random.Generator

    @property
    def posterior(self) -> Posterior:
        """The map. A method that needs planned locations copies it (`with_planned`)."""
        return self.window.posterior

    @property
    def map_grid(self) -> Grid:
        """Locations over which the map's risk is summed."""
        return self.window.grid

    def assume_plans(self, situation: Situation) -> None:
        """Assumes that team mates without a received plan mow, from the first call on."""
        self.team.assume_plans(situation.now_s + situation.planner.replan_lead_s)

    def mates_ahead(self, situation: Situation) -> list[tuple[Array, Array]]:
        """For each mate, times (P,) and locations (P, 2) of the planned measurements near the window.

        Near the ground of a stage, those of a large team are thinned out: every second, third... of each mate.
        """
        ahead = self.team.in_time_order(situation.now_s + situation.planner.replan_lead_s)
        near = [self.window.near(locations) for _, locations in ahead]
        every = 1
        if self.window.is_focused:
            every = max(math.ceil(sum(int(mask.sum()) for mask in near) / MAX_MATE_LOCATIONS), 1)
        return [
            (legs[mask][::every], locations[mask][::every]) for (legs, locations), mask in zip(ahead, near, strict=True)
        ]

    def map_reward(
        self,
        situation: Situation,
        rest: RemainingTour | None = None,
        loss: Loss | None = None,
        near: tuple[float, float] = NO_PREFERENCE,
    ) -> AnytimeReward:
        """Reward of paths: the expected drop of the map's risk, given the team mates' plans in time order.

        Args:
            rest: The tour after the legs that are planned in detail; None: none.
            loss: The loss that replaces the risk.
            near: `Weighting.near`; it replaces `planner.anytime_weight`.
        """
        planner, steps = situation.planner, self.horizon.end
        mates, end, constant = self.mates_ahead(situation), steps, ConstantValue()
        if rest is not None:
            end, constant = rest.begin, ConstantValue(self.window.elsewhere_risk, rest.drop)
            kept = self.window.near(rest.locations_m)
            legs = (rest.begin - situation.step + 1.0 + np.flatnonzero(kept)).astype(np.float64)
            mates.append((legs, rest.locations_m[kept]))
        return AnytimeReward(
            self.window.fine,
            self.settings.level_set if loss is None else loss,
            mates,
            Weighting(end - situation.step, situation.step, steps, 0.0 if near[0] else planner.anytime_weight, near),
            self.window.coarse,
            std_inflation(self.posterior),
            constant,
        )

    def path_reward(self, situation: Situation, planned_m: Array) -> PathReward:
        """Reward at the positions of this vehicle's path, with measurements planned at locations (O, 2)."""
        level_set = LevelSet.of(self.settings.level_set, situation.planner.entry.risk_integral)
        return PathReward(self.posterior.with_planned(planned_m), level_set, situation.planner.credit)

    def search_problem(self, situation: Situation, seeds: list[Actions]) -> SearchProblem:
        """The problem of a tree search that tries `seeds` first."""
        planner, left = situation.planner, self.horizon.end - situation.step
        continued = planner.augmented and left > planner.horizon
        naive_paths = tuple(id_in_plan(each, self.vehicle) for each in planner.naive_paths)
        return SearchProblem(
            planner=planner,
            step=situation.step,
            state=situation.state,
            horizon=min(planner.horizon, left),
            naive_paths=self.rollout.naive.distinct(naive_paths) if continued else (),
            rng=self.rng,
            deadline=situation.deadline,
            seeds=seeds,
            grid=self.map_grid,
        )

    def naive_plan(self, step: int, state: Array, naive_path: int) -> Plan:
        """A naive path from `state` (3,) to the horizon; as actions unless that is the mission's last step."""
        plan = Plan.at(step, state, (), naive_path)
        if self.horizon.is_whole:
            return plan
        actions = self.rollout.naive.actions(plan.state, naive_path, self.horizon.end - step)
        return Plan.at(step, state, tuple(int(a) for a in actions), NONE)

    def map_locations(self, path: PlannedPath) -> Array:
        """Locations (L, n, 2) at which the map's reward evaluates a path: `MAP_LOCATIONS_PER_LEG`, or more."""
        each = max(MAP_LOCATIONS_PER_LEG, self.rollout.samples_per_leg)
        return self.rollout.leg_locations(path.states[:-1], path.actions, each)


@dataclass(frozen=True, slots=True)
class Followed:
    """A plan, and its path from a mission step on."""

    plan: Plan
    path: PlannedPath


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """The inputs of a decision.

    Attributes:
        now_s: Mission time.
        step: Mission step planned from.
        state: Heading (rad), north, east (m), shape (3,).
        last: The last plan and its path from this step on; None before the first.
        off_plan: Whether `state` comes from odometry, so that the last plan cannot be continued from it.
        margin: Margin from the border for the present uncertainty of the position.
        deadline: Returns whether to stop searching; None: no deadline.
        evaluates: Whether to evaluate plans; if not, the last plan continues if the ground allows.
    """

    planner: PlannerConfig
    now_s: float
    step: int
    state: Array
    last: Followed | None = None
    off_plan: bool = False
    margin: PositionMargin = field(default_factory=PositionMargin)
    deadline: Callable[[], bool] | None = None
    evaluates: bool = True

    @property
    def out_of_time(self) -> bool:
        """Whether the deadline has passed."""
        return self.deadline is not None and self.deadline()


@dataclass(frozen=True, slots=True)
class Candidate:
    """A candidate plan, with its path from the current step on and its value.

    Attributes:
        value: Its value on the current data.
        waypoints_m: The waypoints of its tour, shape (n + 1, 2); None without a tour.
    """

    plan: Plan
    path: PlannedPath
    value: Value
    waypoints_m: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The decision of a method.

    Attributes:
        chosen: The plan to follow: the incumbent or a new one.
        incumbent: The last plan, continued; None if there is none or it is void.
        assured: The part of the chosen plan's expected end that no later decision can lose.
        leg_reward: Expected reward of the next leg, if rewards are added up leg by leg.
        map_risk: Risk of the map, if the reward so far is measured by its drop; else NaN.
        budget: See `BoundRecord`.
        void, void_value: See `BoundRecord`.
        infeasible: Whether the map forbids the next legs of the last plan.
        best_new_value: Expected end of the best new plan, in the search's reward.
    """

    chosen: Candidate
    incumbent: Candidate | None
    assured: float
    leg_reward: float = 0.0
    map_risk: float = math.nan
    budget: float = math.nan
    void: str = ""
    void_value: float = math.nan
    infeasible: bool = False
    team_locations: int = 0
    iterations: int = 0
    evaluations: int = 0
    best_new_value: float = math.nan
    deadline_hit: bool = False


@dataclass(frozen=True, slots=True)
class SurfacingValue:
    """Gain and cost of a surfacing, both in the unit of the map's risk.

    Attributes:
        gain: Drop of the loss from uncertain positions.
        cost: Drop of the map's expected risk that is lost with the skipped legs.
    """

    gain: float
    cost: float

    @property
    def pays(self) -> bool:
        """Whether the surfacing gains more than it costs."""
        return self.gain > self.cost


class Method(Protocol):
    """A planning method of one vehicle. Subclasses implement `decide`; the other members have defaults."""

    context: PlanningContext

    def decide(self, situation: Situation) -> Choice:
        """Chooses the plan whose first leg is travelled next."""
        ...

    def evaluates(self, step: int, planner: PlannerConfig) -> bool:
        """Whether the decision from this step has to evaluate plans."""
        return True

    def map_reward(self, situation: Situation) -> AnytimeReward:
        """Reward of paths over the legs that are planned in detail: by default, all remaining ones."""
        return self.context.map_reward(situation)

    def weigh_surfacing(self, situation: Situation, path: PlannedPath, legs: int) -> SurfacingValue:
        """Compares the gain of a fix after the leg just decided with its cost: the last `legs` legs of the path."""
        self.context.assume_plans(situation)
        gain = gain_of_fix(self.context.window.fine, self.context.settings.level_set)
        reward = self.map_reward(situation)
        locations = self.context.map_locations(path)[: reward.legs]
        kept = locations[: max(len(locations) - legs, 0)]
        return SurfacingValue(gain, reward.value(locations).expected_end - reward.value(kept).expected_end)

    def spend(self, cost: float) -> float | None:
        """Subtracts the cost of a surfacing from the budget, down to 0.

        Returns:
            The remaining budget; None for a method without a budget.
        """
        return None

    def shift(self, legs: int) -> None:
        """Shifts the plan to this many legs later than decided; negative means earlier."""
        return  # a default, not an abstract method

    def snapshot(self) -> dict[str, Any]:
        """The method's state as JSON values, for a journal."""
        return {}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        return
