"""Orders are recorded, executed once, and answered, whatever is repeated, late or torn."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from auv_lse_run.remote import session as sessions
from auv_lse_run.remote.order_store import OrderStore
from auv_lse_run.remote.orders import (
    ACTED,
    CANCELLED,
    FOREIGN,
    INTERRUPTED,
    MAX_KEPT,
    OVERTAKEN,
    REFUSED,
    STALE,
    UNRECORDED,
    VALID_S,
    Answer,
    Order,
    OrderBook,
    OrderError,
)
from auv_lse_run.remote.session import Session


def order(number: int, verb: str = "go", laptop: str = "one") -> Order:
    return Order(laptop, number, verb, name=f"{laptop}@boat")


def acted(book: OrderBook, taken: Order, text: str = "") -> None:
    assert book.take(taken, 0.0, "") is None
    book.note(taken, Answer(ACTED, text))


def test_a_repeated_order_gets_its_answer_again_even_after_a_restart_and_when_it_is_late() -> None:
    book = OrderBook()
    acted(book, order(1), "gone")
    again = OrderBook(json.loads(json.dumps(book.values())))
    answer = again.take(order(1), 2 * VALID_S, "")
    assert answer is not None
    assert (answer.outcome, answer.text) == (ACTED, "gone")


def test_an_order_that_was_recorded_and_not_answered_is_executed_unless_a_later_one_was() -> None:
    book = OrderBook()
    assert book.take(order(1), 0.0, "") is None  # power fails here
    book = OrderBook(book.values())
    assert book.take(order(1), 0.0, "") is None
    assert book.take(order(2, "hold"), 0.0, "") is None
    answer = book.take(order(1), 0.0, "")
    assert answer is not None
    assert answer.outcome == INTERRUPTED


def test_an_old_order_that_arrives_late_is_never_executed() -> None:
    book = OrderBook()
    acted(book, order(2, "abort"))
    for late in (order(1), order(1, "start")):
        answer = book.take(late, 0.0, "")
        assert answer is not None
        assert answer.outcome == OVERTAKEN


def test_an_order_that_hung_in_the_link_is_not_executed() -> None:
    book = OrderBook()
    answer = book.take(order(1), VALID_S + 0.1, "")
    assert answer is not None
    assert answer.outcome == STALE
    assert not answer.is_final
    acted(book, order(1))  # repeated in a new session


def test_a_cancelled_order_is_never_executed_and_an_executed_one_keeps_its_answer() -> None:
    book = OrderBook()
    assert book.cancel(order(1), "").outcome == CANCELLED
    answer = book.take(order(1), 0.0, "")
    assert answer is not None
    assert answer.outcome == CANCELLED
    acted(book, order(2))
    assert book.cancel(order(2), "").outcome == ACTED
    assert book.take(order(3), 0.0, "") is None
    assert book.cancel(order(3), "").outcome == INTERRUPTED


def test_a_second_laptop_may_abort_and_take_over() -> None:
    book = OrderBook()
    acted(book, order(1))
    answer = book.take(order(1, "hold", "two"), 0.0, "")
    assert answer is not None
    assert answer.outcome == FOREIGN
    assert "one@boat" in answer.text
    acted(book, order(1, "abort", "two"))
    book.take_over("two", "two@boat", "noon")
    acted(book, order(2, "hold", "two"))
    answer = book.take(order(2), 0.0, "")
    assert answer is not None
    assert "two@boat has commanded this vehicle since noon" in answer.text


def test_old_answers_are_forgotten_and_their_orders_stay_executed() -> None:
    book = OrderBook()
    for number in range(1, MAX_KEPT + 10):
        acted(book, order(number))
    assert len(book.values()["orders"]) == MAX_KEPT
    answer = book.take(order(1), 0.0, "")
    assert answer is not None
    assert answer.outcome == OVERTAKEN


@pytest.mark.parametrize(
    "values", [{"laptop": ""}, {"number": 0}, {"number": True}, {"number": 2**40}, {"verb": "fly"}, {"given_s": "soon"}]
)
def test_an_impossible_order_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(OrderError):
        Order.read({"laptop": "one", "number": 1, "verb": "go", **values})


class Noting:
    """Executes by noting."""

    def __init__(self) -> None:
        self.executed: list[str] = []

    def act(self, given: Order) -> tuple[str, str]:
        self.executed.append(given.verb)
        if given.verb == "reset":
            raise RuntimeError("ROS broke")
        return ACTED, ""

    def state(self) -> dict[str, object]:
        return {}

    def close(self) -> None:
        return


def ask(session: Session, number: int, verb: str, laptop: str = "one") -> dict[str, object]:
    found: dict[str, object] = session.answer({"ask": "order", "laptop": laptop, "number": number, "verb": verb})
    return found


def test_an_order_that_breaks_is_answered(tmp_path: Path) -> None:
    answer = ask(Session(tmp_path, 1, 230, Noting()), 1, "reset")
    assert (answer["outcome"], answer["text"]) == (REFUSED, "RuntimeError: ROS broke")


def test_without_storage_only_what_makes_safer_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: OrderStore, book: OrderBook) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(OrderStore, "write", full)
    actor = Noting()
    session = Session(tmp_path, 1, 230, actor)
    answer = ask(session, 1, "go")
    assert (answer["outcome"], str(answer["text"]).endswith(". Free space on the vehicle.")) == (UNRECORDED, True)
    for number, verb in enumerate(("hold", "surface", "abort", "stop"), 2):
        answer = ask(session, number, verb)
        assert answer["outcome"] == ACTED
        assert "No space left on device" in str(answer["text"])
    assert actor.executed == ["hold", "surface", "abort", "stop"]


@pytest.mark.parametrize(
    ("content", "fault"), [('{"orders": [{}]}', "KeyError: 'order'"), ("[]]", "Extra data: line 1 column 3 (char 2)")]
)
def test_a_damaged_record_stops_go_with_one_cure_and_does_not_stop_abort(
    tmp_path: Path, content: str, fault: str
) -> None:
    (tmp_path / "fleet").mkdir()
    file = tmp_path / "fleet" / "orders.json"
    file.write_text(content)
    actor = Noting()
    session = Session(tmp_path, 1, 230, actor)
    answer = ask(session, 1, "go")
    assert answer["outcome"] == UNRECORDED
    damaged = f"{file} is damaged ({fault}). Move it away, and repeat the order"
    assert answer["text"] == f"It cannot be recorded, so it is not executed: {damaged}."
    assert ask(session, 2, "abort")["outcome"] == ACTED
    assert actor.executed == ["abort"]


def test_an_abort_does_not_wait_for_an_order_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "_ABORT_WAIT_S", 0.1)
    actor, began_s = Noting(), time.monotonic()
    with OrderStore(tmp_path).opened(1.0):
        assert ask(Session(tmp_path, 1, 230, actor), 1, "abort")["outcome"] == ACTED
    assert actor.executed == ["abort"]
    assert time.monotonic() - began_s < 1.0


def test_a_torn_file_of_orders_leaves_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(tmp_path, 1, 230, Noting())
    ask(session, 1, "go")

    def torn(descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as broken:
        broken.setattr(os, "fsync", torn)
        ask(session, 2, "hold")
    assert ask(session, 1, "go")["outcome"] == ACTED
    assert OrderStore(tmp_path).read().values()["highest"] == {"one": 1}


def test_nodes_that_cannot_be_asked_end_no_session(tmp_path: Path) -> None:
    class Broken(Noting):
        def state(self) -> dict[str, object]:
            raise RuntimeError("failed to initialize ROS")

    assert Session(tmp_path, 1, 230, Broken()).answer({"ask": "state"}) == {"error": "failed to initialize ROS"}
