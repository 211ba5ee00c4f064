"""The mini-packets of pings, as the simulated water carries them between emulated modems."""

from __future__ import annotations

import struct
from dataclasses import dataclass

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
