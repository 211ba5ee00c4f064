"""The planner of one vehicle: decides leg by leg from the map, the odometry and the team mates' plans.

Theory of operation.

- *Steps.* The decision for step i starts from the planned state of step i and yields the leg to step i + 1.
- *When.* Step 0 is due with the first odometry after the start delay. Step i + 1 is due when the vehicle needs
  `replan_lead_s` or less to finish leg i.
- *From where.* A decision starts from the planned end of leg i. If odometry shows the vehicle more than `reanchor_m`
  off its leg, on another heading, or past the leg's end, it starts from the position predicted from odometry instead
  (`travel.py`).
- *Surfacing.* A surfacing takes as long as some legs (`surfacing.py`). Their steps are skipped, and the plan is delayed
  by as many steps.
- *Early end.* With `mission.until` the leg after the team's agreement is the last one (`until.py`).
- *Hold.* Steps are counted only while the mission is running (`set_blocked`). While it waits or holds, no decision is
  made and the current leg's timer is paused.
- *Frames.* Plans are made in the map's frame, whose positions may be corrected and so differ from odometry
  (`set_map_offset`). Legs are passed to the vehicle in its odometry frame (`in_odometry_frame`).
- The method decides (`methods/method.py`); this module writes the bound record. A decision always yields a leg; if no
  action is feasible, it is the escape (`free_space.py`).
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.mission_file.sections.vehicle import MAX_SURFACINGS
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.health import Recent
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.methods.decision import BoundRecord, Decision, Statistics
from auv_lse_planner.methods.families import CLASSES
from auv_lse_planner.methods.ground_window import GroundWindow
from auv_lse_planner.methods.method import Choice, Followed, Method, PlanningContext, Situation
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.position_margin import PositionMargin
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.paths.steering import LOOK_AHEAD
from auv_lse_planner.vehicle import problems
from auv_lse_planner.vehicle.reward_so_far import RewardSoFar
from auv_lse_planner.vehicle.shallow_ground import ShallowGround
from auv_lse_planner.vehicle.surfacing import Surfacings, delayed
from auv_lse_planner.vehicle.travel import EstimatedState, Travel
from auv_lse_planner.vehicle.until import Until


class VehiclePlanner:
    """Plans for one vehicle; see the module's theory of operation.

    Attributes:
        planner: The planner's current parameters, complete.
        plans_refused: Number of received plans that could not be followed.
        until: This vehicle's part in the agreement to end early.
        shallow_ground: Ground that its map shows as too shallow.
        records: The bound record of every decision.
    """

    def __init__(self, vehicle: int, settings: PlannerSettings, rng: np.random.Generator) -> None:
        """Sets up the planner.

        Raises:
            ValueError: if the number is not one of the mission's vehicles, or parameters contradict each other.
        """
        mission, area = settings.mission, OperatingArea(settings.area)
        if not 1 <= vehicle <= mission.vehicles:
            raise ValueError(f"vehicle {vehicle} does not exist; mission.vehicles is {mission.vehicles}")
        self.vehicle = vehicle
        self.settings = settings
        self.planner: PlannerConfig = settings.planner.complete()
        self.motion = MotionTable(settings.motion)
        self.space = FreeSpace(area, self.motion, settings.area.raster_m)
        naive = NaivePaths(self.space, self.planner, area.polygon, mission.vehicles)
        self.rollout = Rollout(self.motion, naive, mission.steps, self.planner.samples_per_leg)
        self.posterior = Posterior(settings.gp, banks=Banks.of(settings.area, settings.level_set.level_m))
        leg_m = self.motion.leg_length_m
        self.team = Team(
            vehicle,
            mission.vehicles,
            leg_m / settings.vehicle.speed_mps,
            self.planner.plan_expiry_s,
            self.rollout.follow,
            self._assumed_plan,
        )
        self.until = Until(settings, area, self.team.others)
        self.plans_refused = 0
        self.records: list[BoundRecord] = []
        self._context = PlanningContext(
            vehicle=vehicle,
            settings=settings,
            space=self.space,
            rollout=self.rollout,
            window=GroundWindow.of(settings, area, self.posterior, self.planner.map_spacing_m),
            team=self.team,
            horizon=self.until.horizon,
            rng=rng,
        )
        self._methods: dict[str, Method] = {}  # by family, created on first use
        self._reward = RewardSoFar()
        self._followed: Followed | None = None  # from the last decision's step on
        self._surfacings = Surfacings(vehicle, settings.vehicle, self._most_surfacings(), mission.steps, leg_m)
        self._surfacings_before = self._surfacings.snapshot()  # before the last decision
        self._surfaced = False  # at the end of the leg decided last
        self._travel = Travel(settings.vehicle, mission.steps, self._surfacings.legs)
        limit_m = settings.vehicle.shallowest_ground_m
        grid = area.grid(area.cell_m(max(10.0, 2.0 * settings.area.raster_m)))
        self.shallow_ground = ShallowGround(self.space, self._context.window, grid, limit_m)
        self._new_centers: Centers | None = None
        self._map_s: float | None = None
        self._map_refused = ""
        self._blocked_reason = ""
        self._recent = Recent()
        self._map_offset_m = np.zeros(3)  # of the map from odometry: heading (always 0), north, east
        self._leg_map_offset_m = self._map_offset_m  # when the last leg was decided
        self._position_margin = PositionMargin()

    def _most_surfacings(self) -> int:
        wanted, usual = self.settings.vehicle.surfacings, 0 if self.planner.entry.of_paper else MAX_SURFACINGS
        return usual if wanted is None else wanted

    def set_planner(self, config: PlannerConfig) -> None:
        """Sets new planner parameters; they take effect at the next decision.

        The lane spacing, the measurement locations (which all receivers must share) and the map's spacing do not
        change.

        Raises:
            ValueError: if they contradict each other; the current ones are then kept.
        """
        self.planner = config.complete()

    # ------------------------------------------------------------------ inputs

    def set_centers(self, centers: Centers, now_s: float | None = None) -> None:
        """Sets all kernel centers of the map for the next decision; fast if the old centers come first."""
        self._new_centers = centers
        if now_s is not None:
            self._map_s = now_s

    def receive_plan(self, now_s: float, vehicle: int, plan: Plan) -> None:
        """Stores the plan of team mate `vehicle`, received at `now_s`; an unusable plan is only counted."""
        if self.rollout.can_follow(plan):
            self.until.hear(now_s, vehicle, plan.quality_reached)
            self.team.receive_plan(now_s, vehicle, dataclasses.replace(plan, quality_reached=False))
        else:
            self.plans_refused += 1

    def odometry(self, now_s: float, heading_rad: float, north_m: float, east_m: float) -> None:
        """Updates the vehicle's estimated state at `now_s`; ignores and counts an impossible one."""
        self._travel.move(EstimatedState(now_s, heading_rad, north_m, east_m))

    def set_quality(self, now_s: float, quality: Quality, is_current: bool = True) -> bool:
        """Updates the map's quality for the next decision, as `Until.judged`."""
        return self.until.judged(now_s, quality, self._travel.decided, is_current)

    def set_map_offset(self, north_m: float, east_m: float, covariance_m2: Array | None = None) -> None:
        """Sets the offset from odometry to map coordinates (m), and the covariance (2, 2) of the position in the
        map."""
        if math.isfinite(north_m) and math.isfinite(east_m):
            self._map_offset_m = np.array([0.0, north_m, east_m])
            if covariance_m2 is not None and np.isfinite(covariance_m2).all():
                self._position_margin = PositionMargin(covariance_m2)

    def in_odometry_frame(self, leg: Leg) -> Leg:
        """Converts a leg from map to odometry coordinates."""
        _, north_m, east_m = self._map_offset_m.tolist()
        return dataclasses.replace(leg, north_m=leg.north_m - north_m, east_m=leg.east_m - east_m)

    def set_blocked(self, now_s: float, reason: str = "") -> None:
        """Blocks the mission at `now_s`, with the reason as a text for operators; "" resumes it."""
        self._travel.set_running(now_s, not reason)
        self._blocked_reason = reason

    # ------------------------------------------------------------------ state

    @property
    def leg(self) -> Leg | None:
        """The leg being travelled; None before the first decision."""
        return self._travel.leg

    @property
    def decided_leg(self) -> Leg | None:
        """The leg decided last, which may still lie ahead; None before the first decision."""
        return self._travel.decided_leg

    @property
    def path(self) -> PlannedPath | None:
        """The path of the plan from the next decision's step on; None before the first."""
        return None if self._followed is None else self._followed.path.from_step(self._travel.decided)

    @property
    def finished(self) -> bool:
        """Whether all steps are decided and travelled."""
        return self._travel.finished

    def due(self, now_s: float) -> bool:
        """Whether a decision is due."""
        return self._travel.due(now_s, self.planner)

    def problems(self, now_s: float) -> dict[str, str]:
        """Texts about current problems, by problem key (`problems.py`)."""
        started = now_s >= self.settings.vehicle.start_delay_s
        found = problems.of_odometry(now_s, self._travel, self.planner, started)
        found |= problems.of_position(self._travel, self.space, self._map_offset_m)
        found |= problems.of_map(now_s, self._map_s, self._map_refused, self.planner)
        if started:
            travelled_s = self._travel.decided * self.motion.leg_length_m / self.settings.vehicle.speed_mps
            found |= problems.of_team(now_s, self.team, self.planner, travelled_s)
        found |= problems.of_leg(now_s, self._travel)
        if self._blocked_reason and not self.finished:
            found["held"] = f"not planning: {self._blocked_reason}"
        totals = {
            "odometry impossible": self._travel.impossible,
            "odometry jumps": self._travel.gate.jumps,
            "plans refused": self.plans_refused,
            "leg timeouts": self._travel.timed_out,
        }
        return found | problems.of_counts(totals, self._recent.of(now_s, totals))

    # ------------------------------------------------------------------ the decision

    def decide(self, now_s: float, deadline: Callable[[], bool] | None = None) -> Decision:
        """Decides the next leg.

        The first call searches the whole mission: about 1 s of processor time for 100 legs of a team, 2 s of a single
        vehicle. Compiling adds a minute. Later calls take at most 0.3 s.

        Args:
            deadline: Returns whether to stop searching; the decision then uses the best path so far. Checked between
                evaluations of paths; at most three follow. None: the decision does not depend on the machine.

        Raises:
            ValueError: if there is no odometry or the mission is over. Call it only when `due`.
        """
        step, total = self._travel.decided, self._travel.steps
        if step >= total:
            raise ValueError(f"decide: all {total} steps are decided. Call it only when `due`")
        anchor, reanchored = self._anchor()
        state = anchor.astype(np.float32).astype(float)  # rounded as in its packet
        self.until.begin_decision(now_s, step)
        last = None if self._followed is None else Followed(self._followed.plan, self._followed.path.from_step(step))
        method = self._method  # created before the map is updated, because it may bound the map's size
        evaluates = method.evaluates(step, self.planner) or bool(last and self._surfacings.is_considered(last.path))
        self._take_centers(state, evaluates)
        self._block_shallows(state, evaluates)
        situation = Situation(
            planner=self.planner,
            now_s=now_s,
            step=step,
            state=state,
            last=last,
            off_plan=reanchored,
            margin=self._position_margin,
            deadline=deadline,
            evaluates=evaluates,
        )
        choice = method.decide(situation)
        path = choice.chosen.path
        self._followed = Followed(choice.chosen.plan, path)
        leg = self.motion.leg(step, path.states[0], int(path.actions[0]))
        if self.until.ends:
            self._travel.end_at(step + 1)
        decision = Decision(
            plan=dataclasses.replace(choice.chosen.plan, quality_reached=self.until.reached),
            leg=leg,
            bound=self._bound(situation, choice),
            statistics=Statistics(
                team_locations=choice.team_locations,
                evaluations=choice.evaluations,
                best_new_value=choice.best_new_value,
                escape=not self.space.feasible(state).size,
                reanchored=reanchored,
                incumbent_infeasible=choice.infeasible,
            ),
        )
        decision = self._with_surfacing(situation, decision, path)
        decision = dataclasses.replace(decision, leg=self.in_odometry_frame(decision.leg))
        self._leg_map_offset_m = self._map_offset_m
        self._travel.take(decision.leg, now_s, at_once=reanchored)
        self.records.append(decision.bound)
        return decision

    def adopt(self, plan: Plan, leg: Leg) -> None:
        """Replaces the decision just made by a recorded one, so that a replay continues from the travelled path.

        Args:
            plan: The plan sent to the team, which `rollout` can follow; after a surfacing it continues from there.
            leg: The leg to travel instead of the one decided.
        """
        self._travel.replace(leg)
        step = leg.step + (self._surfacings.legs if leg.surface else 0)
        plan = dataclasses.replace(plan, quality_reached=False)
        self._followed = Followed(plan, self.rollout.follow(plan).from_step(step))
        self._surfacings.restore(self._surfacings_before)
        if leg.surface:
            self._surfacings.record(leg.step + 1)
        more = int(leg.surface) - int(self._surfaced)
        self._method.shift(more * self._surfacings.legs)
        self._surfaced = leg.surface

    def snapshot(self) -> dict[str, Any]:
        """The state from which a planner with the same settings continues after the last decision, as JSON values.

        It excludes the map, which gp_node publishes whole, and the team mates' plans, which the journal holds.
        """
        f = self._followed
        return {
            "followed": None if f is None else {"plan": dataclasses.asdict(f.plan), "step": f.path.step},
            "travel": self._travel.snapshot(),
            "reward": self._reward.snapshot(),
            "methods": {family: method.snapshot() for family, method in self._methods.items()},
            "random": self._context.rng.bit_generator.state,
            "assumed": self.team.snapshot(),
            "surfacings": self._surfacings.snapshot(),
            "until": self.until.snapshot(),
            "displaced": [self._map_offset_m.tolist(), self._leg_map_offset_m.tolist()],
            "position_covariance_m2": self._position_margin.covariance_m2.tolist(),
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        if values["followed"] is not None:
            plan = Plan.from_mapping(values["followed"]["plan"])
            self._followed = Followed(plan, self.rollout.follow(plan).from_step(values["followed"]["step"]))
        self._travel.restore(values["travel"])
        self._reward.restore(values["reward"])
        for family, own in values["methods"].items():
            self._method_of(family).restore(own)
        self._context.rng.bit_generator.state = values["random"]
        self.team.restore(values["assumed"])
        self._surfacings.restore(values["surfacings"])
        self.until.restore(values["until"])
        self._map_offset_m, self._leg_map_offset_m = (np.array(moved) for moved in values["displaced"])
        self._position_margin = PositionMargin(np.array(values["position_covariance_m2"]))

    def is_last(self, leg: Leg) -> bool:
        """Whether a leg is the mission's last one."""
        return leg.step == self._travel.steps - 1

    def resume_at(self, step: int, finished: bool = False) -> None:
        """Continues at `step` after a restart: earlier decisions may have been published, and must not be repeated.

        Args:
            step: Number of steps decided. If `restore` knew fewer, the plan and legs of the others are lost.
            finished: Whether the last leg was travelled, too.
        """
        if step > self._travel.decided:
            self._travel.skip_to(step)
        self._travel.finished |= finished

    def forget_clock(self) -> None:
        """After a reboot the clock may be wrong: restarts the current leg's time. Call it while blocked."""
        self._travel.restart_leg()

    @property
    def decided(self) -> int:
        """Number of steps decided."""
        return self._travel.decided

    # ------------------------------------------------------------------ parts of a decision

    @property
    def _method(self) -> Method:
        return self._method_of(self.planner.family_name)

    def _method_of(self, family: str) -> Method:
        if family not in self._methods:
            self._methods[family] = CLASSES[family](self._context)
        return self._methods[family]

    def _bound(self, situation: Situation, choice: Choice) -> BoundRecord:
        """The bound record of a choice; the leg's own reward is added to the reward so far only afterwards."""
        self._reward.measure(choice.map_risk)
        so_far = self._reward.value
        lower, largest = self._reward.bound(choice.assured)
        self._reward.add(choice.leg_reward)
        return BoundRecord(
            step=situation.step,
            now_s=situation.now_s,
            method=self.planner.method,
            reward_so_far=so_far,
            expected_end=choice.chosen.value.expected_end,
            lower_bound=lower,
            lower_bound_max=largest,
            incumbent_value=math.nan if choice.incumbent is None else choice.incumbent.value.expected_end,
            incumbent_kept=choice.chosen is choice.incumbent,
            iterations=choice.iterations,
            deadline_hit=choice.deadline_hit,
            budget=choice.budget,
            void=choice.void,
            void_value=choice.void_value,
        )

    def _with_surfacing(self, situation: Situation, decision: Decision, path: PlannedPath) -> Decision:
        """The decision, with a surfacing at the end of its leg if one is considered and pays off."""
        self._surfacings_before = self._surfacings.snapshot()
        self._surfaced = False
        legs = self._surfacings.legs
        if self.is_last(decision.leg) or not self._surfacings.is_considered(path):
            return decision
        surfacing = self._method.weigh_surfacing(situation, path, legs)
        if not surfacing.pays:
            return decision
        self._surfaced = True
        self._surfacings.record(path.step + 1)
        budget, bound = self._method.spend(surfacing.cost), decision.bound
        if budget is not None:  # a cost beyond the budget lowers the bound
            end = bound.expected_end - surfacing.cost
            lower = bound.reward_so_far + end - budget
            bound = dataclasses.replace(bound, expected_end=end, budget=budget, lower_bound=lower)
        leg = dataclasses.replace(decision.leg, surface=True)
        assert self._followed is not None  # it was decided
        self._followed = delayed(self._followed, legs, self.rollout)
        self._method.shift(legs)
        plan = dataclasses.replace(self._followed.plan, quality_reached=decision.plan.quality_reached)
        return dataclasses.replace(decision, leg=leg, bound=bound, plan=plan)

    def _anchor(self) -> tuple[Array, bool]:
        """The state (3,) in the map to plan from, and whether it lies off the last plan.

        If the map's offset has changed only a little since the last decision, the plan continues. Its next leg leads
        the vehicle back onto it.
        """
        anchor, reanchored = self._travel.anchor(self.planner)
        moved_m = float(np.linalg.norm(self._map_offset_m - self._leg_map_offset_m))
        if not reanchored and self._travel.leg is not None and moved_m <= self.planner.reanchor_m:
            return anchor + self._leg_map_offset_m, False
        return anchor + self._map_offset_m, reanchored or self._travel.leg is not None

    def _assumed_plan(self, mate: int) -> Plan:
        """The plan assumed for a team mate until its first plan arrives: lanes over its strip."""
        v = self.settings.vehicle
        start = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])
        return self._context.naive_plan(0, start, FITTED[(mate - 1) % len(FITTED)])

    def _take_centers(self, state: Array, evaluates: bool) -> None:
        window, legs = self._context.window, self._travel.steps - self._travel.decided
        if window.limit(state[1:], legs * float(self.motion.lengths_m.max())):
            self._reward.continue_with_other_cells()
        if not self.planner.family.sends_tours:
            window.release()
        centers, self._new_centers = self._new_centers, None
        if centers is not None:
            window.set_centers(centers)
        if evaluates:
            window.update()
        self._map_refused = window.refused

    def _block_shallows(self, state: Array, evaluates: bool) -> None:
        """Blocks ground that the map shows as too shallow, within reach of legs planned from `state`."""
        if not len(self._context.window.centers):
            return
        leg_m = float(self.motion.lengths_m.max())
        try:
            if not evaluates:
                self.shallow_ground.update_ahead(state[1:], LOOK_AHEAD * leg_m)
            elif self.planner.family.to_the_end:
                self.shallow_ground.update_window()
            else:
                self.shallow_ground.update_around(state[1:], (max(self.planner.horizon, LOOK_AHEAD) + 2) * leg_m)
        except IllConditionedError as error:
            self._map_refused = f"map: {error}"
