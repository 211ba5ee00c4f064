"""The posterior at fixed locations, cached: after a change of the measurements, only changed rows are recomputed.

`CachedPoints` stores the whitened covariance, so that it can also follow a posterior that drops rows; it suits a map of
a thousand locations. `CachedMoments` stores only mean and variance, for a hundred thousand locations. Both detect
unchanged rows by their numbers (`Posterior.rows`), which are never reused.
"""

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.inference.point_posteriors import PointPosteriors
from auv_lse_gp.inference.posterior import CHUNK, Posterior, add_whitened, checked_locations
from auv_lse_gp.inference.triangular import solve_lower


class CachedPoints:
    """The posterior at fixed locations."""

    def __init__(self, posterior: Posterior, locations_m: Array) -> None:
        self.posterior = posterior
        self.locations_m = checked_locations(locations_m)
        self._scaled = posterior.kernel.scale(self.locations_m)
        self._prior_mean = np.asarray(posterior.prior_mean(self.locations_m), dtype=float)
        self._prior_var = posterior.kernel.variance(self.locations_m)
        self._white = GrowingRows(len(self.locations_m))
        self._rows = posterior.rows[:0]

    def current(self) -> PointPosteriors:
        """The current posterior at the locations; the next call overwrites its `white`."""
        posterior = self.posterior
        n = posterior.data_rows
        self._update(n)
        self._update(len(posterior))
        white = self._white.buffer[: len(posterior)]
        data_var = np.maximum(self._prior_var - np.einsum("np,np->p", white[:n], white[:n]), 0.0)
        planned_var = np.maximum(data_var - np.einsum("np,np->p", white[n:], white[n:]), 0.0)
        if posterior.positions_uncertain:
            floor = np.einsum("rp,rp->p", *[posterior.white_position_effect.T @ white[:n]] * 2)
            data_var, planned_var = data_var + floor, planned_var + floor
        mean = self._prior_mean + posterior.whitened_residuals[:n] @ white[:n] if n else self._prior_mean
        return PointPosteriors(self._scaled, white.T, mean, data_var, planned_var)

    def _update(self, end: int) -> None:
        """Recomputes the rows from the first changed one to `end` - 1 by forward substitution."""
        posterior = self.posterior
        begin = unchanged_rows(self._rows, posterior.rows[:end])
        if end > begin:
            self._white.resize(begin)
            self._white.resize(end)
            white, lower = self._white.rows, posterior.factor.lower
            right = posterior.kernel.of_scaled(posterior.scaled[begin:end], self._scaled)
            right -= lower[begin:end, :begin] @ white[:begin]
            white[begin:] = solve_lower(lower[begin:end, begin:end], right)
            self._rows = posterior.rows[:end]


class CachedMoments:
    """Mean and variance at fixed locations given the data.

    An update conditions on all new measurements together. They add the rows R = L22^-1 (k(new, locations) - L21 L11^-1
    k(old, locations)) to the whitened covariance. The mean increases by R^T b_new, and the variance decreases by the
    sum of R^2. The cost is one pass over k(old, locations). The last `provisional` measurements may still change, so
    each update starts from the state before them. The variance that uncertain positions add
    (`Posterior.position_variance`) is recomputed as a whole.
    """

    def __init__(self, posterior: Posterior, locations_m: Array, provisional: int = 0) -> None:
        """Starts with the prior.

        Args:
            provisional: Number of the last measurements that are expected to change.
        """
        self.posterior = posterior
        self._locations_m = checked_locations(locations_m)
        self._scaled = posterior.kernel.scale(self._locations_m)
        self._prior_mean = np.asarray(posterior.prior_mean(self._locations_m), dtype=float)
        self._provisional = provisional
        self._reset()

    def _reset(self) -> None:
        self._rows = self.posterior.rows[:0]
        self._residuals = np.zeros(0)
        self._mean = self._prior_mean.copy()
        self._variance = np.array(self.posterior.kernel.variance(self._locations_m))

    def update(self) -> tuple[Array, Array, Array]:
        """Current mean, variance with exact positions, and variance that uncertain positions add; (P,) each.

        The variance includes planned locations.
        """
        posterior = self.posterior
        rows, residuals = posterior.rows, posterior.whitened_residuals
        n, old = len(rows), len(self._rows)
        if unchanged_rows(self._rows, rows) < old or not np.array_equal(self._residuals, residuals[:old]):
            self._reset()
            old = 0
        if n == old:
            return self._mean.copy(), np.maximum(self._variance, 0.0), posterior.position_variance(self._scaled)
        settled = max(old, n - self._provisional)
        mean, variance, position_variance = self._condition(old, settled, n)
        self._rows, self._residuals = rows[:settled], residuals[:settled].copy()
        return mean, np.maximum(variance, 0.0), position_variance

    def _condition(self, old: int, settled: int, new: int) -> tuple[Array, Array, Array]:
        """Conditions on measurements old..settled permanently, on settled..new for this result; returns as `update`."""
        posterior = self.posterior
        position_variance = np.zeros(len(self._scaled)) if old == 0 else posterior.position_variance(self._scaled)
        kernel, factor, residuals = posterior.kernel, posterior.factor, posterior.whitened_residuals
        lower, measured = factor.lower, posterior.scaled
        weights = factor.solve_transposed(lower[old:new, :old].T, old) if old else None  # (old, m): L11^-T L21^T
        own, kept = lower[old:new, old:new], settled - old
        mean, variance = np.empty_like(self._mean), np.empty_like(self._variance)
        memory = np.empty((new - old) * min(CHUNK, len(self._scaled)))  # reused: allocating each time is slower
        for begin in range(0, len(self._scaled), CHUNK):
            part = slice(begin, min(begin + CHUNK, len(self._scaled)))
            rows = memory[: (new - old) * (part.stop - begin)].reshape(new - old, -1)
            kernel.of_scaled(measured[old:new], self._scaled[part], rows)
            if weights is None:
                rows = factor.solve_in_place(rows)
                if posterior.positions_uncertain:
                    off = posterior.white_position_effect.T @ rows[: posterior.data_rows]
                    np.einsum("rp,rp->p", off, off, out=position_variance[part])
            else:
                kernel.subtract_weighted(measured[:old], weights, self._scaled[part], rows)
                rows = np.ascontiguousarray(solve_lower(own, rows))
            add_whitened(rows[:kept], residuals[old:settled], self._mean[part], self._variance[part])
            mean[part], variance[part] = self._mean[part], self._variance[part]
            add_whitened(rows[kept:], residuals[settled:new], mean[part], variance[part])
        return mean, variance, position_variance


def unchanged_rows(cached: Ints, now: Ints) -> int:
    """Number of identical leading rows."""
    common = min(len(cached), len(now))
    same = cached[:common] == now[:common]
    return common if same.all() else int(np.argmin(same))
