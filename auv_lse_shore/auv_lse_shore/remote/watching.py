"""auv_lse fleet watch: one table for the team, asked over a session with each; delivers what is pending on contact."""

from __future__ import annotations

import math
import select
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import IO, Any

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import error_text
from auv_lse_common.vocabulary.health import LEGS_LEFT, LEGS_PLANNED
from auv_lse_shore.live.viewers.server import port_or_any, served
from auv_lse_shore.remote.chart import ChartError, TeamChart
from auv_lse_shore.remote.checking import utc_s
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.ledger_file import LedgerFile
from auv_lse_shore.remote.ordering import delivered, sentence
from auv_lse_shore.remote.picture import VehicleView
from auv_lse_shore.remote.ssh import LinkError, RemoteSession, VehicleError, session

_ANSWER_S, _RETRY_S = 15.0, 2.0
_BELL = "\a"
#: Minimum time (s) between two tables where a table cannot be redrawn: in a file, a pipe or an editor's shell.
_PRINTED_S = 5.0
#: The columns of `cells`.
COLUMNS = ("state", "north, east", "depth", "battery", "age", "link")


class Watch:
    """Asks every vehicle for its state, each in a thread of its own."""

    def __init__(
        self,
        fleet: FleetFile,
        vehicles: Sequence[RemoteVehicle],
        every_s: float,
        chart: TeamChart | None = None,
    ) -> None:
        """Asks nothing yet.

        Args:
            every_s: Time between questions to a vehicle (s).
            chart: Receives excerpts of the vehicles' recordings; None: none are fetched.
        """
        self.chart, self._chart_trouble = chart, dict[str, str]()
        self._fleet, self._vehicles, self._every_s = fleet, vehicles, every_s
        self.ledgers = LedgerFile(fleet.path)
        with self.ledgers.changed() as ledger:
            laptop = ledger.laptop
        self.views = {vehicle.name: VehicleView(vehicle.name, laptop=laptop) for vehicle in vehicles}
        self._over = threading.Event()
        #: Set by a vehicle that was asked once, with or without an answer.
        self.asked = {vehicle.name: threading.Event() for vehicle in vehicles}

    def __enter__(self) -> Watch:
        """Begins to ask."""
        for vehicle in self._vehicles:
            threading.Thread(target=self._follow, args=(vehicle,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the questions."""
        self._over.set()

    def _follow(self, vehicle: RemoteVehicle) -> None:
        view = self.views[vehicle.name]
        while not self._over.is_set():
            try:
                with session(vehicle, self._fleet.ssh_config) as found:
                    while not self._over.is_set() and not self._is_due(vehicle.name):
                        asked_s = time.monotonic()
                        answer = found.ask("state", _ANSWER_S)
                        view.answer, view.asked_s, view.trouble = answer, asked_s, ""
                        self.asked[vehicle.name].set()
                        self._follow_recording(found, vehicle.name, asked_s + self._every_s)
                        self._over.wait(max(asked_s + self._every_s - time.monotonic(), 0.0))
                if self._is_due(vehicle.name):  # in a session of its own: an order is fresh only then
                    delivered(self._fleet, [vehicle], self.ledgers, 0.0)
                    self._over.wait(self._every_s)
            except (LinkError, VehicleError) as error:
                view.trouble = str(error)
                self.asked[vehicle.name].set()
                self._over.wait(_RETRY_S)

    def _follow_recording(self, found: RemoteSession, name: str, until_s: float) -> None:
        """Fetches the part of the recording that the chart lacks: one excerpt, and more until `until_s`."""
        if self.chart is None:
            return
        try:
            while self.chart.take(name, found.ask("excerpt", _ANSWER_S, **self.chart.request(name))):
                if time.monotonic() >= until_s or self._over.is_set():
                    break
            self._chart_trouble.pop(name, None)
        except (ChartError, VehicleError, OSError) as error:  # the laptop's full disk must not end the watch
            self._chart_trouble[name] = error_text(error)

    def chart_trouble(self, name: str) -> str:
        """Why the chart of a vehicle is incomplete; "" if it is not."""
        shown = {} if self.chart is None else self.chart.trouble
        return self._chart_trouble.get(name) or shown.get(name, "")

    def _is_due(self, name: str) -> bool:
        return bool(self.ledgers.read().due(name))


def watch(
    fleet: FleetFile, vehicles: Sequence[RemoteVehicle], every_s: float, once: bool, page: int | None = None
) -> int:
    """Shows the team until Ctrl-C, or without a page until the reader of its lines ends; with `once`, one table.

    Returns the exit code: 1 if there are alarms in the one table.

    Args:
        every_s: Time between questions to a vehicle (s).
        once: Whether to end after one table.
        page: Port of the page; None: no page.
    """
    console = Console()
    with ExitStack() as stack:
        chart = None
        if page is not None:
            chart = stack.enter_context(TeamChart(fleet.path.stem, [vehicle.number for vehicle in vehicles]))
            print(f"the team's page: {stack.enter_context(served(chart.timeline, port_or_any(page)))}", flush=True)
        found = stack.enter_context(Watch(fleet, vehicles, every_s, chart))
        if once:
            for asked in found.asked.values():
                asked.wait(60.0)
            time.sleep(2.5 * every_s)  # a latched state has an age only when the next one has come
            table, lines = _shown(found, time.monotonic())
            _print(console, table, lines)
            return int(bool(lines))
        known, live, printed_s = set[str](), None, -math.inf
        if console.is_terminal and not console.is_dumb_terminal:
            live = stack.enter_context(Live(console=console, auto_refresh=False, screen=page is None))
        while chart is not None or _is_read(console.file):
            now_s = time.monotonic()
            table, lines = _shown(found, now_s)
            if chart is not None:
                chart.timeline.set_state(team=page_picture(found, now_s))
            if set(lines) - known and console.is_terminal:
                console.file.write(_BELL)
            known = set(lines)
            if live is not None:
                live.update(_stacked(table, lines), refresh=True)
            elif now_s - printed_s >= max(every_s, _PRINTED_S):
                printed_s = now_s
                _print(console, table, lines)
            time.sleep(1.0)
    return 0


def _is_read(stream: IO[str]) -> bool:
    """Whether a stream still has a reader: that of a pipe, such as `head`, may have ended."""
    poll = select.poll()
    try:
        poll.register(stream.fileno(), 0)
    except OSError:  # a stream without a descriptor
        return True
    return not any(event & select.POLLERR for _, event in poll.poll(0))


def _print(console: Console, table: Table, lines: Sequence[str]) -> None:
    console.print(table)
    for line in lines:
        console.print(Text(line), soft_wrap=True, highlight=False)


def _stacked(table: Table, lines: Sequence[str]) -> Table:
    stacked = Table.grid()
    stacked.add_row(table)
    for line in lines:
        stacked.add_row(Text(line, style="bold red"))
    return stacked


def _shown(found: Watch, now_s: float) -> tuple[Table, list[str]]:
    """The table, and a line per alarm and per open order."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("vehicle", *COLUMNS):
        table.add_column(column, no_wrap=True)
    lines = []
    ledger = found.ledgers.read()
    ledger.expire(utc_s())
    for name, view in found.views.items():
        table.add_row(name, *cells(view, now_s))
        lines += [f"{name}: {text}" for text in view.alarms(now_s)]
        lines += [f"{name}: {sentence(order, view.trouble)}" for order in ledger.open(name)]
        lines += [f"{name}: {text}" for text in (found.chart_trouble(name),) if text]
    return table, lines


def page_picture(found: Watch, now_s: float) -> dict[str, Any]:
    """The page's values beside the chart: a row for each vehicle, and lines of alarms and open orders."""
    vehicles = []
    for name, view in found.views.items():
        position, row = view.position(now_s), cells(view, now_s)
        expected = list(position[:2]) if position is not None and position[2] else None
        vehicles.append({"number": int(name.removeprefix("auv")), "cells": row, "expected": expected})
    return {"columns": list(COLUMNS), "vehicles": vehicles, "lines": _shown(found, now_s)[1]}


def _legs(legs: Mapping[str, int]) -> str:
    """The legs left by battery beside those planned; "" until they are known."""
    left = legs.get(LEGS_LEFT)
    return "" if left is None else f", {counted(left, 'leg')} ({legs.get(LEGS_PLANNED, '?')} planned)"


def cells(view: VehicleView, now_s: float) -> list[str]:
    """A vehicle's row."""
    position, depth_m = view.position(now_s), view.part("position").get("depth_m")
    battery = view.part("autopilot").get("battery")
    age_s = view.age_s("mission", now_s) if view.answer.get("running") else None
    if view.answer and not view.answer.get("running"):
        age_s = now_s - view.asked_s
    legs = _legs(view.part("legs")) if view.state == "RUNNING" else ""
    link = "under water" if view.trouble and view.answer and view.is_under_water() else "out of reach"
    return [
        view.state,
        "" if position is None else f"{position[0]:.0f}, {position[1]:.0f}{' expected' if position[2] else ''}",
        "" if depth_m is None else f"{depth_m:.1f} m",
        "" if battery is None else f"{100 * battery:.0f} %{legs}",
        "" if not view.answer else "unknown" if age_s is None else f"{age_s:.0f} s",
        link if view.trouble else "up" if view.answer else "asking",
    ]
