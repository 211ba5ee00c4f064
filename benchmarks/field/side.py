"""The vehicle's side with an actor that notes in a file what it executes, in place of a vehicle's nodes.

The faults of a field day call this module with the arguments of auv_lse. Files in the vehicle's folder make its nodes
report a state (`STATE`), and put its clock off (`CLOCK`).
"""

import json
import os
import sys
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from auv_lse_run.process.domain import domain_number
from auv_lse_run.remote import facts, session
from auv_lse_run.remote.orders import ACTED, Order
from auv_lse_run.remote.vehicle_side import parser
from auv_lse_run.vehicle.run_vehicle import vehicle_number

#: The file of executed orders, a line each: number, verb, laptop.
EXECUTED = "executed.txt"
#: The nodes' report; without the file, no nodes run. The clock's error (s).
STATE, CLOCK = "state.json", "clock_off_s"


class NotingActor(session.NodeActor):
    """Notes each order that it executes."""

    def __init__(self, folder: Path) -> None:
        """Notes in a file of `folder`."""
        self._folder = folder

    def act(self, order: Order) -> tuple[str, str]:
        """Notes the order; it takes a moment, so that a cut may come in between."""
        descriptor = os.open(self._folder / EXECUTED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.write(descriptor, f"{order.number} {order.verb} {order.laptop}\n".encode())
        os.close(descriptor)
        time.sleep(0.01)
        return ACTED, "noted"

    def state(self) -> dict[str, Any]:
        """The file's content; a part with `stamp_s`, by this machine's steady clock, gets its true age."""
        found: dict[str, Any] = json.loads((self._folder / STATE).read_text()) if _runs(self._folder) else {}
        for part in found.values():
            if isinstance(part, dict) and "stamp_s" in part:
                part["age_s"] = time.monotonic() - part["stamp_s"]
        return found

    def close(self) -> None:
        """Does nothing: nothing is open."""


class Side(session.Session):
    """A session whose clock may be off."""

    def answer(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The answer, with the clock's error."""
        found = super().answer(asked)
        if "clock_s" in found and (file := self._folder.folder / CLOCK).exists():
            found["clock_s"] = datetime.now(UTC).timestamp() + float(file.read_text())
        return found


def _runs(folder: Path) -> bool:
    return (folder / STATE).exists()


def main() -> None:
    """Answers requests as `auv_lse vehicle-side` does."""
    options = parser().parse_args(sys.argv[2:])
    number, folder = vehicle_number(options.name), options.folder.expanduser().absolute()
    if _runs(folder):
        for module in (facts, session):
            vars(module)["vehicle_on"] = lambda domain, vehicle: (str(folder / "dives" / "none"), "dive", 1)
    Side(folder, number, domain_number(options.domain), NotingActor(folder)).serve(session.Stream(0, 1))


if __name__ == "__main__":
    main()
