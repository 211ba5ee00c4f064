"""The planner's messages: the one place where north/east/heading becomes a pose in the map frame (ENU)."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from numpy.typing import NDArray
from sensor_msgs.msg import Range

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.ros_conversions import header, stamp, stop_fields
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_msgs.msg import AutopilotStatus, Bound, Waypoint
from auv_lse_planner.methods.decision import BoundRecord
from auv_lse_planner.vehicle.intake import Taken


def navigation(message: Odometry) -> tuple[float, float, float]:
    """Heading (rad, clockwise from north), north, east (m) of an ENU Odometry."""
    pose = message.pose.pose
    q = pose.orientation
    heading = heading_from_quaternion(q.x, q.y, q.z, q.w)
    return heading, pose.position.y, pose.position.x


def altitude_m(message: Range) -> float:
    """Height over the ground (m) of a Range; infinite: no echo."""
    return float(message.range)


def waypoint_message(now_s: float, leg: Leg, speed_mps: float, depth_m: float, then: Stop | None) -> Waypoint:
    """Waypoint of the next leg; `then` is what follows the mission's last one, None if it is not the last."""
    end = leg.end_state
    action, north_m, east_m = stop_fields(then)
    return Waypoint(
        header=header(now_s),
        step=leg.step,
        start_heading_rad=leg.heading_rad,
        start_north_m=leg.north_m,
        start_east_m=leg.east_m,
        turn_rad=leg.action_rad,
        turn_radius_m=leg.radius_m,
        straight_m=leg.straight_m,
        end_heading_rad=float(end[0]),
        end_north_m=float(end[1]),
        end_east_m=float(end[2]),
        speed_mps=speed_mps,
        depth_m=depth_m,
        last=then is not None,
        then=action,
        then_north_m=north_m,
        then_east_m=east_m,
        surface=leg.surface,
    )


def path_message(now_s: float, states: NDArray[np.float64], depth_m: float) -> Path:
    """Path through states (heading, north, east), shape (n, 3), at the vehicle's depth."""
    path = Path(header=header(now_s))
    for heading, north, east in states:
        pose = PoseStamped(header=path.header)
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = float(east), float(north), -depth_m
        o = pose.pose.orientation
        o.x, o.y, o.z, o.w = quaternion_from_heading(float(heading))
        path.poses.append(pose)
    return path


def bound_message(now_s: float, bound: BoundRecord, planning_s: float, taken: Taken) -> Bound:
    """Bound message of a decision's record, which took `planning_s` of wall clock and was of what was `taken`."""
    return Bound(
        header=header(now_s),
        step=bound.step,
        jbar=bound.expected_end,
        reward_so_far=bound.reward_so_far,
        lower_bound=bound.lower_bound,
        lower_bound_max=bound.lower_bound_max,
        incumbent_value=bound.incumbent_value,
        incumbent_kept=bound.incumbent_kept,
        iterations=bound.iterations,
        planning_s=planning_s,
        deadline_hit=bound.deadline_hit,
        map_revision=taken.map_revision,
        plans_heard=taken.plans,
        odometry_taken=stamp(taken.odometry_s),
    )


def autopilot_report(message: AutopilotStatus) -> AutopilotReport:
    """What an AutopilotStatus says."""
    return AutopilotReport(
        heard=message.heard,
        armed=message.armed,
        mode=message.mode,
        mode_obeys=message.mode_obeys,
        battery=message.battery,
        leak=message.leak,
    )
