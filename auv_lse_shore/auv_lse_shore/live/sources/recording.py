"""A recording as messages, whether it is complete or still being written."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.retired import without_retired
from auv_lse_record.growing_file import RecordingFile, Wanted
from auv_lse_record.recording import MISSION_FILE, STORAGES, Recording, RecordingError, parts_of
from auv_lse_record.run_reader import mission_file_of
from auv_lse_shore.areas.area_file import read_area


class WholeRecording:
    """Reads the messages of a complete recording: several files, or sqlite3.

    Attributes:
        path: The path that `recording_in` returned.
        complete: True once it has been read.
    """

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        self.path = path
        self.complete = False

    def messages(self, topics: frozenset[str], wanted: Wanted = None) -> Iterator[tuple[str, Any]]:
        """The messages of some topics: topic and message; none at the second call. `wanted` as in `RecordingFile`.

        Raises:
            RecordingError: if it cannot be read.
        """
        if not self.complete:
            self.complete = True
            with Recording(self.path) as recording:
                for topic, _, message in recording.messages(topics, wanted):
                    yield topic, message


class RecordingParts:
    """Reads the recordings of a dive one after the other; the last one may still be written."""

    def __init__(self, parts: Sequence[Path]) -> None:
        """Opens nothing yet."""
        self._files = [open_recording(part) for part in parts]

    @property
    def complete(self) -> bool:
        """Whether the last recording has been read, up to its end."""
        return self._files[-1].complete

    def messages(self, topics: frozenset[str], wanted: Wanted = None) -> Iterator[tuple[str, Any]]:
        """As `RecordingFile.messages`."""
        for file in self._files:
            yield from file.messages(topics, wanted)


def open_recording(path: Path) -> RecordingFile | WholeRecording | RecordingParts:
    """The reader for a path that `recording_in` returned."""
    if (parts := parts_of(path)) != [path]:
        return RecordingParts(parts)
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.suffix in STORAGES]
    alone = len(files) == 1 and files[0].suffix == ".mcap"
    return RecordingFile(files[0]) if alone else WholeRecording(path)


def flown_parameters(recording: Path) -> tuple[dict[str, dict[str, Any]], str]:
    """The mission file of a recording that may still be written, as this version reads it, and where it is.

    Raises:
        RecordingError: if there is none.
        ParameterError: if it is not a parameter file.
    """
    text, damaged = None, None
    try:
        texts = open_recording(recording).messages(frozenset({MISSION_FILE}))
        text = next((str(message.data) for _, message in texts), None)
    except RecordingError as error:  # it is read with the mission file beside it
        damaged = error
    try:
        patterns, where = mission_file_of(recording, text, read_area)
    except RecordingError as error:
        raise damaged or error from None
    return without_retired(patterns), where
