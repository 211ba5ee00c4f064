"""Time slots (section 5), computed from the time alone.

Slot number i spans [epoch + i slot, epoch + (i+1) slot) and belongs to order[i mod len(order)]. A transmission may
start at time t of its owner's clock when

    start + guard <= t    and    t + duration + max_range / c + guard <= end

so it reaches the farthest member at least one guard before the slot ends. If every clock is within one guard of the
true time, everything sent in a slot is sent and received within that slot's true bounds. Slots never overlap, and no
vehicle sends while a packet is still arriving.

A change of settings takes effect at the start of a cycle of the old settings. From then on slots count from the new
epoch, so that a vehicle that has only the new settings finds the same slots. A slot that would have begun before the
change belongs to no vehicle.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig

#: Range in which a packet's slot is searched, to tell wrong clocks and old packets from forged ones: cycles before and
#: after its arrival, and hours, by which time zones differ.
_STALE_CYCLES, _STALE_HOURS = 100, 14
#: Identifies a slot: its index and since_s.
SlotKey = tuple[int, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """One slot.

    Attributes:
        index: Number of the slot, counted from the epoch; unique together with `since_s`.
        owner: Number of the vehicle that may send, 0 for none.
        start_s: Its first instant (s).
        end_s: The first instant after it (s).
        since_s: When its settings took effect (s), -inf for the first ones.
    """

    index: int
    owner: int
    start_s: float
    end_s: float
    since_s: float = -math.inf

    @property
    def key(self) -> SlotKey:
        """Index and since_s."""
        return self.index, self.since_s


class Tdma:
    """The slots of a team, for one of its vehicles."""

    def __init__(self, config: TdmaConfig, address: int, vehicles: int) -> None:
        """Starts with these settings for vehicle `address` of 1..`vehicles`; an empty order becomes 1, 2, ...

        Raises:
            ValueError: if the address or an owner in the order is not a vehicle of the mission.
        """
        if not 1 <= address <= vehicles:
            raise ValueError(f"address {address} is not a vehicle of the mission, 1..{vehicles}")
        self.address = address
        self.vehicles = vehicles
        self._settings: list[tuple[float, TdmaConfig]] = [(-math.inf, self._complete(config))]

    def _complete(self, config: TdmaConfig) -> TdmaConfig:
        if not config.order:
            return dataclasses.replace(config, order=tuple(range(1, self.vehicles + 1)))
        unknown = sorted({owner for owner in config.order if not 0 <= owner <= self.vehicles})
        if unknown:
            raise ValueError(
                f"tdma.order is {config.order}, but {unknown} are not among the vehicles 1..{self.vehicles}"
            )
        return config

    def settings(self, now_s: float) -> TdmaConfig:
        """The settings at a time, with the order written out."""
        return self._at(now_s)[1]

    def change(self, config: TdmaConfig, now_s: float) -> float:
        """Schedules new settings; they replace an earlier change that has not taken effect yet.

        Returns:
            When they take effect (s): at the first start of a cycle, by the present settings, after `now_s`.

        Raises:
            ValueError: if the order contains an unknown vehicle, or the time is not finite.
        """
        config = self._complete(config)
        if not math.isfinite(now_s):
            raise ValueError(f"change of the tdma settings: the time must be finite, not {now_s} s")
        since, old = self._at(now_s)
        self._settings = [(since, old)]
        slots = len(old.order)
        index = slots * math.floor((now_s - old.epoch_s) / (old.slot_s * slots))
        while (effective := old.epoch_s + index * old.slot_s) <= now_s:
            index += slots
        self._settings.append((effective, config))
        return effective

    def _at(self, now_s: float) -> tuple[float, TdmaConfig]:
        for since, config in reversed(self._settings):
            if now_s >= since:
                return since, config
        return self._settings[0]  # a time before a change whose earlier settings are not kept

    def slot(self, now_s: float) -> Slot:
        """The slot at a time."""
        since, config = self._at(now_s)
        index = math.floor((now_s - config.epoch_s) / config.slot_s)
        # a slot's start is defined by the product, not the quotient: all vehicles agree on it to the last bit
        if now_s < config.epoch_s + index * config.slot_s:
            index -= 1
        elif now_s >= config.epoch_s + (index + 1) * config.slot_s:
            index += 1
        start, end = (config.epoch_s + i * config.slot_s for i in (index, index + 1))
        owner = config.order[index % len(config.order)] if start >= since else 0
        return Slot(index=index, owner=owner, start_s=start, end_s=end, since_s=since)

    def window(self, slot: Slot) -> tuple[float, float]:
        """First and last time (s) at which a transmission may start in the slot."""
        config = self._at(slot.since_s)[1]
        first_s = slot.start_s + config.guard_s
        return first_s, slot.end_s - config.guard_s - config.travel_s - config.send_duration_s

    def may_send(self, now_s: float) -> bool:
        """Whether this vehicle may start a transmission now (s, by its own clock)."""
        slot = self.slot(now_s)
        first, last = self.window(slot)
        return slot.owner == self.address and first <= now_s <= last

    def next_slot(self, now_s: float) -> Slot | None:
        """This vehicle's next slot that has not begun yet; None if it has none in the next two cycles."""
        return next((slot for slot in self.following(now_s) if slot.owner == self.address), None)

    def around(self, now_s: float, owner: int, cycles: int = 1) -> list[float]:
        """Starts (s) of the slots of `owner` within `cycles` before and after `now_s`, by the present settings."""
        since, config = self._at(now_s)
        slots = len(config.order)
        first = self.slot(now_s).index - cycles * slots + 1
        return [
            start
            for index in range(first, first + 2 * cycles * slots)
            if config.order[index % slots] == owner and (start := config.epoch_s + index * config.slot_s) >= since
        ]

    def other_slots(self, now_s: float, owner: int) -> Iterator[float]:
        """Starts of slots (s) of `owner` that a wrong clock or an old packet would explain, the likeliest first."""
        yield from self.around(now_s, owner, _STALE_CYCLES)
        for hours in range(1, _STALE_HOURS + 1):
            for sign in (1.0, -1.0):
                yield from self.around(now_s + sign * 3600.0 * hours, owner)

    def following(self, now_s: float) -> Iterator[Slot]:
        """The slots after the present one, until two cycles after the last change of settings."""
        slot = self.slot(now_s)
        last_since, last = self._settings[-1]
        end = max(now_s, last_since) + 2.0 * last.slot_s * len(last.order) + last.slot_s
        while slot.end_s <= end:
            slot = self.slot(slot.end_s)
            yield slot
