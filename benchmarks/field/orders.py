"""Orders to all vehicles of a fleet at the same time, and a fetch with interruptions: what went wrong with them."""

import contextlib
import io
import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from auv_lse_run.remote.orders import ACTED, INTERRUPTED, VERBS
from auv_lse_run.remote.vehicle_folder import sha256_of
from auv_lse_shore.remote import fetching
from auv_lse_shore.remote.checking import utc_s
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle, read_fleet
from auv_lse_shore.remote.ledger_file import LedgerFile
from auv_lse_shore.remote.ordering import delivered
from benchmarks.field.mishaps import killed_laptop
from benchmarks.field.side import EXECUTED
from benchmarks.field.sshd import Computer

Say = Callable[[str], None]
_LONGEST_S = 900.0


class Operator:
    """Gives orders to vehicles, and waits for the outcome of each.

    Attributes:
        ledgers: The laptop's ledger.
        took_s: How long each order took.
        deaths: How often the laptop died.
    """

    def __init__(self, fleet: FleetFile, count: int, seed: int, say: Say, dies: float = 0.0) -> None:
        """Gives nothing yet.

        Args:
            count: Number of orders, shared among them.
            seed: Chooses the orders.
            dies: Share of the orders whose laptop dies in the middle of the command.
        """
        self._dies = dies
        self._fleet, self._count, self._seed, self._say = fleet, count, seed, say
        self._left, self._lock = iter(range(count)), threading.Lock()
        self.ledgers, self.took_s, self.deaths = LedgerFile(fleet.path), list[float](), 0

    def give_all(self, vehicle: RemoteVehicle) -> None:
        """Gives orders to one vehicle until all have been given to one."""
        chance = random.Random(f"{self._seed} {vehicle.name}")
        while True:
            with self._lock:
                if next(self._left, None) is None:
                    return
            given_s, dies = time.monotonic(), chance.random() < self._dies
            self._give(vehicle, chance, dies)
            with self._lock:
                self.took_s.append(time.monotonic() - given_s)
                self.deaths += dies
                if len(self.took_s) % 20 == 0:
                    self._say(f"{len(self.took_s)} of {self._count} orders")

    def _give(self, vehicle: RemoteVehicle, chance: random.Random, laptop_dies: bool) -> None:
        """Gives an order and waits until it is settled; a laptop that dies leaves that to its next command."""
        verb = chance.choice(VERBS)
        if laptop_dies:
            words = [verb, vehicle.name, "--wait", "600", *(["--anyway"] if verb == "go" else [])]
            killed_laptop(self._fleet.path, words, chance.uniform(0.3, 15.0))
        else:
            with self.ledgers.changed() as ledger:
                ledger.give(vehicle.name, verb, utc_s())
        delivered(self._fleet, [vehicle], self.ledgers, _LONGEST_S)


def wrong_orders(
    vehicle: RemoteVehicle, computer: Computer, ledgers: LedgerFile, has_rebooted: bool = False
) -> tuple[int, int, list[str]]:
    """Number of orders to a vehicle, number executed again, and errors in the others.

    One that has rebooted may have executed an order again, or been interrupted by that.
    """
    executed = [int(line.split()[0]) for line in (computer.folder / EXECUTED).read_text().splitlines()]
    counts, ledger, wrong = Counter(executed), ledgers.read(), []
    given = ledger.last(vehicle.name)
    for number in range(1, given + 1):
        status, times = ledger.find(vehicle.name, number).status, counts[number]
        if times < 1 or (times > 1 and not has_rebooted) or status not in (ACTED, *[INTERRUPTED] * has_rebooted):
            wrong.append(f"{vehicle.name}: order {number} is {status}, executed {times} times")
    if executed != sorted(executed):
        wrong.append(f"{vehicle.name}: executed out of order")
    return given, sum(n > 1 for n in counts.values()), wrong


def fetched(
    file: Path, computer: Computer, size_mb: int, seed: int, out: Path, interrupt: Callable[[int], None]
) -> tuple[float, int, list[str]]:
    """Fetches a recording of a vehicle, with an interruption after each quarter.

    Args:
        size_mb: Size of the recording.
        seed: Of its content.
        interrupt: Makes the interruption 0, 1 or 2; returns when it is over.

    Returns:
        How long it took (s), how often it was continued, and what is wrong.
    """
    bag, copy = (folder / "2026-01-01-auv1" / "bag" for folder in (computer.folder / "dives", out / "auv1"))
    bag.mkdir(parents=True)
    chance = random.Random(seed)
    with (bag / "bag.mcap").open("wb") as whole:
        for _ in range(size_mb):
            whole.write(chance.randbytes(1_000_000))
    fleet, began_s = read_fleet(file), time.monotonic()
    with ThreadPoolExecutor(1) as pool, contextlib.redirect_stderr(io.StringIO()):
        job = pool.submit(fetching.fetch, fleet, fleet.vehicles, out, _LONGEST_S, False, False)
        for number in range(3):
            wanted = 250_000 * size_mb * (number + 1)
            while not job.done() and sum(path.stat().st_size for path in copy.glob("bag.mcap*")) < wanted:
                time.sleep(0.05)
            interrupt(number)
        found = job.result()["auv1"]
    took_s, copied = time.monotonic() - began_s, copy / "bag.mcap"
    is_same = copied.is_file() and sha256_of(copied) == sha256_of(bag / "bag.mcap")
    wrong = [] if is_same and not found.trouble else [f"the copy is not the recording: {found.trouble}"]
    return took_s, found.resumed, wrong
