"""Packets as they enter the simulated water and as they come out of it."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """A packet that enters the water.

    Attributes:
        start_s: When its transmission starts (s, the simulation's clock).
        source: The sender's modem address.
        destination: The receiver's modem address, 0: all.
        rate: Packet rate number.
        payload: The frames' bytes, one after another.
    """

    start_s: float
    source: int
    destination: int
    rate: int
    frames: int
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardPacket:
    """A packet that arrives at a modem.

    Attributes:
        start_s: When its first sound arrives (s, the simulation's clock).
        source: The sender's modem address.
        destination: The receiver's modem address, 0: all.
        payload: Its bytes; None if it could not be decoded.
        snr_db: Signal to noise ratio (dB), not finite if unknown.
        rate: Packet rate number.
        measured_s: Arrival of its first sound (s) by this modem's clock, as the sender's clock counts; NaN: `start_s`.
    """

    start_s: float
    source: int
    destination: int
    payload: bytes | None
    snr_db: float = math.nan
    rate: int = 4
    frames: int = 1
    measured_s: float = math.nan

    @property
    def timed_s(self) -> float:
        """`measured_s`, or `start_s` where that is not known."""
        return self.measured_s if math.isfinite(self.measured_s) else self.start_s
