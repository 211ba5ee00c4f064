"""Encodes and decodes plans, waypoints, and the state of a mission."""

import math
from typing import Any

from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.codecs import Fields, header_fields
from auv_lse_common.topics.records import PlanReport, RunReport, Waypoint
from auv_lse_common.vocabulary.frames import quaternion_from_heading
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_common.vocabulary.stamps import seconds


def encode_plan(report: PlanReport, vehicle: int) -> Fields:
    """Plan."""
    plan = report.plan
    segment_legs, bearings = plan.tour_fields
    return {
        "header": header_fields(report.stamp_s),
        "vehicle": report.vehicle,
        "step": plan.step,
        "heading_rad": plan.heading_rad,
        "north_m": plan.north_m,
        "east_m": plan.east_m,
        "actions": list(plan.actions),
        "segment_legs": segment_legs,
        "bearings": list(bearings),
        "naive_path": plan.naive_path,
        "quality_reached": plan.quality_reached,
    }


def decode_plan(message: Any) -> PlanReport:
    """A plan; older recordings call its naive path "heuristic" and have neither tour nor `quality_reached`."""
    bearings = tuple(map(int, getattr(message, "bearings", ())))
    plan = Plan(
        step=int(message.step),
        heading_rad=float(message.heading_rad),
        north_m=float(message.north_m),
        east_m=float(message.east_m),
        actions=tuple(map(int, message.actions)),
        tour=Tour.from_fields(int(getattr(message, "segment_legs", 0)), bearings),
        naive_path=int(message.naive_path if hasattr(message, "naive_path") else message.heuristic),
        quality_reached=bool(getattr(message, "quality_reached", False)),
    )
    return PlanReport(stamp_s=seconds(message.header.stamp), vehicle=int(message.vehicle), plan=plan)


def encode_path(value: tuple[float, Array, float], vehicle: int) -> Fields:
    """Path of (stamp (s), states (n, 3): heading, north, east, depth (m))."""
    stamp_s, states, depth_m = value
    header, poses = header_fields(stamp_s), []
    for heading, north, east in states:
        x, y, z, w = quaternion_from_heading(float(heading))
        position = {"x": float(east), "y": float(north), "z": -depth_m}
        pose = {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}
        poses.append({"header": header, "pose": pose})
    return {"header": header, "poses": poses}


#: Time (s) for which a viewer shows the line of a packet: about a slot.
_LINE_S = 10


def encode_packet_line(value: tuple[float, int, Plan, Plan], vehicle: int) -> Fields:
    """Marker (LINE_LIST) of (stamp (s), sender of a packet, the plan in it, this vehicle's plan)."""
    stamp_s, source, *plans = value
    return {
        "header": header_fields(stamp_s),
        "ns": f"from auv{source}",
        "id": source,
        "type": 5,  # LINE_LIST
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": 3.0},
        "color": {"r": 0.8, "g": 0.475, "b": 0.655, "a": 1.0},
        "lifetime": {"sec": _LINE_S},
        "points": [{"x": plan.east_m, "y": plan.north_m} for plan in plans],
    }


def stop_of(action: int, north_m: float, east_m: float) -> Stop | None:
    """The stop of a message's action (of MissionState) and position; None: the vehicle travels.

    Raises:
        ValueError: for an unknown action, or GO_TO without a position.
    """
    known = Action(action)
    return None if known is Action.TRAVEL else Stop(action=known, position_m=(north_m, east_m))


def stop_fields(stop: Stop | None) -> tuple[int, float, float]:
    """Action, north and east (m) of a stop in a message; None: the vehicle travels."""
    return (int(Action.TRAVEL), math.nan, math.nan) if stop is None else (int(stop.action), *stop.position_m)


#: Fields of a Waypoint that contain its leg, and the corresponding fields of `Leg`.
_LEG_FIELDS = {
    "start_heading_rad": "heading_rad",
    "start_north_m": "north_m",
    "start_east_m": "east_m",
    "turn_rad": "action_rad",
    "turn_radius_m": "radius_m",
    "straight_m": "straight_m",
}


def encode_waypoint(waypoint: Waypoint, vehicle: int) -> Fields:
    """Waypoint."""
    leg = waypoint.leg
    action, then_north_m, then_east_m = stop_fields(waypoint.then)
    end_heading_rad, end_north_m, end_east_m = map(float, waypoint.end)
    return {
        "header": header_fields(waypoint.stamp_s),
        "step": leg.step,
        **{field: getattr(leg, name) for field, name in _LEG_FIELDS.items()},
        "end_heading_rad": end_heading_rad,
        "end_north_m": end_north_m,
        "end_east_m": end_east_m,
        "speed_mps": waypoint.speed_mps,
        "depth_m": waypoint.depth_m,
        "last": waypoint.then is not None,
        "then": action,
        "then_north_m": then_north_m,
        "then_east_m": then_east_m,
        "surface": leg.surface,
    }


def decode_waypoint(message: Any) -> Waypoint:
    """The next leg; older recordings have neither `surface` nor `then`.

    Raises:
        ValueError: if the action after the leg is not one of MissionState.
    """
    values = {name: float(getattr(message, field)) for field, name in _LEG_FIELDS.items()}
    leg = Leg(step=int(message.step), surface=bool(getattr(message, "surface", False)), **values)
    then = stop_of(message.then, message.then_north_m, message.then_east_m) if hasattr(message, "then") else None
    return Waypoint(
        stamp_s=seconds(message.header.stamp),
        leg=leg,
        speed_mps=message.speed_mps,
        depth_m=message.depth_m,
        end=(message.end_heading_rad, message.end_north_m, message.end_east_m),
        then=then,
    )


def encode_run(report: RunReport, vehicle: int) -> Fields:
    """MissionState."""
    status = report.status
    action, north_m, east_m = stop_fields(status.stop)
    return {
        "header": header_fields(report.stamp_s),
        "revision": report.revision,
        "state": int(status.state),
        "action": action,
        "go_to_north_m": north_m,
        "go_to_east_m": east_m,
        "team_abort": status.team_abort,
        "reason": status.reason,
        "limits": list(status.limits),
        "warnings": list(report.warnings),
    }


def decode_run(message: Any) -> RunReport:
    """The state of a vehicle's mission.

    Raises:
        ValueError: if it contains an unknown number.
    """
    status = RunStatus(
        state=RunState(int(message.state)),
        stop=stop_of(int(message.action), message.go_to_north_m, message.go_to_east_m),
        team_abort=bool(message.team_abort),
        reason=str(message.reason),
        limits=tuple(map(str, message.limits)),
    )
    return RunReport(
        stamp_s=seconds(message.header.stamp),
        revision=int(message.revision),
        status=status,
        warnings=tuple(map(str, message.warnings)),
    )
