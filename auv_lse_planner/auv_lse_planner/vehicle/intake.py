"""Queues the inputs of a vehicle's planner between two ticks and applies them in a fixed order."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

#: Largest difference (s) between the stamps of a corrected position and of the odometry it belongs to.
STAMP_TOLERANCE_S = 0.05
#: Number of recent odometry messages kept for that comparison.
KEPT = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class InputsUsed:
    """The inputs applied so far. They and the planner's state determine its next decision.

    Attributes:
        odometry_s: Stamp of the last odometry (s); 0 before the first.
    """

    map_revision: int = 0
    plans: int = 0
    odometry_s: float = 0.0


class PlannerIntake:
    """Queues the mission's state, the map, team plans and odometry for the planner."""

    def __init__(self, planner: VehiclePlanner) -> None:
        self.planner = planner
        self.inputs_used = InputsUsed()
        self._centers: tuple[Centers, int] | None = None
        self._quality: Quality | None = None
        self._plans: list[tuple[float, int, Plan]] = []
        self._odometry: tuple[float, float, float, float] | None = None
        self._recent_odometry: deque[tuple[float, float, float]] = deque(maxlen=KEPT)  # stamp, north, east
        self._corrected: CorrectedPosition | None = None
        self._run_status: RunStatus | None = None
        self._state: RunState | None = None  # the mission's last reported state

    @property
    def end_unreported(self) -> bool:
        """Whether the last leg is travelled but the mission's state does not show it yet (a message may be lost)."""
        return self.planner.finished and self._state in (None, RunState.WAITING, RunState.RUNNING)

    def set_centers(self, centers: Centers, revision: int) -> None:
        """Queues the map's kernel centers and their revision; replaces queued ones."""
        self._centers = centers, revision

    def set_quality(self, quality: Quality) -> None:
        """Queues the quality of the map; replaces a queued one."""
        self._quality = quality

    def add_plan(self, stamp_s: float, vehicle: int, plan: Plan) -> None:
        """Queues a team mate's plan: end of reception (s), number of the mate, the plan."""
        self._plans.append((stamp_s, vehicle, plan))

    def set_odometry(self, stamp_s: float, heading_rad: float, north_m: float, east_m: float) -> None:
        """Queues the vehicle's navigation state; replaces a queued one."""
        self._odometry = (stamp_s, heading_rad, north_m, east_m)
        self._recent_odometry.append((stamp_s, north_m, east_m))

    def set_corrected(self, position: CorrectedPosition) -> None:
        """Queues the vehicle's corrected position in the map; its offset is computed from odometry of the same time."""
        self._corrected = position

    def set_run_status(self, status: RunStatus) -> None:
        """Queues the mission's state; replaces a queued one."""
        self._run_status = status

    def take(self, now_s: float) -> bool:
        """Applies the mission's state, the map, the plans sorted by stamp and vehicle, the map's quality, the odometry.

        The quality is that of the current map unless a newer map was applied before. A map that arrives together with
        the quality may be newer: `gp_node` publishes it right after.

        Returns:
            Whether a decision is now due.
        """
        revision, plans, odometry_s = self.inputs_used.map_revision, self.inputs_used.plans, self.inputs_used.odometry_s
        if self._run_status is not None:
            self.planner.set_blocked(now_s, self._run_status.blocked_reason)
            self._state = self._run_status.state
            self._run_status = None
        if self._centers is not None:
            centers, revision = self._centers
            self.planner.set_centers(centers, now_s)
            self._centers = None
        for stamp_s, vehicle, plan in sorted(self._plans, key=lambda entry: entry[:2]):
            self.planner.receive_plan(stamp_s, vehicle, plan)
        plans += len(self._plans)
        self._plans = []
        if self._quality is not None:
            is_current = self._quality.revision >= self.inputs_used.map_revision
            self.planner.set_quality(now_s, self._quality, is_current)
            self._quality = None
        self.apply_correction()
        if self._odometry is not None:
            self.planner.odometry(*self._odometry)
            odometry_s = self._odometry[0]
            self._odometry = None
        self.inputs_used = InputsUsed(map_revision=revision, plans=plans, odometry_s=odometry_s)
        return self.planner.due(now_s)

    def apply_correction(self) -> None:
        """Passes the planner the offset between map and odometry, if odometry of the same time is available.

        `take` calls this too. Call it directly if the corrected position is computed after `take`.
        """
        position = self._corrected
        if position is None:
            return
        for odometry_s, own_north_m, own_east_m in reversed(self._recent_odometry):
            if abs(odometry_s - position.stamp_s) < STAMP_TOLERANCE_S:
                covariance_m2 = np.array(position.covariance)[1:, 1:]
                self.planner.set_map_offset(position.north_m - own_north_m, position.east_m - own_east_m, covariance_m2)
                self._corrected = None
                return
