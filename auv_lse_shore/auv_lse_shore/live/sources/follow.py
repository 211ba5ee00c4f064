"""Fills a timeline from a recording, also while the recording grows."""

import threading
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import nest
from auv_lse_common.mission_file.retired import without_retired
from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.recording import RecordingError
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.live.sources.events import MissionEvents, topics_of
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.recording import flown_parameters, open_recording
from auv_lse_shore.live.sources.timeline import Timeline

#: Period (s of wall clock) for polling a recording that grows.
_PERIOD_S = 0.2
#: Wall clock (s) without new data after which a recording counts as ended.
_PATIENCE_S = 30.0
#: Number of messages whose events are added at once.
_BATCH = 200


class RecordingFollower:
    """Reads a recording into a timeline.

    Attributes:
        problem: Why reading stopped before the recording's end; else empty.
    """

    def __init__(self, recording: Path, timeline: Timeline, mission: Path | None = None) -> None:
        """Reads the mission file and begins the timeline; reads no message yet.

        Args:
            recording: The path that `recording_in` returns.
            mission: The mission file; None: the one in the recording or beside it.

        Raises:
            RecordingError: if there is no mission file.
            ParameterError: if the mission file cannot be used.
        """
        if mission is None:
            patterns, where = flown_parameters(recording)
        else:
            patterns, where = without_retired(read_parameter_file(mission, read_area)), str(mission)
        self.settings = Settings.from_patterns(patterns, where)
        folder = recording if recording.is_dir() else recording.parent
        run = folder.parent if folder.name == "bag" else recording
        self.problem = ""
        self._file = open_recording(recording)
        self._events = MissionEvents(self.settings)
        self._topics = frozenset(topics_of(self.settings.mission.vehicles))
        self._timeline = timeline
        simulated = any("sim" in nest(values) for values in patterns.values())
        timeline.begin(mission_facts(self.settings, name=run.name, simulated=simulated))
        timeline.set_state(source="recording", growing=True, reading=True, problem="")

    def read(self) -> int:
        """Reads new messages; returns their number.

        Raises:
            RecordingError: if the recording is broken.
        """
        count, waiting = 0, []
        for topic, message in self._file.messages(self._topics, self._events.wants):
            waiting += self._events.take(topic, message)
            count += 1
            if count % _BATCH == 0:
                self._timeline.add(waiting)
                waiting = []
        self._timeline.add(waiting)
        return count

    def follow(self, stop: threading.Event) -> None:
        """Reads until the recording's end or until `stop` is set; sets the timeline's state.

        State "reading" holds until everything has been read that was recorded before.
        """
        quiet_s = 0.0
        try:
            while not stop.is_set() and not self._file.complete:
                quiet_s = 0.0 if self.read() else quiet_s + _PERIOD_S
                growing = not self._file.complete and quiet_s < _PATIENCE_S
                self._timeline.set_state(growing=growing, reading=False)
                stop.wait(_PERIOD_S)
        except RecordingError as error:
            self.problem = str(error)
            self._timeline.set_state(growing=False, reading=False, problem=self.problem)
