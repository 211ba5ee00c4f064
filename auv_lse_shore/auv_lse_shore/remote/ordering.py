"""The orders of auv_lse fleet (start, go, hold, ..., pending): gives them, and reports their outcomes."""

import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from auv_lse_common.support.user_error import error_text
from auv_lse_run.remote.orders import ACTED
from auv_lse_shore.remote.checking import check, utc_s
from auv_lse_shore.remote.contacts import repeated, with_each
from auv_lse_shore.remote.delivery import deliver
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.ledger import DROPPED, EXPIRED, PENDING, UNKNOWN, Given, LedgerError
from auv_lse_shore.remote.ledger_file import LedgerFile, Ledgers, MemoryLedger, laptop_name
from auv_lse_shore.remote.ssh import LinkError, VehicleError, session

#: How recent (s) a check must be for GO.
CHECKED_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderRequest:
    """An order as the operator typed it.

    Attributes:
        team: With abort: also by acoustic packet.
        valid_s: How long it counts if it cannot be delivered (s).
        wait_s: How long to repeat it before asking the operator (s).
        anyway: GO without a check.
        take_over: Take over from another laptop first.
    """

    verb: str
    team: bool = False
    valid_s: float = 600.0
    wait_s: float = 20.0
    anyway: bool = False
    take_over: bool = False


def ordered(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], wish: OrderRequest) -> int:
    """Gives an order to vehicles, and reports; returns the exit code: 0 if all have acted."""
    ledgers: Ledgers = LedgerFile(fleet.path)
    if wish.take_over and not _taken_over(fleet, vehicles, LedgerFile(fleet.path)):
        return 1
    if wish.verb == "go" and not wish.anyway and not _is_checked(fleet, vehicles, LedgerFile(fleet.path)):
        return 1
    try:
        given = _given(ledgers, vehicles, wish)
    except (OSError, LedgerError) as error:
        if wish.verb != "abort":
            raise
        print(f"warning: {error_text(error)}; the abort is sent, and not remembered", file=sys.stderr)
        ledgers = MemoryLedger()
        given = _given(ledgers, vehicles, wish)
    troubles = delivered(fleet, vehicles, ledgers, wish.wait_s)
    while True:
        found = {name: _found(ledgers, name, number) for name, number in given.items()}
        _report(found, troubles)
        if wish.verb == "abort":
            _report_acoustic(found, wish.team)
        left = [vehicle for vehicle in vehicles if found[vehicle.name].is_open]
        if not left or not sys.stdin.isatty():
            break
        choice = _choice(found)
        if choice == "w":
            troubles = delivered(fleet, left, ledgers, wish.wait_s)
            continue
        if choice == "c":
            dropped(fleet, left, ledgers, wish.wait_s)
        if choice == "h":
            gone = [vehicle for vehicle in vehicles if found[vehicle.name].status != PENDING]
            dropped(fleet, [v for v in left if found[v.name].status == PENDING], ledgers, 0.0)
            ordered(fleet, gone, OrderRequest(verb="hold", wait_s=wish.wait_s))
        break
    return int(any(order.status != ACTED for order in found.values()))


def delivered(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], ledgers: Ledgers, wait_s: float) -> dict[str, str]:
    """Delivers what is due to vehicles, repeating for `wait_s`; returns what is in the way, by vehicle."""
    name = laptop_name()
    return with_each(
        vehicles, lambda v: repeated(fleet, v, wait_s, lambda found: deliver(found, ledgers, v.name, name, utc_s))
    )


def dropped(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], ledgers: Ledgers, wait_s: float) -> None:
    """Cancels what is open, asks vehicles that may have acted, and reports."""
    open_before: dict[str, list[int]] = {}
    with ledgers.changed() as ledger:
        for vehicle in vehicles:
            open_before[vehicle.name] = [order.number for order in ledger.drop(vehicle.name)]
    if wait_s:
        asked = [vehicle for vehicle in vehicles if _is_open(ledgers, vehicle.name)]
        delivered(fleet, asked, ledgers, wait_s)
    for name, numbers in open_before.items():
        for number in numbers:
            _report({name: _found(ledgers, name, number)}, {})


def settled(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], cancel: bool, wait_s: float) -> int:
    """`pending`: tries to deliver what is open, or cancels it; returns the exit code: 0 if nothing is open."""
    ledgers = LedgerFile(fleet.path)
    with ledgers.changed() as ledger:
        ledger.expire(utc_s())
        before = {v.name: [order.number for order in ledger.open(v.name)] for v in vehicles}
    waiting = [vehicle for vehicle in vehicles if before[vehicle.name]]
    if not waiting:
        print("nothing is pending")
        return 0
    if cancel:
        dropped(fleet, waiting, ledgers, wait_s)
    else:
        troubles = delivered(fleet, waiting, ledgers, wait_s)
        for vehicle in waiting:
            for number in before[vehicle.name]:
                _report({vehicle.name: _found(ledgers, vehicle.name, number)}, troubles)
    return int(any(_is_open(ledgers, vehicle.name) for vehicle in waiting))


