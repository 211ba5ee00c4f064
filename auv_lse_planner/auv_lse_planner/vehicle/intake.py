"""Inputs of a vehicle's planner between two ticks, and the order in which the planner takes them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

#: Odometry and corrected place that are of the same time differ by less than this (s); so many of the first are kept.
SAME_S = 0.05
KEPT = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class InputsUsed:
    """The inputs of a planner so far: its next decision follows from them and its own state.

    Attributes:
        map_revision: Revision of the kernel centers.
        plans: Team plans, counted.
        odometry_s: Stamp of the last odometry (s); 0 before the first.
    """

    map_revision: int = 0
    plans: int = 0
    odometry_s: float = 0.0


class PlannerIntake:
    """The mission's state, the map, plans and odometry that wait for the planner, and the order in which it takes them.

    Attributes:
        planner: The planner.
        inputs_used: What the planner has been given.
    """

    def __init__(self, planner: VehiclePlanner) -> None:
        """Starts without inputs."""
        self.planner = planner
        self.inputs_used = InputsUsed()
        self._centers: tuple[Centers, int] | None = None
        self._plans: list[tuple[float, int, Plan]] = []
        self._odometry: tuple[float, float, float, float] | None = None
        self._recent_odometry: deque[tuple[float, float, float]] = deque(maxlen=KEPT)  # stamp, north, east
        self._corrected: tuple[float, float, float] | None = None
        self._standing: RunStatus | None = None
        self._state: RunState | None = None  # of the mission, as last told

    @property
    def end_is_news(self) -> bool:
        """Whether the last leg is travelled, but the mission's state does not show it yet: a message may be lost."""
        return self.planner.finished and self._state in (None, RunState.WAITING, RunState.RUNNING)

    def set_centers(self, centers: Centers, revision: int) -> None:
        """The map's kernel centers and their revision; they replace those that still wait."""
        self._centers = centers, revision

    def add_plan(self, stamp_s: float, vehicle: int, plan: Plan) -> None:
        """A mate's plan: end of reception (s), number of the mate, the plan."""
        self._plans.append((stamp_s, vehicle, plan))

    def set_odometry(self, stamp_s: float, heading_rad: float, north_m: float, east_m: float) -> None:
        """The vehicle's navigation; it replaces what still waits."""
        self._odometry = (stamp_s, heading_rad, north_m, east_m)
        self._recent_odometry.append((stamp_s, north_m, east_m))

    def set_corrected(self, stamp_s: float, north_m: float, east_m: float) -> None:
        """Where the map has the vehicle; its offset is from odometry of that time."""
        self._corrected = (stamp_s, north_m, east_m)

    def set_standing(self, standing: RunStatus) -> None:
        """Queues the state of the mission, replacing one that is still queued."""
        self._standing = standing

    def take(self, now_s: float) -> bool:
        """The planner takes the mission's state, the map, plans by stamp and vehicle, odometry.

        Returns:
            Whether a decision is due then.
        """
        revision, plans, odometry_s = self.inputs_used.map_revision, self.inputs_used.plans, self.inputs_used.odometry_s
        if self._standing is not None:
            self.planner.set_blocked(now_s, self._standing.blocked_reason)
            self._state = self._standing.state
            self._standing = None
        if self._centers is not None:
            centers, revision = self._centers
            self.planner.set_centers(centers, now_s)
            self._centers = None
        for stamp_s, vehicle, plan in sorted(self._plans, key=lambda entry: entry[:2]):
            self.planner.hear(stamp_s, vehicle, plan)
        plans += len(self._plans)
        self._plans = []
        self.apply_correction()
        if self._odometry is not None:
            self.planner.odometry(*self._odometry)
            odometry_s = self._odometry[0]
            self._odometry = None
        self.inputs_used = InputsUsed(map_revision=revision, plans=plans, odometry_s=odometry_s)
        return self.planner.due(now_s)

    def apply_correction(self) -> None:
        """Gives the planner the offset of its map from odometry, if both are of the same time.

        `take` does so, too: this is for a corrected place that is computed only once a decision is due.
        """
        if self._corrected is None:
            return
        stamp_s, north_m, east_m = self._corrected
        for odometry_s, own_north_m, own_east_m in reversed(self._recent_odometry):
            if abs(odometry_s - stamp_s) < SAME_S:
                self.planner.set_map_offset(north_m - own_north_m, east_m - own_east_m)
                self._corrected = None
                return
