"""Delivers the orders that are due to one vehicle, in one session, again and again until they are answered."""

from collections.abc import Callable, Mapping
from typing import Any

from auv_lse_common.vocabulary.mission_run import STALES
from auv_lse_run.remote.orders import FOREIGN
from auv_lse_shore.remote.ledger import Given
from auv_lse_shore.remote.ledger_file import Ledgers
from auv_lse_shore.remote.ssh import RemoteSession, VehicleError

#: Longest wait (s) for the answer to an order: starting nodes takes some.
ANSWER_S = 60.0
#: Orders that are void if they arrive late.
_DATED = frozenset(command.name.lower() for command in STALES)


def deliver(asking: RemoteSession, ledgers: Ledgers, vehicle: str, name: str, clock: Callable[[], float]) -> str:
    """Delivers what is due to a vehicle in one session.

    Args:
        vehicle: "auv2".
        name: This laptop, for people.
        clock: The laptop's clock (s).

    Returns:
        Why something is not settled although the vehicle answers; "" if all is settled.

    Raises:
        LinkError: if the link is lost; repeat it then.
    """
    trouble = ""
    tried: set[tuple[str, int]] = set()
    while True:
        with ledgers.changed() as ledger:
            ledger.expire(clock())
            due = next((found for found in ledger.due(vehicle) if (found[0], found[1].number) not in tried), None)
            if due is None:
                return trouble
            what, order = due
            tried.add((what, order.number))
            ledger.note_sent(vehicle, order.number)
            laptop = ledger.laptop
        values = {"number": order.number, "verb": order.verb, "team": order.team, "laptop": laptop, "name": name}
        trouble = _sent(asking, ledgers, vehicle, what, order, values, clock) or trouble


def _sent(
    asking: RemoteSession,
    ledgers: Ledgers,
    vehicle: str,
    what: str,
    order: Given,
    values: Mapping[str, Any],
    clock: Callable[[], float],
) -> str:
    """Sends one order, and notes its answer; returns why it is not settled."""
    try:
        if what == "order" and order.verb in _DATED:  # by the vehicle's clock, a little too early if the answer is slow
            steady_s = asking.ask("clock", ANSWER_S).get("steady_s")
            if steady_s is None:
                return f"Its software cannot tell how old {order.verb} is. Update it to this laptop's version."
            values = {**values, "given_s": steady_s - (clock() - order.given_s), "valid_s": order.valid_s}
        answer = asking.ask(what, ANSWER_S, b"", **values)
    except VehicleError as error:
        return str(error)
    outcome, text = str(answer.get("outcome")), str(answer.get("text", ""))
    with ledgers.changed() as ledger:
        ledger.note_answer(vehicle, order.number, outcome, text, str(answer.get("at", "")))
        if outcome == FOREIGN:  # never executed: it was refused before it was recorded
            ledger.note_answer(vehicle, order.number, "refused", text)
        return text if ledger.find(vehicle, order.number).is_open else ""
