"""Laptop and vehicle together: each order acts exactly once over a link that loses, repeats and delays."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from auv_lse_run.remote.orders import ACTED, ALWAYS, VERBS, Order
from auv_lse_run.remote.session import Session
from auv_lse_shore.remote.delivery import deliver
from auv_lse_shore.remote.ledger import DROPPED, EXPIRED, PENDING, UNKNOWN, Ledger
from auv_lse_shore.remote.ledger_file import LedgerFile
from auv_lse_shore.remote.ssh import LinkError


class Kept:
    """A ledger in memory that a killed laptop reads again."""

    def __init__(self) -> None:
        self.values = Ledger("one").values()

    @contextmanager
    def changed(self) -> Iterator[Ledger]:
        ledger = Ledger("", self.values)
        yield ledger
        self.values = ledger.values()


class Noting:
    """A vehicle that notes what it executes."""

    def __init__(self) -> None:
        self.executed: list[tuple[int, str]] = []

    def act(self, order: Order) -> tuple[str, str]:
        self.executed.append((order.number, order.verb))
        return ACTED, ""

    def state(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        return


class BadLink:
    """Loses requests and answers, delivers some twice, and some again long after."""

    def __init__(self, folder: Path, actor: Noting, seed: int, loss: float) -> None:
        self._folder, self._actor, self._loss = folder, actor, loss
        self._random = random.Random(seed)
        self._late: list[dict[str, Any]] = []

    def ask(self, what: str, wait_s: float, data: bytes = b"", **values: Any) -> dict[str, Any]:
        asked = {"ask": what, **values}
        if self._late and self._random.random() < 0.3:
            self._session().answer(self._late.pop(self._random.randrange(len(self._late))))
        if self._random.random() < self._loss:
            if self._random.random() < 0.5:
                self._late.append(asked)
            raise LinkError("lost")
        answer = self._session().answer(asked)
        if self._random.random() < 0.1:
            answer = self._session().answer(asked)
        if self._random.random() < self._loss:
            raise LinkError("lost")
        return answer

    def _session(self) -> Session:
        return Session(self._folder, 1, 230, self._actor)  # the vehicle forgets all but its files


def test_every_order_acts_once_and_in_order_over_a_link_that_loses_a_third(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.fsync", lambda descriptor: None)  # the disk is not what is tested here
    kept, actor, chance = Kept(), Noting(), random.Random(3)
    link = BadLink(tmp_path, actor, 4, 0.3)
    given = []
    for _ in range(60):
        with kept.changed() as ledger:
            given.append(ledger.give("auv1", chance.choice(VERBS), 0.0))
        for _ in range(40):
            try:
                assert deliver(link, kept, "auv1", "boat", lambda: 0.0) == ""
            except LinkError:
                continue
            break
    with kept.changed() as ledger:
        assert ledger.open("auv1") == [], "no outcome is unknown"
        statuses = {ledger.find("auv1", order.number).status for order in given}
    assert statuses == {ACTED}
    assert actor.executed == [(order.number, order.verb) for order in given]


def test_a_go_that_an_abort_replaces_is_not_executed_wherever_it_was(tmp_path: Path) -> None:
    kept, actor = Kept(), Noting()
    with kept.changed() as ledger:
        ledger.give("auv1", "go", 0.0)
        ledger.note_sent("auv1", 1)  # and lost, or still on its way
        ledger.give("auv1", "reset", 0.0)
        ledger.give("auv1", "abort", 0.0)
        assert [ledger.find("auv1", n).status for n in (1, 2, 3)] == [UNKNOWN, DROPPED, PENDING]
    session = Session(tmp_path, 1, 230, actor)
    link = BadLink(tmp_path, actor, 1, 0.0)
    assert deliver(link, kept, "auv1", "boat", lambda: 0.0) == ""
    session.answer({"ask": "order", "laptop": "one", "number": 1, "verb": "go"})  # it arrives now
    assert actor.executed == [(3, "abort")]
    with kept.changed() as ledger:
        assert [ledger.find("auv1", n).status for n in (1, 2, 3)] == ["overtaken", DROPPED, ACTED]


class Timed(Noting):
    """Notes how old each order is when it is executed, and for how long it counts."""

    def __init__(self) -> None:
        super().__init__()
        self.ages_s: list[tuple[float | None, float]] = []

    def act(self, order: Order) -> tuple[str, str]:
        age_s = None if order.given_s is None else time.monotonic() - order.given_s
        self.ages_s.append((age_s, order.valid_s))
        return super().act(order)


@pytest.mark.parametrize("verb", ["go", "reset"])
def test_a_vehicle_knows_how_old_an_order_is_that_may_move_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    """Pending for 300 s, then 15 s in the link."""
    kept, actor, vehicle_s = Kept(), Timed(), [5000.0]
    monkeypatch.setattr(time, "monotonic", lambda: vehicle_s[0])
    with kept.changed() as ledger:
        ledger.give("auv1", verb, 1000.0, valid_s=600.0)
    session = Session(tmp_path, 1, 230, actor)

    class Slow:
        def ask(self, what: str, wait_s: float, data: bytes = b"", **values: Any) -> dict[str, Any]:
            vehicle_s[0] += 15.0 * (what == "order")
            return session.answer({"ask": what, **values})

    assert deliver(Slow(), kept, "auv1", "boat", lambda: 1300.0) == ""
    assert actor.ages_s == [(315.0, 600.0)]


def test_an_order_is_not_sent_after_the_laptops_clock_was_set_back() -> None:
    """Nobody knows how old it is."""
    ledger = Ledger("one")
    ledger.give("auv1", "go", 1000.0, valid_s=600.0)
    ledger.expire(900.0)
    assert ledger.find("auv1", 1).status == EXPIRED


def test_an_order_that_must_not_wait_expires_at_once() -> None:
    ledger = Ledger("one")
    ledger.give("auv1", "go", 1000.0, valid_s=0.0)
    ledger.expire(1000.0)
    assert ledger.find("auv1", 1).status == EXPIRED


def test_a_pending_go_expires_and_a_safe_order_does_not() -> None:
    ledger = Ledger("one")
    ledger.give("auv1", "go", 100.0, valid_s=60.0)
    ledger.give("auv2", "abort", 100.0, valid_s=60.0)
    ledger.expire(159.0)
    assert ledger.find("auv1", 1).status == PENDING
    ledger.expire(160.0)
    assert ledger.find("auv1", 1).status == EXPIRED
    assert ledger.find("auv2", 1).status == PENDING
    assert ledger.due("auv1") == []


def test_a_sent_go_that_expires_is_asked_for_and_not_repeated() -> None:
    ledger = Ledger("one")
    ledger.give("auv1", "go", 0.0, valid_s=60.0)
    ledger.note_sent("auv1", 1)
    ledger.expire(61.0)
    assert [what for what, _ in ledger.due("auv1")] == ["cancel"]


def test_a_laptop_that_comes_back_knows_what_is_pending(tmp_path: Path) -> None:
    file = LedgerFile(tmp_path / "fleet.yaml")
    with file.changed() as ledger:
        ledger.give("auv3", "go", 0.0, valid_s=600.0)
        laptop = ledger.laptop
    again = LedgerFile(tmp_path / "fleet.yaml").read()
    assert again.laptop == laptop
    assert [(order.verb, order.status) for order in again.open("auv3")] == [("go", PENDING)]


def test_what_makes_safer_goes_first() -> None:
    ledger = Ledger("one")
    for verb in VERBS:
        ledger.give("auv1", verb, 0.0)
    assert {order.verb for _, order in ledger.due("auv1")[:1]} <= ALWAYS
