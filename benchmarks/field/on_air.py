"""Orders and a fetch over links that lose and delay packets, each vehicle's computer in a network namespace."""

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from auv_lse_shore.remote.fleet_file import read_fleet
from auv_lse_shore.remote.watching import Watch
from benchmarks.faults.report import Part
from benchmarks.field.mishaps import AgeCheck, Mishaps, write_state
from benchmarks.field.namespace import Namespace, Radio, namespaces
from benchmarks.field.orders import Operator, fetched, wrong_orders
from benchmarks.field.sshd import Computer, Field, side_command

Say = Callable[[str], None]
#: Vehicles to which orders are given at the same time.
_VEHICLES = 5
#: Share of the orders whose laptop dies in the middle of the command.
_LAPTOP_DIES = 0.1
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
        operator, began_s = Operator(fleet, options.packets, options.seed, say, _LAPTOP_DIES), time.monotonic()
        watch = Watch(watched, watched.vehicles, 1.0)
        mishaps = Mishaps(field, radio, there, options.outage, options.seed)
        with watch, AgeCheck(watch, computers) as ages, mishaps, ThreadPoolExecutor(count) as pool:
            list(pool.map(operator.give_all, fleet.vehicles))
        again, total, wrong = 0, 0, list[str]()
        for vehicle, computer in zip(fleet.vehicles, computers, strict=True):
            given, repeated, found = wrong_orders(vehicle, computer, operator.ledgers, has_rebooted=True)
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


def fetch(options: argparse.Namespace, folder: Path, say: Say) -> Part:
    """A recording fetched over a link with losses: an outage, a change of address and a reboot, each with an outage."""
    with _fleet(folder, 1, options.seed, "auv_lse_run") as (field, radio, there, file_of):
        computer = there[0][1]
        mishaps = Mishaps(field, radio, there, options.outage, options.seed)
        radio.set(loss=_FETCH_LOSS, delay_s=_FETCH_DELAY_S)
        began_s = time.monotonic()

        def interrupt(number: int) -> None:
            say(f"interrupted after {time.monotonic() - began_s:.0f} s")
            for kind in (("outage",), ("outage", "address"), ("outage", "reboot"))[number]:
                mishaps.one(kind, 0)

        file = file_of("fleet.yaml")
        took_s, resumed, wrong = fetched(file, computer, options.fetch_mb, options.seed, folder / "out", interrupt)
    figures = (
        f"{options.fetch_mb} MB in {took_s:.0f} s; 3 outages of {options.outage:g} s, a new address and a reboot; "
        f"continued {resumed} times"
    )
    name = f"fetch at {100 * _FETCH_LOSS:.0f} % of packets lost and {1000 * _FETCH_DELAY_S:.0f} ms, each way"
    return name, 1, 1 - len(wrong), figures, wrong
