"""The orders that this laptop has given: what is pending, what was sent without an answer, what was answered. No clock.

Theory of operation
-------------------
`give` numbers an order and keeps it before anything is sent. For each vehicle, `due` lists what the next contact has to
deliver, in order: orders that still count, and questions about orders that were sent, have no answer, and have been
dropped. The vehicle answers each once (`auv_lse_run/remote/orders.py`), so repeating is harmless.

HOLD, SURFACE, ABORT and STOP drop earlier GO, START and RESET orders. Those that were never sent are gone. The vehicle
is asked for the outcome of the others, and never executes those that it has not executed yet. A pending order other
than a safe one expires.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from auv_lse_run.remote.orders import ALWAYS, FINAL, VERBS

#: An order that was not sent; that was sent and has no answer; that expired or was dropped before it was sent.
PENDING, UNKNOWN, EXPIRED, DROPPED = "pending", "unknown", "expired", "dropped"
#: Answered orders that are kept of each vehicle.
_MAX_SETTLED = 200


@dataclass(frozen=True, slots=True)
class Given:
    """An order that was given to a vehicle.

    Attributes:
        verb: "go".
        team: With abort: also by acoustic packet.
        given_s: When, by the laptop's clock (s).
        expires_s: When it expires; 0: never.
        status: PENDING, UNKNOWN, EXPIRED, DROPPED, or an outcome of `auv_lse_run.remote.orders`.
        counts: Whether it is still wanted.
        text: The vehicle's answer.
        at: When the vehicle acted, by its clock; for people.
    """

    number: int
    verb: str
    team: bool = False
    given_s: float = 0.0
    expires_s: float = 0.0
    status: str = PENDING
    counts: bool = True
    text: str = ""
    at: str = ""

    @property
    def valid_s(self) -> float:
        """How long it counts (s)."""
        return self.expires_s - self.given_s

    @property
    def is_open(self) -> bool:
        """Whether something is still to be done."""
        return self.status in (PENDING, UNKNOWN)


class LedgerError(ValueError):
    """The ledger's values are wrong."""


class Ledger:
    """The orders given to the vehicles of one fleet file.

    Attributes:
        sent: SHA-256 of the files that were sent last, by name.
        checked: When each vehicle was last found without errors, by the laptop's clock (s).
    """

    def __init__(self, laptop: str, values: Mapping[str, Any] | None = None) -> None:
        """A ledger from `values`; None: a new one of the laptop.

        Raises:
            LedgerError: if the values are not those of a ledger.
        """
        values = values or {}
        try:
            self.laptop = str(values.get("laptop", laptop))
            self.sent: dict[str, str] = dict(values.get("sent", {}))
            self.checked: dict[str, float] = {k: float(v) for k, v in values.get("checked", {}).items()}
            self._last: dict[str, int] = {k: int(v) for k, v in values.get("last", {}).items()}
            self._orders = {
                name: {order["number"]: Given(**order) for order in found}
                for name, found in values.get("orders", {}).items()
            }
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise LedgerError(f"is damaged ({error})") from error

    def values(self) -> dict[str, Any]:
        """The ledger as JSON can hold it: a copy, which later changes of the ledger do not affect."""
        orders = {name: [asdict(order) for order in found.values()] for name, found in self._orders.items()}
        own = {"laptop": self.laptop, "sent": dict(self.sent), "checked": dict(self.checked)}
        return own | {"last": dict(self._last), "orders": orders}

    def give(self, vehicle: str, verb: str, now_s: float, valid_s: float = 600.0, team: bool = False) -> Given:
        """A new order to a vehicle; drops those that it replaces.

        Args:
            vehicle: "auv2".
            now_s: The laptop's clock (s).
            valid_s: How long it counts (s). Safe orders always count.
            team: With abort: also by acoustic packet.

        Raises:
            LedgerError: for an unknown order.
        """
        if verb not in VERBS:
            raise LedgerError(f"{verb!r} is not an order")
        if verb in ALWAYS:
            self.drop(vehicle)
        number = self._last[vehicle] = self._last.get(vehicle, 0) + 1
        expires_s = now_s + valid_s if verb not in ALWAYS else 0.0
        order = Given(number, verb, team, now_s, expires_s)
        kept = self._orders.setdefault(vehicle, {})
        for found in [found for found in kept.values() if not found.is_open][:-_MAX_SETTLED]:
            del kept[found.number]
        kept[number] = order
        return order

    def last(self, vehicle: str) -> int:
        """Number of the last order given to a vehicle; 0: none."""
        return self._last.get(vehicle, 0)

    def drop(self, vehicle: str) -> list[Given]:
        """Invalidates the open orders of a vehicle; returns them."""
        found = [order for order in self.open(vehicle) if order.counts]
        for order in found:
            gone = order.status == PENDING
            self._orders[vehicle][order.number] = replace(order, counts=False, status=DROPPED if gone else UNKNOWN)
        return found

    def expire(self, now_s: float) -> None:
        """Invalidates orders that have expired."""
        for orders in self._orders.values():
            for number, order in orders.items():
                is_valid = order.verb in ALWAYS or order.given_s <= now_s < order.expires_s  # else: clock set back
                if order.is_open and order.counts and not is_valid:
                    status = EXPIRED if order.status == PENDING else UNKNOWN
                    orders[number] = replace(order, counts=False, status=status)

    def open(self, vehicle: str) -> list[Given]:
        """The orders of a vehicle that are not settled, oldest first."""
        return [order for order in self._orders.get(vehicle, {}).values() if order.is_open]

    def due(self, vehicle: str) -> list[tuple[str, Given]]:
        """The deliveries at the next contact: ("order" or "cancel", order), the safe orders first.

        Safe orders come before queries, because they also cancel earlier orders.
        """
        orders = self.open(vehicle)
        wanted = [("order", order) for order in orders if order.counts]
        asked = [("cancel", order) for order in orders if not order.counts]
        return [*(o for o in wanted if o[1].verb in ALWAYS), *asked, *(o for o in wanted if o[1].verb not in ALWAYS)]

    def note_sent(self, vehicle: str, number: int) -> None:
        """Notes that an order is about to be sent: from now on its outcome is unknown until it is answered."""
        order = self.find(vehicle, number)
        if order.is_open:
            self._orders[vehicle][number] = replace(order, status=UNKNOWN)

    def note_answer(self, vehicle: str, number: int, outcome: str, text: str = "", at: str = "") -> None:
        """Notes the vehicle's answer; one that settles nothing leaves the order open."""
        order = self.find(vehicle, number)
        if order.is_open:
            status = outcome if outcome in FINAL else UNKNOWN
            self._orders[vehicle][number] = replace(order, status=status, text=text, at=at)

    def find(self, vehicle: str, number: int) -> Given:
        """An order.

        Raises:
            LedgerError: if there is none.
        """
        if (order := self._orders.get(vehicle, {}).get(number)) is None:
            raise LedgerError(f"{vehicle} was given no order {number}")
        return order
