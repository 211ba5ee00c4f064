"""Converts the messages of a mission to the events that the page draws: thinned, rounded, without repetitions.

A message is any object with the fields of its ROS type, from a recording or from a subscription.
"""

import math
from collections import defaultdict
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.records import (
    BoundReport,
    FieldReport,
    HealthReport,
    Odometry,
    PlanReport,
    Reception,
    RunReport,
    SimReport,
    TdmaReport,
    Transmission,
)
from auv_lse_common.topics.table import MISSION_TOPICS, TRUTH_TOPIC, VEHICLE_TOPICS, find_topic, full_name
from auv_lse_common.vocabulary import stamps
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_comms.packet.codec import PacketError, decode
from auv_lse_gp.level_set.lines import contours
from auv_lse_gp.map.certainty import CLASSES, classify, lines_of
from auv_lse_gp.map.depth_map import BAND_SIGMAS, DepthField
from auv_lse_record.message_types import stamp_of
from auv_lse_shore.live.sources.map_layers import LayerCoder, scales_of, thinning
from auv_lse_shore.live.sources.own_map import OwnMap
from auv_lse_shore.live.sources.plan_lines import PlanLines, decimetres
from auv_lse_shore.live.sources.timeline import Event

#: Mission time (s) between the positions of a track.
_TRACK_S = 2.0
#: Mission time (s) between two statuses of the simulator, unless the state changes.
_STATUS_S = 2.0
#: Mission time (s) after which an unchanged health report is repeated.
_HEALTH_S = 60.0

_STATES = ("waiting", "running", "finished", "failed")
_LEVELS = ("ok", "warning", "error", "stale")


def topics_of(vehicles: int) -> list[str]:
    """Full names of all topics that the page shows."""
    rows = [topic for name, topic in (VEHICLE_TOPICS | MISSION_TOPICS).items() if name in MissionEvents.HANDLERS]
    names = {full_name(row, k) for row in (*rows, TRUTH_TOPIC) for k in range(1, vehicles + 1)}
    return sorted(names)


