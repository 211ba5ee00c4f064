"""Fills a timeline from the missions that run on this machine, one after another."""

import math
import os
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.confinement import reach
from auv_lse_record.growing_file import RecordingFile
from auv_lse_record.recording import RecordingError
from auv_lse_run.process.domain import busy_domains, dive_on, run_on
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.live.sources.command_queue import CommandQueue
from auv_lse_shore.live.sources.events import MissionEvents, seconds, topics_of
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.timeline import Timeline

#: Period (s of wall clock) of the search for a mission.
_LOOK_S = 1.0
#: Wall clock (s) for which messages are collected before their events are added.
_SERVE_S = 0.1
#: Wall clock (s) without a message after which the page names the silence, and after which a mission does not run.
_QUIET_S, _SILENT_S = 10.0, 60.0
#: A vehicle's clock that goes back by more than this (s) means that the mission has restarted.
_BACK_S = 10.0
#: Mission time (s) after the first odometry by which every regular topic has been received.
_OVERLAP_S = 60.0


@dataclass(frozen=True, slots=True)
class RunningMission:
    """A mission on a ROS domain.

    Attributes:
        run: Its run folder on this machine, None if it has none.
    """

    domain: int
    run: Path | None


def newest_mission() -> RunningMission | None:
    """The newest mission on this machine; None if none runs."""
    found = [(run.stat().st_mtime, domain, run) for domain in busy_domains() if (run := run_on(domain)) is not None]
    return RunningMission(*max(found)[1:]) if found else None


def _shown(run: Path | None) -> str:
    """A run folder as the user types it: relative where possible."""
    if run is None:
        return ""
    return str(run.relative_to(Path.cwd())) if run.is_relative_to(Path.cwd()) else str(run)


class MissionFollower:
    """Follows missions: those on one domain, or the newest on this machine."""

    def __init__(
        self, timeline: Timeline, domain: int | None, mission: Path | None, commands: CommandQueue | None = None
    ) -> None:
        """Stores what to follow.

        Args:
            domain: ROS domain; None: that of the newest mission on this machine; with a queue, that of the first found.
            mission: Mission file; None: the one in the run folder.
            commands: The queue of the page's commands; None: it has none.
        """
        self._timeline = timeline
        self._domain = domain
        self._mission = mission
        self._commands = commands

    def follow(self, stop: threading.Event) -> None:
        """Follows one mission after another until `stop` is set."""
        done: RunningMission | None = None
        while not stop.is_set():
            found = self._find()
            if found is None or found == done or self._has_ended(found, done):
                self._timeline.set_state(growing=False, waiting="waiting for a mission")
                stop.wait(_LOOK_S)
                continue
            try:
                restarted = self._follow(found, stop)
                self._timeline.set_state(growing=False, control=False, problem="")
            except (OSError, ValueError) as error:
                restarted = False
                print(f"live view: {error}", file=sys.stderr, flush=True)
                self._timeline.set_state(growing=False, control=False, problem=str(error))
            done = None if restarted else found

    def _find(self) -> RunningMission | None:
        if self._domain is None:
            found = newest_mission()
            if found is not None and self._commands is not None:
                self._domain = found.domain  # a later mission does not take over the buttons
            return found
        return RunningMission(self._domain, run_on(self._domain) if self._domain in busy_domains() else None)

    def _has_ended(self, found: RunningMission, done: RunningMission | None) -> bool:
        """Whether the domain is the one on which this machine's mission ran, and is idle now."""
        return done is not None and done.run is not None and found.run is None and self._mission is None

    def _settings(self, found: RunningMission) -> Settings:
        if self._mission is None and found.run is None:
            raise ValueError(
                f"ROS domain {found.domain}: its mission was not started on this machine, so its mission file is "
                "unknown. Name it with --mission FILE"
            )
        return Settings.load(self._mission or (found.run or Path()) / "mission.yaml", read_area=read_area)

    def _follow(self, found: RunningMission, stop: threading.Event) -> bool:
        """Follows a mission to its end; returns whether another mission has begun on its domain."""
        from auv_lse_shore.live.sources.mission_node import MissionListener

        settings = self._settings(found)
        name = found.run.name if found.run else f"ROS domain {found.domain}"
        self._timeline.begin(mission_facts(settings, name=name, simulated=found.run is not None))
        self._timeline.set_state(source="mission", domain=found.domain, growing=True, problem="", waiting="")
        self._timeline.set_state(run=_shown(found.run))
        merged = _MergedMessages(settings, self._timeline, found.run)
        vehicles = settings.mission.vehicles
        dive = dive_on(found.domain) or None  # "": reserved, but not noted, as on a full disk
        with MissionListener(vehicles, found.domain, merged.receive, dive, self._commands) as listener:
            self._timeline.set_state(control=self._commands is not None)
            while not stop.is_set() and not merged.restarted:
                listener.serve(_SERVE_S)
                merged.add_events()
                if found.run is not None and found.domain not in busy_domains():
                    break
                # vehicles at sea may come back, so their domain is followed until the end
                silent_s = time.monotonic() - listener.heard_s
                self._timeline.set_state(growing=silent_s < _SILENT_S, problem=self._silence(found, silent_s))
        merged.catch_up()
        return merged.restarted

    @staticmethod
    def _silence(found: RunningMission, silent_s: float) -> str:
        """Why nothing arrives from vehicles elsewhere; empty while something does, or the mission runs here."""
        if found.run is not None or silent_s < _QUIET_S:
            return ""
        return (
            f"ROS domain {found.domain}: nothing heard {reach(os.environ)} for {_QUIET_S:g} s or more. Vehicles are "
            "under water, or their nodes or the network are down"
        )


