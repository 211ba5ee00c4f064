"""The GP posterior of the depth as planning needs it: given the data, and given places that will be measured.

Everything about a place follows from its whitened covariance w(p) = L^-1 k(X, p), with L the Cholesky factor of the
covariance of X with noise, X being the kernel centres S and after them the places O that team mates will measure:

    cov(p, q | S u O) = k(p, q) - w(p)^T w(q);    of the data alone: the same with the first |S| rows of w.

The factor is kept between decisions and only its end is computed anew as centres arrive.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dsyrk, dtrsm

from auv_lse_gp.config import GpConfig
from auv_lse_gp.factor import Factor, IllConditionedError
from auv_lse_gp.kernels import Kernel
from auv_lse_gp.online import Centers
from auv_lse_gp.prior_mean import PriorMean, prior_mean

Array = NDArray[np.float64]

#: Largest number of right-hand sides solved at once.
CHUNK = 2048
#: Places that a pool has room for before it grows: those of 300 sequences of ten legs, and more.
POOLED = 4096


@dataclass(frozen=True, slots=True)
class Columns:
    """Places, with what the posterior says of them.

    Attributes:
        scaled: Places in the kernel's axes and lengths, shape (P, 2).
        white: Whitened covariance with data and planned places, shape (P, n + o).
        mean_m: Posterior mean of the depth given the data, shape (P,).
        data_var_m2: Posterior variance given the data, shape (P,).
        planned_var_m2: Posterior variance given the data and the team mates' planned places, shape (P,).
    """

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array

    def __len__(self) -> int:
        """Number of places."""
        return len(self.mean_m)

    def slice(self, begin: int, end: int) -> Columns:
        """The places from number `begin` to `end`, without copying."""
        return Columns(
            self.scaled[begin:end],
            self.white[begin:end],
            self.mean_m[begin:end],
            self.data_var_m2[begin:end],
            self.planned_var_m2[begin:end],
        )

    def take(self, index: NDArray[np.int64]) -> Columns:
        """The places at `index`."""
        return Columns(
            self.scaled[index],
            self.white[index],
            self.mean_m[index],
            self.data_var_m2[index],
            self.planned_var_m2[index],
        )


def join(parts: list[Columns]) -> Columns:
    """All places of `parts`, in order."""
    return Columns(
        np.concatenate([p.scaled for p in parts]),
        np.concatenate([p.white for p in parts]),
        np.concatenate([p.mean_m for p in parts]),
        np.concatenate([p.data_var_m2 for p in parts]),
        np.concatenate([p.planned_var_m2 for p in parts]),
    )


def joined_rows(heads: Columns, tails: Columns, paths: int) -> Columns:
    """Places of so many paths of equal length, path after path, of which each has a head and a tail."""

    def both(head: Array, tail: Array) -> Array:
        by_path = [part.reshape(paths, len(part) // paths, *part.shape[1:]) for part in (head, tail)]
        return np.concatenate(by_path, axis=1).reshape(len(head) + len(tail), *head.shape[1:])

    return Columns(
        both(heads.scaled, tails.scaled),
        both(heads.white, tails.white),
        both(heads.mean_m, tails.mean_m),
        both(heads.data_var_m2, tails.data_var_m2),
        both(heads.planned_var_m2, tails.planned_var_m2),
    )


class ColumnPool:
    """Columns of many places, asked for by number: what a search keeps of the places it has looked up."""

    def __init__(self, rows: int) -> None:
        """Makes an empty pool for whitened covariances of `rows` numbers."""
        self._size = 0
        # memory that is not touched costs nothing, growing does
        self._numbers = np.empty((POOLED, 5))
        self._white = np.empty((POOLED, rows))

    def add(self, columns: Columns) -> int:
        """Adds places; returns the number of the first of them."""
        begin, end = self._size, self._size + len(columns)
        if end > len(self._white):
            capacity = max(end, 2 * len(self._white))
            for name in ("_numbers", "_white"):
                old = getattr(self, name)
                grown = np.empty((capacity, old.shape[1]))
                grown[:begin] = old[:begin]
                setattr(self, name, grown)
        self._white[begin:end] = columns.white
        self._numbers[begin:end, :2] = columns.scaled
        self._numbers[begin:end, 2] = columns.mean_m
        self._numbers[begin:end, 3] = columns.data_var_m2
        self._numbers[begin:end, 4] = columns.planned_var_m2
        self._size = end
        return begin

    def take(self, index: NDArray[np.int64]) -> Columns:
        """The places of these numbers."""
        n = self._numbers[index]
        return Columns(np.ascontiguousarray(n[:, :2]), self._white[index], n[:, 2], n[:, 3], n[:, 4])


class Posterior:
    """Posterior of the depth given kernel centres and, after them, places that will be measured.

    Attributes:
        kernel: Covariance function.
        noise_var_m2: Variance of a measurement that is planned.
    """

    def __init__(self, config: GpConfig, mean: PriorMean | None = None) -> None:
        """Starts with no data. `mean`: prior mean (P, 2) -> (P,); by default what `config` describes."""
        self.kernel = Kernel(config)
        self.noise_var_m2 = config.noise_std_m**2
        self.prior_mean = mean or prior_mean(config)
        self.prefix = 0
        self._factor = Factor()
        self._scaled = np.empty((0, 2))
        self._noise_var_m2 = np.empty(0)
        self._centers = Centers(np.empty((0, 2)), np.empty(0), np.empty(0))
        self._whitened = np.empty(0)
        self._planned_scaled = np.empty((0, 2))
        self._watched: _Watched | None = None
        self._lower: Array | None = None

    @property
    def centers(self) -> Centers:
        """The kernel centres."""
        return self._centers

    @property
    def data_rows(self) -> int:
        """Number of centres: the first rows of every whitened covariance."""
        return len(self._centers)

    @property
    def planned_rows(self) -> int:
        """Number of planned places: the rows after those."""
        return len(self._planned_scaled)

    def set_centers(self, centers: Centers) -> int:
        """Takes new kernel centres (and forgets planned places).

        Returns:
            How many of the old centres, from the first on, are unchanged: only what follows is computed.

        Raises:
            IllConditionedError: if they cannot be factorized; the posterior then has the unchanged ones only.
        """
        self.forget_planned()
        old = self._centers
        common = min(len(old), len(centers))
        same = (old.places_m[:common] == centers.places_m[:common]).all(axis=1) & (
            old.noise_std_m[:common] == centers.noise_std_m[:common]
        )
        keep = common if same.all() else int(np.argmin(same))
        keep = min(keep, self._factor.size)
        self._factor.truncate(keep)
        self._lower = None
        if self._watched is not None:
            self._watched.truncate(keep)
        places = np.array(centers.places_m, dtype=float).reshape(-1, 2)
        scaled = self.kernel.scale(places)
        noise = np.asarray(centers.noise_std_m, dtype=float) ** 2
        if len(scaled) > keep:
            new = scaled[keep:]
            try:
                self._factor.append(
                    self.kernel.of_scaled(new, scaled[:keep]), self.kernel.of_scaled(new, new) + np.diag(noise[keep:])
                )
            except IllConditionedError:
                self._set(Centers(places[:keep], centers.depths_m[:keep], centers.noise_std_m[:keep]), scaled, noise)
                raise
        self._set(Centers(places, np.array(centers.depths_m), np.array(centers.noise_std_m)), scaled, noise)
        self.prefix = keep
        return keep

    def _set(self, centers: Centers, scaled: Array, noise: Array) -> None:
        count = len(centers)
        self._centers, self._scaled, self._noise_var_m2 = centers, scaled[:count], noise[:count]
        if self._watched is not None:
            self._watched.follow(self)
        residual = centers.depths_m - self.prior_mean(centers.places_m) if count else np.empty(0)
        self._whitened = self._factor.solve(residual) if count else np.empty(0)

    def plan(self, places_m: Array) -> None:
        """Conditions on measurements that will be made at `places_m` (O, 2), whatever they will show."""
        self.forget_planned()
        if len(places_m) == 0:
            return
        scaled = self.kernel.scale(np.asarray(places_m, dtype=float))
        self._factor.append(
            self.kernel.of_scaled(scaled, self._scaled),
            self.kernel.of_scaled(scaled, scaled) + self.noise_var_m2 * np.eye(len(scaled)),
        )
        self._planned_scaled = scaled
        self._lower = None

    def copy(self) -> Posterior:
        """The same data with planned places of its own; watched places are not taken along."""
        other = copy.copy(self)
        other._factor = copy.deepcopy(self._factor)
        other._watched = None
        other.forget_planned()
        return other

    def forget_planned(self) -> None:
        """Goes back to the data alone."""
        if self.planned_rows:
            self._lower = None
        self._factor.truncate(self.data_rows)
        self._planned_scaled = np.empty((0, 2))

    def watch(self, places_m: Array) -> None:
        """Keeps the columns of fixed places (the map's) from now on: `watched` then costs only what has changed."""
        self._watched = _Watched(self, np.asarray(places_m, dtype=float))
        self._watched.follow(self)

    def watched(self) -> Columns:
        """The columns of the watched places; `white` is a view that the next change overwrites.

        Raises:
            ValueError: if no places are watched.
        """
        if self._watched is None:
            raise ValueError("watched: no places are watched; expected `watch` to be called before")
        return self._watched.columns(self)

    def mean_m(self, places_m: Array) -> Array:
        """Posterior mean (P,) given the data, without the cost of a variance."""
        places_m = np.asarray(places_m, dtype=float)
        mean = self.prior_mean(places_m)
        if not self.data_rows:
            return mean
        weights = self._factor_data_transposed(self._whitened)
        scaled = self.kernel.scale(places_m)
        for begin in range(0, len(scaled), CHUNK):
            part = scaled[begin : begin + CHUNK]
            mean[begin : begin + CHUNK] += weights @ self.kernel.of_scaled(self._scaled, part)
        return mean

    def _factor_data_transposed(self, right: Array) -> Array:
        if self.planned_rows:
            raise ValueError("mean_m: places are planned; expected to be asked given the data alone")
        return self._factor.solve_transposed(right)

    def columns(self, places_m: Array) -> Columns:
        """What the posterior says of places (P, 2)."""
        places_m = np.asarray(places_m, dtype=float).reshape(-1, 2)
        scaled = self.kernel.scale(places_m)
        known = np.concatenate([self._scaled, self._planned_scaled])
        white = self.kernel.of_scaled(scaled, known)
        self._whiten(white)
        n = self.data_rows
        data, planned = white[:, :n], white[:, n:]
        data_var = np.maximum(self.kernel.variance(places_m) - np.einsum("pn,pn->p", data, data), 0.0)
        planned_var = data_var
        if self.planned_rows:
            planned_var = np.maximum(data_var - np.einsum("pn,pn->p", planned, planned), 0.0)
        mean = self.prior_mean(places_m)
        if n:
            mean = mean + data @ self._whitened
        return Columns(scaled, white, mean, data_var, planned_var)

    def _whiten(self, rows: Array) -> None:
        """Solves L w = k for each of the rows k of an array (P, n + o), in place."""
        if not rows.size:
            return
        if self._lower is None:
            self._lower = np.ascontiguousarray(self._factor.lower)
        # to BLAS, whose columns are our rows: L^T is upper, and the right side is overwritten without a copy
        dtrsm(1.0, self._lower.T, rows.T, lower=0, trans_a=1, overwrite_b=1)

    def lower_covariance(self, a: Columns) -> Array:
        """Covariance (A, A) among places, its lower triangle only: half the work. Not to be read above it."""
        own = self.kernel.of_scaled(a.scaled, a.scaled).T  # symmetric; Fortran-ordered, so changed in place
        if not a.white.shape[1]:
            return own
        if a.white.flags.c_contiguous:
            return np.asarray(dsyrk(-1.0, a.white.T, beta=1.0, c=own, trans=1, lower=1, overwrite_c=1))
        return np.asarray(dsyrk(-1.0, np.asfortranarray(a.white), beta=1.0, c=own, lower=1, overwrite_c=1))

    def covariance(self, a: Columns, b: Columns) -> Array:
        """Covariance (A, B) of the depths given the data and the planned places."""
        if a is b and a.white.shape[1]:
            lower = self.lower_covariance(a)
            return np.tril(lower) + np.tril(lower, -1).T
        return self.kernel.of_scaled(a.scaled, b.scaled) - a.white @ b.white.T


class _Watched:
    """Whitened covariance of fixed places with the centres, row by row as centres come and go."""

    def __init__(self, posterior: Posterior, places_m: Array) -> None:
        self.scaled = posterior.kernel.scale(places_m)
        self._prior_mean = posterior.prior_mean(places_m)
        self._prior_var = posterior.kernel.variance(places_m)
        self._white = np.zeros((64, len(places_m)))
        self._rows = 0

    def truncate(self, rows: int) -> None:
        self._rows = min(self._rows, rows)

    def _extend(self, posterior: Posterior, known: Array) -> None:
        """Rows for the known places (scaled) from number `_rows` on, from the same rows of the factor."""
        begin, end = self._rows, len(known)
        if end <= begin:
            return
        if end > len(self._white):
            grown = np.zeros((max(end, 2 * len(self._white)), self._white.shape[1]))
            grown[:begin] = self._white[:begin]
            self._white = grown
        lower = posterior._factor.lower
        right = posterior.kernel.of_scaled(known[begin:end], self.scaled)
        right -= lower[begin:end, :begin] @ self._white[:begin]
        self._white[begin:end] = solve_triangular(
            lower[begin:end, begin:end], right, lower=True, check_finite=False, overwrite_b=True
        )
        self._rows = end

    def follow(self, posterior: Posterior) -> None:
        self._extend(posterior, posterior._scaled)

    def columns(self, posterior: Posterior) -> Columns:
        n = posterior.data_rows
        self._rows = min(self._rows, n)
        self._extend(posterior, np.concatenate([posterior._scaled, posterior._planned_scaled]))
        white = self._white[: self._rows]
        data_var = np.maximum(self._prior_var - np.einsum("np,np->p", white[:n], white[:n]), 0.0)
        planned_var = np.maximum(data_var - np.einsum("np,np->p", white[n:], white[n:]), 0.0)
        mean = self._prior_mean + posterior._whitened @ white[:n] if n else self._prior_mean
        return Columns(self.scaled, white.T, mean, data_var, planned_var)
