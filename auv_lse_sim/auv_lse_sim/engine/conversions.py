"""Converts the simulation's values to the records of its topics."""

import math

from auv_lse_common.topics.records import Odometry, Reception, SimReport, Waypoint
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.water import gauge_pressure_pa
from auv_lse_sim.engine.simulation import MissionState, Simulation
from auv_lse_sim.vehicle.vehicle_state import NavigationEstimate
from auv_lse_sim.water.channel import Arrival

#: Numbers of auv_lse_msgs/SimStatus.
_STATES = {state: number for number, state in enumerate(MissionState)}


def reception_of(arrival: Arrival) -> Reception:
    """The reception of a packet that arrived."""
    return Reception(
        stamp_s=arrival.arrival_s,
        source=arrival.source,
        snr_db=float(arrival.snr_db),
        sent_s=arrival.sent_s,
        arrival_s=arrival.heard_s,
        travel_s=arrival.travel_s,
        payload=arrival.payload,
    )


def odometry_of(estimate: NavigationEstimate, depth_m: float) -> Odometry:
    """The vehicle's estimate of itself at its measured depth below the surface (m)."""
    return Odometry(
        stamp_s=estimate.stamp_s,
        heading_rad=estimate.heading_rad,
        north_m=estimate.north_m,
        east_m=estimate.east_m,
        depth_m=depth_m,
        speed_mps=estimate.speed_mps,
        covariance=estimate.covariance,
    )


def pressure_pa(depth_m: float) -> float:
    """Absolute pressure (Pa) at a depth in fresh water of 1000 kg/m3 under one atmosphere."""
    return 101325.0 + gauge_pressure_pa(depth_m, 1000.0)


def checked_leg(waypoint: Waypoint) -> Leg:
    """The leg of a waypoint.

    Raises:
        ValueError: if a number in it is not finite, or its arc has no radius.
    """
    leg = waypoint.leg
    values = (leg.heading_rad, leg.north_m, leg.east_m, leg.action_rad, leg.radius_m, leg.straight_m)
    if not all(math.isfinite(v) for v in values) or leg.radius_m <= 0.0 or leg.straight_m < 0.0:
        raise ValueError(f"waypoint of step {leg.step}: {values} must be finite, with a radius above 0")
    return leg


def status_report(simulation: Simulation, state: MissionState, message: str, speed: float) -> SimReport:
    """The simulation's progress.

    Args:
        message: Why it waits or has failed.
        speed: Simulated seconds per second of wall clock.
    """
    return SimReport(
        stamp_s=simulation.now_s,
        state=_STATES[state],
        message=message,
        steps=tuple(simulation.steps),
        steps_total=simulation.steps_total,
        packets_sent=simulation.sent,
        packets_received=simulation.received,
        packets_lost=simulation.lost,
        speed=speed,
    )
