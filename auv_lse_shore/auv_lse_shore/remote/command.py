"""auv_lse fleet: the command line."""

import argparse
import difflib
import functools
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_shore.remote import checking, fetching, ordering, sending, watching
from auv_lse_shore.remote.fleet_file import FleetFileError, fleet_text, read_fleet, refuse_folder
from auv_lse_shore.remote.ledger import LedgerError
from auv_lse_shore.remote.ledger_file import LedgerFile

ERRORS = (FleetFileError, LedgerError, ParameterError, OSError)
INTERRUPTED = "interrupted; what is pending is remembered: auv_lse fleet FILE pending"

_ORDERS = {
    "start": "start the vehicles' nodes; a new dive waits for go",
    "go": "start the missions, or continue after a hold; every vehicle must have passed a check within a minute",
    "hold": "hold the position until go",
    "surface": "hold at the surface until go",
    "abort": "end the missions; to all vehicles: also by acoustic packet through those in reach",
    "reset": "clear tripped limits and an abort; the missions then hold until go",
    "stop": "end the vehicles' nodes, the recorder last",
}
_VERBS = (*_ORDERS, "init", "check", "send", "pending", "watch", "fetch")
_FILE = "fleet.yaml"


class _Parser(argparse.ArgumentParser):
    """A command line whose first word may be left out: argparse would take the verb before a vehicle for it."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words = list(args or ())
        if len(words) > 1 and words[1] not in _VERBS and difflib.get_close_matches(words[0], _VERBS):
            words = [_FILE, *words]  # also before a misspelled verb, which is then the one that is named
        return super().parse_known_args(words, namespace)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse fleet."""
    p = _Parser(
        prog="auv_lse fleet",
        description="Checks, loads, commands and watches several vehicles from one laptop, and fetches their "
        "recordings, over their SSH. An order acts exactly once, however often the link drops. See "
        "docs/guide/field-day.md.",
        epilog="Exit codes: 0 done, nothing is wrong; 1 something is wrong or not done; 2 wrong fleet file or command "
        "line; 130 Ctrl-C.",
    )
    p.add_argument(
        "file", nargs="?", type=Path, default=Path(_FILE), metavar="FILE", help="the fleet file (fleet.yaml)"
    )
    of_verb: Any = functools.partial(argparse.ArgumentParser, epilog=p.epilog)
    verbs = p.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=of_verb)
    c = verbs.add_parser("init", help="write a fleet file")
    c.add_argument("hosts", nargs="*", metavar="HOST", help="USER@HOST or USER@HOST:PORT of auv1, auv2, ...")
    c.set_defaults(call=_init)
    c = _verb(verbs, "check", "check vehicles: link, versions, clocks, disk, battery, devices, files", _check)
    c.add_argument("--quick", action="store_true", help="do not let the vehicles check their devices")
    c = verbs.add_parser("send", help="send mission file, prior and key to vehicles: all get the same, or none")
    c.add_argument("mission", type=Path, metavar="MISSION.yaml", help="the vehicles' mission file")
    _vehicles(c, _send)
    c.add_argument("--wait", type=float, default=20.0, metavar="S", help="how long to repeat it (default: 20 s)")
    for name, text in _ORDERS.items():
        c = _verb(verbs, name, text, _order)
        c.add_argument("--wait", type=float, default=20.0, metavar="S", help="how long to repeat it (default: 20 s)")
        c.add_argument("--take-over", action="store_true", help="command vehicles that another laptop commands")
        if name == "go":
            c.add_argument("--anyway", action="store_true", help="without a check")
        if name in ("start", "go", "reset"):
            c.add_argument(
                "--expires", type=float, default=10.0, metavar="MIN", help="minutes it may stay pending (default: 10)"
            )
        if name == "abort":
            c.add_argument("--team", action="store_true", help="to named vehicles: also by acoustic packet, to all")
    c = _verb(verbs, "pending", "deliver orders that are pending, and settle unknown outcomes", _pending)
    c.add_argument("--cancel", action="store_true", help="cancel them instead")
    c.add_argument("--wait", type=float, default=20.0, metavar="S", help="how long to try (default: 20 s)")
    c = _verb(verbs, "watch", "show the team in one table until Ctrl-C, and deliver what is pending", _watch)
    c.add_argument("--every", type=float, default=1.0, metavar="S", help="time between questions (default: 1 s)")
    c.add_argument("--once", action="store_true", help="print one table, and end")
    c.add_argument(
        "--page", type=int, nargs="?", const=8650, metavar="PORT", help="also a page on 127.0.0.1 (default: 8650)"
    )
    _add_fetch(verbs)
    return p


