"""The planner of one vehicle: takes its map, its odometry and its team mates' plans, and decides leg by leg.

Theory of operation.

- Mission steps are counted by planned states: the decision for step i starts from the planned state of step i and
  gives the leg to step i + 1. The decision for step 0 is due with the first odometry after the start delay, the one
  for step i + 1 when what remains of leg i takes `replan_lead_s` or less. It starts from leg i's planned end, unless
  odometry shows the vehicle further than `reanchor_m` off its leg, headed elsewhere, or past that end: then from where
  odometry leads in that time (`travel.py`). A surfacing takes the time of some legs (`surfacing.py`): their steps are
  passed over, and the plan waits for as many.
- Steps are counted only while the mission goes (`run`): while it waits or holds nothing is decided, and the leg under
  way takes no time.
- A decision goes through the steps of `receding_horizon.py`.
- Plans are made in the map, whose places may be corrected; odometry is displaced against it (`displaced`). Legs are
  given to the vehicle, and travelled, as that knows its place (`for_vehicle`).
- Nothing here reads a clock. A decision always yields a leg: where nothing is feasible, the escape (`free_space.py`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.mission_file.sections.vehicle import MOST_SURFACINGS
from auv_lse_common.vocabulary.health import Recent
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.methods.account import BoundRecord
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.methods.receding_horizon import LOOK_AHEAD, RecedingHorizon, Weighing
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.search.dec_mcts import KEPT_PLANS
from auv_lse_planner.vehicle import problems
from auv_lse_planner.vehicle.surfacing import Surfacings
from auv_lse_planner.vehicle.travel import EstimatedState, Travel

Array = NDArray[np.float64]

#: Shallow ground is looked for so much (m) farther away than the legs of a plan lead: room to turn, and to spare.
SHALLOWS_BEYOND_M = 100.0
#: Least spacing (m) of the cells over which the gradient of a tour's reward is summed.
COARSE_M = 30.0


class VehiclePlanner:
    """Plans for one vehicle; see the module's theory of operation.

    Attributes:
        vehicle: Number of the vehicle.
        settings: All parameters, as they were at the start.
        motion: Its actions.
        space: Where it may go.
        rollout: Follows plans, its own and team mates', to the mission's end.
        posterior: Its map.
        team: Its team mates.
        plans_refused: Number of received plans that could not be followed.
        records: The account of every decision.
    """

    def __init__(self, vehicle: int, settings: PlannerSettings, rng: np.random.Generator) -> None:
        """Sets up the planner.

        Args:
            vehicle: Number of the vehicle, from 1.
            settings: All parameters.
            rng: Random stream; every choice by chance is drawn from it.

        Raises:
            ValueError: if the number is not one of the mission's vehicles, or parameters contradict each other.
        """
        mission, planner, area = settings.mission, settings.planner, OperatingArea(settings.area)
        if not 1 <= vehicle <= mission.vehicles:
            raise ValueError(f"vehicle: got {vehicle}; expected 1 to mission.vehicles = {mission.vehicles}")
        self.vehicle = vehicle
        self.settings = settings
        self.motion = MotionTable(settings.motion)
        self.space = FreeSpace(area, self.motion, settings.area.raster_m)
        naive = NaivePaths(self.space, planner, area.polygon, mission.vehicles)
        self.rollout = Rollout(self.motion, naive, mission.steps, planner.samples_per_leg)
        self.posterior = Posterior(settings.gp)
        decentralized = planner.coordination == "dec_mcts"
        self.team = Team(
            vehicle,
            mission.vehicles,
            "all" if decentralized else planner.team_order,
            self.motion.leg_length_m / settings.vehicle.speed_mps,
            planner.plan_expiry_s,
            self.rollout.follow,
            KEPT_PLANS if decentralized else 1,
            self._mowing,
        )
        self.plans_refused = 0
        self.records: list[BoundRecord] = []
        wanted = settings.vehicle.surfacings
        if wanted is None:
            wanted = 0 if planner.entry.of_paper else MOST_SURFACINGS
        self._surfacings = Surfacings(vehicle, settings.vehicle, wanted, mission.steps, self.motion.leg_length_m)
        self._travel = Travel(settings.vehicle, mission.steps, self._surfacings.legs)
        self._horizon = RecedingHorizon(
            vehicle,
            settings,
            self.space,
            self.rollout,
            self.posterior,
            self.team,
            area.grid(planner.map_spacing_m),
            area.grid(max(COARSE_M, planner.map_spacing_m)),
            rng,
        )
        self._shallow_grid = area.grid(max(10.0, 2.0 * settings.area.raster_m))
        self._new_centers: Centers | None = None
        self._map_s: float | None = None
        self._map_refused = ""
        self._held = ""
        self._recent = Recent()
        self._displaced_m = np.zeros(3)  # the map against odometry: heading, which is not displaced, north, east
        self._leg_displaced_m = self._displaced_m  # when the last leg was decided
        self._surfaced = False  # where the leg decided last ends
        self._surfacings_before = self._surfacings.snapshot()  # before that decision

    @property
    def planner(self) -> PlannerConfig:
        """The planner's parameters, complete."""
        return self._horizon.planner

    def set_planner(self, config: PlannerConfig) -> None:
        """Takes new planner parameters; they take effect at the next decision.

        Lanes and measurement places (which all receivers must share), the map's spacing and the team's order stay as
        they were.

        Raises:
            ValueError: if they contradict each other; the old ones then stay.
        """
        self._horizon.planner = config.complete()

    # ------------------------------------------------------------------ what comes in

    def set_centers(self, centers: Centers, now_s: float | None = None) -> None:
        """Takes the map: all kernel centers. The next decision uses it (cheap where the old centers come first)."""
        self._new_centers = centers
        if now_s is not None:
            self._map_s = now_s

    def hear(self, now_s: float, vehicle: int, plan: Plan) -> None:
        """Takes the plan of team mate `vehicle`, received at `now_s`; one that cannot be followed is only counted."""
        if self.rollout.can_follow(plan):
            self.team.hear(now_s, vehicle, plan)
        else:
            self.plans_refused += 1

    def odometry(self, now_s: float, heading_rad: float, north_m: float, east_m: float) -> None:
        """Takes the estimated state of the vehicle at `now_s`; one that no vehicle can have is ignored and counted."""
        self._travel.move(EstimatedState(now_s, heading_rad, north_m, east_m))

    def displaced(self, north_m: float, east_m: float) -> None:
        """Takes by how much a place in the map is off the same place by odometry, from now on."""
        if math.isfinite(north_m) and math.isfinite(east_m):
            self._displaced_m = np.array([0.0, north_m, east_m])

    def for_vehicle(self, leg: Leg) -> Leg:
        """A leg in the map, as the vehicle knows its place."""
        _, north_m, east_m = self._displaced_m.tolist()
        return dataclasses.replace(leg, north_m=leg.north_m - north_m, east_m=leg.east_m - east_m)

    def run(self, now_s: float, standing: str = "") -> None:
        """The mission goes from `now_s` on, or does not.

        Args:
            now_s: Mission time.
            standing: Why it does not, for people; "" if it goes.
        """
        self._travel.run(now_s, not standing)
        self._held = standing

    # ------------------------------------------------------------------ where it is

    @property
    def leg(self) -> Leg | None:
        """The leg being travelled; None before the first decision."""
        return self._travel.leg

    @property
    def decided_leg(self) -> Leg | None:
        """The leg decided last, which may still be to come; None before the first decision."""
        return self._travel.decided_leg

    @property
    def path(self) -> PlannedPath | None:
        """The path of the plan from the next decision's step on; None before the first."""
        path = self._horizon.path
        return None if path is None else path.from_step(self._travel.decided)

    @property
    def finished(self) -> bool:
        """Whether all steps are decided and travelled."""
        return self._travel.finished

    def due(self, now_s: float) -> bool:
        """Whether a decision is due."""
        return self._travel.due(now_s, self.planner)

    def problems(self, now_s: float) -> dict[str, str]:
        """What keeps the planner from working as it should: a text for each problem, by its key (`problems.py`)."""
        started = now_s >= self.settings.vehicle.start_delay_s
        found = problems.of_odometry(now_s, self._travel, self.planner, started)
        found |= problems.of_place(self._travel, self.space)
        found |= problems.of_map(now_s, self._map_s, self._map_refused, self.planner)
        if started:
            found |= problems.of_team(now_s, self._travel.decided, self.team, self.planner)
        found |= problems.of_leg(now_s, self._travel)
        if self._held:
            found["held"] = f"no steps are counted: {self._held}"
        totals = {
            "odometry absurd": self._travel.absurd,
            "odometry jumps": self._travel.gate.jumps,
            "plans refused": self.plans_refused,
            "legs given up": self._travel.given_up,
        }
        return found | problems.of_counts(totals, self._recent.of(now_s, totals))

    # ------------------------------------------------------------------ the decision

    def decide(self, now_s: float, deadline: Callable[[], bool] | None = None) -> Decision:
        """Decides the next leg.

        Args:
            now_s: Mission time.
            deadline: Says when to stop searching; the best path so far is then taken.

        Raises:
            ValueError: if no decision can be made: no odometry, or the mission is over (`due` says when to ask).
        """
        step, total = self._travel.decided, self.settings.mission.steps
        if step >= total:
            raise ValueError(f"decide: all {total} steps are decided; expected to be asked only when `due`")
        anchor, reanchored = self._anchor()
        state = anchor.astype(np.float32).astype(float)  # as its packet will have it
        self._take_centers()
        self._keep_off_shallows(state)
        if self.planner.proposals == "tour":  # it takes team mates in time order, not as if they had measured already
            return self._taken(self._horizon.decide(now_s, step, state, reanchored, 0, deadline), now_s, reanchored)
        ahead = [self.team.places_ahead(now_s, mate) for mate in self.team.before(step)]
        places = np.concatenate([np.empty((0, 2)), *ahead])
        self.posterior.plan(places)
        try:
            decision = self._horizon.decide(now_s, step, state, reanchored, len(places), deadline)
        finally:
            self.posterior.forget_planned()
        return self._taken(decision, now_s, reanchored)

    def snapshot(self) -> dict[str, Any]:
        """What a planner of the same settings needs to go on after the last decision, as values that JSON holds.

        Not the map, which comes whole from its owner, nor the team mates' plans, which are heard again.
        """
        return {
            "travel": self._travel.snapshot(),
            "horizon": self._horizon.snapshot(),
            "assumed": self.team.snapshot(),
            "surfacings": self._surfacings.snapshot(),
            "displaced": [self._displaced_m.tolist(), self._leg_displaced_m.tolist()],
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Goes on from what `snapshot` gave."""
        self._travel.restore(values["travel"])
        self._horizon.restore(values["horizon"])
        self.team.restore(values["assumed"])
        self._surfacings.restore(values["surfacings"])
        self._displaced_m, self._leg_displaced_m = (np.array(moved) for moved in values["displaced"])

    def adopt(self, plan: Plan, leg: Leg) -> None:
        """Follows another plan, with another next leg, than the one just decided: a replay goes on from what was flown.

        Args:
            plan: A plan that `rollout` can follow, as it was told: with a surfacing it goes on after that.
            leg: The leg to travel in place of the one decided.
        """
        self._travel.replace(leg)
        self._horizon.adopt(plan, leg.step + (self._surfacings.legs if leg.surface else 0))
        self._surfacings.restore(self._surfacings_before)
        if leg.surface:
            self._surfacings.surfaced(leg.step + 1)
        more = int(leg.surface) - int(self._surfaced)
        self._horizon.delayed(more * self._surfacings.legs)
        self._surfaced = leg.surface

    def _taken(self, decision: Decision, now_s: float, reanchored: bool) -> Decision:
        path, legs = self._horizon.path, self._surfacings.legs
        weighing: Weighing | None = None

        def pays() -> bool:
            nonlocal weighing
            weighing = self._horizon.weigh_surfacing(now_s, legs)
            return weighing.pays

        self._surfacings_before = self._surfacings.snapshot()
        self._surfaced = path is not None and self._surfacings.due(path, pays)
        if self._surfaced and weighing is not None:
            leg = dataclasses.replace(decision.leg, surface=True)
            bound = self._horizon.charge(weighing, decision.bound)
            plan = self._horizon.delay(legs, decision.plan)
            decision = dataclasses.replace(decision, leg=leg, plan=plan, bound=bound)
        decision = dataclasses.replace(decision, leg=self.for_vehicle(decision.leg))
        self._leg_displaced_m = self._displaced_m
        self._travel.take(decision.leg, now_s, at_once=reanchored)
        self.records.append(decision.bound)
        return decision

    def _anchor(self) -> tuple[Array, bool]:
        """The state (3,) in the map to plan from, and whether the last plan does not lead there.

        Where the map is displaced a little since the last leg was decided, the plan goes on, and its next leg leads the
        vehicle back to it.
        """
        anchor, reanchored = self._travel.anchor(self.planner)
        moved_m = float(np.linalg.norm(self._displaced_m - self._leg_displaced_m))
        if not reanchored and self._travel.leg is not None and moved_m <= self.planner.reanchor_m:
            return anchor + self._leg_displaced_m, False
        return anchor + self._displaced_m, reanchored or self._travel.leg is not None

    def _mowing(self, mate: int) -> Plan:
        """What a team mate that was never heard is taken to do: it mows its strip from the start."""
        v = self.settings.vehicle
        start = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])
        return Plan.at(0, start, (), FITTED[(mate - 1) % len(FITTED)])

    def _take_centers(self) -> None:
        centers, self._new_centers = self._new_centers, None
        if centers is None:
            return
        try:
            self.posterior.follow(centers)
            self._map_refused = ""
        except IllConditionedError as error:
            self._map_refused = f"map: {error}"

    def _keep_off_shallows(self, state: Array) -> None:
        """Keeps clear of what the map shows to be too shallow, as far as legs planned from `state` can reach."""
        if not len(self.posterior.centers):
            return
        places = self._shallow_grid.places_m
        if not self.planner.family.to_the_end:  # a naive path and a tour look as far as the mission goes
            legs = max(self.planner.horizon, LOOK_AHEAD) + 2
            reach_m = legs * float(self.motion.lengths_m.max()) + SHALLOWS_BEYOND_M
            places = places[np.hypot(places[:, 0] - state[1], places[:, 1] - state[2]) <= reach_m]
        limit_m = self.settings.vehicle.depth_m + self.settings.vehicle.min_water_m
        self.space.set_shallow(places, self.posterior.mean_m(places) < limit_m, self._shallow_grid.resolution_m)
