"""The vehicle's side with an actor that notes in a file what it executes, in place of a vehicle's nodes.

Run as `python -m benchmarks.field.side`, with the arguments of auv_lse.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

from auv_lse_run.process.domain import domain_number
from auv_lse_run.remote.orders import ACTED, Order
from auv_lse_run.remote.session import Session, Stream
from auv_lse_run.remote.vehicle_side import parser
from auv_lse_run.vehicle.run_vehicle import vehicle_number

#: The file of executed orders, a line each: number, verb.
EXECUTED = "executed.txt"


class NotingActor:
    """Notes each order that it executes."""

    def __init__(self, folder: Path) -> None:
        """Notes in a file of `folder`."""
        self._file = folder / EXECUTED

    def act(self, order: Order) -> tuple[str, str]:
        """Notes the order; it takes a moment, so that a cut may come in between."""
        descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.write(descriptor, f"{order.number} {order.verb} {order.laptop}\n".encode())
        os.close(descriptor)
        time.sleep(0.01)
        return ACTED, "noted"

    def state(self) -> dict[str, Any]:
        """None."""
        return {}

    def close(self) -> None:
        """Nothing is open."""


def main() -> None:
    """Answers requests as `auv_lse vehicle-side` does."""
    options = parser().parse_args(sys.argv[2:])
    number, folder = vehicle_number(options.name), options.folder.expanduser().absolute()
    Session(folder, number, domain_number(options.domain), NotingActor(folder)).serve(Stream(0, 1))


if __name__ == "__main__":
    main()
