"""A field day's faults: orders over a link that cuts, ten faults that check or watch has to name, and a fetch.

The vehicles' computers are real sshd processes on this machine. Orders go to a vehicle that notes what it executes. A
relay cuts connections at a random byte. With `--packets`, each vehicle has a network namespace behind a link that loses
and delays packets, and outages, new addresses, reboots and dying laptops happen. `--dive` flies a whole simulated day.
"""

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from auv_lse_common.support.option_types import number_from, positive, whole_from
from auv_lse_shore.remote.fleet_file import read_fleet
from benchmarks.faults.report import Part, Report
from benchmarks.field import dive, on_air
from benchmarks.field.faults import FAULTS, printed, team_on_deck
from benchmarks.field.orders import Operator, fetched, wrong_orders
from benchmarks.field.relay import Relay
from benchmarks.field.sshd import Computer, Field, lacks_sshd, side_command

SMALL = ("--orders", "40", "--fetch-mb", "5")
#: Vehicles to which orders are given at the same time.
_VEHICLES = 5


def arguments(p: argparse.ArgumentParser) -> None:
    """Adds the options."""
    p.add_argument(
        "--orders", type=whole_from(0), default=1000, metavar="N", help="orders of all kinds (default: 1000)"
    )
    p.add_argument(
        "--packets",
        type=whole_from(0),
        default=0,
        metavar="N",
        help="orders to network namespaces whose packets are lost; the fetch goes there, too; as root (default: 0)",
    )
    p.add_argument(
        "--loss",
        type=number_from(0.0, below=1.0),
        default=0.3,
        metavar="P",
        help="share of connections cut, of packets lost (0.3)",
    )
    p.add_argument(
        "--delay", type=number_from(0.0), default=0.0, metavar="S", help="one-way delay of the link (default: 0 s)"
    )
    p.add_argument(
        "--fetch-mb", type=whole_from(0), default=50, metavar="MB", help="size of the recording (default: 50; 0: none)"
    )
    p.add_argument("--outage", type=positive, default=5.0, metavar="S", help="length of each outage (default: 5 s)")
    p.add_argument(
        "--dive",
        type=whole_from(0),
        default=0,
        metavar="N",
        help="vehicles of a simulated day, from check to certificate, in some minutes (default: 0, none)",
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Gives orders, injects faults and fetches.

    Raises:
        RuntimeError: without sshd, or without what an option needs.
    """
    if problem := lacks_sshd():
        raise RuntimeError(problem)
    lines = ["| what | tried | as it should be | figures |", "|---|---|---|---|"]
    lost: list[str] = []
    tried = survived = 0
    parts: dict[str, Callable[[argparse.Namespace, Path, Callable[[str], None]], Part]] = {}
    if options.orders:
        parts["orders"] = _orders
    if options.packets:
        parts["packets"] = on_air.orders
    parts["faults"] = _faults
    if options.fetch_mb:
        parts["fetch"] = on_air.fetch if options.packets else _fetch
    if options.dive:
        parts["dive"] = dive.part
    for key, part in parts.items():
        name, of, good, figures, wrong = part(options, folder / key, say)
        lines.append(f"| {name} | {of} | {good} | {figures} |")
        tried, survived, lost = tried + of, survived + good, [*lost, *wrong]
    return Report(lines, tried=tried, survived=survived, lost=lost)


@contextlib.contextmanager
def _vehicles(
    field: Field, count: int, relay: Callable[[int, int], Relay], side: str
) -> Iterator[tuple[list[Relay], list[Computer], Path]]:
    """A fleet behind relays: relays, computers, fleet file."""
    with contextlib.ExitStack() as stack:
        computers = [stack.enter_context(field.computer(f"auv{k}")) for k in range(1, count + 1)]
        relays = [stack.enter_context(relay(computer.port, k)) for k, computer in enumerate(computers)]
        entries = {}
        for k, (made, computer) in enumerate(zip(relays, computers, strict=True), 1):
            field.trust(f"auv{k}", made.port)
            entries[f"auv{k}"] = {"port": made.port, "folder": str(computer.folder), "command": side_command(side)}
        yield relays, computers, field.fleet_file(entries)


def _orders(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Part:
    """Orders of all kinds: each executed once, in order, and answered."""
    relay = lambda port, k: Relay(port, options.seed + k, options.delay, options.loss)
    with _vehicles(Field(folder), _VEHICLES, relay, "benchmarks.field.side") as (relays, computers, file):
        fleet, began_s = read_fleet(file), time.monotonic()
        operator = Operator(fleet, options.orders, options.seed, say)
        with ThreadPoolExecutor(_VEHICLES) as pool:
            list(pool.map(operator.give_all, fleet.vehicles))
        took_s, wrong, worst_s = time.monotonic() - began_s, list[str](), max(operator.took_s)
        for vehicle, computer in zip(fleet.vehicles, computers, strict=True):
            wrong += wrong_orders(vehicle, computer, operator.ledgers)[2]
        cut, all_ = (sum(made.counts[key] for made in relays) for key in ("cut", "connections"))
    figures = f"{cut} of {all_} connections cut; {took_s:.0f} s; longest until answered {worst_s:.1f} s"
    return f"orders at {100 * options.loss:.0f} % cuts", options.orders, options.orders - len(wrong), figures, wrong


def _faults(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Part:
    """Faults that check or watch has to name."""
    missed = []
    with team_on_deck(folder) as team:
        if problems := [
            line for line in team("no fault").fleet("check", "--quick").splitlines() if line.startswith("auv1: ")
        ]:
            missed.append(f"a team without a fault has one: {problems}")
        for name, fault in FAULTS.items():
            text = printed(fault, team(name))
            is_named = all(word in text for word in fault.words)
            say(f"{name}: {'named' if is_named else 'NOT named'}")
            if not is_named:
                missed.append(f"{name} is not named: {text.strip().splitlines()[-2:]}")
    return "faults named by check or watch", len(FAULTS), len(FAULTS) - len(missed), ", ".join(FAULTS), missed


def _fetch(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Part:
    """A recording fetched over a link with outages."""
    with _vehicles(Field(folder), 1, lambda port, k: Relay(port, options.seed), "auv_lse_run") as (
        relays,
        computers,
        file,
    ):
        relays[0].rate_bps = options.fetch_mb * 1e6 / 20.0  # so that outages fall into it

        def interrupt(number: int) -> None:
            relays[0].up = False
            time.sleep(options.outage)
            relays[0].cut_all()
            relays[0].up = True

        out = folder / "out"
        took_s, resumed, wrong = fetched(file, computers[0], options.fetch_mb, options.seed, out, interrupt)
    figures = f"{options.fetch_mb} MB in {took_s:.0f} s; 3 outages of {options.outage:g} s; continued {resumed} times"
    return "fetch", 1, 1 - len(wrong), figures, wrong
