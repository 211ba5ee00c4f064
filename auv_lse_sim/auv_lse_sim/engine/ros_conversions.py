"""The simulator's messages: the one place where its north/east/heading becomes ENU."""

from __future__ import annotations

import math

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.topics.ros_conversions import header, stamp
from auv_lse_common.vocabulary.frames import quaternion_from_heading
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_msgs.msg import LockstepTick, ModemRx, SimStatus, Waypoint
from auv_lse_sim.engine.simulation import MissionState, Simulation
from auv_lse_sim.vehicle.vehicle_state import NavigationEstimate, Truth
from auv_lse_sim.water.channel import Arrival


def arrival_message(arrival: Arrival) -> ModemRx:
    """ModemRx of a packet that arrived."""
    return ModemRx(
        header=header(arrival.arrival_s),
        source=arrival.source,
        destination=0,
        snr_db=float(arrival.snr_db),
        sent_s=arrival.sent_s,
        arrival_s=arrival.heard_s,
        travel_s=arrival.travel_s,
        payload=arrival.payload,
    )


def odometry_message(odometry: NavigationEstimate, depth_m: float, vehicle: int) -> Odometry:
    """The vehicle's estimate of itself as an Odometry in ENU.

    Args:
        odometry: The estimate.
        depth_m: Measured depth of the vehicle below the surface (m).
        vehicle: Its number.
    """
    o = odometry
    message = _pose_message(o.stamp_s, o.heading_rad, o.north_m, o.east_m, depth_m, o.speed_mps, f"auv{vehicle}")
    # (heading, north, east) -> (x = east, y = north, yaw = pi/2 - heading)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    pose = np.zeros((6, 6))
    rows = np.array([0, 1, 5])
    pose[np.ix_(rows, rows)] = turn @ np.asarray(o.covariance) @ turn.T
    message.pose.covariance = pose.ravel()
    return message


def truth_message(truth: Truth, vehicle: int) -> Odometry:
    """What the vehicle really does as an Odometry in ENU."""
    t = truth
    return _pose_message(t.stamp_s, t.heading_rad, t.north_m, t.east_m, t.depth_m, t.speed_mps, f"truth/auv{vehicle}")


def _pose_message(
    stamp_s: float, heading_rad: float, north_m: float, east_m: float, depth_m: float, speed_mps: float, child: str
) -> Odometry:
    message = Odometry(header=header(stamp_s), child_frame_id=child)
    message.pose.pose.position.x, message.pose.pose.position.y = float(east_m), float(north_m)
    message.pose.pose.position.z = -float(depth_m)
    o = message.pose.pose.orientation
    o.x, o.y, o.z, o.w = quaternion_from_heading(float(heading_rad))
    message.twist.twist.linear.x = float(speed_mps)
    return message


def altitude_message(stamp_s: float, altitude_m: float, vehicle: int) -> Range:
    """DVL altitude above the bottom as a Range; no echo (NaN) is +inf (REP 117)."""
    message = Range(header=header(stamp_s), radiation_type=Range.ULTRASOUND, field_of_view=0.07)
    message.header.frame_id = f"auv{vehicle}/dvl"
    message.min_range, message.max_range = 0.2, 200.0
    message.range = math.inf if math.isnan(altitude_m) else float(altitude_m)
    return message


def pressure_message(stamp_s: float, depth_m: float, vehicle: int) -> FluidPressure:
    """Measured depth of the vehicle as absolute pressure (Pa) in fresh water of 1000 kg/m3 under one atmosphere."""
    message = FluidPressure(header=header(stamp_s))
    message.header.frame_id = f"auv{vehicle}/pressure"
    message.fluid_pressure = 101325.0 + 1000.0 * 9.80665 * float(depth_m)
    return message


def leg_of_waypoint(message: Waypoint) -> Leg:
    """The leg of a Waypoint.

    Raises:
        ValueError: if a number in it is not finite, or its arc has no radius.
    """
    values = (
        message.start_heading_rad,
        message.start_north_m,
        message.start_east_m,
        message.turn_rad,
        message.turn_radius_m,
        message.straight_m,
    )
    if not all(math.isfinite(v) for v in values) or message.turn_radius_m <= 0.0 or message.straight_m < 0.0:
        raise ValueError(f"waypoint of step {message.step}: {values}; expected finite numbers and a radius above 0")
    return Leg(
        step=message.step,
        heading_rad=message.start_heading_rad,
        north_m=message.start_north_m,
        east_m=message.start_east_m,
        action_rad=message.turn_rad,
        radius_m=message.turn_radius_m,
        straight_m=message.straight_m,
        surface=message.surface,
    )


def tick_message(simulation: Simulation) -> LockstepTick:
    """LockstepTick of the simulation's last tick."""
    return LockstepTick(
        stamp=stamp(simulation.now_s),
        tick=simulation.tick,
        soundings=simulation.soundings,
        arrivals=simulation.arrivals,
        odometries=[simulation.tick] * len(simulation.vehicles),
        commands=simulation.commands,
        dead_reckonings=[simulation.tick] * len(simulation.vehicles),
        fixes=simulation.fixes,
    )


def status_message(simulation: Simulation, state: MissionState, message: str, speed: float) -> SimStatus:
    """SimStatus of the simulation, with what is to be said of it now.

    Args:
        simulation: The simulation.
        state: Where the mission is.
        message: Why it waits or has failed.
        speed: Simulated seconds per second of wall clock.
    """
    return SimStatus(
        header=header(simulation.now_s),
        state=getattr(SimStatus, state.name),
        message=message,
        steps=simulation.steps,
        steps_total=simulation.steps_total,
        packets_sent=simulation.sent,
        packets_received=simulation.received,
        packets_lost=simulation.lost,
        speed=speed,
    )
