"""What the other vehicles know, as a sender believes, and what one more sample would be worth to them.

The belief: everyone has everything that was ever told (sent or heard), whether or not it got through. A sample's worth
is the drop of the Bayes risk, summed over a coarse map of the operating area, that they expect of it before they know
its depth (PAPER.md section 1, with D1 what was told and D2 the sample's place).

An exact GP on what was told, one row of the Cholesky factor per sample; samples nearer than `gp.min_spacing_m` to one
told before are left out, as the receivers' own maps merge them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from auv_lse_common.params import section
from auv_lse_gp.area import AreaConfig, OperatingArea
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kernels import Kernel
from auv_lse_gp.prior_mean import prior_mean
from auv_lse_gp.risk import LevelSet

Array = NDArray[np.float64]

#: A place whose depth a sample explains by less than this share of its variance is not reckoned with.
_NEGLIGIBLE = 1e-4


class ReceiversRisk:
    """Has the shape that `auv_lse_comms.selection.ReceiversRisk` asks for.

    Attributes:
        places_m: Where risk is summed, shape (G, 2): north, east.
    """

    def __init__(
        self, gp: GpConfig, level_set: LevelSet, area: OperatingArea, spacing_m: float = 20.0, capacity: int = 64
    ) -> None:
        """Starts with receivers who know nothing but the prior.

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

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any], where: str) -> ReceiversRisk:
        """From the sections `gp`, `level_set` and `area` of a mission file.

        Args:
            parameters: Nested parameters.
            where: Where they came from, for messages.

        Raises:
            ParameterError: naming what cannot be used.
        """
        return cls(
            section(GpConfig, parameters, "gp", where),
            section(LevelSet, parameters, "level_set", where),
            OperatingArea(section(AreaConfig, parameters, "area", where)),
        )

    def __len__(self) -> int:
        """Number of samples told and kept."""
        return self._count

    @property
    def risk(self) -> float:
        """Bayes risk of the receivers, mean over the places."""
        return float(self._level_set.risk(self._mean, np.sqrt(self._variance)).mean())

    def _whiten(self, places_m: Array, covariance: Array) -> Array:
        """L^-1 of a covariance (N, P) of what was told with places."""
        n = self._count
        if n == 0:
            return covariance
        return np.asarray(solve_triangular(self._factor[:n, :n], covariance, lower=True, check_finite=False))

    def tell(self, samples_m: Array) -> None:
        """The receivers have these samples now.

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
        """Expected drop of the receivers' Bayes risk, summed over the places, by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3). The depth is not looked at: the receivers do not
                know it yet.
        """
        at = np.asarray(samples_m, dtype=float)[:, :2]
        if not len(at):
            return np.zeros(0)
        n = self._count
        row = self._whiten(at, self._kernel(self._told[:n], at))
        variance = np.maximum(self._kernel.variance(at) - (row**2).sum(axis=0), 0.0) + self._noise_m2
        cross = self._kernel(at, self.places_m) - row.T @ self._white[:n]
        explained = np.minimum(cross**2 / variance[:, None], self._variance)
        sample, place = np.nonzero(explained > _NEGLIGIBLE * self._variance)
        drop = explained[sample, place]
        benefit = self._level_set.benefit(
            self._mean[place], np.sqrt(drop), np.sqrt(np.maximum(self._variance[place] - drop, 0.0))
        )
        return np.asarray(np.bincount(sample, weights=benefit, minlength=len(at)), dtype=float)
