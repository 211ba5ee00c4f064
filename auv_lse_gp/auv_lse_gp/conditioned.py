"""The posterior given the data and places that are to be measured: what the reward of a planned path needs.

What will be known after measuring at places V does not depend on what is measured there. A `Conditioned` holds it for a
growing sequence of places and is never changed: `extend` makes another that shares all its rows. So candidate paths
with a common beginning extend one `Conditioned` of the beginning; with a common end (a naive path flown to the end of
the mission), one of that end is extended by the candidates: the order of the places makes no difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cholesky, solve_triangular

from auv_lse_gp.online import OnlineGp
from auv_lse_gp.risk import LevelSet

Array = NDArray[np.float64]


class Conditioned:
    """Posterior of the depth given the data in `gp` and measurements planned at `places_m`.

    It stays valid while `gp` holds the same centres.

    Attributes:
        places_m: The planned places (V, 2), in the order given.
        mean_m: Mean of the depth there given the data (V,).
        std_before_m: Standard deviation of the depth there given the data (V,).
    """

    def __init__(self, gp: OnlineGp) -> None:
        """Nothing is planned yet."""
        self._gp = gp
        self._noise_m2 = gp.config.noise_std_m**2
        self._scaled = np.zeros((0, 2))
        self._white = np.zeros((len(gp.cholesky), 0))  # L^-1 k(S, V)
        self._lower = np.zeros((0, 0))  # of cov(V, V | S) + noise
        self.places_m = np.zeros((0, 2))
        self.mean_m = np.zeros(0)
        self.std_before_m = np.zeros(0)

    def __len__(self) -> int:
        """Number of planned places."""
        return len(self.mean_m)

    def extend(self, places_m: ArrayLike) -> Conditioned:
        """The same with measurements at `places_m` (m, 2) planned as well. O(n^2 m + (n + V) V m)."""
        places = np.asarray(places_m, dtype=float).reshape(-1, 2)
        gp, kernel = self._gp, self._gp.kernel
        scaled = kernel.scale(places)
        white = gp.whiten(places)
        old, new = len(self), len(self) + len(places)
        own = kernel.of_scaled(scaled, scaled) - white.T @ white
        cross = kernel.of_scaled(self._scaled, scaled) - self._white.T @ white
        child = Conditioned.__new__(Conditioned)
        child._gp, child._noise_m2 = gp, self._noise_m2
        child._scaled = np.concatenate([self._scaled, scaled])
        child._white = np.concatenate([self._white, white], axis=1)
        child._lower = np.zeros((new, new))
        child._lower[:old, :old] = self._lower
        rows = solve_triangular(self._lower, cross, lower=True, check_finite=False) if old else cross
        child._lower[old:, :old] = rows.T
        # The noise keeps this positive definite, whatever the places: even the same place twice.
        corner = own - rows.T @ rows + self._noise_m2 * np.eye(new - old)
        child._lower[old:, old:] = cholesky(corner, lower=True, check_finite=False) if new > old else corner
        child.places_m = np.concatenate([self.places_m, places])
        mean = np.asarray(gp.prior_mean(places), float) + gp.whitened_residuals @ white
        child.mean_m = np.concatenate([self.mean_m, mean])
        child.std_before_m = np.concatenate([self.std_before_m, np.sqrt(np.maximum(np.diag(own), 0.0))])
        return child

    def variance_after(self) -> Array:
        """Variance (V,) of the depth at the planned places after all of them are measured."""
        if not len(self):
            return np.zeros(0)
        # var = s - s^2 [(C + s I)^-1]_ii with s the noise variance: no large numbers cancel.
        inverse = solve_triangular(self._lower, np.eye(len(self)), lower=True, check_finite=False)
        s = self._noise_m2
        return np.asarray(np.maximum(s - s * s * np.einsum("ij,ij->j", inverse, inverse), 0.0))

    def look(self, places_m: ArrayLike) -> tuple[Array, Array, Array]:
        """Mean given the data, variance given the data, and variance after the planned measurements (P,), each.

        Args:
            places_m: Places to look at (P, 2), for instance a map's cells.
        """
        places = np.asarray(places_m, dtype=float).reshape(-1, 2)
        gp, kernel = self._gp, self._gp.kernel
        scaled = kernel.scale(places)
        white = gp.whiten(places)
        mean = np.asarray(gp.prior_mean(places), float) + gp.whitened_residuals @ white
        before = np.maximum(kernel.signal_variance_m2 - np.einsum("np,np->p", white, white), 0.0)
        if not len(self):
            return mean, before, before.copy()
        cross = kernel.of_scaled(self._scaled, scaled) - self._white.T @ white
        rows = solve_triangular(self._lower, cross, lower=True, check_finite=False)
        return mean, before, np.maximum(before - np.einsum("vp,vp->p", rows, rows), 0.0)

    def benefit(self, level_set: LevelSet) -> Array:
        """Expected benefit of search (V,) at each planned place once all of them are measured."""
        before, after = self.std_before_m**2, self.variance_after()
        return level_set.benefit(self.mean_m, np.sqrt(np.maximum(before - after, 0.0)), np.sqrt(after))