def _given(ledgers: Ledgers, vehicles: Sequence[RemoteVehicle], wish: OrderRequest) -> dict[str, int]:
    now_s = utc_s()
    with ledgers.changed() as ledger:
        give: Callable[[str], Given] = lambda name: ledger.give(name, wish.verb, now_s, wish.valid_s, wish.team)
        return {vehicle.name: give(vehicle.name).number for vehicle in vehicles}


def _found(ledgers: Ledgers, name: str, number: int) -> Given:
    with ledgers.changed() as ledger:
        ledger.expire(utc_s())
        return ledger.find(name, number)


def _is_open(ledgers: Ledgers, name: str) -> bool:
    with ledgers.changed() as ledger:
        return bool(ledger.open(name))


def _is_checked(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], ledgers: LedgerFile) -> bool:
    """Whether every vehicle was found without errors within a minute; asks those again that were not."""
    ledger, now_s = ledgers.read(), utc_s()
    late = [v for v in vehicles if not 0.0 <= now_s - ledger.checked.get(v.name, 0.0) <= CHECKED_S]
    if not late:
        return True
    reports, problems = check(fleet, vehicles, False, ledger.sent, ledger.laptop)
    errors = [problem for problem in problems if problem.level == "error"]
    note_checked(ledgers, reports, {problem.vehicle for problem in errors})
    idle = [name for name, report in reports.items() if not report.trouble and not report.facts["running"]]
    for problem in errors:
        print(f"{problem.vehicle}: {problem.text}", file=sys.stderr)
    for name in idle:
        start = f"auv_lse fleet {shlex.quote(str(fleet.path))} start {name}"
        print(f"{name}: its nodes do not run. Start them: {start}", file=sys.stderr)
    if errors or idle:
        print("GO was sent to no vehicle. Remove the errors, or override them with --anyway.", file=sys.stderr)
    return not errors and not idle


def note_checked(ledgers: LedgerFile, reports: Mapping[str, object], faulty: set[str]) -> None:
    """Notes which vehicles were found without errors now."""
    with ledgers.changed() as ledger:
        for name in reports:
            if faulty & {name, "fleet"}:
                ledger.checked.pop(name, None)
            else:
                ledger.checked[name] = utc_s()


def _taken_over(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], ledgers: LedgerFile) -> bool:
    """Makes this laptop the one that commands; reports from whom it took over."""
    with ledgers.changed() as ledger:
        laptop = ledger.laptop

    def one(vehicle: RemoteVehicle) -> tuple[bool, str]:
        try:
            with session(vehicle, fleet.ssh_config) as found:
                before = found.ask("take_over", 45.0, laptop=laptop, name=laptop_name())["before"]
        except (LinkError, VehicleError) as error:
            return False, f"not taken over: {error}"
        by = f"taken over from {before['name']}" if before and before["laptop"] != laptop else "commanded from here"
        return True, by

    answers = with_each(vehicles, one)
    for name, (_, text) in answers.items():
        print(f"{name}: {text}")
    return all(done for done, _ in answers.values())


def _report(found: Mapping[str, Given], troubles: Mapping[str, str]) -> None:
    for name, order in found.items():
        print(f"{name}: {sentence(order, troubles.get(name, ''))}", flush=True)


def _report_acoustic(found: Mapping[str, Given], is_for_team: bool) -> None:
    """Reports how vehicles that an abort has not reached can hear it under water."""
    acted = ", ".join(name for name, order in found.items() if order.status == ACTED)
    away = ", ".join(name for name, order in found.items() if order.is_open)
    if away and is_for_team and acted:
        print(f"Passed on to {away} by acoustic packet: the abort of {acted}, if packets have a tag (packet.tag).")
    elif away and not is_for_team:
        print(f"To reach {away} by acoustic packet, abort all: the vehicles in reach pass it on, and abort, too.")


def sentence(order: Given, trouble: str = "") -> str:
    """The outcome of an order, for people."""
    verb, why = order.verb.upper(), f" ({trouble})" if trouble else ""
    until = f" until {datetime.fromtimestamp(order.expires_s):%H:%M:%S}" if order.expires_s else ""
    if order.status == PENDING:
        return f"{verb} is pending{why}; it is sent when the vehicle answers `watch` or `pending`{until}"
    if order.status == UNKNOWN and order.counts:
        return f"{verb} was sent, its outcome is unknown{why}; the next contact asks for it"
    if order.status == UNKNOWN:
        return f"{verb} is cancelled, but may have been executed{why}; the next contact asks for it"
    if order.status == EXPIRED:
        return f"{verb} has expired; it was never sent"
    if order.status == DROPPED:
        return f"{verb} is cancelled; it was never sent"
    at = f" at {order.at}" if order.at else ""
    return f"{verb} {order.status}{at}: {order.text}" if order.text else f"{verb} {order.status}{at}"


def _choice(found: Mapping[str, Given]) -> str:
    """Asks the operator about the vehicles that are left; returns w, l, c or h."""
    gone = [name for name, order in found.items() if order.verb == "go" and order.status == ACTED]
    words = {"w": "[w]ait on", "l": "[l]eave it pending", "c": "[c]ancel it"}
    if gone:
        words["h"] = f"[h]old {', '.join(gone)}, and cancel the rest"
    while True:
        answer = input(f"{', '.join(words.values())}? ").strip().lower()[:1]
        if answer in words:
            return answer
