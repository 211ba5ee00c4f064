"""The sentences of a two-way ping: one modem asks another by a mini-packet, which that one answers by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from auv_lse_comms.micromodem.sentences.fields import number_or, take_int
from auv_lse_comms.micromodem.sentences.wire import Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class PingEcho:
    """`$CAMPC,src,dest`: the modem has taken our `$CCMPC`, and pings."""

    source: int
    destination: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> PingEcho:
        """From the fields of `$CAMPC` or `$CCMPC`."""
        return cls(source=take_int(fields, 0, "src", 0, 127), destination=take_int(fields, 1, "dest", 0, 127))

    def sentence(self) -> Sentence:
        """`$CAMPC`."""
        return Sentence("CAMPC", (str(self.source), str(self.destination)))

    def initiate(self) -> Sentence:
        """`$CCMPC`."""
        return Sentence("CCMPC", (str(self.source), str(self.destination)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PingHeard:
    """`$CAMPA,src,dest`: a ping of modem `src` was heard, and is answered."""

    source: int
    destination: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> PingHeard:
        """From the fields of `$CAMPA`."""
        return cls(source=take_int(fields, 0, "src", 0, 127), destination=take_int(fields, 1, "dest", 0, 127))

    def sentence(self) -> Sentence:
        """`$CAMPA`."""
        return Sentence("CAMPA", (str(self.source), str(self.destination)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PingReply:
    """`$CAMPR,src,dest,travel`: modem `src` has answered the ping of `dest`.

    Attributes:
        source: Who answered.
        destination: Who had asked.
        travel_s: One-way travel time (s): half of what is left when the modem has taken off its turn-around; NaN if
            the modem does not tell it.
    """

    source: int
    destination: int
    travel_s: float = math.nan

    @classmethod
    def read(cls, fields: Sequence[str]) -> PingReply:
        """From the fields of `$CAMPR`."""
        return cls(
            source=take_int(fields, 0, "src", 0, 127),
            destination=take_int(fields, 1, "dest", 0, 127),
            travel_s=number_or(fields, 2, "travel time"),
        )

    def sentence(self) -> Sentence:
        """`$CAMPR`, to 0.1 ms."""
        travel = () if math.isnan(self.travel_s) else (f"{self.travel_s:.4f}",)
        return Sentence("CAMPR", (str(self.source), str(self.destination), *travel))
