"""Tells the autopilot's datagrams from those of other senders on the same port, at a bounded cost."""

from collections import Counter

from auv_lse_mavlink.messages.wire import MavlinkCodec

#: Largest number of bytes of other senders that are parsed to find the autopilot, until `renew`.
EXAMINED_BYTES = 16384


class SenderFilter:
    """Recognizes one autopilot's datagrams."""

    def __init__(self, codec: MavlinkCodec, autopilot: tuple[int, int], counts: Counter[str]) -> None:
        """Uses `codec` to read; counts "other_senders" and "other_senders_unread" in `counts`."""
        self._codec, self._autopilot, self._counts = codec, autopilot, counts
        self._examined_bytes = 0

    def renew(self) -> None:
        """Allows another `EXAMINED_BYTES`."""
        self._examined_bytes = 0

    def recognizes(self, datagram: bytes) -> bool:
        """Whether a datagram contains a message of the autopilot; counts it if not.

        Without the autopilot's ids, or beyond `EXAMINED_BYTES`, it is rejected before it is parsed.
        """
        found = bytes(self._autopilot) in datagram and self._examine(datagram)
        self._counts["other_senders"] += not found
        return found

    def _examine(self, datagram: bytes) -> bool:
        self._examined_bytes += len(datagram)
        if self._examined_bytes > EXAMINED_BYTES:
            self._counts["other_senders_unread"] += 1
            return False
        return self._autopilot in self._codec.senders(datagram)
