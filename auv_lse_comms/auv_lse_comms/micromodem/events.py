"""The events that the driver of a Micromodem reports to its owner."""

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
    """The modem's clock was read. `offset_s`: modem minus host, 0 within the reading's resolution."""

    offset_s: float
    within_tolerance: bool
    source: str
    pps: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStarted:
    """A packet's transmission has begun: the transducer is on."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitDone:
    """A packet's transmission is over."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitFailed:
    """A packet was not sent, or (after `TransmitStarted`) its end was never reported."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReceived:
    """A packet was received completely.

    Attributes:
        utc_s: End of its reception, s since 1970: by the modem's clock, to 0.1 ms, where that is right; else by the
            host's clock when it was reported.
        payload: Its bytes; zeros after byte 252, which some firmware appends, are cut off.
        snr_db: At the equalizer's input, dB; NaN if its statistics were lost.
        travel_s: One-way travel time, s, without its whole seconds (1.5 km of water each): 0 to 1. NaN unless
            transmissions start on the second (`modem.synchronous`) and a PPS disciplines the modem's clock.
        sent_s: Start of its transmission, s since 1970: the last full second before it arrived; NaN likewise.
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
    """A ping's transmission has begun."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PingAnswered:
    """Another modem has answered a ping.

    Attributes:
        number: The ping's number.
        source: The other modem's address.
        travel_s: One-way travel time, s, measured with this modem's clock alone.
        utc_s: Time at which the range applies: half-way between the start of the ping and the start of its answer, by
            the host's clock, s since 1970.
    """

    number: int
    source: int
    travel_s: float
    utc_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PingFailed:
    """A ping did not begin or was not answered."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionFailed:
    """A reception gave no packet."""

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
