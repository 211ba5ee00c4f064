"""Orders and a fetch over links that lose and delay packets, each vehicle's computer in a network namespace."""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from auv_lse_run.remote.orders import ACTED, INTERRUPTED, VERBS
from auv_lse_shore.remote import fetching
from auv_lse_shore.remote.checking import utc_s
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle, read_fleet
from auv_lse_shore.remote.ledger_file import LedgerFile
from auv_lse_shore.remote.ordering import delivered
from auv_lse_shore.remote.watching import Watch
from benchmarks.faults.report import Part
from benchmarks.field.mishaps import AgeCheck, Mishaps, killed_laptop, write_state
from benchmarks.field.namespace import Namespace, Radio, namespaces
from benchmarks.field.side import EXECUTED
from benchmarks.field.sshd import Computer, Field, side_command

Say = Callable[[str], None]
#: Vehicles to which orders are given at the same time.
_VEHICLES = 5
#: Share of the orders whose laptop dies in the middle of the command.
_LAPTOP_DIES = 0.1
_LONGEST_S = 900.0
#: The link of the fetch: packets lost and delay (s), each way.
_FETCH_LOSS, _FETCH_DELAY_S = 0.01, 0.05


@contextlib.contextmanager
def _fleet(
    folder: Path, count: int, seed: int, side: str
) -> Iterator[tuple[Field, Radio, list[tuple[Namespace, Computer]], Callable[[str], Path]]]:
    """Vehicles in namespaces: the laptop, the links, the computers, and a maker of fleet files."""
    field = Field(folder)
    with namespaces(count, seed) as (radio, made), contextlib.ExitStack() as stack:
        there, entries = [], {}
        for k, own in enumerate(made, 1):
            computer = stack.enter_context(field.computer(f"auv{k}", "0.0.0.0", own.inside))
            field.place(f"auv{k}", own.address)
            there.append((own, computer))
            at = {"domain": 225, "host": f"auv{k}", "port": computer.port, "folder": str(computer.folder)}
            entries[f"auv{k}"] = {**at, "command": side_command(side)}
        yield field, radio, there, lambda name: field.fleet_file(entries, name)


def orders(options: argparse.Namespace, folder: Path, say: Say) -> Part:
    """Orders of all kinds over a bad link, while things go wrong: each takes effect once, and its outcome is known."""
    count = min(_VEHICLES, options.packets)
    with _fleet(folder, count, options.seed, "benchmarks.field.side") as (field, radio, there, file_of):
        fleet, watched = read_fleet(file_of("fleet.yaml")), read_fleet(file_of("watched.yaml"))
        computers = [computer for _, computer in there]
        for computer in computers:
            write_state(computer)
        radio.set(loss=options.loss, delay_s=options.delay)
        operator, began_s = _Operator(fleet, options.packets, options.seed, say), time.monotonic()
        watch = Watch(watched, watched.vehicles, 1.0)
        mishaps = Mishaps(field, radio, there, options.outage, options.seed)
        with watch, AgeCheck(watch, computers) as ages, mishaps, ThreadPoolExecutor(count) as pool:
            list(pool.map(operator.give_all, fleet.vehicles))
        again, total, wrong = 0, 0, []
        for vehicle, computer in zip(fleet.vehicles, computers, strict=True):
            given, repeated, found = _wrong_orders(vehicle, computer, operator.ledgers)
            again, total, wrong = again + repeated, total + given, wrong + found
    low = [margin for margin in ages.margins_s if margin < 0.0]
    wrong += [f"{len(low)} states were older than shown, by {-min(low):.3f} s"] if low else []
    befell, took_s = ", ".join(f"{n} x {kind}" for kind, n in sorted(mishaps.counts.items())), sorted(operator.took_s)
    figures = (
        f"{count} vehicles, {time.monotonic() - began_s:.0f} s; {befell}, {operator.deaths} x laptop killed; answered "
        f"after {took_s[len(took_s) // 2]:.1f} s (median), {took_s[-1]:.0f} s at most; {again} executed again after a "
        f"reboot; {len(ages.margins_s)} ages shown, {len(low)} too small, at most "
        f"{max(ages.margins_s, default=0.0):.1f} s too large"
    )
    name = f"orders at {100 * options.loss:.0f} % of packets lost and {1000 * options.delay:.0f} ms, each way"
    return name, total, total - len(wrong), figures, wrong


