"""What the driver of a Micromodem reports to its owner."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemReady:
    """The modem is configured and its clock checked: packets can be sent. `version` is its firmware's."""

    version: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemLost:
    """The connection is closed, or the modem has rebooted: nothing can be sent until `ModemReady`."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockChecked:
    """The modem's clock was read. `offset_s`: modem less host, 0 within the reading's resolution."""

    offset_s: float
    within_tolerance: bool
    source: str
    pps: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStarted:
    """A packet is going out: the transducer is on."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitDone:
    """A packet has gone out."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitFailed:
    """A packet was not sent, or (after `TransmitStarted`) its end was never reported."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReceived:
    """A packet was received whole.

    Attributes:
        utc_s: End of its reception, s since 1970: by the modem's clock to 0.1 ms where that is right, else the
            host's when it was reported.
        payload: Its bytes; zeros after byte 252 are cut off, as some firmware fills frames up with them.
        snr_db: At the equalizer's input, dB; NaN if its statistics were lost.
        travel_s: One-way travel time, s; NaN unless transmissions start on the second (`modem.synchronous`) and the
            modem's clock is held by a PPS. Only what is beyond whole seconds (1.5 km of water each): from 0 to 1.
        sent_s: Start of its transmission, s since 1970, NaN likewise; the last second before it arrived.
        arrival_s: Start of its reception by the modem's clock, s since 1970; NaN likewise.
    """

    utc_s: float
    source: int
    destination: int
    payload: bytes
    snr_db: float
    travel_s: float
    rate: int
    sent_s: float = math.nan
    arrival_s: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class PingStarted:
    """A ping is going out."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PingAnswered:
    """Another modem has answered a ping.

    Attributes:
        number: The ping's.
        source: The other modem's address.
        travel_s: One-way travel time, s, by the own clock alone.
        utc_s: The time for which it holds: half-way between the start of the ping and of its answer's arrival, by the
            host's clock, s since 1970.
    """

    number: int
    source: int
    travel_s: float
    utc_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PingFailed:
    """A ping that did not begin or was not answered."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionFailed:
    """A reception that gave no packet."""

    reason: str
    snr_db: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Something an operator should read: a setting refused, an error sentence, a clock that cannot be set."""

    text: str


Event = (
    ModemReady
    | ModemLost
    | ClockChecked
    | TransmitStarted
    | TransmitDone
    | TransmitFailed
    | PacketReceived
    | PingStarted
    | PingAnswered
    | PingFailed
    | ReceptionFailed
    | Problem
)
