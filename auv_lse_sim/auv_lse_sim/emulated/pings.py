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
        destination: Whom it is for.
        answer: Whether it answers a ping.
        turn_s: How long after the ping arrived its answer began (s). Real modems answer after a time that both know;
            an emulated one answers when a tick lets it, and says so.
    """

    source: int
    destination: int
    answer: bool = False
    turn_s: float = 0.0

    def to_bytes(self) -> bytes:
        """Its bytes in the water."""
        return _LAYOUT.pack(_MARK, self.source, self.destination, self.answer, self.turn_s)

    @classmethod
    def read(cls, data: bytes) -> MiniPacket | None:
        """The mini-packet that bytes are; None if they are another packet."""
        if len(data) != _LAYOUT.size or not data.startswith(_MARK):
            return None
        _, source, destination, answer, turn_s = _LAYOUT.unpack(data)
        return cls(source=source, destination=destination, answer=bool(answer), turn_s=turn_s)


class Pings:
    """The pings of one emulated modem: those it sends for its host, and those that it answers by itself."""

    def __init__(
        self,
        address: Callable[[], int],
        write: Callable[[Message], None],
        transmit: Callable[[float, MiniPacket], None],
    ) -> None:
        """Nothing is asked yet.

        Args:
            address: Gives the modem's address.
            write: Takes what the host is told.
            transmit: Takes (start (s), mini-packet) into the water.
        """
        self._address, self._write, self._transmit = address, write, transmit
        self._asked: tuple[int, float] | None = None  # whom, and when (s)

    def ask(self, now_s: float, ping: PingEcho) -> None:
        """Pings another modem for the host."""
        self._write(ping)
        self._asked = (ping.destination, now_s)
        self._transmit(now_s, MiniPacket(source=ping.source, destination=ping.destination))

    def hear(self, now_s: float, mini: MiniPacket, heard_s: float, free: bool) -> bool:
        """Answers a ping at once, or takes the answer to the own one.

        Args:
            now_s: Time (s).
            mini: What was heard.
            heard_s: When its first sound arrived, as the modems measure it (s).
            free: Whether the modem can answer.

        Returns:
            Whether the host was told a travel time.
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
