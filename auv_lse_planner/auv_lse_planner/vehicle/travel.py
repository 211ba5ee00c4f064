"""Tracks a vehicle along its legs: when the next decision is due, and the state from which it plans."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import is_possible
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_planner.vehicle.odometry_gate import OdometryGate

#: A leg counts as travelled when at most this distance (m) remains, to absorb rounding.
ARRIVAL_TOLERANCE_M = 1e-9
#: Above this heading error (rad) the next leg is planned from odometry instead of the current leg's end. Currents cause
#: smaller errors.
MAX_HEADING_ERROR_RAD = math.pi / 4.0
#: The same applies this far (m) past the leg's end: the decision is late, and the course since then is unknown.
MAX_OVERSHOOT_M = 3.0


@dataclass(frozen=True, slots=True)
class EstimatedState:
    """The vehicle's estimate of its heading and position.

    Attributes:
        heading_rad: Heading (rad, clockwise from north).
    """

    now_s: float
    heading_rad: float
    north_m: float
    east_m: float


class Travel:
    """Progress of one vehicle along its legs.

    The next leg is decided while the vehicle is still on the current leg. It begins where the current leg ends.

    Attributes:
        estimate: The last estimated state; None before the first.
        leg: The current leg; None before the first decision.
        leg_started_s: Mission time at which it began; NaN before the first decision.
        steps: Number of steps of the mission; fewer than planned after `end_at`.
        decided: Number of steps decided.
        running: Whether the mission is running. While it is not, no decision is due and leg timers are paused.
        gate: Rejects estimates that jump.
        impossible: Number of impossible estimates, which are ignored.
        timed_out: Number of legs that timed out (`overdue`) before the vehicle passed their end.
        finished: Whether all steps are decided and travelled. It stays true wherever the vehicle goes afterwards.
    """

    def __init__(self, vehicle: VehicleConfig, steps: int, surfacing_legs: int = 0) -> None:
        self._vehicle, self.steps, self._surfacing_legs = vehicle, steps, surfacing_legs
        self._held_up_s = 0.0  # duration of a surfacing at the start of the current leg
        self.estimate: EstimatedState | None = None
        self.leg: Leg | None = None
        self.leg_started_s = math.nan
        self.decided = 0
        self.impossible = self.timed_out = 0
        self.gate = OdometryGate(vehicle.speed_mps)
        self.finished = False
        self.running = True
        self._held_s = math.nan
        self._next_leg: Leg | None = None

    def set_running(self, now_s: float, running: bool) -> None:
        """Resumes or pauses the mission at `now_s`."""
        if self.running and not running:
            self._held_s = now_s
        elif running and not self.running:
            self.leg_started_s += max(now_s - max(self._held_s, self.leg_started_s), 0.0)
        self.running = running

    def move(self, estimate: EstimatedState) -> None:
        """Processes an estimated state; the next leg begins when the current one has ended or timed out.

        A vehicle may never pass the leg's end: its autopilot may stop just before it, or follow another target. The
        timeout lets the mission continue.
        """
        e = estimate
        if not math.isfinite(e.now_s) or not is_possible(e.heading_rad, e.north_m, e.east_m):
            self.impossible += 1
            return
        if not self.gate.passes(e.now_s, e.north_m, e.east_m):
            return
        self.estimate = estimate
        if not self.running:
            return
        leg, following = self.leg, self._next_leg
        if leg is not None and following is not None and self._over(leg, estimate):
            self._begin(following, estimate.now_s)
        if self.leg is not None and self._next_leg is None and self.decided >= self.steps and not self.finished:
            self.finished = self._over(self.leg, estimate)

    def _over(self, leg: Leg, estimate: EstimatedState) -> bool:
        """Whether the leg is travelled or timed out; counts timeouts."""
        if self._remaining_m(leg, estimate) <= ARRIVAL_TOLERANCE_M:
            return True
        overdue = self.overdue(estimate.now_s)
        self.timed_out += overdue
        return overdue

    def take(self, leg: Leg, now_s: float, at_once: bool) -> None:
        """Accepts the leg just decided.

        It begins `at_once` or when the current leg ends; the first leg begins at once.
        """
        self.decided = self._after(leg)
        if self.leg is None or at_once:
            self._begin(leg, now_s)
        else:
            self._next_leg = leg

    def replace(self, leg: Leg) -> None:
        """Replaces the leg accepted last."""
        self.decided = self._after(leg)
        if self._next_leg is None:
            self.leg = leg
        else:
            self._next_leg = leg

    def end_at(self, step: int) -> None:
        """Ends the mission at `step`, earlier than planned."""
        self.steps = step

    def skip_to(self, step: int) -> None:
        """Counts the steps before `step` as travelled, along unknown legs; the next one is due at once."""
        self.leg = self._next_leg = None
        self.leg_started_s = math.nan
        self.decided = step
        self.finished = step >= self.steps

    def restart_leg(self) -> None:
        """Restarts the leg's time when the mission runs again, because the clock may be wrong. Call it while paused."""
        self.leg_started_s = self._held_s

    def snapshot(self) -> dict[str, Any]:
        """The legs and their timing, for a journal; the vehicle's position comes with the next odometry."""
        legs = {"leg": self.leg, "next_leg": self._next_leg}
        values = {name: None if leg is None else dataclasses.asdict(leg) for name, leg in legs.items()}
        return {
            **values,
            "leg_started_s": self.leg_started_s,
            "decided": self.decided,
            "finished": self.finished,
            "held_up_s": self._held_up_s,
            "steps": self.steps,
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self.leg, self._next_leg = (
            None if values[name] is None else Leg(**values[name]) for name in ("leg", "next_leg")
        )
        self.leg_started_s, self.decided, self.finished, self._held_up_s, self.steps = (
            values[name] for name in ("leg_started_s", "decided", "finished", "held_up_s", "steps")
        )

    def _after(self, leg: Leg) -> int:
        """The step after a leg and its surfacing."""
        return leg.step + 1 + (self._surfacing_legs if leg.surface else 0)

    def _begin(self, leg: Leg, now_s: float) -> None:
        self._held_up_s = self._vehicle.surfacing_s if self.leg is not None and self.leg.surface else 0.0
        self.leg, self.leg_started_s, self._next_leg = leg, now_s, None

    @property
    def decided_leg(self) -> Leg | None:
        """The leg decided last, which may still lie ahead; None before the first decision."""
        return self.leg if self._next_leg is None else self._next_leg

    @staticmethod
    def _remaining_m(leg: Leg, estimate: EstimatedState) -> float:
        return leg.length_m - leg.progress_m(estimate.north_m, estimate.east_m)

    def overdue(self, now_s: float) -> bool:
        """Whether the current leg has taken far longer than expected: the vehicle is stuck or drifting off."""
        if self.leg is None or not self.running:
            return False
        expected_s = self.leg.length_m / self._vehicle.speed_mps
        return now_s - self.leg_started_s > 4.0 * expected_s + 10.0 + self._held_up_s

    def due(self, now_s: float, planner: PlannerConfig) -> bool:
        """Whether a decision is due."""
        if not self.running or self.estimate is None or self.decided >= self.steps or self._next_leg is not None:
            return False
        if now_s - self.estimate.now_s > planner.odometry_timeout_s:
            return False
        if self.leg is None:
            return now_s >= self._vehicle.start_delay_s
        lead_m = self._vehicle.speed_mps * planner.replan_lead_s
        return bool(self._remaining_m(self.leg, self.estimate) <= lead_m or self.overdue(now_s))

    def anchor(self, planner: PlannerConfig) -> tuple[Array, bool]:
        """The state (3,) to plan from, and whether it comes from odometry instead of the last decision.

        Raises:
            ValueError: if there is no odometry yet.
        """
        if self.estimate is None:
            raise ValueError("decide: there is no odometry yet. Call it only when `due`")
        here = np.array([self.estimate.heading_rad, self.estimate.north_m, self.estimate.east_m])
        if self.leg is None and self.decided:
            return here, True
        if self.leg is None:
            v = self._vehicle
            start = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])
            off_m = math.hypot(here[1] - start[1], here[2] - start[2])
            return (here, True) if off_m > planner.reanchor_m else (start, False)
        remaining_m = self._remaining_m(self.leg, self.estimate)
        heading = self.leg.state_at(self.leg.length_m - remaining_m)[0]
        if (
            abs(math.remainder(here[0] - heading, 2.0 * math.pi)) <= MAX_HEADING_ERROR_RAD
            and self.leg.distance_off_m(here[1], here[2]) <= planner.reanchor_m
            and remaining_m >= -MAX_OVERSHOOT_M
            and not self.overdue(self.estimate.now_s)
        ):
            return self.leg.end_state, False
        ahead_m = min(max(remaining_m, 0.0), self._vehicle.speed_mps * planner.replan_lead_s)
        here[1] += ahead_m * math.cos(here[0])
        here[2] += ahead_m * math.sin(here[0])
        return here, True
