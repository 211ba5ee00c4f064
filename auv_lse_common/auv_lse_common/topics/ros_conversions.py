"""Conversions that several nodes need: stamps, headers, arrays, diagnostics, plans, soundings, dead reckoning."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation, raw_place
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
from auv_lse_common.vocabulary.health import Health
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_msgs.msg import Fix as FixMessage
from auv_lse_msgs.msg import MateNavigation as MateNavigationMessage
from auv_lse_msgs.msg import MissionState, Sounding
from auv_lse_msgs.msg import Plan as PlanMessage


def stamp(seconds: float) -> Time:
    """ROS time of seconds since the clock's epoch, to the nearest nanosecond."""
    nanoseconds = round(seconds * 1e9)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds(time: Time) -> float:
    """Seconds since the clock's epoch of a ROS time."""
    return float(time.sec) + time.nanosec * 1e-9


def header(now_s: float) -> Header:
    """Header in the map frame (ENU) with the stamp `now_s`."""
    return Header(stamp=stamp(now_s), frame_id="map")


def doubles(values: Any) -> array.array:
    """A float64[] field's value from a NumPy array, without a Python loop."""
    return array.array("d", values.astype("f8").tobytes())


def floats(values: Any) -> array.array:
    """A float32[] field's value from a NumPy array, without a Python loop."""
    return array.array("f", values.astype("f4").tobytes())


def diagnostics(now_s: float, name: str, health: Health) -> DiagnosticArray:
    """A DiagnosticArray with the one status `name`."""
    status = DiagnosticStatus(
        level=bytes([health.level]),
        name=name,
        message=health.text,
        hardware_id="auv_lse",
        values=[KeyValue(key=key, value=str(value)) for key, value in health.values.items()],
    )
    return DiagnosticArray(header=header(now_s), status=[status])


def sounding_row(message: Sounding) -> tuple[float, float, float, float]:
    """Stamp (s), north, east, depth (m) of a Sounding."""
    return (seconds(message.header.stamp), message.north_m, message.east_m, message.depth_m)


def raw_sounding_row(message: Sounding) -> tuple[float, float, float, float, float, float]:
    """Stamp (s), north, east, depth, raw north, raw east (m) of a Sounding; the raw place is NaN if unknown."""
    return (*sounding_row(message), *raw_place(message.raw_north_m, message.raw_east_m))


def sounding_message(row: Sequence[float]) -> Sounding:
    """Sounding of a stamp (s), north, east, depth (m), and raw north, raw east (m) if the row has them."""
    raw_north_m, raw_east_m = (float(row[4]), float(row[5])) if len(row) > 4 else (math.nan, math.nan)
    return Sounding(
        header=header(float(row[0])),
        north_m=float(row[1]),
        east_m=float(row[2]),
        depth_m=float(row[3]),
        raw_north_m=raw_north_m,
        raw_east_m=raw_east_m,
    )


def dead_reckoning_message(raw: DeadReckoning, vehicle: int) -> Odometry:
    """Odometry in ENU of a vehicle's raw place; its covariance is not known (zeros)."""
    message = Odometry(header=header(raw.stamp_s), child_frame_id=f"auv{vehicle}")
    position, attitude = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = float(raw.east_m), float(raw.north_m), -float(raw.depth_m)
    attitude.x, attitude.y, attitude.z, attitude.w = quaternion_from_heading(float(raw.heading_rad))
    return message


def dead_reckoning_from_message(message: Odometry) -> DeadReckoning:
    """The raw place in an ENU Odometry."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return DeadReckoning(
        stamp_s=seconds(message.header.stamp),
        heading_rad=heading_from_quaternion(q.x, q.y, q.z, q.w),
        north_m=position.y,
        east_m=position.x,
        depth_m=-position.z,
    )


def fix_message(fix: Fix) -> FixMessage:
    """Message of a fix."""
    return FixMessage(
        header=header(fix.stamp_s),
        north_m=fix.north_m,
        east_m=fix.east_m,
        raw_north_m=fix.raw_north_m,
        raw_east_m=fix.raw_east_m,
        std_m=fix.std_m,
    )


def fix_from_message(message: FixMessage) -> Fix:
    """The fix of a message."""
    return Fix(
        stamp_s=seconds(message.header.stamp),
        north_m=message.north_m,
        east_m=message.east_m,
        raw_north_m=message.raw_north_m,
        raw_east_m=message.raw_east_m,
        std_m=message.std_m,
    )


def mate_navigation_message(mate: MateNavigation) -> MateNavigationMessage:
    """Message of what a packet told of its sender's navigation."""
    return MateNavigationMessage(
        header=header(mate.stamp_s),
        source=mate.source,
        sent_s=mate.sent_s,
        raw_north_m=mate.raw_north_m,
        raw_east_m=mate.raw_east_m,
        has_fix=mate.has_fix,
        fix_raw_north_m=mate.fix_raw_north_m,
        fix_raw_east_m=mate.fix_raw_east_m,
        fix_north_m=mate.fix_north_m,
        fix_east_m=mate.fix_east_m,
        travel_s=mate.travel_s,
    )


