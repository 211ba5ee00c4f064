"""Fills a timeline from the missions that run on this machine, one after another."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.process.domain import busy_domains, run_on
from auv_lse_record.recording import RecordingError
from auv_lse_shore.live.sources.events import MissionEvents, seconds, topics_of
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.recording import RecordingFile
from auv_lse_shore.live.sources.timeline import Timeline

#: Wall clock (s) between two looks for a mission.
_LOOK_S = 1.0
#: Wall clock (s) for which messages are handled before they are handed on.
_SERVE_S = 0.1
#: Wall clock (s) without a message after which a mission counts as silent.
_SILENT_S = 60.0
#: Mission time (s) by which a vehicle's clock must go back for a restart of the mission.
_BACK_S = 10.0
#: Mission time (s) from the first message of a vehicle's odometry until every topic that comes regularly was heard.
_OVERLAP_S = 60.0


@dataclass(frozen=True, slots=True)
class RunningMission:
    """A mission on a ROS domain.

    Attributes:
        domain: The domain.
        run: Its run folder on this machine, None if there is none.
    """

    domain: int
    run: Path | None


def newest_mission() -> RunningMission | None:
    """The mission on this machine that began last; None if none runs."""
    found = [(run.stat().st_mtime, domain, run) for domain in busy_domains() if (run := run_on(domain)) is not None]
    return RunningMission(*max(found)[1:]) if found else None


class MissionFollower:
    """Listens to missions: the one on a domain, or whichever began last on this machine."""

    def __init__(self, timeline: Timeline, domain: int | None, mission: Path | None) -> None:
        """Joins nothing yet.

        Args:
            timeline: What is filled.
            domain: ROS domain; None: that of the mission that began last on this machine.
            mission: Mission file; None: that of the run folder.
        """
        self._timeline = timeline
        self._domain = domain
        self._mission = mission

    def follow(self, stop: threading.Event) -> None:
        """Follows one mission after another until `stop` is set."""
        done: RunningMission | None = None
        while not stop.is_set():
            found = self._find()
            if found is None or found == done:
                self._timeline.say(growing=False, waiting="waiting for a mission")
                stop.wait(_LOOK_S)
                continue
            try:
                restarted = self._follow(found, stop)
                self._timeline.say(growing=False, problem="")
            except (OSError, ValueError) as error:
                restarted = False
                self._timeline.say(growing=False, problem=str(error))
            done = None if restarted else found

    def _find(self) -> RunningMission | None:
        if self._domain is None:
            return newest_mission()
        return RunningMission(self._domain, run_on(self._domain) if self._domain in busy_domains() else None)

    def _settings(self, found: RunningMission) -> Settings:
        if self._mission is None and found.run is None:
            raise ValueError(
                f"ROS domain {found.domain}: its mission was not started on this machine, so its mission file is not "
                "known; name it: --mission FILE"
            )
        return Settings.load(self._mission or (found.run or Path()) / "mission.yaml")

    def _follow(self, found: RunningMission, stop: threading.Event) -> bool:
        """Follows a mission to its end; returns whether another one has begun on its domain."""
        from auv_lse_shore.live.sources.mission_node import MissionListener

        settings = self._settings(found)
        name = found.run.name if found.run else f"ROS domain {found.domain}"
        self._timeline.begin(mission_facts(settings, name=name, simulated=found.run is not None))
        self._timeline.say(source="mission", domain=found.domain, growing=True, problem="", waiting="")
        merged = _Merged(settings, self._timeline, found.run)
        with MissionListener(settings.mission.vehicles, found.domain, merged.hear) as listener:
            while not stop.is_set() and not merged.restarted:
                listener.serve(_SERVE_S)
                merged.hand_on()
                if found.run is not None and found.domain not in busy_domains():
                    break
                # vehicles at sea may come back: their domain is listened to for ever
                self._timeline.say(growing=time.monotonic() - listener.heard_s < _SILENT_S)
        merged.catch_up()
        return merged.restarted


class _Merged:
    """What is heard and, from the recording, what was said before: a page that comes late misses nothing.

    The recorder writes in chunks, so the recording's end lags behind. It is read on until it has passed the moment at
    which the vehicles were heard first.

    Attributes:
        restarted: Whether another mission has begun.
    """

    def __init__(self, settings: Settings, timeline: Timeline, run: Path | None) -> None:
        """Takes the mission file, the timeline and the run folder."""
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

    def hear(self, topic: str, message: Any) -> None:
        """Takes a message as it comes. Odometry that goes back in time is that of another mission."""
        stamp_s = seconds(message.header.stamp)
        if topic.endswith("/odometry"):
            self.restarted |= stamp_s < self._last_s.get(topic, stamp_s) - _BACK_S
            self._last_s[topic] = stamp_s
        if topic not in self._first_s:
            self._first_s[topic] = stamp_s
            if topic.endswith("/odometry"):
                self._joined_s = min(self._joined_s, self._first_s[topic])
        self._waiting.append((topic, message))

    def hand_on(self) -> None:
        """Makes the events of what has come in, and now and then looks into the recording."""
        self._timeline.add([event for topic, message in self._waiting for event in self._events.take(topic, message)])
        self._waiting.clear()
        if time.monotonic() - self._looked_s >= _LOOK_S:
            self._looked_s = time.monotonic()
            self.catch_up()

    def catch_up(self) -> None:
        """Takes from the recording what was said before the first message heard of each topic."""
        if self._run is None or math.isinf(self._joined_s):
            return
        try:
            if self._file is None:
                self._file = RecordingFile(next((self._run / "bag").glob("*.mcap")))
            told, newest_s = [], -math.inf
            for topic, message in self._file.messages(self._topics):
                stamp_s = seconds(message.header.stamp)
                newest_s = max(newest_s, stamp_s)
                if stamp_s < self._first_s.get(topic, math.inf):
                    told += self._events.take(topic, message)
        except (RecordingError, StopIteration):
            self._run = None  # no recording, or one of another kind: what was said before is not known
            return
        self._timeline.add(told)
        if newest_s > self._joined_s + _OVERLAP_S:
            self._run = None
