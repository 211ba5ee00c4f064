"""Which of the unsent samples go into the next packet (section 5)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class ReceiversRisk(Protocol):
    """What the receivers are thought to know, and what a sample would be worth to them.

    The map and its risk belong to other packages, so whoever wires a vehicle hands an object of this shape in.
    """

    def tell(self, samples_m: Array) -> None:
        """The receivers now have these samples (or will, when the packet arrives).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """

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


def most_useful(samples_m: Array, room: int, receivers: ReceiversRisk) -> Indices:
    """The samples worth most to the receivers, chosen one after the other, each given those chosen before.

    Tells `receivers` what it chose. The oldest is always among them, so none waits for ever.

    Args:
        samples_m: Unsent samples in time order, shape (n, 3).
        room: Samples that fit the packet.
        receivers: What the receivers know.

    Returns:
        Ascending indices of min(n, room) different samples.

    Raises:
        ValueError: if the gains are not one finite number per sample.
    """
    n = len(samples_m)
    if n <= room:
        if n:
            receivers.tell(samples_m)
        return np.arange(n)
    if room == 0:
        return np.arange(0)
    chosen = np.zeros(n, dtype=bool)
    chosen[0] = True
    receivers.tell(samples_m[:1])
    for _ in range(room - 1):
        left = np.flatnonzero(~chosen)
        gains = np.asarray(receivers.gains(samples_m[left]), dtype=float)
        if gains.shape != left.shape or not np.isfinite(gains).all():
            raise ValueError(f"gains of shape {gains.shape}: expected {left.shape}, one finite number per sample")
        best = left[np.argmax(gains)]
        chosen[best] = True
        receivers.tell(samples_m[best : best + 1])
    return np.flatnonzero(chosen)
