"""Converts a plan to a path: its states, its actions to the mission's end, and its measurement locations.

The planner, its team mates and the judge of a mission all use this module, so that they compute the same locations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.frames import is_possible
from auv_lse_common.vocabulary.naive_ids import IDS
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_planner.paths.motion import MotionTable, roll_many
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.steering import Steering


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """The legs of a plan from a given mission step on.

    Attributes:
        step: Mission step of the first state.
        states: States before and after each of L legs, shape (L + 1, 3): heading (rad), north, east (m).
        actions: Action of each leg, shape (L,).
        own: Number of legs from the plan's actions and its tour; the naive path adds the others.
        leg_locations_m: Measurement locations of each leg, in the order travelled, shape (L, n, 2): north, east.
    """

    step: int
    states: Array
    actions: Ints
    own: int
    leg_locations_m: Array

    def __len__(self) -> int:
        """Number of legs."""
        return len(self.actions)

    def from_step(self, step: int) -> PlannedPath:
        """The same path from mission step `step` on; without legs if `step` is past its end."""
        skipped = min(max(step - self.step, 0), len(self))
        return PlannedPath(
            self.step + skipped,
            self.states[skipped:],
            self.actions[skipped:],
            max(0, self.own - skipped),
            self.leg_locations_m[skipped:],
        )

    def to_step(self, step: int) -> PlannedPath:
        """The same path, cut off at mission step `step` if it is longer."""
        legs = max(step - self.step, 0)
        if legs >= len(self):
            return self
        return PlannedPath(
            self.step, self.states[: legs + 1], self.actions[:legs], min(self.own, legs), self.leg_locations_m[:legs]
        )

    @property
    def locations_m(self) -> Array:
        """All measurement locations, shape (L * n, 2)."""
        return self.leg_locations_m.reshape(-1, 2)

    @property
    def own_locations_m(self) -> Array:
        """Measurement locations on the legs of the plan's actions and tour, shape (P, 2)."""
        return self.leg_locations_m[: self.own].reshape(-1, 2)

    @property
    def naive_locations_m(self) -> Array:
        """Measurement locations of the naive path, shape (P, 2)."""
        return self.leg_locations_m[self.own :].reshape(-1, 2)


class Rollout:
    """Follows plans to the mission's end."""

    def __init__(self, motion: MotionTable, naive: NaivePaths, steps: int, samples_per_leg: int) -> None:
        """Sets up the rollout.

        Args:
            samples_per_leg: Measurement locations on a leg, evenly spaced, the last one at its end.
        """
        self.motion = motion
        self.naive = naive
        self.steps = steps
        self.samples_per_leg = samples_per_leg
        self._steering = Steering(naive.space)
        self._samples_m = {samples_per_leg: _samples(motion, samples_per_leg)}

    def follow(self, plan: Plan) -> PlannedPath:
        """The path of a plan."""
        return self.path(plan.step, plan.state, plan.actions, plan.naive_path, plan.tour)

    def path(
        self, step: int, state: Array, actions: Sequence[int], naive_path: int, tour: Tour | None = None
    ) -> PlannedPath:
        """The path of the actions, then the tour, then the naive path; without a naive path it ends after the tour.

        Args:
            step: Mission step of the first state; actions beyond the mission's end are dropped.
            naive_path: Id of the naive path, `NONE` for none.
            tour: Tour that starts where the actions end; None: no tour.
        """
        left = max(0, self.steps - step)
        own = np.array(actions[:left], dtype=np.int64)
        end = self.motion.roll(state, own)[-1]
        if tour is not None and left > len(own):
            legs = min(left - len(own), tour.segment_legs * len(tour.bearings))
            waypoints = tour.waypoints_m(end[1:], self.motion.leg_length_m)
            along = self._steering.actions(end, waypoints, tour.segment_legs, legs)
            own = np.concatenate([own, along])
            end = self.motion.roll(end, along)[-1]
        every = np.concatenate([own, self.naive.actions(end, naive_path, left - len(own))])
        states = self.motion.roll(state, every)
        return PlannedPath(step, states, every, len(own), self.leg_locations(states[:-1], every))

    def can_follow(self, plan: Plan) -> bool:
        """Whether a received plan can be followed: its state is possible; step, actions, tour and naive path are valid.

        A step beyond the mission's end is invalid. If it were accepted, all later plans of the sender would be ignored
        as older.
        """
        return (
            is_possible(plan.heading_rad, plan.north_m, plan.east_m)
            and plan.step <= self.steps
            and all(0 <= a < self.motion.actions for a in plan.actions)
            and (plan.tour is None or plan.tour.is_sound)
            and plan.naive_path in (*IDS, NONE)
        )

    def leg_locations(self, states: Array, actions: Ints, samples: int | None = None) -> Array:
        """Measurement locations (L, n, 2) of legs that start from `states` (L, 3) with `actions` (L,).

        Args:
            samples: Locations on a leg; None: `samples_per_leg`.
        """
        each = samples or self.samples_per_leg
        if each not in self._samples_m:
            self._samples_m[each] = _samples(self.motion, each)
        ahead, starboard = np.moveaxis(self._samples_m[each][actions], 2, 0)
        c, s = np.cos(states[:, :1]), np.sin(states[:, :1])
        north = states[:, 1:2] + c * ahead - s * starboard
        east = states[:, 2:3] + s * ahead + c * starboard
        return np.stack([north, east], axis=2)

    def locations_of_many(self, states: Array, actions: Ints) -> Array:
        """Measurement locations (B, L * n, 2) of many sequences of `actions` (B, L) from `states` (B, 3)."""
        rolled = roll_many(states, actions, self.motion.turns_rad, self.motion.steps_m)
        if self.samples_per_leg == 1:
            return np.asarray(rolled[:, 1:, 1:])
        locations = self.leg_locations(rolled[:, :-1].reshape(-1, 3), actions.ravel())
        return locations.reshape(len(states), -1, 2)

    def naive_locations(self, states: Array, naive_path: int, legs: int) -> Array:
        """Measurement locations (B, legs * n, 2) of a naive path over `legs` legs from many states (B, 3)."""
        return self.locations_of_many(states, self.naive.actions_from(states, naive_path, legs))


def _samples(motion: MotionTable, count: int) -> Array:
    """Measurement locations (A, count, 2) of every action in the frame of the state before it: ahead, to starboard."""
    return np.stack([motion.samples(a, count) for a in range(motion.actions)])
