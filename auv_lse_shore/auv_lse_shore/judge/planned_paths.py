"""The paths of recorded plans, rebuilt as their receivers build them, and the legs that a vehicle travelled."""

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_record.run_data import DecisionRecord, VehicleRun


class PlannedPaths:
    """The paths of one vehicle's plans."""

    def __init__(self, settings: PlannerSettings, area: OperatingArea) -> None:
        """Prepares to follow plans with the vehicle's settings."""
        motion = MotionTable(settings.motion)
        space = FreeSpace(area, motion, settings.area.raster_m)
        naive = NaivePaths(space, settings.planner, area.polygon, settings.mission.vehicles)
        self.rollout = Rollout(motion, naive, settings.mission.steps, settings.planner.samples_per_leg)
        self._paths: dict[Plan, PlannedPath] = {}

    def ahead(self, decision: DecisionRecord) -> PlannedPath:
        """The path of a decision's plan from the decided leg on."""
        plan = decision.plan
        if plan not in self._paths:
            self._paths[plan] = self.rollout.follow(plan)
        return self._paths[plan].from_step(decision.step)

    def next_leg(self, decision: DecisionRecord) -> PlannedPath:
        """The decided leg, and perhaps later ones; no leg if the plan ended before."""
        plan = decision.plan
        if 0 <= decision.step - plan.step < len(plan.actions):  # what follows the leg need not be computed
            actions = plan.actions[: decision.step - plan.step + 1]
            return self.rollout.path(plan.step, plan.state, actions, NONE).from_step(decision.step)
        return self.ahead(decision)

    def leg(self, decision: DecisionRecord) -> Array:
        """Locations (n, 2) of the decided leg that count in the reward; none if the plan ended before."""
        return self.next_leg(decision).leg_locations_m[:1].reshape(-1, 2)

    def naive(self, start: Plan, naive_path: int, steps: int) -> Array:
        """Locations (n, 2) of the first `steps` legs of a naive path from the state of a plan to the mission's end."""
        return self.rollout.path(0, start.state, (), naive_path).leg_locations_m[:steps].reshape(-1, 2)


def leg_times(vehicle: VehicleRun, paths: PlannedPaths) -> Array:
    """Times (s) at which a vehicle began the legs it decided, then infinity, shape (n + 1,).

    A decision is taken shortly before its leg begins. The leg begins between decisions i and i + 1, when the odometry
    is nearest to the state from which it was planned.
    """
    track, decisions = vehicle.odometry, vehicle.decisions
    times = []
    for index, decision in enumerate(decisions):
        following = decisions[index + 1].now_s if index + 1 < len(decisions) else np.inf
        if index + 1 == len(decisions) and index:
            following = decision.now_s + 2.0 * (decision.now_s - decisions[index - 1].now_s)
        first = np.searchsorted(track[:, 0], decision.now_s, side="left")
        rows = track[first : np.searchsorted(track[:, 0], following, side="right")]
        if len(rows) == 0:
            times.append(decision.now_s)
            continue
        _, north, east = paths.next_leg(decision).states[0]
        distance = np.hypot(rows[:, 1] - north, rows[:, 2] - east)
        times.append(float(rows[np.argmin(distance), 0]))
    return np.array([*times, np.inf])


def soundings_by_leg(vehicle: VehicleRun, paths: PlannedPaths, steps: int) -> list[Soundings]:
    """A vehicle's soundings by the leg they were made on; those before the first or after the last count to it."""
    legs = [Soundings.from_rows(())] * steps
    if len(vehicle.decisions) == 0 or not legs:
        return legs
    times = leg_times(vehicle, paths)
    index = np.clip(np.searchsorted(times[:-1], vehicle.soundings.stamp_s, side="right") - 1, 0, None)
    order = np.argsort(index, kind="stable")
    edges = np.searchsorted(index[order], np.arange(len(vehicle.decisions) + 1))
    for number, decision in enumerate(vehicle.decisions):
        own = vehicle.soundings[order[edges[number] : edges[number + 1]]]
        leg = min(decision.step, steps - 1)  # the last leg may have been cut off
        legs[leg] = Soundings.join([legs[leg], own])
    return legs