class MissionEvents:
    """Creates the events of one mission.

    Attributes:
        last_s: Stamp (s) of the last message taken of each topic.
    """

    def __init__(self, settings: Settings, maps_on_request: bool = False) -> None:
        """Reads the mission file.

        Args:
            maps_on_request: Whether maps that vehicles do not publish are computed by `newest_map` only.
        """
        self._settings = settings
        self._maps_on_request = maps_on_request
        self._area = OperatingArea(settings.area)
        self._scales = scales_of(settings.level_set.level_m, settings.level_set.largest_risk)
        self._lines: dict[int, PlanLines] = {}
        self._coders: dict[int, LayerCoder] = {}
        self._own_maps: dict[int, OwnMap] = {}
        self._sounded: dict[int, list[tuple[float, float]]] = defaultdict(list)  # north, east: own and received
        self._plans: dict[int, Plan] = {}
        self._health: dict[str, tuple[str, str, float]] = {}
        self._event_s: dict[str, float] = {}
        self._runs: dict[int, Event] = {}
        self._state = ""
        self.last_s: dict[str, float] = {}

    def take(self, topic: str, message: Any) -> list[Event]:
        """The events of a message; none for a repetition or another topic."""
        found = find_topic(topic)
        if found is None or found.topic.name not in self.HANDLERS or found.vehicle > self._settings.mission.vehicles:
            return []
        stamp_s = seconds(message.header.stamp)
        self.last_s[topic] = stamp_s
        assert found.topic.decode is not None
        return self.HANDLERS[found.topic.name](self, found.vehicle, stamp_s, found.topic.decode(message))

    def wants(self, topic: str, data: bytes) -> bool:
        """Whether a serialized message (CDR) can have events; saves decoding positions that the page omits."""
        found = find_topic(topic)
        if found is None or found.topic.name not in ("odometry", TRUTH_TOPIC.name, "sounding"):
            return True
        if found.topic.name != TRUTH_TOPIC.name and not self._map_of(found.vehicle).stopped:
            return True
        key = {TRUTH_TOPIC.name: "truth", "odometry": "pose", "sounding": "sounding"}[found.topic.name]
        return self._is_due(f"{key} {found.vehicle}", round(stamp_of(data), 3), _TRACK_S)

    def _is_due(self, key: str, stamp_s: float, period_s: float) -> bool:
        """Whether the last event of `key` is at least `period_s` of mission time away."""
        return abs(stamp_s - self._event_s.get(key, -math.inf)) >= period_s - 1e-6

    # ------------------------------------------------------------------ positions

    def _pose(self, vehicle: int, stamp_s: float, odometry: Odometry) -> list[Event]:
        maps = [] if self._maps_on_request else self._own_map(vehicle, stamp_s)
        if not self._is_due(f"pose {vehicle}", stamp_s, _TRACK_S):
            return maps
        self._event_s[f"pose {vehicle}"] = stamp_s
        std_m = math.hypot(*odometry.position_std_m)
        event = {
            "kind": "pose",
            "vehicle": vehicle,
            "t": stamp_s,
            "north": round(odometry.north_m, 1),
            "east": round(odometry.east_m, 1),
            "heading": round(odometry.heading_rad, 3),
            "depth": round(odometry.depth_m, 2),
            "speed": round(odometry.speed_mps, 2),
            "std": round(std_m, 2) if std_m > 0.0 else None,  # nav_msgs has no other mark of an unknown error
        }
        return [event, *maps]

    def _truth(self, vehicle: int, stamp_s: float, truth: Odometry) -> list[Event]:
        if not self._is_due(f"truth {vehicle}", stamp_s, _TRACK_S):
            return []
        self._event_s[f"truth {vehicle}"] = stamp_s
        north, east = round(truth.north_m, 1), round(truth.east_m, 1)
        return [{"kind": "truth", "vehicle": vehicle, "t": stamp_s, "north": north, "east": east}]

    # ------------------------------------------------------------------ maps and plans

    def _sounding(self, vehicle: int, stamp_s: float, sounding: Sounding) -> list[Event]:
        self._map_of(vehicle).add([(stamp_s, *sounding[1:4])])
        if self._is_due(f"sounding {vehicle}", stamp_s, _TRACK_S):
            self._event_s[f"sounding {vehicle}"] = stamp_s
            self._sounded[vehicle].append((sounding.north_m, sounding.east_m))
        return []

    def _map_of(self, vehicle: int) -> OwnMap:
        if vehicle not in self._own_maps:
            self._own_maps[vehicle] = OwnMap(self._settings.planner_settings(vehicle), self._area)
        return self._own_maps[vehicle]

    def _own_map(self, vehicle: int, stamp_s: float, at_once: bool = False) -> list[Event]:
        """The map of a vehicle that publishes none, if one is due, or wanted at once."""
        field = self._map_of(vehicle).field(stamp_s, at_once)
        if field is None:
            return []
        layers = {"risk": field.risk, "p_safe": field.p_safe, "depth": field.mean_m, "std": field.std_m}
        return [self._map_event(vehicle, stamp_s, field.grid.north_m, field.grid.east_m, layers, field.variance_scale)]

    def newest_map(self, vehicle: int) -> list[Event]:
        """A vehicle's map at its last position's time, if there are new soundings or samples for it."""
        own, at_s = self._own_maps.get(vehicle), self.last_s.get(f"/auv{vehicle}/odometry")
        return [] if own is None or not own.has_news or at_s is None else self._own_map(vehicle, at_s, True)

    def _map(self, vehicle: int, stamp_s: float, field: FieldReport) -> list[Event]:
        self._map_of(vehicle).stop()
        found = {"risk": field.risk, "p_safe": field.p_safe, "depth": field.mean_m, "std": field.std_m}
        layers = {name: values.astype(float) for name, values in found.items()}
        return [self._map_event(vehicle, stamp_s, field.north_m, field.east_m, layers, field.variance_scale)]

    def _map_event(
        self, vehicle: int, stamp_s: float, north_m: Array, east_m: Array, layers: dict[str, Array], scale: float
    ) -> Event:
        level_m = self._settings.level_set.level_m
        apart = thinning(*layers["risk"].shape)
        shown = {name: values[::apart, ::apart] for name, values in layers.items()}
        axes, half_m = (north_m[::apart], east_m[::apart]), BAND_SIGMAS * shown["std"]
        coder = self._coders.setdefault(vehicle, LayerCoder(self._scales))
        field, signal_std_m = _field_of(north_m, east_m, layers, scale), self._settings.vehicle(vehicle).gp.signal_std_m
        informed = field.informed(signal_std_m)
        estimate = contours(north_m, east_m, layers["depth"], level_m, informed)
        # as the report's pieces, with the soundings that the vehicle knows; their position errors are not known here
        sounded = np.reshape(self._sounded[vehicle], (-1, 2))
        sounded = sounded[np.isfinite(sounded).all(axis=1)]
        pieces = classify(estimate, field, signal_std_m, np.column_stack([sounded, np.full(len(sounded), np.nan)]))
        lines = {
            **{kind: lines_of(pieces, kind) for kind in CLASSES},
            "shallow_edge": contours(*axes, shown["depth"] + half_m, level_m, informed[::apart, ::apart]),
            "deep_edge": contours(*axes, shown["depth"] - half_m, level_m, informed[::apart, ::apart]),
        }
        return {
            "kind": "map",
            "vehicle": vehicle,
            "t": stamp_s,
            "rows": shown["risk"].shape[0],
            "columns": shown["risk"].shape[1],
            "south": round(float(north_m[0]), 2),
            "west": round(float(east_m[0]), 2),
            "cell": round(float(north_m[1] - north_m[0]) * apart, 3),
            "expected_loss": round(float(np.nanmean(layers["risk"])), 5),
            "layers": coder.code(shown),
            **{name: [decimetres(line) for line in found] for name, found in lines.items()},
        }

    def _plan(self, vehicle: int, stamp_s: float, report: PlanReport) -> list[Event]:
        plan = report.plan
        if plan == self._plans.get(vehicle):
            return []
        self._plans[vehicle] = plan
        if vehicle not in self._lines:
            self._lines[vehicle] = PlanLines(self._settings.planner_settings(vehicle), self._area)
        return [{"kind": "plan", "vehicle": vehicle, "t": stamp_s, **self._lines[vehicle].lines(plan)}]

    def _bound(self, vehicle: int, stamp_s: float, bound: BoundReport) -> list[Event]:
        event = {
            "kind": "bound",
            "vehicle": vehicle,
            "t": stamp_s,
            "step": bound.step,
            "jbar": _number(bound.jbar),
            "reward": _number(bound.reward_so_far),
            "bound": _number(bound.lower_bound),
            "bound_max": _number(bound.lower_bound_max),
            "kept": bound.incumbent_kept,
            "planning_s": round(bound.planning_s, 4),
            "late": bound.deadline_hit,
        }
        return [event]

    # ------------------------------------------------------------------ packets

    def _sent(self, vehicle: int, stamp_s: float, sent: Transmission) -> list[Event]:
        if sent.ping:
            return []
        event = {"kind": "sent", "vehicle": vehicle, "t": stamp_s, "bytes": len(sent.payload)}
        try:
            packet = decode(sent.payload)
        except PacketError as error:
            return [{**event, "problem": error.reason}]
        return [{**event, "samples": len(packet.samples), "actions": len(packet.plan.actions)}]

    def _received(self, vehicle: int, stamp_s: float, heard: Reception) -> list[Event]:
        if heard.ping:
            return []
        event = {
            "kind": "received",
            "vehicle": vehicle,
            "t": stamp_s,
            "source": heard.source,
            "snr_db": _number(heard.snr_db, 1),
            "travel_s": _number(heard.travel_s, 4),
        }
        return [event]

    def _samples(self, vehicle: int, stamp_s: float, samples: Soundings) -> list[Event]:
        if not len(samples):
            return []
        source = int(samples.vehicle[0])
        self._map_of(vehicle).add(samples.points_m, source)
        self._sounded[vehicle] += map(tuple, samples.locations_m.tolist())
        positions = decimetres(samples.locations_m)
        return [{"kind": "samples", "vehicle": vehicle, "t": stamp_s, "source": source, "positions": positions}]

    def _slots(self, vehicle: int, stamp_s: float, report: TdmaReport) -> list[Event]:
        event = {
            "kind": "slots",
            "vehicle": vehicle,
            "t": stamp_s,
            "used": report.slots_used,
            "missed": report.slots_missed,
            "received": report.packets_received,
            "reasons": dict(zip(report.reasons, report.counts, strict=False)),
        }
        return [event]

    # ------------------------------------------------------------------ state and health

    def _diagnostics(self, vehicle: int, stamp_s: float, reports: list[HealthReport]) -> list[Event]:
        events: list[Event] = []
        for status in reports:
            node, text = status.name.rsplit("/", 1)[-1], status.text
            name = _LEVELS[min(status.level, len(_LEVELS) - 1)]
            known = self._health.get(status.name)
            if known and known[:2] == (name, text) and stamp_s - known[2] < _HEALTH_S:
                continue
            self._health[status.name] = (name, text, stamp_s)
            event = {"kind": "health", "vehicle": vehicle, "t": stamp_s, "node": node, "level": name, "text": text}
            events.append({**event, "values": status.values})
        return events

    def _run(self, vehicle: int, stamp_s: float, report: RunReport) -> list[Event]:
        """The state of a vehicle's mission; safety_node's repetitions are dropped."""
        event: Event = {
            "kind": "run",
            "vehicle": vehicle,
            "t": stamp_s,
            "state": report.status.state.name.lower(),
            "reason": report.status.reason,
            "limits": list(report.status.limits),
            "warnings": list(report.warnings),
        }
        if {**event, "t": 0.0} == {**self._runs.get(vehicle, {}), "t": 0.0}:
            return []
        self._runs[vehicle] = event
        return [event]

    def _status(self, vehicle: int, stamp_s: float, report: SimReport) -> list[Event]:
        state = _STATES[report.state]
        if state == self._state and not self._is_due("status", stamp_s, _STATUS_S):
            return []
        self._state, self._event_s["status"] = state, stamp_s
        event = {
            "kind": "status",
            "t": stamp_s,
            "state": state,
            "text": report.message,
            "steps": list(report.steps),
            "sent": report.packets_sent,
            "received": report.packets_received,
            "lost": report.packets_lost,
            "speed": round(report.speed, 2),
        }
        return [event]

    #: Handler of each topic that the page shows, by the topic's name in the table.
    HANDLERS: ClassVar[dict[str, Callable[[Any, int, float, Any], list[Event]]]] = {
        "odometry": _pose,
        "truth/odometry": _truth,
        "sounding": _sounding,
        "field": _map,
        "plan": _plan,
        "planner/bound": _bound,
        "modem/tx": _sent,
        "modem/rx": _received,
        "team/samples": _samples,
        "tdma": _slots,
        "mission/state": _run,
        "diagnostics": _diagnostics,
        "/sim/status": _status,
    }


def seconds(stamp: Any) -> float:
    """Seconds of a ROS time, to the millisecond."""
    return round(stamps.seconds(stamp), 3)


def _number(value: Any, digits: int = 3) -> float | None:
    """A rounded number; None for NaN and infinity, which JSON lacks."""
    return round(float(value), digits) if math.isfinite(value) else None


def _field_of(north_m: Array, east_m: Array, layers: dict[str, Array], scale: float) -> DepthField:
    """A published map's field, with the mean variance factor of the map at every location."""
    inside = np.isfinite(layers["depth"])
    return DepthField(
        grid=Grid(north_m=north_m, east_m=east_m, inside=inside, resolution_m=float(north_m[1] - north_m[0])),
        mean_m=layers["depth"],
        std_m=layers["std"],
        prior_std_m=layers["std"] / np.sqrt(scale),
        risk=layers["risk"],
        p_safe=layers["p_safe"],
        variance_scale=scale,
        revision=0,
    )
