"""The orders that a vehicle takes from a laptop: numbered, recorded before they are executed, answered once. No clock.

Theory of operation
-------------------
A laptop numbers its orders to a vehicle upwards from 1 and repeats one until it has the answer. `OrderBook.take`
decides about each delivery:

- An order that was answered is not executed again: its answer is repeated.
- An order that was recorded and not answered (power failed in between) is executed again, because executing twice is
  harmless. If a later order was recorded, it is not.
- GO and RESET state when they were given, by the vehicle's clock, for which the laptop asks first. `safety_node` voids
  them if they are older than their limit, a later HOLD, SURFACE or ABORT from anywhere, or the vehicle's start.
- A number below the highest one is never executed, so what the network delivers late has no effect.
- An order that reaches the vehicle too long after the vehicle's own hello is stale. It was on its way through a link
  that hung. The laptop may repeat it in a new session. No clocks are compared.
- One laptop commands a vehicle. Another may watch, abort, or take over; the first then learns who did.

`cancel` settles an order whose outcome the laptop does not know: it returns the answer, or makes sure that the order
is never executed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

VERBS = ("start", "go", "hold", "surface", "abort", "reset", "stop")
#: Orders that make a vehicle safer. They are executed even if they cannot be recorded.
ALWAYS = frozenset({"hold", "surface", "abort", "stop"})
#: Time (s) after the vehicle's hello in which a session's order is accepted.
VALID_S = 20.0
#: Number of orders whose answers are kept.
MAX_KEPT = 500
_MAX_NUMBER = 2**31
_MAX_NAME = 80

#: Outcomes after which an order is settled: it was executed, or never will be.
ACTED, REFUSED, OVERTAKEN = "acted", "refused", "overtaken"
CANCELLED, INTERRUPTED = "cancelled", "interrupted"
FINAL = frozenset({ACTED, REFUSED, OVERTAKEN, CANCELLED, INTERRUPTED})
#: Outcomes after which the laptop may repeat the order.
STALE, FOREIGN, UNRECORDED, SILENT = "stale", "foreign", "unrecorded", "silent"


class OrderError(ValueError):
    """An order, or a record of orders, that makes no sense."""


@dataclass(frozen=True, slots=True)
class Order:
    """An order of a laptop to a vehicle.

    Attributes:
        number: Counts the laptop's orders to this vehicle, from 1.
        verb: One of `VERBS`.
        team: With abort: whether the team mates are aborted, too, by acoustic packet.
        name: The laptop and its user, for people.
        given_s: When it was given, by the vehicle's steady clock: seconds since its start; None: not known.
        valid_s: With `given_s`: for how long it counts (s).
    """

    laptop: str
    number: int
    verb: str
    team: bool = False
    name: str = ""
    given_s: float | None = None
    valid_s: float = 0.0

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Order:
        """The order of a message.

        Raises:
            OrderError: naming the wrong value.
        """
        order = cls(
            laptop=values.get("laptop", ""),
            number=values.get("number", 0),
            verb=values.get("verb", ""),
            team=values.get("team", False) is True,
            name=str(values.get("name", ""))[:_MAX_NAME],
            given_s=values.get("given_s"),
            valid_s=values.get("valid_s", 0.0),
        )
        if not isinstance(order.laptop, str) or not 0 < len(order.laptop) <= _MAX_NAME:
            raise OrderError(f"The order names no laptop: {order.laptop!r}.")
        if type(order.number) is not int or not 0 < order.number < _MAX_NUMBER:
            raise OrderError(f"The order has no valid number: {order.number!r}.")
        for value in (order.given_s or 0.0, order.valid_s):
            if not isinstance(value, int | float) or not math.isfinite(value):
                raise OrderError(f"The order has no valid time: {value!r}.")
        if order.verb not in VERBS:
            raise OrderError(f"{order.verb!r} is not an order. Orders are {', '.join(VERBS)}.")
        return order


@dataclass(frozen=True, slots=True)
class Answer:
    """The outcome of an order.

    Attributes:
        outcome: One of the outcomes above.
        text: An explanation for people.
        at: When, by the vehicle's clock (UTC, ISO 8601); for people only.
    """

    outcome: str
    text: str = ""
    at: str = ""

    @property
    def is_final(self) -> bool:
        """Whether the order is settled."""
        return self.outcome in FINAL


class OrderBook:
    """The orders that one vehicle has recorded.

    Attributes:
        controller: The laptop that commands this vehicle ({"laptop", "name", "at"}); empty: none yet.
    """

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        """A book from `values`; None: an empty one.

        Raises:
            OrderError: if the values are not those of a book.
        """
        values = values or {}
        try:
            self.controller: dict[str, str] = {str(k): str(v) for k, v in values.get("controller", {}).items()}
            self._highest: dict[str, int] = {str(k): int(v) for k, v in values.get("highest", {}).items()}
            #: Orders and their answers, by laptop and number, the oldest first.
            self._records: dict[tuple[str, int], tuple[Order, Answer | None]] = {}
            for found in values.get("orders", []):
                self._put(Order(**found["order"]), None if found["answer"] is None else Answer(**found["answer"]))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise OrderError(f"{type(error).__name__}: {error}") from error

    def values(self) -> dict[str, Any]:
        """The book as JSON can hold it."""
        orders = [{"order": asdict(o), "answer": None if a is None else asdict(a)} for o, a in self._records.values()]
        return {"controller": self.controller, "highest": self._highest, "orders": orders}

    def take(self, order: Order, age_s: float, at: str) -> Answer | None:
        """Decides about a delivered order.

        Args:
            age_s: Time since this session's hello, by the vehicle's steady clock.
            at: The time for people.

        Returns:
            The answer without executing it; None: it is recorded, and must be executed and answered.
        """
        key = order.laptop, order.number
        is_recorded, (_, known) = key in self._records, self._records.get(key, (order, None))
        if known is not None:
            return known
        if age_s > VALID_S:
            return Answer(STALE, f"It arrived {age_s:.0f} s after this session began. It will be repeated.", at)
        refusal = self._foreign(order)
        if not is_recorded and refusal is not None:
            return refusal
        if is_recorded and key == next(reversed(self._records)) and refusal is None:
            return None
        if is_recorded:
            answer = Answer(INTERRUPTED, "The vehicle stopped while executing it, and has had a later order since.", at)
            self._put(order, answer)
            return answer
        if order.number <= self._highest.get(order.laptop, 0):
            return Answer(OVERTAKEN, "A later order of this laptop was taken before it.", at)
        if not self.controller:
            self.take_over(order.laptop, order.name, at)
        self._put(order, None)
        return None

    def note(self, order: Order, answer: Answer) -> None:
        """Notes the answer of an executed order, which perhaps could not be recorded before."""
        self._put(order, answer)

    def cancel(self, order: Order, at: str) -> Answer:
        """Settles an order: its answer if it has one; else it is never executed."""
        key = order.laptop, order.number
        if key in self._records:
            _, known = self._records[key]
            answer = known or Answer(INTERRUPTED, "The vehicle stopped while executing it; see its state.", at)
        elif order.number <= self._highest.get(order.laptop, 0):
            return Answer(OVERTAKEN, "A later order of this laptop was taken before it.", at)
        else:
            answer = Answer(CANCELLED, "It never arrived, and will not be executed.", at)
        self._put(order, answer)
        return answer

    def take_over(self, laptop: str, name: str, at: str) -> None:
        """Makes a laptop the one that commands this vehicle."""
        self.controller = {"laptop": laptop, "name": name, "at": at}

    def _foreign(self, order: Order) -> Answer | None:
        if not self.controller or self.controller["laptop"] == order.laptop or order.verb == "abort":
            return None
        by = self.controller
        return Answer(FOREIGN, f"{by['name']} has commanded this vehicle since {by['at']}. Use --take-over.")

    def _put(self, order: Order, answer: Answer | None) -> None:
        self._highest[order.laptop] = max(order.number, self._highest.get(order.laptop, 0))
        self._records[order.laptop, order.number] = (order, answer)
        if len(self._records) > MAX_KEPT:
            del self._records[next(iter(self._records))]
