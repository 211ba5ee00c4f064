"""Converts the page's events to standard ROS messages under /viz, so that RViz and Foxglove need no plugin.

All positions are in the frame `map` (ENU: x east, y north); z only sets the order of drawing.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_lse_common.topics.codecs import encode_geodetic, header_fields, time_fields
from auv_lse_common.topics.records import GeodeticPosition, Odometry
from auv_lse_common.vocabulary.frames import quaternion_from_heading
from auv_lse_record.message_types import make_message, types_of
from auv_lse_shore.live.sources.map_layers import OUTSIDE
from auv_lse_shore.live.sources.timeline import Event
from auv_lse_shore.live.viewers.map_panel import GEOJSON, area_text, isobath_text

#: Colors of the vehicles on the page (Okabe and Ito), red, green, blue of 0..1.
_COLORS = (
    (0.835, 0.369, 0.0),
    (0.337, 0.706, 0.914),
    (0.0, 0.62, 0.451),
    (0.8, 0.475, 0.655),
    (0.902, 0.624, 0.0),
    (0.0, 0.447, 0.698),
    (0.941, 0.894, 0.259),
    (0.55, 0.55, 0.55),
)
_ARROW, _LINE_STRIP, _TEXT = 0, 4, 9
_ADD, _DELETE_ALL = 0, 3
_TRACK_EVERY = 5  # positions between two messages, because each message holds the whole track
_Z = {"area": 0.05, "isobath": 0.1, "track": 0.2, "plan": 0.3, "packet": 0.4, "vehicle": 0.5}
_LEVELS = {"ok": 0, "warning": 1, "error": 2, "stale": 3}


@dataclass(frozen=True, slots=True)
class StandardMessage:
    """One message, serialized.

    Attributes:
        topic: Full name.
        kind: Its type, "nav_msgs/msg/Path"; `GEOJSON` for Foxglove alone.
        stamp_s: Mission time (s) of its content.
        data: CDR bytes; of GeoJSON its text.
    """

    topic: str
    kind: str
    stamp_s: float
    data: bytes


class StandardMessages:
    """Creates the messages of one mission from its events, in order of time."""

    def __init__(self, facts: Event) -> None:
        """Takes the mission's first event."""
        self._store: Any = types_of({})
        self._facts = facts
        self._origin_deg: tuple[float, float] | None = facts["origin_deg"] and tuple(facts["origin_deg"])
        self._cells: dict[int, Any] = {}
        self._tracks: dict[int, list[tuple[float, float]]] = {}
        self._poses: dict[int, Event] = {}
        self._plans: dict[int, Event] = {}
        self._sent: dict[int, Event] = {}

    def definition(self, kind: str) -> str:
        """The message definition of a type, with those of its fields."""
        text: str = self._store.generate_msgdef(kind, ros_version=2)[0]
        return text

    def first(self, stamp_s: float) -> list[StandardMessage]:
        """Messages that hold for the whole mission: the area and, for a simulated lake, the true isobath."""
        area = {"points": [{"x": e, "y": n, "z": _Z["area"]} for n, e in _positions(self._facts["area"])]}
        lines = [self._line(0, "true isobath", i, line, (0.0, 0.0, 0.0), 2.0) for i, line in enumerate(self._true)]
        messages = [
            self._make("/viz/area", "geometry_msgs/msg/PolygonStamped", stamp_s, polygon=area),
            self._markers("/viz/true_isobath", stamp_s, lines),
        ]
        if self._origin_deg:
            messages.append(StandardMessage("/viz/geojson/area", GEOJSON, stamp_s, area_text(self._facts).encode()))
        return messages

    @property
    def _true(self) -> list[Any]:
        lines: list[Any] = self._facts["true_isobath"]
        return lines

    def take(self, event: Event) -> list[StandardMessage]:
        """The messages of an event; none for kinds that have no message."""
        taker = {
            "pose": self._pose,
            "map": self._map,
            "plan": self._plan,
            "bound": self._bound,
            "sent": self._packet,
            "received": self._reception,
            "health": self._health,
        }.get(event["kind"])
        return list(taker(event)) if taker else []

    # ------------------------------------------------------------------ one method per kind of event

    def _pose(self, event: Event) -> Iterator[StandardMessage]:
        vehicle, t = event["vehicle"], event["t"]
        self._poses[vehicle] = event
        track = self._tracks.setdefault(vehicle, [])
        track.append((event["north"], event["east"]))
        x, y, z, w = quaternion_from_heading(event["heading"])
        position = {"x": event["east"], "y": event["north"], "z": _Z["vehicle"]}
        turned = {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}
        yield self._make(f"/viz/auv{vehicle}/pose", "geometry_msgs/msg/PoseStamped", t, pose=turned)
        if self._origin_deg:
            at = Odometry(stamp_s=t, heading_rad=event["heading"], north_m=event["north"], east_m=event["east"])
            fields = encode_geodetic(GeodeticPosition.of(at, self._origin_deg), vehicle)
            yield self._make(f"/viz/auv{vehicle}/navsat", "sensor_msgs/msg/NavSatFix", t, **fields)
        color = _color(vehicle)
        size = {"scale": {"x": 24.0, "y": 8.0, "z": 4.0}}
        arrow = self._marker(t, "vehicles", 2 * vehicle, _ARROW, color, pose=turned, **size)
        name = {"position": {**position, "y": position["y"] + 14.0}, "orientation": {"w": 1.0}}
        text = self._marker(
            t, "vehicles", 2 * vehicle + 1, _TEXT, color, pose=name, scale={"z": 16.0}, text=f"auv{vehicle}"
        )
        yield self._make("/viz/vehicles", "visualization_msgs/msg/MarkerArray", t, markers=[arrow, text])
        if len(track) % _TRACK_EVERY == 1:
            yield self._path(f"/viz/auv{vehicle}/track", t, track, _Z["track"])

    def _map(self, event: Event) -> Iterator[StandardMessage]:
        vehicle, t = event["vehicle"], event["t"]
        names = [layer["name"] for layer in self._facts["layers"]]
        change = np.frombuffer(zlib.decompress(base64.b64decode(event["layers"])), dtype=np.uint8)
        last = self._cells.get(vehicle)
        cells = change + last if last is not None and last.shape == change.shape else change
        self._cells[vehicle] = cells
        planes = cells.reshape(len(names), -1)
        for layer, topic in (("risk", "risk_map"), ("p_safe", "p_safe")):
            plane = planes[names.index(layer)]
            percent = np.where(plane == OUTSIDE, -1, np.round(plane * (100.0 / 254.0))).astype(np.int8)
            corner = {"x": event["west"] - event["cell"] / 2.0, "y": event["south"] - event["cell"] / 2.0}
            info = {
                "resolution": event["cell"],
                "width": event["columns"],
                "height": event["rows"],
                "origin": {"position": corner, "orientation": {"w": 1.0}},
            }
            name = f"/viz/auv{vehicle}/{topic}"
            yield self._make(name, "nav_msgs/msg/OccupancyGrid", t, info=info, data=percent)
        lines = []
        for key, color, width in (
            ("found", (1.0, 1.0, 1.0), 5.0),
            ("likely", (1.0, 1.0, 1.0), 2.5),
            ("guessed", (0.7, 0.7, 0.7), 1.0),
            ("shallow_edge", (0.9, 0.6, 0.0), 1.5),
            ("deep_edge", (0.0, 0.45, 0.7), 1.5),
        ):
            lines += [self._line(t, key, i, line, color, width) for i, line in enumerate(event[key])]
        yield self._markers(f"/viz/auv{vehicle}/isobath", t, lines)
        if self._origin_deg:
            text = isobath_text(event, self._facts)
            yield StandardMessage(f"/viz/geojson/auv{vehicle}/isobath", GEOJSON, t, text.encode())
        yield self._value(f"/viz/auv{vehicle}/expected_loss", t, event["expected_loss"])

    def _plan(self, event: Event) -> Iterator[StandardMessage]:
        self._plans[event["vehicle"]] = event
        yield from self._plan_from(event["vehicle"], event["t"], event["step"])

    def _plan_from(self, vehicle: int, t: float, step: int) -> Iterator[StandardMessage]:
        """The plan's two parts, from a mission step on."""
        plan, per = self._plans[vehicle], self._facts["points_per_leg"]
        positions = list(_positions(plan["line"]))
        gone, own = max(0, step - plan["step"]), plan["own"]
        parts = {"actions": positions[gone * per : own * per + 1], "continuation": positions[max(gone, own) * per :]}
        for name, part in parts.items():
            yield self._path(f"/viz/auv{vehicle}/plan/{name}", t, part, _Z["plan"])

    def _bound(self, event: Event) -> Iterator[StandardMessage]:
        vehicle, t = event["vehicle"], event["t"]
        for name, key in (("reward", "reward"), ("lower_bound", "bound_max"), ("planning_s", "planning_s")):
            if event[key] is not None:
                yield self._value(f"/viz/auv{vehicle}/{name}", t, event[key])
        if vehicle in self._plans:
            yield from self._plan_from(vehicle, t, event["step"])

    def _packet(self, event: Event) -> Iterator[StandardMessage]:
        vehicle = event["vehicle"]
        self._sent[vehicle] = event
        if vehicle in self._poses:
            here = self._poses[vehicle]
            ring = [
                (here["north"] + 30.0 * np.cos(a), here["east"] + 30.0 * np.sin(a))
                for a in np.linspace(0, 2 * np.pi, 25)
            ]
            yield self._flight(event["t"], f"sent by auv{vehicle}", 0, vehicle, ring)

    def _reception(self, event: Event) -> Iterator[StandardMessage]:
        source, vehicle = self._poses.get(event["source"]), self._poses.get(event["vehicle"])
        if source and vehicle:
            ends = [(p["north"], p["east"]) for p in (source, vehicle)]
            name = f"received from auv{event['source']}"
            yield self._flight(event["t"], name, event["vehicle"], event["source"], ends)

    def _flight(
        self, t: float, name: str, number: int, vehicle: int, line: list[tuple[float, float]]
    ) -> StandardMessage:
        slot_s = self._facts["tdma"]["slot_s"]
        flat = [10.0 * value for position in line for value in position]
        marker = self._line(t, name, number, flat, _color(vehicle), 3.0, "packet")
        marker["lifetime"] = time_fields(slot_s)
        return self._make("/viz/packets", "visualization_msgs/msg/MarkerArray", t, markers=[marker])

    def _health(self, event: Event) -> Iterator[StandardMessage]:
        status = {
            "level": _LEVELS[event["level"]],
            "name": f"auv{event['vehicle']}/{event['node']}",
            "message": event["text"],
            "hardware_id": f"auv{event['vehicle']}",
            "values": [{"key": key, "value": value} for key, value in event["values"].items()],
        }
        yield self._make("/viz/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", event["t"], status=[status])

    # ------------------------------------------------------------------ parts of messages

    def _value(self, topic: str, t: float, value: float) -> StandardMessage:
        data = self._store.serialize_cdr(
            make_message(self._store, "std_msgs/msg/Float64", {"data": float(value)}), "std_msgs/msg/Float64"
        )
        return StandardMessage(topic, "std_msgs/msg/Float64", t, bytes(data))

    def _path(self, topic: str, t: float, positions: list[tuple[float, float]], z: float) -> StandardMessage:
        header = header_fields(t)
        poses = [
            {"header": header, "pose": {"position": {"x": e, "y": n, "z": z}, "orientation": {"w": 1.0}}}
            for n, e in positions
        ]
        return self._make(topic, "nav_msgs/msg/Path", t, poses=poses)

    def _markers(self, topic: str, t: float, markers: list[dict[str, Any]]) -> StandardMessage:
        """Markers that replace all earlier markers of the topic."""
        clear = {"header": header_fields(t), "action": _DELETE_ALL}
        return self._make(topic, "visualization_msgs/msg/MarkerArray", t, markers=[clear, *markers])

    def _line(
        self,
        t: float,
        space: str,
        number: int,
        line: Any,
        color: tuple[float, ...],
        width: float,
        level: str = "isobath",
    ) -> dict[str, Any]:
        points = [{"x": e, "y": n, "z": _Z[level]} for n, e in _positions(line)]
        return self._marker(t, space, number, _LINE_STRIP, color, points=points, scale={"x": width})

    def _marker(
        self, t: float, space: str, number: int, kind: int, color: tuple[float, ...], **fields: Any
    ) -> dict[str, Any]:
        red, green, blue = color
        return {
            "header": header_fields(t),
            "ns": space,
            "id": number,
            "type": kind,
            "action": _ADD,
            "color": {"r": red, "g": green, "b": blue, "a": 1.0},
            "pose": {"orientation": {"w": 1.0}},
            **fields,
        }

    def _make(self, topic: str, kind: str, t: float, **fields: Any) -> StandardMessage:
        header = {} if kind.endswith("/MarkerArray") else {"header": header_fields(t)}
        message = make_message(self._store, kind, {**header, **fields})
        return StandardMessage(topic, kind, t, bytes(self._store.serialize_cdr(message, kind)))


def _positions(line: Any) -> Iterator[tuple[float, float]]:
    """North, east (m) of a line in decimetres."""
    for i in range(0, len(line), 2):
        yield 0.1 * line[i], 0.1 * line[i + 1]


def _color(vehicle: int) -> tuple[float, float, float]:
    return _COLORS[(vehicle - 1) % len(_COLORS)]
