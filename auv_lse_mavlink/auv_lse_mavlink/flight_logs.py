"""Reads the messages of ArduPilot's logs with pymavlink: dataflash (.bin, or text) and telemetry (.tlog)."""

import contextlib
import io
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO, Any

from auv_lse_common.support.missing_packages import missing
from auv_lse_common.support.user_error import brief

#: A message; its type is `get_type()`, its fields are attributes.
Message = Any
#: Takes the share of a log that has been read, 0 to 1.
Progress = Callable[[float], None]

#: First bytes of MAVLink 1 and 2 messages, which follow 8 bytes of time in a telemetry log.
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
#: First bytes of a dataflash log that is not text.
_DATAFLASH = b"\xa3\x95"
#: A telemetry log's times (s since 1970) are between these: 2000 and 2100.
_TIMES_S = (946_684_800.0, 4_102_444_800.0)
#: Least messages in the first bytes of a log that begins within one, or with the lines of a booting autopilot.
_FEWEST, _BEGIN = 3, 2048
_DAMAGED = "positions where the log is damaged"
#: Messages between two reports of progress.
_MESSAGES = 5000


class FlightLogError(ValueError):
    """A file that is no log of ArduPilot, or too damaged to be read."""


def is_telemetry(data: bytes) -> bool:
    """Whether the beginning of a file looks like a telemetry log, or a piece of one that begins within a message.

    Lines of text that an autopilot prints while it boots may lie between the messages.
    """
    if len(data) > 8 and data[8] in (_MAVLINK_1, _MAVLINK_2) and _is_time(data):
        return True
    damage: Counter[str] = Counter()
    found = sum(1 for _ in _frames(data[:_BEGIN], damage))
    return found >= max(_FEWEST, damage[_DAMAGED])


def dataflash_messages(
    path: Path, kinds: Collection[str], damage: Counter[str], progress: Progress
) -> Iterator[tuple[float, Message]]:
    """Time (s since 1970, or since the start without GPS time) and message of a dataflash log, as far as it goes.

    Args:
        kinds: Names of the messages to read.
        damage: Takes the number of damaged bytes and messages.
        progress: Takes the share that has been read.

    Raises:
        FlightLogError: if it is damaged.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    try:
        from pymavlink.DFReader import DFReader_binary, DFReader_text
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    with _captured_output() as complaints:
        try:
            with path.open("rb") as file:
                make: Any = DFReader_binary if file.read(len(_DATAFLASH)) == _DATAFLASH else DFReader_text
            reader = make(str(path), progress_callback=lambda percent: progress(percent / 200.0))
            number = 0
            # pymavlink's list of messages ends at the first of an unknown type: then each is read
            complaints.seek(0)
            is_listed = b"unknown msg type" not in complaints.read()
            while (message := reader.recv_match(type=list(kinds) if is_listed else None)) is not None:
                if number % _MESSAGES == 0:
                    progress(0.5 + 0.5 * reader.offset / max(reader.data_len, 1))
                number += 1
                if is_listed or message.get_type() in kinds:
                    yield message._timestamp, message
        except (OSError, GeneratorExit):
            raise
        except Exception as error:  # pymavlink raises errors of many kinds for a damaged log
            raise FlightLogError(
                f"{path} is a damaged dataflash log ({brief(error)}). Copy the .bin from the autopilot again"
            ) from error
        complaints.seek(0)
        damage["damaged bytes or messages"] += sum(1 for _ in complaints)


@contextlib.contextmanager
def _captured_output() -> Iterator[IO[bytes]]:
    """Redirects output to a file: pymavlink, partly in C, prints a line for each bad byte or message."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            with (
                io.TextIOWrapper(os.fdopen(os.dup(2), "wb", buffering=0), write_through=True) as text,
                contextlib.redirect_stderr(text),
                contextlib.redirect_stdout(text),
            ):
                yield file
        finally:
            os.dup2(before, 2)
            os.close(before)


def telemetry_messages(
    path: Path, kinds: Collection[str], damage: Counter[str], progress: Progress
) -> Iterator[tuple[float, Message]]:
    """Time (s since 1970) and message of a telemetry log, as far as it goes.

    Args:
        kinds: Names of the messages to read, such as "HEARTBEAT".
        damage: Takes the number of damaged messages and positions.
        progress: Takes the share that has been read.

    Raises:
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega as dialect
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    decoder: Any = dialect.MAVLink(None)
    wanted = {getattr(dialect, f"MAVLINK_MSG_ID_{kind}") for kind in kinds}
    for number, (stamp_s, frame, share) in enumerate(_frames(path.read_bytes(), damage)):
        if number % _MESSAGES == 0:
            progress(share)
        if (int.from_bytes(frame[7:10], "little") if frame[0] == _MAVLINK_2 else frame[5]) not in wanted:
            continue
        try:
            message = decoder.decode(bytearray(frame))
        except dialect.MAVError:
            damage["messages with a wrong checksum"] += 1
        else:
            yield stamp_s, message


def _is_time(data: bytes) -> bool:
    return _TIMES_S[0] < int.from_bytes(data[:8], "big") * 1e-6 < _TIMES_S[1]


def _frames(data: bytes, damage: Counter[str]) -> Iterator[tuple[float, bytes, float]]:
    """Time (s), bytes of each message, and the share of the log that has been read."""
    at, in_step = 0, True
    while at + 16 <= len(data):
        first, length = data[at + 8], data[at + 9]
        size = 0
        if first == _MAVLINK_2:
            size = 12 + length + (13 if data[at + 10] & 1 else 0)
        elif first == _MAVLINK_1:
            size = 8 + length
        if not size or not _is_time(data[at : at + 8]):
            damage[_DAMAGED] += in_step
            at, in_step = at + 1, False
            continue
        in_step = True
        if at + 8 + size > len(data):
            break
        yield int.from_bytes(data[at : at + 8], "big") * 1e-6, data[at + 8 : at + 8 + size], at / len(data)
        at += 8 + size
    damage["messages that are cut off"] += in_step and at != len(data)
