"""Tells the autopilot's datagrams from those of other senders on the same port, at a bounded cost.

Two autopilots may have the same ids, such as ArduPilot's default: only the one that is heard counts.
"""

import math
from collections import Counter
from collections.abc import Callable

from auv_lse_mavlink.messages.wire import MavlinkCodec

#: Largest number of bytes of other senders that are parsed to find the autopilot, until `renew`; while it is silent, as
#: many again to name the others.
EXAMINED_BYTES = 16384
#: Another sender with the autopilot's ids is the autopilot after this time (s) of silence: ArduSub's failsafe acts
#: 2.5 s after the stack's last heartbeat. One that sends beside the autopilot for `TWIN_S` (s), without a gap of
#: `SILENT_S`, is a second autopilot: it is reported, and takes over only when the link is lost.
SILENT_S, TWIN_S = 1.5, 5.0
#: The cure for a second autopilot.
_CURE = (
    "Give each autopilot its own system ID (SYSID_THISMAV, MAV_SYSID since 4.8) or port, and send its messages here by "
    "one route only."
)


class SenderFilter:
    """Recognizes one autopilot's datagrams."""

    def __init__(
        self,
        codec: MavlinkCodec,
        autopilot: tuple[int, int],
        lost_after_s: float,
        counts: Counter[str],
        report: Callable[[str], None],
    ) -> None:
        """Uses `codec` to read; counts "other_senders", "other_senders_unread" and "twins" in `counts`."""
        self._lost_after_s = max(lost_after_s, SILENT_S)
        self._codec, self._autopilot, self._counts, self._report = codec, autopilot, counts, report
        self._examined_bytes: Counter[bool] = Counter()  # with the autopilot's ids, and without
        self._others: set[tuple[int, int]] = set()  # since the autopilot was last heard
        self._now_s = self._heard_s = -math.inf
        self._first_twin_s = self._twin_s = -math.inf  # first and last time of a second sender, without a gap
        self._is_reported = False

    def renew(self, now_s: float) -> None:
        """Advances to `now_s` (s), and allows another `EXAMINED_BYTES`."""
        self._now_s = now_s
        self._examined_bytes.clear()

    def heard(self, sender: tuple[int, int]) -> None:
        """A message of a system and component has arrived."""
        if sender != self._autopilot:
            self._others.add(sender)
            return
        self._heard_s = self._now_s
        self._others.clear()
        self._codec.unsigned.clear()

    def reopened(self) -> None:
        """The port was opened again: the autopilot's next datagram will be a new sender's."""
        self._heard_s = self._first_twin_s = self._twin_s = -math.inf
        self._is_reported = False

    @property
    def is_sending(self) -> bool:
        """Whether messages of the autopilot have arrived lately."""
        return self._now_s - self._heard_s < self._lost_after_s

    @property
    def others(self) -> set[tuple[int, int]]:
        """Other systems and components heard since the autopilot was, signed or not."""
        return (self._others | self._codec.unsigned) - {self._autopilot}

    @property
    def is_unsigned(self) -> bool:
        """Whether the autopilot is not heard because its messages have no signature, or another key's."""
        return self._autopilot in self._codec.unsigned

    @property
    def is_unproven(self) -> bool:
        """Whether the autopilot is not heard because it has not answered the nonce."""
        return self._codec.is_unproven(self._autopilot)

    def recognizes(self, datagram: bytes) -> bool:
        """Whether a datagram of a new sender contains a message of the autopilot; counts it if not.

        Beyond `EXAMINED_BYTES`, or without the autopilot's ids while that is heard, it is rejected before it is parsed.
        """
        found = self._examine(datagram) and self._takes_over()
        self._counts["other_senders"] += not found
        return found

    def _takes_over(self) -> bool:
        """Whether a new sender with the autopilot's ids is the autopilot from now on; counts and reports it."""
        silent_s, has_gap = self._now_s - self._heard_s, self._now_s - self._twin_s > SILENT_S
        is_twin = not has_gap and self._twin_s - self._first_twin_s >= TWIN_S
        name = f"system ID {self._autopilot[0]}"
        if not silent_s < (self._lost_after_s if is_twin else SILENT_S):  # NaN before the first `renew`
            if is_twin:
                self._heard_s = self._now_s
                self._report(
                    f"the autopilot was silent for {silent_s:.1f} s; another sender with its {name} takes its place. "
                    f"{_CURE}"
                )
            return True
        self._first_twin_s, self._twin_s = self._now_s if has_gap else self._first_twin_s, self._now_s
        self._counts["twins"] += 1
        if self._twin_s - self._first_twin_s >= TWIN_S and not self._is_reported:
            self._is_reported = True
            self._report(f"another sender has the autopilot's {name}, and is ignored. {_CURE}")
        return False

    def _examine(self, datagram: bytes) -> bool:
        """Whether a datagram contains a message of the autopilot; notes the senders of others while that is silent."""
        has_ids = bytes(self._autopilot) in datagram
        if not has_ids and self._now_s - self._heard_s < SILENT_S:
            return False
        self._examined_bytes[has_ids] += len(datagram)
        if self._examined_bytes[has_ids] > EXAMINED_BYTES:
            self._counts["other_senders_unread"] += 1
            return False
        senders = self._codec.senders(datagram)
        self._others |= senders - {self._autopilot}
        return self._autopilot in senders