class _MergedMessages:
    """Merges live messages with the earlier ones from the recording, so that a late page gets the whole mission.

    The recorder writes in chunks, so the recording lags behind. It is read until it has passed the time of the first
    live message.

    Attributes:
        restarted: Whether another mission has begun.
    """

    def __init__(self, settings: Settings, timeline: Timeline, run: Path | None) -> None:
        self._events = MissionEvents(settings)
        self._topics = frozenset(topics_of(settings.mission.vehicles))
        self._timeline = timeline
        self._run = run
        self._file: RecordingFile | None = None
        self._waiting: list[tuple[str, Any]] = []
        self._first_s: dict[str, float] = {}
        self._last_s: dict[str, float] = {}
        self.restarted = False
        self._joined_s = math.inf
        self._looked_s = -math.inf

    def receive(self, topic: str, message: Any) -> None:
        """Handles a live message. Odometry that goes back in time belongs to another mission."""
        stamp_s = seconds(message.header.stamp)
        if topic.endswith("/odometry"):
            self.restarted |= stamp_s < self._last_s.get(topic, stamp_s) - _BACK_S
            self._last_s[topic] = stamp_s
        if topic not in self._first_s:
            self._first_s[topic] = stamp_s
            if topic.endswith("/odometry"):
                self._joined_s = min(self._joined_s, self._first_s[topic])
        self._waiting.append((topic, message))

    def add_events(self) -> None:
        """Adds the events of new messages and, once a second, those of the recording."""
        self._timeline.add([event for topic, message in self._waiting for event in self._events.take(topic, message)])
        self._waiting.clear()
        if time.monotonic() - self._looked_s >= _LOOK_S:
            self._looked_s = time.monotonic()
            self.catch_up()

    def catch_up(self) -> None:
        """Adds the events from the recording that precede each topic's first live message."""
        if self._run is None or math.isinf(self._joined_s):
            return
        try:
            if self._file is None:
                self._file = RecordingFile(next((self._run / "bag").glob("*.mcap")))
            earlier, newest_s = [], -math.inf
            for topic, message in self._file.messages(self._topics):
                stamp_s = seconds(message.header.stamp)
                newest_s = max(newest_s, stamp_s)
                if stamp_s < self._first_s.get(topic, math.inf):
                    earlier += self._events.take(topic, message)
        except (RecordingError, StopIteration):
            self._run = None  # no recording, or one of another kind: earlier messages are unavailable
            return
        self._timeline.add(earlier)
        if newest_s > self._joined_s + _OVERLAP_S:
            self._run = None
