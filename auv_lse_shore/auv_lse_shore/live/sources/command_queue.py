"""Hands the commands of the page's buttons to the thread that has joined the mission's ROS domain."""

import threading
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field

from auv_lse_common.vocabulary.mission_run import Command

#: The commands that the page offers. Nothing that starts a vehicle: that needs auv_lse go.
COMMANDS = {"hold": Command.HOLD, "surface": Command.SURFACE, "abort": Command.ABORT}

#: Why a vehicle with an open command has not answered.
MISSION_ENDED = "the mission has ended"

#: What a vehicle answered: "accepted", "refused" or "not heard", and a text.
Outcome = tuple[str, str]


class CommandError(ValueError):
    """A command that is not sent to any vehicle."""


@dataclass(frozen=True, slots=True)
class Order:
    """A command on its way.

    Attributes:
        vehicles: Numbers of the vehicles that it is for.
        outcomes: Gets each vehicle's outcome when all are known.
    """

    command: Command
    vehicles: tuple[int, ...]
    outcomes: Future[dict[int, Outcome]] = field(default_factory=Future)


class CommandQueue:
    """Queues commands from the server's thread for the thread that follows a mission."""

    def __init__(self) -> None:
        """Accepts nothing until a mission is followed."""
        self._lock = threading.Lock()
        self._vehicles = 0
        self._orders: list[Order] = []

    def open(self, vehicles: int) -> None:
        """Accepts commands from now on, for a mission with that number of vehicles."""
        with self._lock:
            self._vehicles = vehicles

    def close(self) -> None:
        """Refuses commands after the mission's end, and reports waiting ones as not heard."""
        with self._lock:
            self._vehicles, waiting, self._orders = 0, self._orders, []
        for order in waiting:
            order.outcomes.set_result(dict.fromkeys(order.vehicles, ("not heard", MISSION_ENDED)))

    def order(self, name: object, vehicles: Sequence[object]) -> Future[dict[int, Outcome]]:
        """Queues a command; returns the future outcome of each vehicle.

        Args:
            name: "hold", "surface" or "abort".
            vehicles: Numbers of the vehicles.

        Raises:
            CommandError: if the command or a vehicle does not exist, or no mission is followed.
        """
        if not isinstance(name, str) or name not in COMMANDS:
            raise CommandError(f"{name!r} is not a command; use one of {', '.join(COMMANDS)}")
        with self._lock:
            if not self._vehicles:
                raise CommandError("no mission is running; recordings are read-only")
            there = range(1, self._vehicles + 1)
            found = [k for k in vehicles if type(k) is int and k in there]
            if not found or len(found) < len(vehicles):
                raise CommandError(f"vehicles must be numbers from 1 to {self._vehicles}, not {list(vehicles)!r}")
            order = Order(COMMANDS[name], tuple(sorted(set(found))))
            self._orders.append(order)
        return order.outcomes

    def take(self) -> list[Order]:
        """The commands since the last call; the caller sets their outcomes."""
        with self._lock:
            orders, self._orders = self._orders, []
        return orders
