"""Line log of a modem's port: all traffic with its time, as text; and the log's replay.

One entry per line, `<time> <kind> <text>`, time in s since 1970 with microseconds:

    <  bytes from the modem, as received (one line, or a part of one; \\r \\n \\xHH escaped)
    >  bytes to the modem
    =  calls of the driver: "address N", "opened", "closed REASON", "send DESTINATION HEX", "poll"

Polls without effect are omitted. The driver reads no clock and no port, so a replay gives the same sentences and
events: a problem from the field can be debugged at the desk, and a log can serve as a test.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.driver import CALL, FROM_MODEM, TO_MODEM, Micromodem
from auv_lse_comms.micromodem.events import Event

_ESCAPED = re.compile(rb"[^\x20-\x5b\x5d-\x7e]")
_ENTRY = re.compile(r"(\d{1,12}\.\d{6}) ([<>=]) (.*)\Z")


class LogError(ValueError):
    """A line that is not an entry of a line log; names it and the reason."""


class LogEntry(NamedTuple):
    """One entry: time (s since 1970), kind (`<`, `>` or `=`), and the bytes or the call (as bytes)."""

    utc_s: float
    kind: str
    data: bytes


def escape(data: bytes) -> str:
    """`data` as printable ASCII: CR, LF and backslash as in C, other unprintable bytes as backslash xHH."""
    names = {b"\r": b"\\r", b"\n": b"\\n", b"\\": b"\\\\"}
    text = _ESCAPED.sub(lambda match: names.get(match[0], b"\\x%02x" % match[0][0]), data)
    return text.decode("ascii")


def unescape(text: str) -> bytes:
    """The inverse of `escape`.

    Raises:
        LogError: if `text` is not a result of `escape`.
    """
    result = bytearray()
    position = 0
    for match in re.finditer(r"\\(r|n|\\|x[0-9a-f]{2}|.?)", text):
        result += text[position : match.start()].encode("ascii", "strict")
        code = match[1]
        if code in ("r", "n", "\\"):
            result += {"r": b"\r", "n": b"\n", "\\": b"\\"}[code]
        elif len(code) == 3:
            result.append(int(code[1:], 16))
        else:
            raise LogError(f"line log: {match[0]!r} is not an escape; use \\r, \\n, \\\\ or \\xHH")
        position = match.end()
    return bytes(result + text[position:].encode("ascii"))


def format_entry(entry: LogEntry) -> str:
    """The line of an entry, without its end."""
    return f"{entry.utc_s:.6f} {entry.kind} {escape(entry.data)}"


def read_entries(lines: Iterable[str], where: str = "line log") -> Iterator[LogEntry]:
    """The entries of a log's lines; a last line without a line end (the machine stopped) is ignored.

    Raises:
        LogError: naming `where`, the line's number and its text, if a line is not an entry.
    """
    for number, line in enumerate(lines, start=1):
        if not line.endswith("\n"):
            return
        match = _ENTRY.match(line[:-1])
        if match is None:
            raise LogError(f"{where}:{number}: {line[:60]!r} is not '<seconds>.<microseconds> <kind> <text>'")
        yield LogEntry(float(match[1]), match[2], unescape(match[3]))


@dataclass(frozen=True, slots=True, kw_only=True)
class LogReplay:
    """The result of replaying a log.

    Attributes:
        modem: The driver in its final state.
        events: (time, event) in order.
        written: Bytes that the driver wrote in the replay.
        logged: Bytes written according to the log: the same if the log is complete and neither the driver nor its
            settings have changed.
    """

    modem: Micromodem
    events: list[tuple[float, Event]]
    written: bytes
    logged: bytes


def replay_log(entries: Iterable[LogEntry], config: ModemConfig, address: int | None = None) -> LogReplay:
    """Replays a log's entries with a new driver with `config`; `address` defaults to the log's.

    Raises:
        LogError: if a call is unknown, or the log names no address and none is given.
    """
    modem = Micromodem(config, address) if address is not None else None
    events: list[tuple[float, Event]] = []
    written = bytearray()
    logged = bytearray()
    for entry in entries:
        if entry.kind == TO_MODEM:
            logged += entry.data
            continue
        words = entry.data.decode("latin-1").split(" ", 1) if entry.kind == CALL else []
        if words[:1] == ["address"]:
            modem = modem or Micromodem(config, int(words[1]))
            continue
        if modem is None:
            raise LogError("line log: no '= address N' before the first entry; add it, or give an address")
        _replay_entry(modem, entry, words)
        written += modem.outgoing()
        events += [(entry.utc_s, event) for event in modem.events()]
    if modem is None:
        raise LogError("line log: no entries to replay")
    return LogReplay(modem=modem, events=events, written=bytes(written), logged=bytes(logged))


def _replay_entry(modem: Micromodem, entry: LogEntry, words: list[str]) -> None:
    match words:
        case [] if entry.kind == FROM_MODEM:
            modem.receive(entry.utc_s, entry.data)
        case ["opened"]:
            modem.opened(entry.utc_s)
        case ["closed", *reason]:
            modem.closed(entry.utc_s, "".join(reason))
        case ["send", arguments]:
            destination, payload = arguments.split(" ")
            modem.send(entry.utc_s, bytes.fromhex(payload), None if destination == "-" else int(destination))
        case ["ping", destination]:
            modem.ping(entry.utc_s, int(destination))
        case ["poll"]:
            modem.poll(entry.utc_s)
        case _:
            raise LogError(f"line log: '= {entry.data.decode('latin-1')[:40]}' is not a call of the driver")
