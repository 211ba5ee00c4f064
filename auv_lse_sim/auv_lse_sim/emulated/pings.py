"""Pings between emulated modems, and the mini-packets that carry them through the simulated water."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from auv_lse_comms.micromodem.sentences.layout import Message
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho, PingHeard, PingReply

_LAYOUT = struct.Struct("<4sBBBd")
_MARK = b"ping"


@dataclass(frozen=True, slots=True, kw_only=True)
class MiniPacket:
    """A ping, or the answer to one.

    Attributes:
        source: The sender's modem address.
        destination: The receiver's modem address.
        answer: Whether it answers a ping.
        turn_s: Time (s) from the ping's arrival to its answer. Real modems answer after a fixed delay; an emulated one
            answers in the next tick and reports the delay here.
    """

    source: int
    destination: int
    answer: bool = False
    turn_s: float = 0.0

    def to_bytes(self) -> bytes:
        """The bytes that travel through the water."""
        return _LAYOUT.pack(_MARK, self.source, self.destination, self.answer, self.turn_s)

    @classmethod
    def read(cls, data: bytes) -> MiniPacket | None:
        """Decodes a mini-packet; None for any other packet."""
        if len(data) != _LAYOUT.size or not data.startswith(_MARK):
            return None
        _, source, destination, answer, turn_s = _LAYOUT.unpack(data)
        return cls(source=source, destination=destination, answer=bool(answer), turn_s=turn_s)


class Pings:
    """The pings of one emulated modem: those that its host requests, and those that it answers itself."""

    def __init__(
        self,
        address: Callable[[], int],
        write: Callable[[Message], None],
        transmit: Callable[[float, MiniPacket], None],
    ) -> None:
        """Starts without a pending ping.

        Args:
            write: Sends a message to the host.
            transmit: Sends (start (s), mini-packet) into the water.
        """
        self._address, self._write, self._transmit = address, write, transmit
        self._asked: tuple[int, float] | None = None  # destination and time (s) of the pending ping

    def ask(self, now_s: float, ping: PingEcho) -> None:
        """Pings another modem for the host."""
        self._write(ping)
        self._asked = (ping.destination, now_s)
        self._transmit(now_s, MiniPacket(source=ping.source, destination=ping.destination))

    def receive(self, now_s: float, mini: MiniPacket, heard_s: float, free: bool) -> bool:
        """Receives a mini-packet: answers a ping at once, or reports the travel time of this modem's own ping.

        Args:
            heard_s: Measured arrival time of its first sound (s).
            free: Whether the modem can answer.

        Returns:
            Whether it reported a travel time to the host.
        """
        own = self._address()
        if mini.destination != own:
            return False
        if not mini.answer:
            self._write(PingHeard(source=mini.source, destination=own))
            if free:
                turn_s = now_s - heard_s
                self._transmit(now_s, MiniPacket(source=own, destination=mini.source, answer=True, turn_s=turn_s))
            return False
        if self._asked is None or mini.source != self._asked[0]:
            return False
        (_, asked_s), self._asked = self._asked, None
        self._write(PingReply(source=mini.source, destination=own, travel_s=0.5 * (heard_s - asked_s - mini.turn_s)))
        return True
