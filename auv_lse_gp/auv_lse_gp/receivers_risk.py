"""What the other vehicles know, as a sender believes, and what one more sample would be worth to them.

A sample's worth is the drop of the Bayes risk, summed over a coarse map of the operating area, that the receivers
expect of it before they know its depth (PAPER.md section 1, with D1 what they know and D2 the sample's place).

Nobody tells a sender what got through. A sender that takes all for known leaves holes where packets were lost, and
does worse than one that sends every n-th sample. So several receivers are supposed, each of which misses every packet,
sent or heard, with the chance that packets are lost then; a sample's worth is its mean over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from auv_lse_common.params import section
from auv_lse_common.seeds import stream
from auv_lse_gp.area import AreaConfig, OperatingArea
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kernels import Kernel
from auv_lse_gp.prior_mean import prior_mean
from auv_lse_gp.risk import LevelSet

Array = NDArray[np.float64]

#: Not reckoned with: a place whose depth a sample explains by less than this share of its variance, ...
_NEGLIGIBLE_SHARE = 1e-3
#: ... and one whose Bayes risk is less than this share of the larger cost.
_NEGLIGIBLE_RISK = 1e-4
#: Supposed receivers.
SUPPOSED = 4


class Knowledge:
    """What one vehicle knows: an exact GP on the samples it has, one row of the Cholesky factor per sample.

    Samples nearer than `gp.min_spacing_m` to an earlier one are left out, as a vehicle's map merges them.

    Attributes:
        places_m: Where risk is summed, shape (G, 2): north, east.
    """

    def __init__(
        self, gp: GpConfig, level_set: LevelSet, area: OperatingArea, spacing_m: float = 20.0, capacity: int = 64
    ) -> None:
        """Starts with nothing but the prior.

        Args:
            gp: The prior, and the noise of a sounding.
            level_set: The isobath and what errors cost.
            area: Where risk counts.
            spacing_m: Spacing of the places where it is summed.
            capacity: Samples that room is made for at first.
        """
        self.places_m: Array = area.grid(spacing_m).places_m
        self._level_set = level_set
        self._kernel = Kernel(gp)
        self._prior = prior_mean(gp)
        self._noise_m2 = gp.noise_std_m**2
        self._spacing_m = gp.min_spacing_m
        self._count = 0
        self._told = np.zeros((capacity, 2))
        self._factor = np.zeros((capacity, capacity))  # L of K + noise = L L^T
        self._residuals = np.zeros(capacity)  # L^-1 (z - m)
        self._white = np.zeros((capacity, len(self.places_m)))  # L^-1 K(told, places)
        self._mean = np.array(self._prior(self.places_m), dtype=float)
        self._variance = np.array(self._kernel.variance(self.places_m), dtype=float)

    def __len__(self) -> int:
        """Number of samples told and kept."""
        return self._count

    @property
    def risk(self) -> float:
        """Bayes risk, mean over the places."""
        return float(self._level_set.risk(self.mean_m, self.std_m).mean())

    @property
    def mean_m(self) -> Array:
        """Expected depth (m) at the places, shape (G,)."""
        return self._mean.copy()

    @property
    def std_m(self) -> Array:
        """Standard deviation (m) of the depth at the places, shape (G,)."""
        return np.asarray(np.sqrt(self._variance))

    def mark(self) -> tuple[int, Array, Array]:
        """Where it stands, for `forget`."""
        return self._count, self._mean.copy(), self._variance.copy()

    def forget(self, mark: tuple[int, Array, Array]) -> None:
        """Forgets what it was told since `mark()`."""
        self._count, self._mean, self._variance = mark[0], mark[1].copy(), mark[2].copy()

    def _whiten(self, places_m: Array, covariance: Array) -> Array:
        """L^-1 of a covariance (N, P) of what was told with places."""
        n = self._count
        if n == 0:
            return covariance
        return np.asarray(solve_triangular(self._factor[:n, :n], covariance, lower=True, check_finite=False))

    def tell(self, samples_m: Array) -> None:
        """It has these samples now.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        for north, east, depth in np.asarray(samples_m, dtype=float).tolist():
            self._tell(np.array([[north, east]]), depth)

    def _tell(self, place_m: Array, depth_m: float) -> None:
        n = self._count
        if n and np.hypot(*(self._told[:n] - place_m).T).min() < self._spacing_m:
            return
        if n == len(self._told):
            self._grow()
        row = self._whiten(place_m, self._kernel(self._told[:n], place_m))[:, 0]
        pivot = float(np.sqrt(self._kernel.variance(place_m)[0] + self._noise_m2 - row @ row))
        self._factor[n, :n], self._factor[n, n] = row, pivot
        white = (self._kernel(place_m, self.places_m)[0] - row @ self._white[:n]) / pivot
        residual = (depth_m - float(self._prior(place_m)[0]) - float(row @ self._residuals[:n])) / pivot
        self._told[n], self._white[n], self._residuals[n] = place_m[0], white, residual
        self._mean += white * residual
        self._variance = np.maximum(self._variance - white**2, 0.0)
        self._count = n + 1

    def _grow(self) -> None:
        old = len(self._told)
        self._told = np.concatenate([self._told, np.zeros((old, 2))])
        self._residuals = np.concatenate([self._residuals, np.zeros(old)])
        self._white = np.concatenate([self._white, np.zeros((old, len(self.places_m)))])
        factor = np.zeros((2 * old, 2 * old))
        factor[:old, :old] = self._factor
        self._factor = factor

    def gains(self, samples_m: Array) -> Array:
        """Expected drop of its Bayes risk, summed over the places, by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3). The depth is not looked at: it is not known
                yet.
        """
        at = np.asarray(samples_m, dtype=float)[:, :2]
        if not len(at):
            return np.zeros(0)
        n = self._count
        row = self._whiten(at, self._kernel(self._told[:n], at))
        variance = np.maximum(self._kernel.variance(at) - (row**2).sum(axis=0), 0.0) + self._noise_m2
        cross = self._kernel(at, self.places_m) - row.T @ self._white[:n]
        explained = np.minimum(cross**2 / variance[:, None], self._variance)
        cost = max(self._level_set.cost_false_safe, self._level_set.cost_false_unsafe)
        open_places = self._level_set.risk(self._mean, np.sqrt(self._variance)) > _NEGLIGIBLE_RISK * cost
        sample, place = np.nonzero((explained > _NEGLIGIBLE_SHARE * self._variance) & open_places)
        drop = explained[sample, place]
        benefit = self._level_set.benefit(
            self._mean[place], np.sqrt(drop), np.sqrt(np.maximum(self._variance[place] - drop, 0.0))
        )
        return np.asarray(np.bincount(sample, weights=benefit, minlength=len(at)), dtype=float)


