"""Calls to abort the mission, between the vehicles of a team."""

from collections import Counter
from collections.abc import Callable


class AbortCalls:
    """Decides which calls to abort a vehicle obeys.

    A mate calls until its own RESET. Its call is obeyed until this vehicle has aborted, and not again after a RESET of
    this vehicle: only a packet without the call makes the next one a new call. A mate's first packet after that RESET
    may have been sent before the mate was reset, too: a call in it waits for the next packet.

    Attributes:
        allowed: Whether the team obeys calls: its packets have a tag, or need none.
        obeyed: Mates whose current call this vehicle has aborted for.
    """

    def __init__(self, allowed: bool, counts: Counter[str], changed: Callable[[list[int]], None]) -> None:
        """Starts without calls; `counts` gets "aborts.<mate>", and `changed` the new `obeyed`."""
        self.allowed = allowed
        self.obeyed: set[int] = set()
        self._counts, self._changed = counts, changed
        self._calling: set[int] = set()  # mates whose last packet had the call
        self._own = False
        self._heard: set[int] | None = None  # mates heard since this vehicle's RESET; None without one

    @property
    def own(self) -> bool:
        """Whether this vehicle calls the team to abort."""
        return self._own

    @own.setter
    def own(self, call: bool) -> None:
        if self._own and not call:
            self._heard = set()
        self._own = call
        if call:
            self._set_obeyed(self.obeyed | self._calling)

    def take(self, mate: int, call: bool) -> bool:
        """Updates the abort calls from a mate's packet; returns whether this vehicle must abort now."""
        is_first = self._heard is not None and mate not in self._heard
        if self._heard is not None:
            self._heard.add(mate)
        if not call:
            self._calling.discard(mate)
            self._set_obeyed(self.obeyed - {mate})
            return False
        if not self.allowed:
            self._counts[f"aborts_refused.{mate}"] += 1
            return False
        self._counts[f"aborts.{mate}"] += 1
        self._calling.add(mate)
        if self._own:
            self._set_obeyed(self.obeyed | {mate})
        return mate not in self.obeyed and not is_first

    def _set_obeyed(self, mates: set[int]) -> None:
        if mates != self.obeyed:
            self.obeyed = mates
            self._changed(sorted(mates))