def mate_navigation_from_message(message: MateNavigationMessage) -> MateNavigation:
    """What the packet told of its sender's navigation."""
    fix = (message.fix_raw_north_m, message.fix_raw_east_m, message.fix_north_m, message.fix_east_m)
    fix_raw_north_m, fix_raw_east_m, fix_north_m, fix_east_m = fix if message.has_fix else (math.nan,) * 4
    return MateNavigation(
        stamp_s=seconds(message.header.stamp),
        source=message.source,
        sent_s=message.sent_s,
        raw_north_m=message.raw_north_m,
        raw_east_m=message.raw_east_m,
        fix_raw_north_m=fix_raw_north_m,
        fix_raw_east_m=fix_raw_east_m,
        fix_north_m=fix_north_m,
        fix_east_m=fix_east_m,
        travel_s=message.travel_s,
    )


def plan_message(now_s: float, vehicle: int, plan: Plan) -> PlanMessage:
    """Plan message of a vehicle's plan, decided or received at `now_s` (s)."""
    segment_legs, bearings = plan.tour_fields
    return PlanMessage(
        header=header(now_s),
        vehicle=vehicle,
        step=plan.step,
        heading_rad=plan.heading_rad,
        north_m=plan.north_m,
        east_m=plan.east_m,
        actions=list(plan.actions),
        segment_legs=segment_legs,
        bearings=list(bearings),
        naive_path=plan.naive_path,
    )


def plan_from_message(message: PlanMessage) -> Plan:
    """The plan of a Plan message."""
    return Plan(
        step=message.step,
        heading_rad=message.heading_rad,
        north_m=message.north_m,
        east_m=message.east_m,
        actions=tuple(message.actions),
        tour=Tour.from_fields(message.segment_legs, message.bearings),
        naive_path=message.naive_path,
    )


def stop_of(action: int, north_m: float, east_m: float) -> Stop | None:
    """The stop of a message's action, one of MissionState's, and place; None: the vehicle travels.

    Raises:
        ValueError: if there is no such action, or no place to go to.
    """
    known = Action(action)
    return None if known is Action.TRAVEL else Stop(action=known, place_m=(north_m, east_m))


def stop_fields(stop: Stop | None) -> tuple[int, float, float]:
    """Action, north and east (m) of a stop in a message; None: the vehicle travels."""
    return (int(Action.TRAVEL), math.nan, math.nan) if stop is None else (int(stop.action), *stop.place_m)


def mission_state(now_s: float, revision: int, standing: RunStatus, warnings: Sequence[str]) -> MissionState:
    """MissionState number `revision` of how it stands with a vehicle's mission."""
    action, north_m, east_m = stop_fields(standing.stop)
    return MissionState(
        header=header(now_s),
        revision=revision,
        state=standing.state,
        action=action,
        go_to_north_m=north_m,
        go_to_east_m=east_m,
        team_abort=standing.team_abort,
        reason=standing.reason,
        limits=list(standing.limits),
        warnings=list(warnings),
    )


def standing_of(message: MissionState) -> RunStatus:
    """How it stands with the mission, by a MissionState.

    Raises:
        ValueError: if it has a number that stands for nothing.
    """
    return RunStatus(
        state=RunState(message.state),
        stop=stop_of(message.action, message.go_to_north_m, message.go_to_east_m),
        team_abort=message.team_abort,
        reason=message.reason,
        limits=tuple(message.limits),
    )
