"""The team's chart: excerpts of the vehicles' recordings, as the events of the live page.

Each vehicle's excerpts become a recording of its own on the laptop, in a temporary folder. So what a vehicle recorded
while it was away is filled in when it is back, and maps are computed here, from soundings: over the link, a map would
be a hundred times larger than the soundings that it is made of.
"""

from __future__ import annotations

import math
import os
import tempfile
import threading
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import parse_parameters
from auv_lse_common.mission_file.retired import without_retired
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.user_error import brief
from auv_lse_common.topics.table import VEHICLE_TOPICS, full_name
from auv_lse_record.growing_file import MAGIC, RecordingFile
from auv_lse_record.recording import MISSION_FILE
from auv_lse_shore.live.sources.events import MissionEvents
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.timeline import Timeline

#: Shortest time (s) between two messages of a topic that are fetched. Maps are computed on the laptop; health comes
#: with the vehicle's state.
_PERIODS = {
    "odometry": 2.0, "sounding": 1.0, "mission/state": 2.0, "plan": 0.0, "planner/bound": 0.0,
    "modem/tx": 0.0, "modem/rx": 0.0, "team/samples": 0.0, "tdma": 10.0,
}  # fmt: skip
#: Time (s) between two checks for new data, and between two maps of a vehicle; largest share of time for each map.
_LOOK_S, _MAPS_S, _MAP_SHARE = 0.5, 30.0, 0.1
#: Largest excerpt (bytes), unpacked: no vehicle's software sends more.
_MOST_BYTES = 50_000_000


#: First words of the two kinds of trouble.
_READING, _MAPPING = "its recording cannot be shown", "its map cannot be computed"


class ChartError(ValueError):
    """An answer of a vehicle that is not an excerpt."""


@dataclass(slots=True)
class _Track:
    """One vehicle's dive: its files on the laptop, and the cursor up to which they are complete."""

    cursor: dict[str, Any] = field(default_factory=dict)
    paths: list[Path] = field(default_factory=list)
    files: list[RecordingFile] = field(default_factory=list)


class TeamChart:
    """Fills a timeline from excerpts; a context manager, whose thread does that.

    Attributes:
        timeline: What the page shows.
        trouble: Why a vehicle's excerpts cannot be shown, by vehicle.
    """

    def __init__(self, name: str, vehicles: Sequence[int]) -> None:
        """Sets up an empty timeline."""
        self.timeline, self.trouble = Timeline(), dict[str, str]()
        self._name, self._tracks = name, {f"auv{k}": _Track() for k in vehicles}
        self._lock, self._over, self._renewed = threading.Lock(), threading.Event(), False
        self._events: MissionEvents | None = None
        self._map_due_s = dict.fromkeys(vehicles, -math.inf)
        self.timeline.set_state(source="team", growing=True, waiting="waiting for the vehicles’ recordings")

    def __enter__(self) -> TeamChart:
        """Starts the thread."""
        self._folder = tempfile.TemporaryDirectory(prefix="auv_lse_watch_")
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stops the thread, and removes its files."""
        self._over.set()
        self._thread.join()
        self._folder.cleanup()

    def request(self, name: str) -> dict[str, Any]:
        """The values of the next request for an excerpt of a vehicle ("auv2")."""
        number = int(name.removeprefix("auv"))
        topics = {full_name(VEHICLE_TOPICS[topic], number): period_s for topic, period_s in _PERIODS.items()}
        return {"cursor": self._tracks[name].cursor, "topics": {MISSION_FILE: 0.0, **topics}}

    def take(self, name: str, answer: Mapping[str, Any]) -> bool:
        """Handles a vehicle's answer; returns whether there is more.

        Raises:
            ChartError: if it is not an excerpt.
        """
        track, cursor = self._tracks[name], answer.get("cursor")
        try:
            unpacker, packed = zlib.decompressobj(), answer.get("data", b"")
            data = unpacker.decompress(packed, _MOST_BYTES)
            if not isinstance(cursor, dict) or (packed and not unpacker.eof):
                raise ValueError("no cursor, cut off, or too large")
        except (ValueError, TypeError, zlib.error) as error:
            raise ChartError(f"its excerpt of the recording is damaged ({error})") from error
        if not cursor:  # it has no dive; the page keeps the last one
            return False
        with self._lock:
            if cursor.get("dive") != track.cursor.get("dive") and track.paths:
                track.paths, track.files, self._renewed = [], [], True
                self._clear(name, _READING)
            if (cursor.get("dive"), cursor.get("file")) != (track.cursor.get("dive"), track.cursor.get("file")):
                path = Path(self._folder.name) / f"{name}-{time.monotonic_ns()}.mcap"
                path.write_bytes(MAGIC)
                track.paths.append(path)
                track.files.append(RecordingFile(path))
            if data:
                _append(track.paths[-1], data)
            track.cursor = cursor
        return bool(answer.get("more"))

    def _work(self) -> None:
        while not self._over.wait(_LOOK_S):
            with self._lock:
                renewed, self._renewed = self._renewed, False
                if renewed:  # a vehicle's new dive replaces its old one on the page
                    self._events = None
                    for track in self._tracks.values():
                        track.files = [RecordingFile(path) for path in track.paths]
                files = {name: list(track.files) for name, track in self._tracks.items()}
            for name, found in files.items():
                try:
                    self._read(name, found)
                except Exception as error:  # one vehicle's bad data must not hide the others
                    self.trouble[name] = f"{_READING}: {brief(error)}"
            self._add_maps()

    def _clear(self, name: str, kind: str) -> None:
        if self.trouble.get(name, "").startswith(kind):
            del self.trouble[name]

    def _read(self, name: str, files: Sequence[RecordingFile]) -> None:
        topics = frozenset(self.request(name)["topics"])
        for file in files:
            events: list[Any] = []
            try:
                for topic, message in file.messages(topics):
                    if topic == MISSION_FILE:
                        self._begin(str(message.data))
                    elif self._events is not None:
                        events += self._events.take(topic, message)
            finally:  # events before the damage are shown
                self.timeline.add(events)

    def _begin(self, text: str) -> None:
        """Begins the timeline with the first vehicle's mission file; that of the others is the same."""
        if self._events is None:
            where = "the recorded mission file"
            settings = Settings.from_patterns(without_retired(parse_parameters(text, where, is_recorded=True)), where)
            self._events = MissionEvents(settings, maps_on_request=True)
            self.timeline.begin(mission_facts(settings, name=self._name, simulated=False))

    def _add_maps(self) -> None:
        """Adds the newest maps, if they are due: they take time here, and memory in the browser."""
        for vehicle, due_s in self._map_due_s.items():
            began_s = time.monotonic()
            if self._events is None or began_s < due_s:
                continue
            try:
                event = self._events.newest_map(vehicle)
            except Exception as error:  # must not hide the other maps and the tracks
                self.trouble[f"auv{vehicle}"] = f"{_MAPPING}: {brief(error)}"
                self._map_due_s[vehicle] = began_s + _MAPS_S
                continue
            if not event:
                continue
            self._clear(f"auv{vehicle}", _MAPPING)
            self.timeline.add(event)
            took_s = time.monotonic() - began_s
            self._map_due_s[vehicle] = began_s + max(_MAPS_S, took_s / _MAP_SHARE)


def _append(path: Path, data: bytes) -> None:
    """Adds bytes to a file, all of them or none."""
    size = path.stat().st_size
    try:
        with path.open("ab") as file:
            file.write(data)
    except OSError:
        os.truncate(path, size)
        raise
