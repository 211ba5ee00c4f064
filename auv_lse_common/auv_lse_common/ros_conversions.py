"""Conversions that several nodes need: stamps, headers, arrays, diagnostics, plans, soundings."""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from auv_lse_common.health import Health
from auv_lse_common.plan import Plan, Tour
from auv_lse_msgs.msg import Plan as PlanMessage
from auv_lse_msgs.msg import Sounding


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


def sounding_message(row: Sequence[float]) -> Sounding:
    """Sounding of a stamp (s), north, east, depth (m)."""
    return Sounding(header=header(float(row[0])), north_m=float(row[1]), east_m=float(row[2]), depth_m=float(row[3]))


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
