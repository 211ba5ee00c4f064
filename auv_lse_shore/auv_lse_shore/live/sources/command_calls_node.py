"""Sends the page's commands to the vehicles' missions, as auv_lse go does."""

import getpass
import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from rclpy.node import Node

from auv_lse_run.inspect.mission_calls_node import CommandCalls
from auv_lse_shore.live.sources.command_queue import MISSION_ENDED, CommandQueue, Order, Outcome

#: Wall clock (s) within which a vehicle has to answer.
_ANSWER_S = 5.0


@dataclass(slots=True)
class _Sent:
    """An order on its way, with the answers so far."""

    order: Order
    until_s: float
    answers: dict[str, Any] = field(default_factory=dict)
    calls: CommandCalls | None = None


class QueuedCalls:
    """Calls the vehicles' service mission/run for the queued commands, without waiting for the answers."""

    def __init__(self, node: Node, commands: CommandQueue, vehicles: int) -> None:
        """Opens the queue.

        Args:
            node: The node that calls; its owner spins it.
        """
        self._caller: Any = SimpleNamespace(node=node)
        self._commands = commands
        self._sent: list[_Sent] = []
        commands.open(vehicles)

    def step(self) -> None:
        """Sends new orders, and reports the outcomes of those that are answered or too old."""
        for order in self._commands.take():
            sent = _Sent(order, time.monotonic() + _ANSWER_S)
            names, source = [f"auv{k}" for k in order.vehicles], f"{getpass.getuser()} (live view)"
            sent.calls = CommandCalls(self._caller, names, order.command, False, sent.answers.setdefault, source)
            self._sent.append(sent)
        for sent in list(self._sent):
            assert sent.calls is not None
            if sent.calls.step() or time.monotonic() >= sent.until_s:
                self._finish(sent, f"no answer within {_ANSWER_S:g} s")

    def _finish(self, sent: _Sent, unheard: str) -> None:
        self._sent.remove(sent)
        assert sent.calls is not None
        sent.calls.close()
        answers = {k: sent.answers.get(f"auv{k}") for k in sent.order.vehicles}
        sent.order.outcomes.set_result({k: _outcome(answer, unheard) for k, answer in answers.items()})

    def close(self) -> None:
        """Closes the queue; what is not answered is reported as not heard."""
        self._commands.close()
        for sent in list(self._sent):
            self._finish(sent, MISSION_ENDED)


def _outcome(answer: Any, unheard: str) -> Outcome:
    if answer is None:
        return "not heard", unheard
    return ("accepted" if answer.accepted else "refused"), str(answer.message)
