"""Tells the autopilot's datagrams from those of other senders on the same port, at a bounded cost.

Two autopilots may have the same ids, such as ArduPilot's default: only the one that is heard counts.
"""

import math
from collections import Counter
from collections.abc import Callable

from auv_lse_mavlink.messages.wire import MavlinkCodec

#: Largest number of bytes of other senders that are parsed to find the autopilot, until `renew`.
EXAMINED_BYTES = 16384
#: Another sender with the autopilot's ids is the autopilot after this time (s) of silence: ArduSub's failsafe acts
#: 2.5 s after the stack's last heartbeat. One that sends for `TWIN_S` (s) beside the autopilot is reported.
SILENT_S, TWIN_S = 1.5, 5.0


class SenderFilter:
    """Recognizes one autopilot's datagrams."""

    def __init__(
        self, codec: MavlinkCodec, autopilot: tuple[int, int], counts: Counter[str], report: Callable[[str], None]
    ) -> None:
        """Uses `codec` to read; counts "other_senders", "other_senders_unread" and "twins" in `counts`."""
        self._codec, self._autopilot, self._counts, self._report = codec, autopilot, counts, report
        self._examined_bytes = 0
        self._now_s = self._heard_s = self._twin_s = -math.inf

    def renew(self, now_s: float) -> None:
        """Advances to `now_s` (s), and allows another `EXAMINED_BYTES`."""
        self._now_s, self._examined_bytes = now_s, 0

    def heard(self) -> None:
        """A message of the autopilot has arrived."""
        self._heard_s = self._now_s

    def recognizes(self, datagram: bytes) -> bool:
        """Whether a datagram of a new sender contains a message of the autopilot; counts it if not.

        Without the autopilot's ids, or beyond `EXAMINED_BYTES`, it is rejected before it is parsed.
        """
        found = bytes(self._autopilot) in datagram and self._examine(datagram)
        if found and self._now_s - self._heard_s < SILENT_S:
            self._note_twin()
            found = False
        self._counts["other_senders"] += not found
        return found

    def _note_twin(self) -> None:
        """Counts another sender with the autopilot's ids, and reports it once."""
        if not self._counts["twins"]:
            self._twin_s = self._now_s
        self._counts["twins"] += 1
        if self._now_s - self._twin_s >= TWIN_S:
            self._twin_s = math.inf
            self._report(
                f"another sender has the autopilot's system id {self._autopilot[0]}, and is ignored. Give each "
                "autopilot its own (SYSID_THISMAV, MAV_SYSID since 4.8) or its own port, and each one way to it"
            )

    def _examine(self, datagram: bytes) -> bool:
        self._examined_bytes += len(datagram)
        if self._examined_bytes > EXAMINED_BYTES:
            self._counts["other_senders_unread"] += 1
            return False
        return self._autopilot in self._codec.senders(datagram)
