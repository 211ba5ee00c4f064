"""A simulated vehicle's estimated and true state."""

from dataclasses import dataclass

from auv_lse_common.support.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationEstimate:
    """The vehicle's own estimate of its state.

    Attributes:
        heading_rad: Heading (rad, clockwise from north).
        speed_mps: Speed over ground.
        drift_rad: Direction of travel minus the heading, positive to starboard.
        covariance: Covariance of heading (rad), north, east (m), shape (3, 3).
    """

    stamp_s: float
    heading_rad: float
    north_m: float
    east_m: float
    speed_mps: float
    covariance: Array
    drift_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The vehicle's true state, which no core may read.

    Attributes:
        heading_rad: True heading.
        depth_m: True depth of the vehicle below the surface.
        travelled_m: Distance over ground since the start.
        water_m: True depth of the water there, NaN where the ground is unknown or land.
        step: Step at which its current leg starts; -1 before the first.
        along_m: Distance travelled along that leg.
        loitering: Whether it circles because it has no next leg.
    """

    stamp_s: float
    heading_rad: float
    north_m: float
    east_m: float
    depth_m: float
    speed_mps: float
    travelled_m: float
    water_m: float
    step: int
    along_m: float
    loitering: bool
