"""What a vehicle's planner does in a tick: takes what has come in."""

from __future__ import annotations

from auv_lse_common.plan import Plan
from auv_lse_gp.centers import Centers
from auv_lse_planner.vehicle_planner import VehiclePlanner


class PlannerIntake:
    """The map, plans and odometry that wait for the planner, and the order in which it takes them.

    Attributes:
        planner: The planner.
    """

    def __init__(self, planner: VehiclePlanner) -> None:
        """Nothing waits yet."""
        self.planner = planner
        self._centers: Centers | None = None
        self._plans: list[tuple[float, int, Plan]] = []
        self._odometry: tuple[float, float, float, float] | None = None

    def set_centers(self, centers: Centers) -> None:
        """The map's kernel centers; they replace those that still wait."""
        self._centers = centers

    def add_plan(self, stamp_s: float, vehicle: int, plan: Plan) -> None:
        """A mate's plan: end of reception (s), number of the mate, the plan."""
        self._plans.append((stamp_s, vehicle, plan))

    def set_odometry(self, stamp_s: float, heading_rad: float, north_m: float, east_m: float) -> None:
        """The vehicle's navigation; it replaces what still waits."""
        self._odometry = (stamp_s, heading_rad, north_m, east_m)

    def take(self, now_s: float) -> bool:
        """The planner takes the map, plans by stamp and vehicle, odometry; returns whether a decision is due then."""
        if self._centers is not None:
            self.planner.set_centers(self._centers, now_s)
            self._centers = None
        for stamp_s, vehicle, plan in sorted(self._plans, key=lambda entry: entry[:2]):
            self.planner.hear(stamp_s, vehicle, plan)
        self._plans = []
        if self._odometry is not None:
            self.planner.odometry(*self._odometry)
            self._odometry = None
        return self.planner.due(now_s)
