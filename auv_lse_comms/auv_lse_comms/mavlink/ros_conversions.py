"""The autopilot's messages: the one place where its north/east/heading becomes ENU."""

from __future__ import annotations

import math

from nav_msgs.msg import Odometry
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.topics.ros_conversions import header, stop_of
from auv_lse_common.vocabulary.frames import quaternion_from_heading
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_comms.mavlink.messages.conversion import Target
from auv_lse_comms.mavlink.messages.events import Altitude, AutopilotEstimate, AutopilotState, Pressure
from auv_lse_msgs.msg import AutopilotStatus, Waypoint


def odometry_message(odometry: AutopilotEstimate, vehicle: int) -> Odometry:
    """The autopilot's estimate as an Odometry in ENU; its covariance is not known (zeros)."""
    message = Odometry(header=header(odometry.stamp_s), child_frame_id=f"auv{vehicle}")
    position, attitude = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = odometry.east_m, odometry.north_m, -odometry.depth_m
    attitude.x, attitude.y, attitude.z, attitude.w = quaternion_from_heading(odometry.heading_rad)
    message.twist.twist.linear.x = odometry.speed_mps
    message.twist.twist.angular.z = -odometry.yaw_rate_radps
    return message


def altitude_message(altitude: Altitude, vehicle: int) -> Range:
    """Altitude over ground as a Range; no ground in reach (NaN) is +inf (REP 117)."""
    message = Range(header=header(altitude.stamp_s), radiation_type=Range.ULTRASOUND, field_of_view=0.07)
    message.header.frame_id = f"auv{vehicle}/dvl"
    message.min_range, message.max_range = altitude.min_m, altitude.max_m
    message.range = math.inf if math.isnan(altitude.altitude_m) else altitude.altitude_m
    return message


def pressure_message(pressure: Pressure, vehicle: int) -> FluidPressure:
    """The water's absolute pressure."""
    message = FluidPressure(header=header(pressure.stamp_s), fluid_pressure=pressure.pressure_pa)
    message.header.frame_id = f"auv{vehicle}/pressure"
    return message


def target_of_waypoint(message: Waypoint) -> Target:
    """The end of a Waypoint's leg.

    Raises:
        ValueError: if what is to follow it is none of MissionState's actions.
    """
    return Target(
        north_m=message.end_north_m,
        east_m=message.end_east_m,
        depth_m=message.depth_m,
        heading_rad=message.end_heading_rad,
        step=message.step,
        speed_mps=message.speed_mps if message.speed_mps > 0.0 else math.nan,
        then=stop_of(message.then, message.then_north_m, message.then_east_m),
        surface=message.surface,
        begins_m=(message.start_north_m, message.start_east_m),
    )


def status_message(state: AutopilotState) -> AutopilotStatus:
    """What the autopilot says of itself."""
    says = state.says
    return AutopilotStatus(
        header=header(state.stamp_s),
        heard=says.heard,
        armed=says.armed,
        mode=says.mode,
        mode_obeys=says.mode_obeys,
        battery=says.battery,
        battery_v=state.battery_v,
        leak=says.leak,
    )


def ends_to_reach(message: Waypoint, north_m: float, east_m: float) -> list[Target]:
    """What a link that was started again has to reach: the end of a Waypoint's leg, and its start if that is to come.

    The leg may still be to come, and where it leads back, the short cut to its end would never pass the end of the leg
    before. On the leg its start lies behind: the vehicle must not turn back to it.

    Args:
        message: The last waypoint before the start.
        north_m: Where the vehicle is, north (m).
        east_m: And east (m).
    """
    leg = Leg(
        step=message.step,
        heading_rad=message.start_heading_rad,
        north_m=message.start_north_m,
        east_m=message.start_east_m,
        action_rad=message.turn_rad,
        radius_m=message.turn_radius_m,
        straight_m=message.straight_m,
    )
    end = target_of_waypoint(message)
    if leg.progress_m(north_m, east_m) > 0.0:
        return [end]
    start = Target(
        north_m=leg.north_m,
        east_m=leg.east_m,
        depth_m=message.depth_m,
        heading_rad=leg.heading_rad,
        step=message.step - 1,
    )
    return [start, end]
