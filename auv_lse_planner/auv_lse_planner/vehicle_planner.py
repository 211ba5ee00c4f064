"""The planner of one vehicle: takes its map, its odometry and its team mates' plans, and decides leg by leg.

Theory of operation.

- Mission steps are counted by planned states: the decision for step i starts from the planned state of step i and
  gives the leg to step i + 1. The decision for step 0 is due with the first odometry after the start delay, the one
  for step i + 1 when what remains of leg i takes `replan_lead_s` or less. It starts from leg i's planned end, unless
  odometry shows the vehicle further than `reanchor_m` off its leg: then from where odometry leads in that time.
- The *incumbent* is the last plan, continued. If the method keeps it, it is valued on the same data as the new plan
  and given up only for one worth more, or when the map shows its next legs to be infeasible. An incumbent stays
  anchored at the state it was made from (its packet too), so that every receiver rebuilds the same path.
- Nothing here reads a clock. A decision always yields a leg: where nothing is feasible, the escape (free_space.py).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.leg import Leg
from auv_lse_common.plan import NONE, Plan
from auv_lse_gp.area import Grid, OperatingArea
from auv_lse_gp.centers import Centers
from auv_lse_gp.columns import Columns
from auv_lse_gp.factor import IllConditionedError
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_planner.config import PlannerConfig, PlannerSettings
from auv_lse_planner.methods import Recipe, recipe
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import IDS, NaivePaths
from auv_lse_planner.proposals import (
    Proposal,
    Situation,
    chosen_with_map,
    naive_only,
    one_leg,
    search_map,
    search_path,
)
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.reward.surrogate import Surrogate
from auv_lse_planner.search.dec_mcts import JOINT_DRAWS, KEPT_PLANS, search_dec_mcts
from auv_lse_planner.team import Team

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Legs of a continued plan that must be feasible on the map, at least.
LOOK_AHEAD = 3
#: Shallow ground is looked for so much (m) farther away than the legs of a plan lead: room to turn, and to spare.
SHALLOWS_BEYOND_M = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundRecord:
    """The account of one decision. Rewards are sums of expected benefit of search, in the unit of the costs.

    Attributes:
        step: Step planned from.
        now_s: Mission time.
        jbar: Value of the chosen path to its end (the paper's Jbar, or J without a naive path).
        naive_part: The part of `jbar` that the naive path brings.
        reward_so_far: Reward credited for the legs already decided.
        lower_bound: reward_so_far + naive_part: the time-varying lower bound.
        lower_bound_max: Its running maximum.
        promised: reward_so_far + jbar.
        incumbent_value: Value of continuing the last plan on the same data; NaN where there was none.
        incumbent_kept: Whether the last plan was continued.
        iterations: Search iterations.
        deadline_hit: Whether the deadline ended the search.
        method: The method.
    """

    step: int
    now_s: float
    jbar: float
    naive_part: float
    reward_so_far: float
    lower_bound: float
    lower_bound_max: float
    promised: float
    incumbent_value: float
    incumbent_kept: bool
    iterations: int
    deadline_hit: bool
    method: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """How a decision was found.

    Attributes:
        centers: Kernel centres of the map.
        team_places: Places that team mates' plans still hold.
        evaluations: Different paths valued.
        best_new_value: Value of the best path the search found; NaN if there was no search.
        progress: (iteration, best value) at every improvement.
        escape: Whether nothing was feasible.
        reanchored: Whether the plan starts from odometry instead of the planned state.
        incumbent_infeasible: Whether the last plan had to be given up because the map now forbids its next legs.
    """

    centers: int
    team_places: int
    evaluations: int = 0
    best_new_value: float = math.nan
    progress: list[tuple[int, float]] = field(default_factory=list)
    escape: bool = False
    reanchored: bool = False
    incumbent_infeasible: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What `VehiclePlanner.decide` gives.

    Attributes:
        plan: The path to the mission's end, to be shown to the team.
        leg: The leg to travel next.
        bound: The account.
        statistics: How it was found.
    """

    plan: Plan
    leg: Leg
    bound: BoundRecord
    statistics: Statistics


@dataclass(slots=True)
class _Odometry:
    now_s: float
    heading_rad: float
    north_m: float
    east_m: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class _Path:
    """A plan rolled out: states (L + 1, 3), actions (L,), of which the first `explicit` are the plan's own."""

    plan: Plan
    states: Array
    actions: Ints
    explicit: int

    def rest(self, step: int) -> tuple[Array, Ints, int]:
        """States, actions and number of own actions from mission step `step` on."""
        skip = step - self.plan.step
        return self.states[skip:], self.actions[skip:], max(0, self.explicit - skip)


class VehiclePlanner:
    """Plans for one vehicle; see the module's theory of operation."""

    def __init__(self, vehicle: int, settings: PlannerSettings, rng: np.random.Generator) -> None:
        """Sets up the planner.

        Args:
            vehicle: Number of the vehicle, from 1.
            settings: All parameters.
            rng: Random stream; every choice by chance is drawn from it.

        Raises:
            ValueError: if the number is not one of the mission's vehicles.
        """
        if not 1 <= vehicle <= settings.mission.vehicles:
            raise ValueError(f"vehicle: got {vehicle}; expected 1 to mission.vehicles = {settings.mission.vehicles}")
        self.vehicle = vehicle
        self.settings = settings
        self._rng = rng
        self.area = OperatingArea(settings.area)
        self.motion = MotionTable(settings.motion)
        self.space = FreeSpace(self.area, self.motion, settings.area.raster_m)
        self.naive = NaivePaths(self.space, settings.planner, self.area.polygon, settings.mission.vehicles)
        self.posterior = Posterior(settings.gp)
        self.team = Team(
            vehicle,
            settings.mission.vehicles,
            "all" if settings.planner.coordination == "dec_mcts" else settings.planner.team_order,
            self.motion.leg_length_m / settings.vehicle.speed_mps,
            settings.planner.plan_expiry_s,
            self.rebuild,
            KEPT_PLANS if settings.planner.coordination == "dec_mcts" else 1,
        )
        self._map_problem = ""
        self._new_centers: Centers | None = None
        self._map_s: float | None = None
        self._shallow_grid = self.area.grid(max(10.0, 2.0 * settings.area.raster_m))
        self._odometry: _Odometry | None = None
        self._travelled = False  # stays true once the last leg is done, wherever the vehicle circles then
        self._leg: Leg | None = None
        self._next_leg: Leg | None = None
        self._leg_started_s = math.nan
        self._path: _Path | None = None
        self._decided = 0
        self.plans_refused = 0
        self._map_grid: Grid | None = None
        self._map: KeptColumns | None = None
        self._surrogate: Surrogate | None = None
        self._rough_grid = self.area.grid(settings.planner.map_spacing_m)
        self._risk_at_start = math.nan
        self._reward_so_far = 0.0
        self._bound_max = -math.inf
        self._seeds: list[tuple[int, ...]] = []
        self.records: list[BoundRecord] = []
        self.set_planner(settings.planner)

    def set_planner(self, config: PlannerConfig) -> None:
        """Takes new planner parameters; they take effect at the next decision.

        Lanes (which all receivers must share), the map's spacing and the team's order stay as they were.
        """
        how = recipe(config)
        if config.coordination == "dec_mcts" and (how.kind != "search" or how.objective != "path"):
            raise ValueError(
                f"planner.coordination: 'dec_mcts' searches by the path's reward; got planner.method {config.method!r} "
                f"with objective {how.objective!r}; expected 'augmented', 'plain' or objective 'path'"
            )
        self.planner = config
        self.recipe = how

    # ------------------------------------------------------------------ what comes in

    def set_centers(self, centers: Centers, now_s: float | None = None) -> None:
        """Takes the map: all kernel centres. It is taken in at the next decision (cheap where old ones come first)."""
        self._new_centers = centers
        if now_s is not None:
            self._map_s = now_s

    def _take_centers(self) -> None:
        centers, self._new_centers = self._new_centers, None
        if centers is None:
            return
        try:
            self.posterior.follow(centers)
            self._map_problem = ""
        except IllConditionedError as error:
            self._map_problem = f"map: {error}"

    def _keep_off_shallows(self, state: Array) -> None:
        """Keeps clear of what the map shows to be too shallow, as far as legs planned from `state` can reach."""
        if not len(self.posterior.centers):
            return
        places = self._shallow_grid.places_m
        if self.recipe.kind != "naive":  # which looks as far as the mission goes
            legs = max(self.recipe.horizon, LOOK_AHEAD) + 2
            reach_m = legs * float(self.motion.lengths_m.max()) + SHALLOWS_BEYOND_M
            places = places[np.hypot(places[:, 0] - state[1], places[:, 1] - state[2]) <= reach_m]
        limit = self.settings.vehicle.depth_m + self.settings.vehicle.min_water_m
        self.space.set_shallow(places, self.posterior.mean_m(places) < limit, self._shallow_grid.resolution_m)

    def hear(self, now_s: float, vehicle: int, plan: Plan) -> None:
        """Takes the plan of team mate `vehicle`, received at `now_s`; what cannot be rebuilt is ignored and counted.

        One of a step beyond the mission, too: it would keep every true plan of that mate out as older.
        """
        if plan.naive_path not in (*IDS, NONE) or any(not 0 <= a < self.motion.actions for a in plan.actions):
            self.plans_refused += 1
            return
        if not all(math.isfinite(v) for v in (plan.heading_rad, plan.north_m, plan.east_m)):
            self.plans_refused += 1
            return
        if plan.step > self.settings.mission.steps:
            self.plans_refused += 1
            return
        self.team.hear(now_s, vehicle, plan)

    def odometry(self, now_s: float, heading_rad: float, north_m: float, east_m: float, speed_mps: float) -> None:
        """Takes the estimated state of the vehicle at `now_s`; values that are not finite are ignored."""
        if not all(math.isfinite(v) for v in (now_s, heading_rad, north_m, east_m)):
            return
        speed = speed_mps if math.isfinite(speed_mps) else self.settings.vehicle.speed_mps
        self._odometry = _Odometry(now_s, heading_rad, north_m, east_m, speed)
        leg, following = self._leg, self._next_leg
        if leg is not None and following is not None and leg.progress_m(north_m, east_m) >= leg.length_m - 1e-9:
            self._start_leg(following, now_s)
            self._next_leg = None
        if self._leg is not None and self._next_leg is None and self._decided >= self.settings.mission.steps:
            self._travelled = self._travelled or self._remaining_m() <= 0.0

    def _start_leg(self, leg: Leg, now_s: float) -> None:
        self._leg, self._leg_started_s = leg, now_s

    # ------------------------------------------------------------------ when

    @property
    def leg(self) -> Leg | None:
        """The leg being travelled; None before the first decision."""
        return self._leg

    @property
    def path(self) -> tuple[Array, Ints] | None:
        """States (L + 1, 3) and actions (L,) of the plan from the next decision's step on; None before the first."""
        if self._path is None:
            return None
        states, actions, _ = self._path.rest(self._decided)
        return states, actions

    @property
    def finished(self) -> bool:
        """Whether all steps are decided and travelled."""
        return self._travelled

    def _remaining_m(self) -> float:
        assert self._leg is not None
        assert self._odometry is not None
        return self._leg.length_m - self._leg.progress_m(self._odometry.north_m, self._odometry.east_m)

    def _overdue(self, now_s: float) -> bool:
        """Whether the leg has taken far longer than it should: the vehicle is held up or driven off."""
        assert self._leg is not None
        expected = self._leg.length_m / self.settings.vehicle.speed_mps
        return now_s - self._leg_started_s > 4.0 * expected + 10.0

    def due(self, now_s: float) -> bool:
        """Whether a decision is due."""
        if self._odometry is None or self._decided >= self.settings.mission.steps or self._next_leg is not None:
            return False
        if now_s - self._odometry.now_s > self.planner.odometry_timeout_s:
            return False
        if self._leg is None:
            return now_s >= self.settings.vehicle.start_delay_s
        lead = self.settings.vehicle.speed_mps * self.planner.replan_lead_s
        return bool(self._remaining_m() <= lead or self._overdue(now_s))

    def problems(self, now_s: float) -> dict[str, str]:
        """What keeps the planner from working as it should: a text for each problem, by its key.

        A key names the kind of problem (and the team mate, where it is about one) and stays the same while the
        problem lasts; its text may change from call to call.
        """
        found: dict[str, str] = {}
        started = now_s >= self.settings.vehicle.start_delay_s
        if self._odometry is None:
            if started:
                found["odometry missing"] = "odometry: none received; no planning without it"
        elif now_s - self._odometry.now_s > self.planner.odometry_timeout_s:
            found["odometry old"] = (
                f"odometry: last {now_s - self._odometry.now_s:.1f} s ago, more than planner.odometry_timeout_s = "
                f"{self.planner.odometry_timeout_s:g} s; planning has stopped"
            )
        if self._map_problem:
            found["map ill-conditioned"] = self._map_problem
        if self._map_s is not None and now_s - self._map_s > self.planner.map_timeout_s:
            found["map old"] = f"map: last {now_s - self._map_s:.0f} s ago; planning goes on with it"
        if started:
            ages = self.team.age_s(now_s)
            for mate in self.team.before(self._decided):
                if mate not in ages:
                    found[f"plan of {mate} missing"] = (
                        f"team: no plan of vehicle {mate} heard yet; planning goes on without"
                    )
                elif ages[mate] >= self.planner.plan_expiry_s:
                    found[f"plan of {mate} expired"] = (
                        f"team: plan of vehicle {mate} expired, heard {ages[mate]:.0f} s ago"
                    )
        if self._leg is not None and self._odometry is not None and not self.finished and self._overdue(now_s):
            found["leg overdue"] = (
                f"leg {self._leg.step}: not finished {now_s - self._leg_started_s:.0f} s after its start"
            )
        if self.plans_refused:
            found["plans refused"] = f"team: {self.plans_refused} received plans could not be rebuilt and were ignored"
        return found

    # ------------------------------------------------------------------ plans as paths

    def rebuild(self, plan: Plan) -> tuple[Array, Ints]:
        """States (L + 1, 3) and actions (L,) of a plan to the mission's end (or, without naive path, to its own)."""
        own = np.array(plan.actions[: max(0, self.settings.mission.steps - plan.step)], dtype=np.int64)
        states = self.motion.roll(plan.state, own)
        left = self.settings.mission.steps - plan.step - len(own)
        tail = self.naive.actions(states[-1], plan.naive_path, left)
        actions = np.concatenate([own, tail])
        return self.motion.roll(plan.state, actions), actions

    def _team_places(self, now_s: float, step: int) -> Array:
        return self._places_of([self.team.legs_ahead(now_s, mate) for mate in self.team.before(step)])

    def _places_of(self, legs: list[tuple[Array, Ints]]) -> Array:
        """Measurement places (O, 2) along legs, given by their states and actions."""
        samples = self.planner.samples_per_leg
        places = [self.motion.sample_places(states, actions, samples) for states, actions in legs if len(actions)]
        return np.concatenate([np.empty((0, 2)), *places])

    # ------------------------------------------------------------------ the decision

    def decide(self, now_s: float, deadline: Callable[[], bool] | None = None) -> Decision:
        """Decides the next leg.

        Args:
            now_s: Mission time.
            deadline: Says when to stop searching; the best path so far is then taken.

        Raises:
            ValueError: if no decision can be made: no odometry, or the mission is over (`due` says when to ask).
        """
        step, total = self._decided, self.settings.mission.steps
        if step >= total:
            raise ValueError(f"decide: all {total} steps are decided; expected to be asked only when `due`")
        state, reanchored = self._anchor(step)
        state = np.array([float(np.float32(v)) for v in state])
        self._take_centers()
        self._keep_off_shallows(state)
        places = self._team_places(now_s, step)
        self.posterior.plan(places)
        try:
            decision = self._decide(now_s, step, state, reanchored, len(places), deadline)
        finally:
            self.posterior.forget_planned()
        if self._leg is None or reanchored:
            self._start_leg(decision.leg, now_s)
            self._next_leg = None
        else:
            self._next_leg = decision.leg
        self._decided = step + 1
        self.records.append(decision.bound)
        return decision

    def _anchor(self, step: int) -> tuple[Array, bool]:
        """The state to plan from, and whether it comes from odometry."""
        odometry = self._odometry
        if odometry is None:
            raise ValueError("decide: no odometry yet; expected to be asked only when `due`")
        vehicle = self.settings.vehicle
        here = np.array([odometry.heading_rad, odometry.north_m, odometry.east_m])
        if self._leg is None:
            start = np.array([vehicle.start_heading_rad, vehicle.start_north_m, vehicle.start_east_m])
            off = math.hypot(odometry.north_m - start[1], odometry.east_m - start[2])
            return (here, True) if off > self.planner.reanchor_m else (start, False)
        remaining = self._remaining_m()
        if (
            self._leg.distance_off_m(odometry.north_m, odometry.east_m) <= self.planner.reanchor_m
            and remaining >= -self.planner.reanchor_m
            and not self._overdue(odometry.now_s)
        ):
            return self._leg.end_state, False
        ahead = min(max(remaining, 0.0), vehicle.speed_mps * self.planner.replan_lead_s)
        here[1] += ahead * math.cos(here[0])
        here[2] += ahead * math.sin(here[0])
        return here, True

    def _decide(
        self,
        now_s: float,
        step: int,
        state: Array,
        reanchored: bool,
        team_places: int,
        deadline: Callable[[], bool] | None,
    ) -> Decision:
        how = self.recipe
        left = self.settings.mission.steps - step
        horizon = min(how.horizon, left)
        naive_paths = self.naive.different(how.naive_paths) if how.tail and left > horizon else ()
        escape = not self.space.feasible(state).size
        situation = Situation(
            state=state,
            steps_left=left,
            horizon=horizon,
            naive_paths=naive_paths,
            iterations=how.iterations,
            exploration=how.exploration,
            batch=self.planner.batch,
            samples_per_leg=self.planner.samples_per_leg,
            finalists=how.finalists,
            rng=self._rng,
            deadline=deadline,
            seeds=self._seeds,
            grid=self._rough_grid,
            map_share=how.map_share,
        )
        level_set = self.settings.level_set
        if how.risk_method:
            level_set = dataclasses.replace(level_set, method=how.risk_method)
        reward: PathReward | MapReward
        if how.objective == "map":
            reward = MapReward(self._map_columns(), level_set)
            if math.isnan(self._risk_at_start):
                self._risk_at_start = float(reward.risk_in_hand.sum())
            # the map's risk is measured, not predicted: what the mission has brought so far is the drop until now
            self._reward_so_far = self._risk_at_start - float(reward.risk_in_hand.sum())
        else:
            reward = PathReward(self.posterior, level_set, how.credit)
        incumbent_value, infeasible = math.nan, False
        if self._path is not None and not reanchored:
            states, actions, _ = self._path.rest(step)
            if len(actions):
                infeasible = not self.space.path_feasible(states[0], actions, max(LOOK_AHEAD, horizon))
                incumbent_value = reward.value(self._columns(states, actions))
                if how.incumbent and not infeasible:
                    situation = dataclasses.replace(situation, to_beat=incumbent_value)
        shown: tuple[tuple[int, ...], int] | None = None
        if self.planner.coordination == "dec_mcts":
            draws = [self._places_of(self.team.draw(now_s, self._rng)) for _ in range(JOINT_DRAWS)]
            found, shown = search_dec_mcts(situation, self.space, self.naive, self.posterior, level_set, draws, step)
        else:
            found = self._propose(how, situation, reward)
        plan = Plan.at(step, state, found.actions, found.naive_path)
        chosen = _Path(plan, *self.rebuild(plan), len(found.actions))
        value, kept = found.value, False
        if shown is not None:  # valued against draws; from here on against the team mates' last plans
            value = reward.value(self._columns(chosen.states, chosen.actions))
        stays = how.kind == "naive" or incumbent_value >= value
        if self._path is not None and math.isfinite(situation.to_beat) and stays:
            chosen, value, kept = self._path, incumbent_value, True
        self._path = chosen
        states, actions, explicit = chosen.rest(step)
        columns = self._columns(states, actions)
        per_leg = self.planner.samples_per_leg
        if isinstance(reward, MapReward):
            naive_part = value - reward.value(columns.take(np.arange(explicit * per_leg)))
            first_part = 0.0
        else:
            gains = reward.contributions(columns)
            naive_part = float(gains[explicit * per_leg :].sum())
            first_part = float(gains[:per_leg].sum())
        first = int(actions[0])
        self._seeds = [a[1:] for a, _ in found.ranking if a and a[0] == first and len(a) > 1][:4]
        if kept:
            self._seeds.insert(0, tuple(int(a) for a in actions[1 : 1 + how.horizon]))
        bound = self._bound(now_s, step, value, naive_part, incumbent_value, kept, found.iterations, found.deadline_hit)
        self._reward_so_far += first_part
        statistics = Statistics(
            centers=len(self.posterior.centers),
            team_places=team_places,
            evaluations=found.evaluations,
            best_new_value=found.value,
            progress=found.progress,
            escape=escape,
            reanchored=reanchored,
            incumbent_infeasible=infeasible,
        )
        leg = self.motion.leg(step, states[0], first)
        told = chosen.plan if shown is None or kept else Plan.at(step, state, *shown)
        return Decision(plan=told, leg=leg, bound=bound, statistics=statistics)

    def _propose(self, how: Recipe, situation: Situation, reward: PathReward | MapReward) -> Proposal:
        """The method's new plan."""
        if how.kind == "search":
            if isinstance(reward, MapReward):
                own = PathReward(self.posterior, reward.level_set, how.credit) if how.proposals == "path" else None
                return search_map(situation, self.space, self.naive, reward, self._surrogate_for(reward), own)
            found = search_path(situation, self.space, self.naive, reward)
            if how.map_share > 0.0 and not found.deadline_hit:
                by_map = MapReward(self._map_columns(), reward.level_set)
                found = chosen_with_map(found, situation, self.space, by_map, how.map_share)
            return found
        if how.kind == "naive":
            naive_path = how.naive_paths[(self.vehicle - 1) % len(how.naive_paths)]
            return naive_only(situation, self.space, self.naive, reward, naive_path)
        return one_leg(situation, self.space, self.naive, reward, how.score)

    def _map_columns(self) -> KeptColumns:
        if self._map is None:
            self._map_grid = self.area.grid(self.planner.map_spacing_m)
            self._map = KeptColumns(self.posterior, self._map_grid.places_m)
        return self._map

    def _surrogate_for(self, reward: MapReward) -> Surrogate:
        if self._surrogate is None:
            assert self._map_grid is not None
            self._surrogate = Surrogate(self._map_grid, self.settings.level_set)
        self._surrogate.set(reward)
        return self._surrogate

    def _columns(self, states: Array, actions: Ints) -> Columns:
        return self.posterior.columns(self.motion.sample_places(states[:-1], actions, self.planner.samples_per_leg))

    def _bound(
        self,
        now_s: float,
        step: int,
        value: float,
        naive_part: float,
        incumbent_value: float,
        kept: bool,
        iterations: int,
        deadline_hit: bool,
    ) -> BoundRecord:
        lower = self._reward_so_far + naive_part
        self._bound_max = max(self._bound_max, lower)
        return BoundRecord(
            step=step,
            now_s=now_s,
            jbar=value,
            naive_part=naive_part,
            reward_so_far=self._reward_so_far,
            lower_bound=lower,
            lower_bound_max=self._bound_max,
            promised=self._reward_so_far + value,
            incumbent_value=incumbent_value,
            incumbent_kept=kept,
            iterations=iterations,
            deadline_hit=deadline_hit,
            method=self.recipe.method,
        )
