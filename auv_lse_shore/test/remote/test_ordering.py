"""GO needs a check of every vehicle within a minute; a laptop without space for recordings names the cure."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from auv_lse_run.remote.orders import ACTED
from auv_lse_shore.remote import fetching, ordering
from auv_lse_shore.remote.checking import utc_s
from auv_lse_shore.remote.fleet_file import FleetFile, FleetFileError, read_fleet
from auv_lse_shore.remote.judge import Problem, Report
from auv_lse_shore.remote.ledger import LedgerError
from auv_lse_shore.remote.ledger_file import LedgerFile


@pytest.fixture
def fleet(tmp_path: Path) -> FleetFile:
    (tmp_path / "fleet.yaml").write_text("vehicles: {auv1: {host: a}, auv2: {host: b}}\n")
    return read_fleet(tmp_path / "fleet.yaml")


def test_vehicles_are_named_as_for_the_other_orders(fleet: FleetFile) -> None:
    """Whoever aborts in a hurry types what comes to mind."""
    for typed, names in ((["2"], ["auv2"]), (["AUV2", "/auv1", "2"], ["auv2", "auv1"]), (["ALL"], ["auv1", "auv2"])):
        assert [vehicle.name for vehicle in fleet.chosen(typed)] == names
    with pytest.raises(FleetFileError, match="auv3 is not in"):
        fleet.chosen(["3"])


@pytest.fixture
def checks(monkeypatch: pytest.MonkeyPatch) -> list[Problem]:
    """The problems that a check finds; the vehicles' nodes run, and no order is delivered."""
    problems: list[Problem] = []
    reports = {name: Report(facts={"running": {"dive": "a"}}) for name in ("auv1", "auv2")}
    monkeypatch.setattr(ordering, "check", lambda *_: (reports, problems))
    monkeypatch.setattr(ordering, "delivered", lambda *_: {})
    return problems


def given(fleet: FleetFile) -> list[int]:
    ledger = LedgerFile(fleet.path).read()
    return [ledger.last(vehicle.name) for vehicle in fleet.vehicles]


def test_go_is_given_to_nobody_if_one_vehicle_has_an_error(
    fleet: FleetFile, checks: list[Problem], capsys: pytest.CaptureFixture[str]
) -> None:
    checks.append(Problem("auv2", "error", "its clock is wrong"))
    assert ordering.ordered(fleet, fleet.vehicles, ordering.OrderRequest(verb="go")) == 1
    assert "auv2: its clock is wrong\nGO was sent to no vehicle" in capsys.readouterr().err
    assert given(fleet) == [0, 0]
    ordering.ordered(fleet, fleet.vehicles, ordering.OrderRequest(verb="go", anyway=True))
    assert given(fleet) == [1, 1]


@pytest.mark.parametrize(("age_s", "is_given"), [(50.0, True), (61.0, False), (-5.0, False)])
def test_a_check_counts_for_a_minute(fleet: FleetFile, checks: list[Problem], age_s: float, is_given: bool) -> None:
    checks.append(Problem("fleet", "error", "only a new check finds this"))
    with LedgerFile(fleet.path).changed() as ledger:
        ledger.checked = {"auv1": utc_s(), "auv2": utc_s() - age_s}
    ordering.ordered(fleet, fleet.vehicles, ordering.OrderRequest(verb="go"))
    assert given(fleet) == [int(is_given)] * 2
    assert (LedgerFile(fleet.path).read().checked == {}) == (not is_given), "an error takes the check away"


def test_a_full_disk_of_the_laptop_is_named_with_the_cure(
    fleet: FleetFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def full(*_: Any) -> Iterator[None]:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(tmp_path / "bag.mcap.part"))
        yield

    monkeypatch.setattr(fetching, "session", full)
    found = fetching.fetch(fleet, fleet.vehicles[:1], tmp_path, 1.0, False, False)["auv1"]
    assert found.trouble == (
        f"{tmp_path}/bag.mcap.part: No space left on device. Make room on this laptop; the same command continues."
    )


def test_an_abort_tells_how_a_vehicle_that_is_out_of_reach_hears_it(
    fleet: FleetFile, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def reach_the_first(fleet: FleetFile, vehicles: Any, ledgers: Any, wait_s: float) -> dict[str, str]:
        with ledgers.changed() as ledger:
            for vehicle in vehicles:
                if vehicle.name == "auv1":
                    ledger.note_answer("auv1", ledger.last("auv1"), ACTED)
        return {"auv2": "It is out of reach or off."}

    monkeypatch.setattr(ordering, "delivered", reach_the_first)
    assert ordering.ordered(fleet, fleet.vehicles, ordering.OrderRequest(verb="abort", team=True)) == 1
    assert "Passed on to auv2 by acoustic packet: the abort of auv1" in capsys.readouterr().out
    assert ordering.ordered(fleet, fleet.vehicles[1:], ordering.OrderRequest(verb="abort")) == 1
    assert "To reach auv2 by acoustic packet, abort all" in capsys.readouterr().out
    ordering.ordered(fleet, fleet.vehicles[:1], ordering.OrderRequest(verb="abort"))
    assert "acoustic" not in capsys.readouterr().out


def test_an_abort_is_sent_although_the_ledger_is_damaged(
    fleet: FleetFile, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given: list[str] = []

    def deliver(fleet: FleetFile, vehicles: Any, ledgers: Any, wait_s: float) -> dict[str, str]:
        with ledgers.changed() as ledger:
            given.extend(vehicle.name for vehicle in vehicles if ledger.last(vehicle.name))
        return {}

    monkeypatch.setattr(ordering, "delivered", deliver)
    ordering.ordered(fleet, fleet.vehicles[:1], ordering.OrderRequest(verb="hold"))
    path = LedgerFile(fleet.path).path
    path.write_text(path.read_text()[:-20])
    ordering.ordered(fleet, fleet.vehicles[:1], ordering.OrderRequest(verb="abort"))
    assert given == ["auv1", "auv1"]
    assert "is damaged" in capsys.readouterr().err
    with pytest.raises(LedgerError, match="is damaged"):
        ordering.ordered(fleet, fleet.vehicles[:1], ordering.OrderRequest(verb="go", anyway=True))