class _Operator:
    """Gives orders to vehicles, and waits for the outcome of each.

    Attributes:
        ledgers: The laptop's ledger.
        took_s: How long each order took.
        deaths: How often the laptop died.
    """

    def __init__(self, fleet: FleetFile, count: int, seed: int, say: Say) -> None:
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
            given_s, dies = time.monotonic(), chance.random() < _LAPTOP_DIES
            self._give(vehicle, chance, dies)
            with self._lock:
                self.took_s.append(time.monotonic() - given_s)
                self.deaths += dies
                if len(self.took_s) % 20 == 0:
                    self._say(f"{len(self.took_s)} of {self._count} orders on air")

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


def _wrong_orders(vehicle: RemoteVehicle, computer: Computer, ledgers: LedgerFile) -> tuple[int, int, list[str]]:
    """Number of orders to a vehicle, of those executed again, and what is wrong with the others."""
    executed = [int(line.split()[0]) for line in (computer.folder / EXECUTED).read_text().splitlines()]
    counts, ledger, wrong = Counter(executed), ledgers.read(), []
    given = ledger.last(vehicle.name)
    for number in range(1, given + 1):
        status = ledger.find(vehicle.name, number).status
        if counts[number] < 1 or status not in (ACTED, INTERRUPTED):
            wrong.append(f"{vehicle.name}: order {number} is {status}, executed {counts[number]} times")
    if executed != sorted(executed):
        wrong.append(f"{vehicle.name}: executed out of order")
    return given, sum(n > 1 for n in counts.values()), wrong


def fetch(options: argparse.Namespace, folder: Path, say: Say) -> Part:
    """A recording fetched over a link with losses: an outage, a change of address and a reboot, each with an outage."""
    with _fleet(folder, 1, options.seed, "auv_lse_run") as (field, radio, there, file_of):
        computer = there[0][1]
        mishaps = Mishaps(field, radio, there, options.outage, options.seed)
        bag = computer.folder / "dives" / "2026-01-01-auv1" / "bag"
        bag.mkdir(parents=True)
        chance, size = random.Random(options.seed), options.fetch_mb * 1_000_000
        with (bag / "bag.mcap").open("wb") as file:
            for _ in range(options.fetch_mb):
                file.write(chance.randbytes(1_000_000))
        radio.set(loss=_FETCH_LOSS, delay_s=_FETCH_DELAY_S)
        fleet, out, began_s = read_fleet(file_of("fleet.yaml")), folder / "out", time.monotonic()
        copy = out / "auv1" / "2026-01-01-auv1" / "bag"
        with ThreadPoolExecutor(1) as pool, contextlib.redirect_stderr(io.StringIO()):
            job = pool.submit(fetching.fetch, fleet, fleet.vehicles, out, _LONGEST_S, False, False)
            for share, kind in ((0.25, ""), (0.5, "address"), (0.75, "reboot")):
                while not job.done() and sum(path.stat().st_size for path in copy.glob("bag.mcap*")) < share * size:
                    time.sleep(0.2)
                say(
                    f"{share:.0%} fetched after {time.monotonic() - began_s:.0f} s; an outage{kind and ', then '}{kind}"
                )
                mishaps.one("outage", 0)
                if kind:
                    mishaps.one(kind, 0)
            found = job.result()["auv1"]
        took_s = time.monotonic() - began_s
        copied = copy / "bag.mcap"
        is_same = copied.is_file() and fetching.sha256_of(copied) == fetching.sha256_of(bag / "bag.mcap")
    wrong = [] if is_same and not found.trouble else [f"the copy is not the recording: {found.trouble}"]
    figures = (
        f"{options.fetch_mb} MB in {took_s:.0f} s; 3 outages of {options.outage:g} s, a new address and a reboot; "
        f"continued {found.resumed} times"
    )
    name = f"fetch at {100 * _FETCH_LOSS:.0f} % of packets lost and {1000 * _FETCH_DELAY_S:.0f} ms, each way"
    return name, 1, 1 - len(wrong), figures, wrong
