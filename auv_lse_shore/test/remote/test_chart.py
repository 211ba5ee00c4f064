"""The team's chart is filled from excerpts, and what was recorded while a vehicle was away is filled in afterwards."""

from __future__ import annotations

import shutil
import time
import zlib
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from auv_lse_record.run_writer import write_run
from auv_lse_run.remote.session import Session
from auv_lse_shore.live.sources.timeline import Event
from auv_lse_shore.remote.chart import ChartError, TeamChart
from auv_lse_shore.remote.picture import VehicleView
from auv_lse_shore.remote.watching import cells


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, synthetic_run: Callable[[], Any]) -> Path:
    folder = tmp_path_factory.mktemp("chart") / "run"
    write_run(synthetic_run(), folder)
    return folder / "bag" / "bag.mcap"


@pytest.fixture
def chart() -> Iterator[TeamChart]:
    with TeamChart("lake", [1, 2]) as chart:
        yield chart


class Vehicle:
    """A vehicle whose dive has the first part of a recording."""

    def __init__(self, folder: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self.name, self._folder, self._session = f"auv{number}", folder, Session(folder, number, 80 + number)
        monkeypatch.setattr(self._session, "_running", lambda: str(self._dive))

    def dives(self, dive: str, recorded: Path, share: float) -> None:
        path = self._folder / "dives" / dive / "bag" / "bag.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        data = recorded.read_bytes()
        path.write_bytes(data[: int(share * len(data))])
        self._dive = path.parent.parent

    def fill(self, chart: TeamChart) -> None:
        while chart.take(self.name, self._session.answer({"ask": "excerpt", **chart.request(self.name)})):
            pass


def events(chart: TeamChart, kind: str, vehicle: int) -> list[Event]:
    found = chart.timeline.since("", 0, 10**6)[2]
    return [event for event in found if event["kind"] == kind and event.get("vehicle") == vehicle]


def wait_for(what: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def test_what_a_vehicle_recorded_while_it_was_away_is_filled_in(
    recorded: Path, chart: TeamChart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = (Vehicle(tmp_path / f"auv{k}", k, monkeypatch) for k in (1, 2))
    for vehicle in (one, two):
        vehicle.dives("monday", recorded, 0.3)
        vehicle.fill(chart)
    last = lambda k: max((event["t"] for event in events(chart, "pose", k)), default=-1.0)
    wait_for(lambda: min(last(1), last(2)) > 0.0)
    away_s = last(2)
    one.dives("monday", recorded, 1.0)
    one.fill(chart)
    wait_for(lambda: last(1) > away_s + 100.0)
    assert last(2) == away_s
    two.dives("monday", recorded, 1.0)
    two.fill(chart)
    wait_for(lambda: last(2) > away_s + 100.0)
    stamps = sorted(event["t"] for event in events(chart, "pose", 2))
    assert max(b - a for a, b in pairwise(stamps)) <= 4.0, "no gap is left"
    for kind in ("plan", "map"):
        wait_for(lambda kind=kind: all(events(chart, kind, k) for k in (1, 2)))
    assert len(events(chart, "map", 1)) <= 3, "maps of the past are not computed one by one"
    assert chart.trouble == {}


def test_a_new_dive_replaces_the_old_one_and_that_of_the_others_stays(
    recorded: Path, chart: TeamChart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = (Vehicle(tmp_path / f"auv{k}", k, monkeypatch) for k in (1, 2))
    for vehicle, dive, share in ((one, "monday", 1.0), (two, "monday", 1.0), (two, "tuesday", 0.3)):
        vehicle.dives(dive, recorded, share)
        vehicle.fill(chart)
        wait_for(lambda vehicle=vehicle: bool(events(chart, "pose", int(vehicle.name[3:]))))
    before = len(events(chart, "pose", 1))
    wait_for(lambda: 0 < len(events(chart, "pose", 2)) < 0.7 * before == 0.7 * len(events(chart, "pose", 1)))
    shutil.rmtree(tmp_path / "auv2")  # fetched and deleted: what is shown stays
    two.fill(chart)
    time.sleep(1.0)
    assert events(chart, "pose", 2)


def test_what_is_no_excerpt_is_named(chart: TeamChart) -> None:
    for answer in ({"cursor": {"dive": "a"}, "data": b"x"}, {"cursor": 3}, {}):
        with pytest.raises(ChartError, match="is damaged"):
            chart.take("auv1", answer)


def test_a_row_has_the_age_and_what_is_expected() -> None:
    position = {"north_m": 0.0, "east_m": 0.0, "depth_m": 5.0, "speed_mps": 1.0, "age_s": 0.0}
    state = {
        "mission": {"state": "RUNNING", "age_s": 1.0},
        "position": position,
        "path": {"north_east_m": [[0.0, 0.0], [50.0, 0.0]]},
        "autopilot": {"battery": 0.62},
        "legs": {"legs left by battery": 31, "legs planned": 45},
    }
    view = VehicleView("auv1", {"running": True, "state": state}, 100.0, "out of reach", "one")
    assert cells(view, 110.0) == [
        "RUNNING",
        "10, 0 expected",
        "5.0 m",
        "62 %, 31 legs (45 planned)",
        "11 s",
        "under water",
    ]
    assert cells(VehicleView("auv1"), 0.0) == ["no answer", "", "", "", "", "asking"]


def test_a_recording_that_cannot_be_shown_is_named_and_the_others_are_shown(
    recorded: Path, chart: TeamChart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chart.take(
        "auv2",
        {
            "cursor": {"dive": "a", "file": "b"},
            "data": zlib.compress(b"\x06" + (40).to_bytes(8, "little") + bytes(range(40))),
        },
    )
    wait_for(lambda: "auv2" in chart.trouble)
    one = Vehicle(tmp_path / "auv1", 1, monkeypatch)
    one.dives("monday", recorded, 0.3)
    one.fill(chart)
    wait_for(lambda: bool(events(chart, "pose", 1)))
    assert chart.trouble["auv2"].startswith("its recording cannot be shown: ")
