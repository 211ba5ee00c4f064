"""Lines of the WHOI Micromodem-2: bytes to sentences and back.

A sentence is `$TYPE,field,...*HH` and CR LF. HH is the XOR of the characters between `$` and `*`, as two upper-case
hexadecimal digits. Types `CC...` go from host to modem, `CA...` from modem to host. `SentenceReader` tolerates and
counts any damage on a serial line. `messages.py` interprets the sentences.
"""

import re
from collections import Counter
from functools import reduce
from operator import xor
from typing import ClassVar, NamedTuple

#: Longest line accepted (characters without CR LF): a 256-byte frame in hexadecimal, with a margin.
MAX_LINE = 1024
#: Sentence types that `TypeCounts` counts by name; further ones are counted together, so garbage cannot fill memory.
MAX_COUNTED_TYPES = 32

_PRINTABLE = re.compile(rb"[\x20-\x7e]*\Z")
_TYPE = re.compile(r"[A-Z][A-Z0-9]{2,7}\Z")
_CHECKSUM = re.compile(r"[0-9A-Fa-f]{2}\Z")


def checksum(body: str) -> str:
    """XOR of the characters of `body` (between `$` and `*`) as two upper-case hexadecimal digits."""
    return f"{reduce(xor, body.encode('ascii'), 0):02X}"


class Sentence(NamedTuple):
    """One sentence: its type ("CADRQ") and its fields as text."""

    type: str
    fields: tuple[str, ...]

    @property
    def body(self) -> str:
        """The text between `$` and `*`."""
        return ",".join((self.type, *self.fields))

    def encode(self) -> bytes:
        """The line as it goes over the wire, CR LF included."""
        return f"${self.body}*{checksum(self.body)}\r\n".encode("ascii")


class SentenceReader:
    """Splits bytes into sentences; keeps incomplete lines; counts damaged ones.

    Keys of `counts`: "sentences" (good ones), "bad_checksum", "no_checksum", "bad_character" (not printable ASCII),
    "broken_off" (a `$` inside a sentence: the line before it never ended), "overlong", "not_a_sentence" (text without
    `$`, such as a boot banner), "bad_type".
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._line = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[Sentence]:
        """The sentences that `data` completes, in order; all other content is counted."""
        found: list[Sentence] = []
        start = 0
        while start < len(data):
            ends = [i for i in (data.find(b"\n", start), data.find(b"\r", start), data.find(b"$", start)) if i >= 0]
            end = min(ends, default=len(data))
            self._take(data[start:end])
            if end == len(data):
                break
            if data[end : end + 1] == b"$":
                if self._line or self._skipping:
                    self._drop("broken_off" if self._line[:1] == b"$" else "not_a_sentence")
                self._line += b"$"
            else:
                sentence = self._finish()
                if sentence is not None:
                    found.append(sentence)
            start = end + 1
        return found

    def reset(self) -> None:
        """Discards an incomplete line: the port has been reopened."""
        if self._line:
            self._drop("broken_off")
        self._skipping = False

    def _take(self, part: bytes) -> None:
        if self._skipping or not part:
            return
        if len(self._line) + len(part) > MAX_LINE:
            self._line.clear()
            self._skipping = True
            self.counts["overlong"] += 1
            return
        self._line += part

    def _drop(self, reason: str) -> None:
        if not self._skipping:
            self.counts[reason] += 1
        self._line.clear()
        self._skipping = False

    def _finish(self) -> Sentence | None:
        line = bytes(self._line)
        self._line.clear()
        if self._skipping:
            self._skipping = False
            return None
        if not line:
            return None
        problem = self._check(line)
        if isinstance(problem, Sentence):
            self.counts["sentences"] += 1
            return problem
        self.counts[problem] += 1
        return None

    @staticmethod
    def _check(line: bytes) -> Sentence | str:
        if not line.startswith(b"$"):
            return "not_a_sentence"
        if not _PRINTABLE.match(line):
            return "bad_character"
        text = line[1:].decode("ascii")
        body, star, digits = text.rpartition("*")
        if not star:
            return "no_checksum"
        if not _CHECKSUM.match(digits) or digits.upper() != checksum(body):
            return "bad_checksum"
        kind, *fields = (field.strip() for field in body.split(","))
        if not _TYPE.match(kind):
            return "bad_type"
        return Sentence(kind, tuple(fields))


class TypeCounts:
    """Counts sentence types by name, up to `MAX_COUNTED_TYPES` of them; the rest as "others"."""

    OTHERS: ClassVar[str] = "others"

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def add(self, kind: str) -> None:
        """Counts one sentence of type `kind`."""
        if kind not in self.counts and len(self.counts) >= MAX_COUNTED_TYPES:
            kind = self.OTHERS
        self.counts[kind] += 1