def _add_fetch(verbs: Any) -> None:
    c = _verb(verbs, "fetch", "copy the newest dives, verify them, and make map, report and certificate", _fetch)
    c.add_argument("--out", type=Path, default=Path("fetched"), metavar="DIR", help="run folder (default: fetched)")
    c.add_argument("--all", action="store_true", help="all dives that are on the vehicles, not only the newest")
    c.add_argument("--delete", action="store_true", help="remove files on the vehicle once their copy is verified")
    c.add_argument("--copy-only", action="store_true", help="make no map, report and certificate")
    c.add_argument(
        "--wait", type=float, default=600.0, metavar="S", help="longest time without a byte (default: 600 s)"
    )


def _verb(verbs: Any, name: str, text: str, call: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
    c: argparse.ArgumentParser = verbs.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    _vehicles(c, call)
    return c


def _vehicles(c: argparse.ArgumentParser, call: Callable[[argparse.Namespace], int]) -> None:
    c.add_argument("vehicles", nargs="*", metavar="VEHICLE", help="vehicles, such as auv2 (default: all)")
    c.set_defaults(call=call)


def run(options: argparse.Namespace) -> int:
    """Runs the verb; returns the exit code (see --help)."""
    code: int = options.call(options)
    return code


def _init(options: argparse.Namespace) -> int:
    refuse_folder(options.file)
    if options.file.exists():
        raise FleetFileError(f"{options.file} exists already. Edit it, or name another file.")
    write_whole(options.file, fleet_text(options.hosts))
    print(f"{options.file}: written. Edit it, then: auv_lse fleet {shlex.quote(str(options.file))} check")
    return 0


def _check(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    ledgers = LedgerFile(fleet.path)
    with ledgers.changed() as ledger:
        sent, laptop = ledger.sent, ledger.laptop
    reports, problems = checking.check(fleet, fleet.chosen(options.vehicles), not options.quick, sent, laptop)
    checking.show(Console(), reports, problems)
    errors = {problem.vehicle for problem in problems if problem.level == "error"}
    ordering.note_checked(ledgers, reports, errors)
    return int(bool(errors))


def _order(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    vehicles = fleet.chosen(options.vehicles)
    is_all = len(vehicles) == len(fleet.vehicles)
    wish = ordering.OrderRequest(
        verb=options.verb,
        team=options.verb == "abort" and (is_all or options.team),
        valid_s=60.0 * getattr(options, "expires", 0.0),
        wait_s=options.wait,
        anyway=getattr(options, "anyway", False),
        take_over=options.take_over,
    )
    return ordering.ordered(fleet, vehicles, wish)


def _pending(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    return ordering.settled(fleet, fleet.chosen(options.vehicles), options.cancel, options.wait)


def _send(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    return sending.send(fleet, fleet.chosen(options.vehicles), options.mission, options.wait)


def _fetch(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    vehicles = fleet.chosen(options.vehicles)
    found = fetching.fetch(fleet, vehicles, options.out, options.wait, options.delete, options.all)
    for name, fetched in found.items():
        print(fetching.summary(name, fetched), flush=True)
    runs = [run for fetched in found.values() for run in fetched.runs]
    if any(fetched.trouble for fetched in found.values()):
        return 1
    return 0 if options.copy_only or options.all or not runs else min(fetching.results(runs, options.out), 1)


def _watch(options: argparse.Namespace) -> int:
    fleet = read_fleet(options.file)
    return watching.watch(fleet, fleet.chosen(options.vehicles), options.every, options.once, options.page)
