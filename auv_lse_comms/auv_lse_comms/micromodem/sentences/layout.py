"""Dataclasses laid out as sentences: each field states how its text is read and written, in the sentence's order."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple, Self

from auv_lse_comms.micromodem.sentences.fields import number_or, take_flag, take_hex, take_int, take_text, whole_or
from auv_lse_comms.micromodem.sentences.wire import Sentence


class _Column(NamedTuple):
    """A field in a sentence: its name in errors, how it is read and written, its index (None: the next one)."""

    name: str
    read: Callable[[Sequence[str], int, str], Any]
    write: Callable[[Any], str]
    at: int | None


def column(
    name: str,
    read: Callable[[Sequence[str], int, str], Any],
    write: Callable[[Any], str] = str,
    at: int | None = None,
    default: Any = MISSING,
) -> Any:
    """A field of a `Message`: `read` takes all fields, the index and the name; `write` the value."""
    return dataclasses.field(default=default, metadata={"column": _Column(name, read, write, at)})


def text(name: str) -> Any:
    """A field kept as text."""
    return column(name, take_text)


def rest() -> Any:
    """All remaining fields as one text, commas included."""
    return column("rest", lambda fields, index, _: ",".join(fields[index:]))


def whole(name: str, low: int | None = None, high: int | None = None, digits: int = 0, default: Any = MISSING) -> Any:
    """An integer from `low` to `high`, written with at least `digits` digits."""
    return column(name, partial(take_int, low=low, high=high), lambda value: f"{value:0{digits or ''}d}", None, default)


def address(name: str) -> Any:
    """A modem's address, 0 to 127."""
    return whole(name, 0, 127)


def flag(name: str) -> Any:
    """True as 1, False as 0."""
    return column(name, take_flag, lambda value: f"{value:d}")


def hexadecimal(name: str) -> Any:
    """Bytes as hexadecimal digits."""
    return column(name, take_hex, lambda value: value.hex().upper())


def rounded(name: str, at: int, missing: int = 0, default: Any = MISSING) -> Any:
    """An integer at index `at` that firmware may write as a decimal number, or leave empty (`missing`)."""
    return column(name, partial(whole_or, other=missing), at=at, default=default)


def tenths(name: str, at: int) -> Any:
    """A decimal number at index `at`, written with one decimal; NaN if the field is empty, and written as 0."""
    return column(name, number_or, lambda value: f"{0.0 if math.isnan(value) else value:.1f}", at, math.nan)


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """Base of the messages: dataclasses whose fields are columns of a sentence."""

    #: Type of the sentence; `CA...` comes from the modem, `CC...` from the host.
    TYPE: ClassVar[str]

    @classmethod
    def columns(cls) -> dict[str, tuple[int, _Column]]:
        """Index and column of each field, by the field's name."""
        found = [(f.name, f.metadata["column"]) for f in dataclasses.fields(cls) if "column" in f.metadata]
        return {name: (position if c.at is None else c.at, c) for position, (name, c) in enumerate(found)}

    @classmethod
    def read_columns(cls, fields: Sequence[str]) -> dict[str, Any]:
        """The columns' values, by the field's name.

        Raises:
            SentenceError: naming the field, its text and what was expected.
        """
        return {name: c.read(fields, index, c.name) for name, (index, c) in cls.columns().items()}

    @classmethod
    def read(cls, fields: Sequence[str]) -> Self:
        """From a sentence's fields; raises SentenceError if they do not fit."""
        return cls(**cls.read_columns(fields))

    def texts(self) -> list[str]:
        """The fields of the sentence; "0" where no column stands."""
        columns = self.columns()
        texts = ["0"] * (1 + max(index for index, _ in columns.values()))
        for name, (index, c) in columns.items():
            texts[index] = c.write(getattr(self, name))
        return texts

    def sentence(self) -> Sentence:
        """The sentence with this content."""
        return Sentence(self.TYPE, tuple(self.texts()))

    def command(self) -> Sentence:
        """The same fields as a command of the host: `$CC...`."""
        return Sentence("CC" + self.TYPE[2:], tuple(self.texts()))
