"""Which of the unsent samples go into the next packet (section 5)."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.params import ParameterError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Unsent samples whose worth is asked about for one packet.
CONSIDERED = 200
#: How many are asked about at once while choosing.
_BATCH = 8


class ReceiversRisk(Protocol):
    """What the receivers are thought to know, and what a sample would be worth to them.

    The map and its risk belong to other packages, so whoever wires a vehicle hands an object of this shape in.
    """

    def hear(self, samples_m: Array, loss: float) -> None:
        """A packet of a team mate with these samples was heard; others may have missed it.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
            loss: Chance that a packet is lost at present.
        """

    def suppose(self, samples_m: Array) -> None:
        """The packet that is being made will hold these samples too.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """

    def send(self, loss: float) -> None:
        """The packet with what was supposed is sent; it may get lost.

        Args:
            loss: Chance that a packet is lost at present.
        """

    def take_back(self) -> None:
        """The last packet given to `send` was not sent after all: nobody has its samples."""

    def gains(self, samples_m: Array) -> Array:
        """Expected drop of the receivers' Bayes risk by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """


def every_nth(unsent: int, room: int) -> Indices:
    """Every n-th of the unsent samples in time order, n from what fits: n = (unsent - 1) / (room - 1), not rounded.

    The oldest is always among them, so none waits for ever, and a backlog is covered from its oldest to its newest.

    Args:
        unsent: Number of unsent samples.
        room: Samples that fit the packet.

    Returns:
        Ascending indices of min(unsent, room) different samples.
    """
    if unsent <= room:
        return np.arange(unsent)
    if room <= 1:
        return np.arange(room)
    return np.rint(np.linspace(0.0, unsent - 1.0, room)).astype(np.intp)


def most_useful(samples_m: Array, room: int, receivers: ReceiversRisk, worth: Array) -> Indices:
    """The samples worth most to the receivers, chosen one after the other, each given those chosen before.

    Lets `receivers` suppose what it chose. The oldest is always among them, so none waits for ever.

    Only the `CONSIDERED` that were worth most when last asked about are asked about again, and while choosing, only
    those whose last answer exceeds the best new one: what receivers learn makes nearby samples worth less, as a rule.

    Args:
        samples_m: Unsent samples in time order, shape (n, 3).
        room: Samples that fit the packet.
        receivers: What the receivers know.
        worth: Each sample's gain when last asked about, infinite if never, shape (n,); updated in place.

    Returns:
        Ascending indices of min(n, room) different samples.

    Raises:
        ValueError: if the gains are not one finite number per sample.
    """
    n = len(samples_m)
    if n <= room:
        if n:
            receivers.suppose(samples_m)
        return np.arange(n)
    if room == 0:
        return np.arange(0)

    def ask(which: Indices) -> None:
        gains = np.asarray(receivers.gains(samples_m[which]), dtype=float)
        if gains.shape != which.shape or not np.isfinite(gains).all():
            raise ValueError(f"gains of shape {gains.shape}: expected {which.shape}, one finite number per sample")
        worth[which] = gains

    chosen = [0]
    receivers.suppose(samples_m[:1])
    considered = max(CONSIDERED, room)
    new = 1 + np.flatnonzero(np.isinf(worth[1:]))
    if len(new) > considered:  # a backlog: look at it evenly
        pool = new[every_nth(len(new), considered)]
    else:
        pool = 1 + np.argsort(-worth[1:], kind="stable")[:considered]
    ask(pool)
    fresh = np.ones(len(pool), dtype=bool)
    for _ in range(room - 1):
        while not fresh[best := int(np.argmax(worth[pool]))]:
            stale = np.flatnonzero(~fresh)
            batch = stale[np.argsort(-worth[pool[stale]], kind="stable")[:_BATCH]]
            ask(pool[batch])
            fresh[batch] = True
        chosen.append(int(pool[best]))
        receivers.suppose(samples_m[pool[best] : pool[best] + 1])
        pool = np.delete(pool, best)
        fresh = np.zeros(len(pool), dtype=bool)
    return np.sort(np.array(chosen, dtype=np.intp))


def load_receivers(name: str, parameters: Mapping[str, Any], where: str, address: int) -> ReceiversRisk:
    """The `ReceiversRisk` that the mission file names.

    This package knows no map, so what a sample is worth comes from a class named as "module:class", which is made by
    its `from_parameters(parameters, where, address)`.

    Args:
        name: `packet.receivers`.
        parameters: Nested parameters of the mission.
        where: Where they came from, for messages.
        address: Number of the sender.

    Raises:
        ParameterError: if there is no such class.
    """
    module, _, attribute = name.partition(":")
    try:
        kind = getattr(importlib.import_module(module), attribute)
        made: ReceiversRisk = kind.from_parameters(parameters, where, address)
    except (ImportError, AttributeError, ValueError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(
            f"{where}: packet.receivers: got {name!r}; expected 'module:class' with from_parameters: {error}"
        ) from error
    return made
