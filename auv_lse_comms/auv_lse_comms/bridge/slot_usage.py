"""Records the slots that a vehicle has used or missed, and estimates how many packets of others are lost."""

from collections import Counter

from auv_lse_comms.tdma import Slot, SlotKey, Tdma

#: Weight of the last slot in the estimate of the loss: a memory of about ten slots.
_LOSS_GAIN = 0.1


class SlotUsage:
    """Follows the slots from poll to poll; counts "slots.missed.<reason>".

    Attributes:
        loss: Estimated chance that a packet is lost: the share of the others' recent slots without a reception.
        used: Whether the packet of the current slot has been given out.
        reason: Why the current slot, if it is this vehicle's, is missed when it ends without a packet.
        last: The slot of the last packet; None before the first.
    """

    def __init__(self, tdma: Tdma, counts: Counter[str]) -> None:
        self.loss = 0.0
        self.used = False
        self.reason = "late"
        self.last: SlotKey | None = None
        self._tdma, self._counts = tdma, counts
        self._slot: Slot | None = None
        self._heard = False  # whether a packet was accepted since the current slot began

    def enter(self, slot: Slot) -> None:
        """Enters a slot; ends the previous one."""
        if self._slot is not None and slot.key == self._slot.key:
            return
        if self._slot is not None:
            self._end(self._slot, slot)
        self._slot, self.reason = slot, "late"
        self.used = slot.key == self.last  # a clock that was set back must not use a slot twice

    def heard(self) -> None:
        """Records that a packet was accepted."""
        self._heard = True

    def sent(self, slot: SlotKey) -> None:
        """Records that a packet was handed over for sending in `slot`."""
        self.last = slot
        self._counts["slots.used"] += 1

    def _end(self, before: Slot, slot: Slot) -> None:
        """Counts this vehicle's slots between the last poll and this one."""
        own = self._tdma.address
        if before.owner not in (0, own):
            self.loss += _LOSS_GAIN * ((0.0 if self._heard else 1.0) - self.loss)
        self._heard = False
        if before.owner == own and not self.used:
            self._counts[f"slots.missed.{self.reason}"] += 1
        if slot.since_s != before.since_s or slot.index <= before.index + 1:
            return  # settings changed, or the clock was set back
        order = self._tdma.settings(slot.start_s).order
        mine = [i for i, owner in enumerate(order) if owner == own]
        turns, rest = divmod(slot.index - before.index - 1, len(order))
        asleep = turns * len(mine) + sum((i - before.index - 1) % len(order) < rest for i in mine)
        if asleep:
            self._counts["slots.missed.asleep"] += asleep
