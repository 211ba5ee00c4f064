"""auv_lse fleet check: asks every vehicle, and prints one table and one line per problem."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from auv_lse_common.support.installed_copy import copy_of
from auv_lse_common.support.plurals import counted
from auv_lse_shore.remote.clocks import ClockOffset, clock_offset
from auv_lse_shore.remote.contacts import with_each
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.judge import Problem, Report, judged
from auv_lse_shore.remote.ssh import LinkError, RemoteSession, VehicleError, session

#: Time (s) for a vehicle's own checks, and for a quick report.
_THOROUGH_S, _QUICK_S = 90.0, 30.0
_CLOCK_QUESTIONS = 5
_MARKS = {"error": "✗", "warning": "!"}


def own_version() -> str:
    """The laptop's version of the software."""
    copy = copy_of("auv_lse_shore")
    return "?" if copy is None else copy.version


def utc_s() -> float:
    """The laptop's clock, in seconds of Unix time."""
    return datetime.now(UTC).timestamp()


def report_of(vehicle: RemoteVehicle, fleet: FleetFile, thorough: bool) -> Report:
    """A vehicle's report, or why there is none."""
    try:
        with session(vehicle, fleet.ssh_config) as found:
            clock = _clock(found)
            facts = found.ask("facts", _THOROUGH_S if thorough else _QUICK_S, thorough=thorough)
    except (LinkError, VehicleError) as error:
        return Report(trouble=str(error))
    return Report(facts=facts, clock=clock)


def _clock(found: RemoteSession) -> ClockOffset:
    """The vehicle's clock by the question with the shortest round trip."""
    tried = []
    for _ in range(_CLOCK_QUESTIONS):
        sent_s = utc_s()
        vehicle_s = float(found.ask("clock", _QUICK_S)["clock_s"])
        tried.append(clock_offset(sent_s, vehicle_s, utc_s()))
    return min(tried, key=lambda clock: clock.error_s)


def check(
    fleet: FleetFile, vehicles: Sequence[RemoteVehicle], thorough: bool, sent: Mapping[str, str], laptop: str
) -> tuple[dict[str, Report], list[Problem]]:
    """Asks vehicles at the same time; returns their reports and the problems.

    Args:
        thorough: Whether the vehicles' own checks run.
        sent: As `judged` takes it.
    """
    reports = with_each(vehicles, lambda vehicle: report_of(vehicle, fleet, thorough))
    return reports, judged(reports, own_version(), sent, laptop)


def show(console: Console, reports: Mapping[str, Report], problems: Sequence[Problem]) -> None:
    """Prints the table, and a line per problem."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("vehicle", "", "version", "clock", "disk", "battery", "mission", "key", "nodes"):
        table.add_column(column, no_wrap=True)
    for name, report in reports.items():
        level = _worst(problem.level for problem in problems if problem.vehicle == name)
        table.add_row(name, _MARKS.get(level, "✓"), *_cells(report))
    console.print(table)
    for problem in problems:
        line = f"{problem.vehicle}: {'' if problem.level == 'error' else 'warning: '}{problem.text}"
        console.print(Text(line), soft_wrap=True, highlight=False)
    errors = sum(problem.level == "error" for problem in problems)
    warnings = len(problems) - errors
    console.print(f"{counted(errors, 'error')}, {counted(warnings, 'warning')}", highlight=False)


def _worst(levels: Any) -> str:
    found = set(levels)
    return "error" if "error" in found else "warning" if found else ""


def _cells(report: Report) -> list[str]:
    if report.trouble:
        return ["no answer", *[""] * 6]
    facts = report.facts
    autopilot = facts.get("state", {}).get("autopilot") or {}
    battery = autopilot.get("battery")
    key = facts.get("mission", {}).get("hashes", {}).get("packet.key_file", "")
    state = (facts.get("state", {}).get("mission") or {}).get("state", "")
    return [
        facts["version"],
        "" if report.clock is None else report.clock.text,
        f"{facts['free_mb'] / 1000:.1f} GB",
        "-" if battery is None else f"{100 * battery:.0f} %",
        facts["hashes"].get("mission.yaml", "")[:8] or "-",
        key[:8] or "-",
        state or ("run" if facts["running"] else "do not run"),
    ]
