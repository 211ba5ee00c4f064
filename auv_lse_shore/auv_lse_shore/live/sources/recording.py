"""A recording as messages, whether it is complete or still being written."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import parse_parameters, read_parameter_file
from auv_lse_common.mission_file.retired import without_retired
from auv_lse_record.growing_file import RecordingFile, Wanted
from auv_lse_record.recording import MISSION_FILE, STORAGES, Recording, RecordingError, parts_of
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


def find_parameters(recording: Path) -> tuple[dict[str, dict[str, Any]], str]:
    """The flown mission file and its source: inside the recording, else beside it or above it.

    Parameters and values of earlier versions are left out or replaced (`retired.py`).

    Raises:
        RecordingError: if there is none.
        ParameterError: if it is not a parameter file.
    """
    damaged: RecordingError | None = None
    try:
        for _, message in open_recording(recording).messages(frozenset({MISSION_FILE})):
            where = f"{recording} ({MISSION_FILE})"
            return without_retired(parse_parameters(str(message.data), where, is_recorded=True)), where
    except RecordingError as error:  # it is read with the mission file beside it
        damaged = error
    for folder in (recording, recording.parent, recording.parent.parent):
        if (path := folder / "mission.yaml").is_file():
            return without_retired(read_parameter_file(path, read_area, is_recorded=True)), str(path)
    if damaged is not None:
        raise damaged
    raise RecordingError(
        f"{recording}: there is no mission.yaml in it, beside it or above it. Name the mission file with --mission FILE"
    )