class ReceiversRisk:
    """Has the shape that `auv_lse_comms.packet.selection.ReceiversRisk` asks for."""

    def __init__(
        self,
        gp: GpConfig,
        level_set: LevelSet,
        area: OperatingArea,
        rng: np.random.Generator,
        spacing_m: float = 20.0,
    ) -> None:
        """Starts with receivers who know nothing but the prior.

        Args:
            gp: The prior, and the noise of a sounding.
            level_set: The isobath and what errors cost.
            area: Where risk counts.
            rng: Which packets the supposed receivers miss.
            spacing_m: Spacing of the places where risk is summed.
        """
        self._rng = rng
        self._receivers = [Knowledge(gp, level_set, area, spacing_m) for _ in range(SUPPOSED)]
        self._missed = [0] * SUPPOSED  # what each has missed, as a number: those with the same know the same
        self._marks = [receiver.mark() for receiver in self._receivers]
        #: What the receivers knew and had missed before the last packet sent, while that can be taken back ...
        self._before_sent: tuple[list[tuple[int, Array, Array]], list[int]] | None = None
        #: ... and what was heard after it: samples, and which receivers missed them.
        self._heard_since: list[tuple[Array, list[bool]]] = []

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any], where: str, address: int) -> ReceiversRisk:
        """From the sections `gp`, `level_set` and `area` of a mission file.

        Args:
            parameters: Nested parameters.
            where: Where they came from, for messages.
            address: Number of the sender.

        Raises:
            ParameterError: naming what cannot be used.
        """
        return cls(
            section(GpConfig, parameters, "gp", where),
            section(LevelSet, parameters, "level_set", where),
            OperatingArea(section(AreaConfig, parameters, "area", where)),
            stream(int(parameters.get("mission", {}).get("seed", 1)), "receivers", address),
        )

    def hear(self, samples_m: ArrayLike, loss: float) -> None:
        """A team mate's packet with these samples was heard; the others may have missed it.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
            loss: Chance that a packet is lost at present.
        """
        samples = np.asarray(samples_m, dtype=float)
        missed = self._draw(loss)
        self._heard_since.append((samples, missed))
        self.suppose(samples)
        self._deliver(missed)

    def suppose(self, samples_m: ArrayLike) -> None:
        """The packet that is being made holds these samples too; what it is worth is reckoned as if it arrived.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        for receiver in self._receivers:
            receiver.tell(np.asarray(samples_m, dtype=float))

    def send(self, loss: float) -> None:
        """The packet is made; each of the supposed receivers misses it with the chance that packets are lost.

        Args:
            loss: That chance at present.
        """
        self._before_sent, self._heard_since = (self._marks, list(self._missed)), []
        self._deliver(self._draw(loss))

    def take_back(self) -> None:
        """The last packet given to `send` was not sent: nobody has its samples. What was heard since stays known."""
        if self._before_sent is None:
            return
        (self._marks, self._missed), self._before_sent = self._before_sent, None
        for receiver, mark in zip(self._receivers, self._marks, strict=True):
            receiver.forget(mark)
        for samples, missed in self._heard_since:
            self.suppose(samples)
            self._deliver(missed)

    def _draw(self, loss: float) -> list[bool]:
        """Which of the receivers miss a packet."""
        return [bool(missed) for missed in self._rng.random(len(self._receivers)) < loss]

    def _deliver(self, missed: list[bool]) -> None:
        """The packet of the samples supposed last is on its way; those who miss it forget them."""
        for i, receiver in enumerate(self._receivers):
            self._missed[i] = hash((self._missed[i], missed[i]))
            if missed[i]:
                receiver.forget(self._marks[i])
        self._marks = [receiver.mark() for receiver in self._receivers]

    def gains(self, samples_m: ArrayLike) -> Array:
        """Expected drop of the receivers' Bayes risk by each sample alone, mean over the receivers, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        samples = np.asarray(samples_m, dtype=float)
        different = dict(zip(self._missed, self._receivers, strict=True))
        known = {missed: receiver.gains(samples) for missed, receiver in different.items()}
        return np.asarray(np.mean([known[missed] for missed in self._missed], axis=0))
