"""The sentences of a two-way ping: one modem sends a mini-packet, and the other answers it without its host."""

import math
from dataclasses import dataclass
from typing import ClassVar

from auv_lse_comms.micromodem.sentences.fields import number_or
from auv_lse_comms.micromodem.sentences.layout import Message, address, column
from auv_lse_comms.micromodem.sentences.wire import Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class PingEcho(Message):
    """`$CAMPC,src,dest`: the modem has accepted our `$CCMPC` and pings."""

    TYPE: ClassVar[str] = "CAMPC"
    source: int = address("src")
    destination: int = address("dest")


@dataclass(frozen=True, slots=True, kw_only=True)
class PingHeard(Message):
    """`$CAMPA,src,dest`: a ping from modem `src` was received and is being answered."""

    TYPE: ClassVar[str] = "CAMPA"
    source: int = address("src")
    destination: int = address("dest")


@dataclass(frozen=True, slots=True, kw_only=True)
class PingReply(Message):
    """`$CAMPR,src,dest,travel`: modem `src` has answered the ping from `dest`.

    Attributes:
        source: Modem that answered.
        destination: Modem that pinged.
        travel_s: One-way travel time (s), to 0.1 ms: half of the round trip without the turn-around time; NaN if the
            modem does not report it.
    """

    TYPE: ClassVar[str] = "CAMPR"
    source: int = address("src")
    destination: int = address("dest")
    travel_s: float = column("travel time", number_or, lambda value: f"{value:.4f}", default=math.nan)

    def sentence(self) -> Sentence:
        """`$CAMPR`, without the travel time if it is NaN."""
        return Sentence(self.TYPE, tuple(self.texts()[: 2 if math.isnan(self.travel_s) else 3]))
