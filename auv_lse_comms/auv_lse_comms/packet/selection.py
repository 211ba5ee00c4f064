"""Selection of the unsent samples that go into the next packet (section 5)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Unsent samples whose gain is computed for one packet.
CONSIDERED = 200
#: Samples whose gain is computed in one call while choosing.
_BATCH = 8


class Receivers(Protocol):
    """Estimate of the receivers' knowledge, which rates further samples.

    `auv_lse_gp.map.receivers_risk.ReceiversRisk` implements it; `modem_node` and the fleet engine pass one in.
    """

    def receive(self, samples_m: Array, loss: float) -> None:
        """A teammate's packet with these samples was received; other vehicles may have missed it.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
            loss: Present chance that a packet is lost.
        """

    def suppose(self, samples_m: Array) -> None:
        """The next packet will contain these samples too.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """

    def send(self, loss: float) -> None:
        """The packet with the supposed samples is sent; it may get lost.

        Args:
            loss: Present chance that a packet is lost.
        """

    def take_back(self) -> None:
        """The packet of the last `send` was not sent: no receiver has its samples."""

    def gains(self, samples_m: Array) -> Array:
        """Expected reduction of the receivers' Bayes risk by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """


def every_nth(unsent: int, room: int) -> Indices:
    """Every n-th of the unsent samples in time order, with n = (unsent - 1) / (room - 1), not rounded.

    The oldest is always included, so that every sample is sent eventually; a backlog is covered evenly.

    Args:
        unsent: Number of unsent samples.
        room: Number of samples that fit the packet.

    Returns:
        Ascending indices of min(unsent, room) different samples.
    """
    if unsent <= room:
        return np.arange(unsent)
    if room <= 1:
        return np.arange(room)
    return np.rint(np.linspace(0.0, unsent - 1.0, room)).astype(np.intp)


def most_useful(samples_m: Array, room: int, receivers: Receivers, last_gains: Array) -> Indices:
    """The samples most valuable to the receivers, chosen greedily: each given those chosen before it.

    `receivers` supposes the chosen samples afterwards. The oldest sample is always included, so that every sample is
    sent eventually.

    To save time, gains are computed only for the `CONSIDERED` samples with the largest last gains, and in each step
    only for samples whose last gain exceeds the best new one. New knowledge usually lowers the gain of nearby samples,
    so a last gain is nearly always an upper bound.

    Args:
        samples_m: Unsent samples in time order, shape (n, 3).
        room: Number of samples that fit the packet.
        receivers: Estimate of the receivers' knowledge.
        last_gains: Each sample's gain when last computed, infinite if never, shape (n,); updated in place.

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

    def compute_gains(which: Indices) -> None:
        gains = np.asarray(receivers.gains(samples_m[which]), dtype=float)
        if gains.shape != which.shape or not np.isfinite(gains).all():
            raise ValueError(f"gains: got shape {gains.shape}; expected {which.shape}, one finite number per sample")
        last_gains[which] = gains

    chosen = [0]
    receivers.suppose(samples_m[:1])
    considered = max(CONSIDERED, room)
    new = 1 + np.flatnonzero(np.isinf(last_gains[1:]))
    if len(new) > considered:  # a backlog: consider samples spread evenly over it
        pool = new[every_nth(len(new), considered)]
    else:
        pool = 1 + np.argsort(-last_gains[1:], kind="stable")[:considered]
    compute_gains(pool)
    fresh = np.ones(len(pool), dtype=bool)
    for _ in range(room - 1):
        while not fresh[best := int(np.argmax(last_gains[pool]))]:
            stale = np.flatnonzero(~fresh)
            batch = stale[np.argsort(-last_gains[pool[stale]], kind="stable")[:_BATCH]]
            compute_gains(pool[batch])
            fresh[batch] = True
        chosen.append(int(pool[best]))
        receivers.suppose(samples_m[pool[best] : pool[best] + 1])
        pool = np.delete(pool, best)
        fresh = np.zeros(len(pool), dtype=bool)
    return np.sort(np.array(chosen, dtype=np.intp))
