"""The online Gaussian process of the depth: soundings in, one at a time; posterior out (paper, section "Online GP").

Theory of operation. The kept soundings are kernel centres; the Cholesky factor L of their covariance (with noise)
grows by a row per centre, O(n^2). Everything about a place p comes from its whitened covariance w(p) = L^-1 k(S, p):

    mean(p) = m(p) + w(p)^T b,  b = L^-1 (z - m(S));      cov(p, q) = k(p, q) - w(p)^T w(q).

Merging moves centres. That is put off until an answer is asked for, so that a hundred merged soundings cost one
refactoring, of the rows from the first moved centre on, which as a rule is one of the last. New centres wait likewise,
and are factorized as a block, where it is certain that they can be (`_certain`): which soundings are kept, and where
the centres are, does not depend on the factor. Otherwise each is factorized at once, so that `add` can refuse it.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_gp import compiled
from auv_lse_gp.config import GpConfig
from auv_lse_gp.factor import Factor, IllConditionedError
from auv_lse_gp.kernels import LOCAL_RATIO, Kernel
from auv_lse_gp.prior_mean import PriorMean, prior_mean

Array = NDArray[np.float64]

#: Places handled at once by `predict`, so that the work stays in the processor's cache.
CHUNK = 2048

#: Soundings that one centre is merged from, at most.
MERGED_AT_MOST = 256

#: Only the last so many centres are merged into: older ones stay as they are, so that neither the factor nor a map has
#: to be made anew when a vehicle crosses an old track (at 2000 centres that would take seconds).
MERGE_WINDOW = 32


class SoundingError(ValueError):
    """A sounding that cannot be one: not finite, or absurd."""


class Outcome(enum.Enum):
    """What became of a sounding."""

    KEPT = "kept"
    TOO_CLOSE = "too_close"
    MERGED = "merged"
    OUTLIER = "outlier"


@dataclasses.dataclass(slots=True)
class Counts:
    """How many soundings became what."""

    kept: int = 0
    too_close: int = 0
    merged: int = 0
    outliers: int = 0
    refused: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class Centers:
    """The kernel centres.

    Attributes:
        places_m: North, east (n, 2).
        depths_m: Depth (n,).
        noise_std_m: Standard deviation of each depth as a measurement (n,).
    """

    places_m: Array
    depths_m: Array
    noise_std_m: Array

    def __len__(self) -> int:
        """Number of centres."""
        return len(self.depths_m)


class OnlineGp:
    """Posterior of the depth given the soundings so far.

    Attributes:
        config: The configuration.
        kernel: Its covariance function.
        counts: What became of the soundings.
        revision: Changes whenever the posterior does.
        problems: What the user should know of: a support below the default, merges that were undone.
    """

    def __init__(self, config: GpConfig, mean: PriorMean | None = None) -> None:
        """Starts with no data.

        Args:
            config: Prior and rules for soundings.
            mean: Prior mean (P, 2) -> (P,); by default the one `config` describes (read from its file for a survey).
        """
        self.config = config
        self.kernel = Kernel(config)
        self.counts = Counts()
        self.revision = 0
        self.problems: list[str] = []
        self._warn_of_short_support()
        self.prior_mean = mean or prior_mean(config)
        self._size = 0
        self._places_m = np.zeros((64, 2))
        self._scaled = np.zeros((64, 2))
        self._depths_m = np.zeros(64)
        self._noise_m2 = np.zeros(64)
        self._whitened = np.zeros(64)  # L^-1 (z - m)
        self._factor = Factor()
        self._index = _SpacingIndex(config.min_spacing_m)
        self._groups: list[_Group] = []
        self._moved: set[int] = set()
        self._least_noise_m2 = config.noise_std_m**2 / (MERGED_AT_MOST if config.merge else 1)  # of any centre
        self._most_noise_m2 = config.noise_std_m**2  # before merging

    def __len__(self) -> int:
        """Number of centres."""
        return self._size

    # ---------------------------------------------------------------- data in

    def check(self, north_m: float, east_m: float, depth_m: float) -> None:
        """Refuses what cannot be a sounding.

        Raises:
            SoundingError: if a number is not finite, or the depth out of the configured range.
        """
        if not (math.isfinite(north_m) and math.isfinite(east_m) and math.isfinite(depth_m)):
            raise SoundingError(
                f"sounding north_m={north_m!r}, east_m={east_m!r}, depth_m={depth_m!r}: expected finite numbers"
            )
        if not self.config.min_depth_m <= depth_m <= self.config.max_depth_m:
            raise SoundingError(
                f"sounding at north_m={north_m:.1f}, east_m={east_m:.1f}: depth_m={depth_m!r}; expected "
                f"{self.config.min_depth_m:g} to {self.config.max_depth_m:g} m (gp.min_depth_m, gp.max_depth_m)"
            )
        if max(abs(north_m), abs(east_m)) > 1e6:
            raise SoundingError(
                f"sounding at north_m={north_m!r}, east_m={east_m!r}: expected within 1000 km of the local origin"
            )

    def add(self, north_m: float, east_m: float, depth_m: float) -> Outcome:
        """Takes one sounding, of the configured noise.

        Args:
            north_m: North (m).
            east_m: East (m).
            depth_m: Water depth (m, positive down).

        Returns:
            What became of it.

        Raises:
            SoundingError: if it cannot be a sounding (counted as refused).
            IllConditionedError: if the centres' covariance cannot be factorized with it (it is not kept).
        """
        try:
            self.check(north_m, east_m, depth_m)
        except SoundingError:
            self.counts.refused += 1
            raise
        place = np.array([[north_m, east_m]])
        if self.config.outlier_sigmas > 0.0 and self._size:
            mean, std = self._predict_stale(place)
            spread = math.hypot(std, self.config.noise_std_m)
            if abs(depth_m - mean) > self.config.outlier_sigmas * spread:
                self.counts.outliers += 1
                return Outcome.OUTLIER
        near = self._index.too_close(north_m, east_m)
        if near is None:
            self._append(place, np.array([depth_m]), np.array([self.config.noise_std_m**2]))
            self._index.add(north_m, east_m)
            if self.config.merge:
                self._groups.append(_Group(self.kernel, place[0], depth_m, self.config.noise_std_m))
            self.counts.kept += 1
            return Outcome.KEPT
        if not self._may_merge(near):
            self.counts.too_close += 1
            return Outcome.TOO_CLOSE
        self._groups[near].add(place[0], depth_m)
        self._moved.add(near)
        self.revision += 1
        self.counts.merged += 1
        return Outcome.MERGED

    def _may_merge(self, number: int) -> bool:
        held = len(self._groups)  # none after `set_centers`
        return max(0, self._size - MERGE_WINDOW) <= number < held and not self._groups[number].full

    def set_centers(self, places_m: ArrayLike, depths_m: ArrayLike, noise_std_m: ArrayLike) -> None:
        """Replaces all centres, as they come from another `OnlineGp`; no spacing, gate or merging is applied.

        Work is done only from the first centre on that differs from what is held: appending is cheap.

        Args:
            places_m: North, east (n, 2).
            depths_m: Depth (n,).
            noise_std_m: Standard deviation of each depth (n,), or one for all.

        Raises:
            ValueError: for shapes that do not fit, values that are not finite or noise that is not positive.
            IllConditionedError: if their covariance cannot be factorized (the centres up to there are held).
        """
        places = np.array(places_m, dtype=float).reshape(-1, 2)
        depths = np.array(depths_m, dtype=float).ravel()
        if len(places) != len(depths):
            raise ValueError(f"got {len(places)} places and {len(depths)} depths; expected as many")
        noise = np.broadcast_to(np.asarray(noise_std_m, dtype=float), depths.shape)
        for name, values in (("places_m", places), ("depths_m", depths), ("noise_std_m", noise)):
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{name}: holds {values[~np.isfinite(values)][0]}; expected finite numbers")
        if np.any(noise <= 0.0):
            raise ValueError(f"noise_std_m: holds {float(np.min(noise))}; expected standard deviations > 0 m")
        self._sync()
        same = min(self._size, len(depths))
        differs = (
            np.any(places[:same] != self._places_m[:same], axis=1)
            | (depths[:same] != self._depths_m[:same])
            | (noise[:same] ** 2 != self._noise_m2[:same])
        )
        first = int(np.argmax(differs)) if np.any(differs) else same
        if first == self._size == len(depths):
            return
        self._truncate(first)
        self._groups = []
        self._least_noise_m2 = min(self._least_noise_m2, float(np.min(noise, initial=math.inf)) ** 2)
        self._most_noise_m2 = max(self._most_noise_m2, float(np.max(noise, initial=0.0)) ** 2)
        self._append(places[first:], depths[first:], noise[first:] ** 2)
        self._index = _SpacingIndex(self.config.min_spacing_m)
        for north, east in places:
            self._index.add(float(north), float(east))

    # ---------------------------------------------------------------- posterior out

    @property
    def centers(self) -> Centers:
        """A copy of the kernel centres."""
        n = self._size
        if self._certain(n):
            self._settle()
        else:
            self._sync()
        return Centers(self._places_m[:n].copy(), self._depths_m[:n].copy(), np.sqrt(self._noise_m2[:n]))

    @property
    def cholesky(self) -> Array:
        """L (n, n) with L L^T = k(S, S) + noise: a view, not to be written to."""
        self._sync()
        return self._factor.lower

    @property
    def whitened_residuals(self) -> Array:
        """b = L^-1 (z - m(S)) (n,): a view, not to be written to."""
        self._sync()
        return self._whitened[: self._size]

    @property
    def scaled_centers(self) -> Array:
        """The centres' places (n, 2) in the kernel's own axes and lengths: a view, not to be written to."""
        self._sync()
        return self._scaled[: self._size]

    def solve_transposed_leading(self, right: Array, size: int) -> Array:
        """L11^-T right, with L11 the factor of the first `size` centres, for right (size, m)."""
        self._sync()
        return self._factor.solve_transposed(right, size)

    @property
    def condition(self) -> float:
        """A lower bound of the condition number of the centres' covariance with noise."""
        pivots = np.diag(self.cholesky)
        return float((pivots.max() / pivots.min()) ** 2) if len(pivots) else 1.0

    def whiten(self, places_m: ArrayLike) -> Array:
        """w = L^-1 k(S, p) (n, P) of places (P, 2).

        For a planner to keep: the posterior covariance of a and b is k(a, b) - w(a)^T w(b), the mean of a is
        m(a) + w(a)^T `whitened_residuals`. Rows of centres already there do not change when more are appended.
        """
        self._sync()
        cross = self.kernel.of_scaled(self._scaled[: self._size], self.kernel.scale(_places(places_m)))
        return self._factor.solve_in_place(cross)

    def predict(self, places_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth (without noise) at places (P, 2)."""
        places = _places(places_m)
        self._sync()
        if self.config.local and not self.kernel.compact:
            return self._predict_local(places)
        mean = np.asarray(self.prior_mean(places), float)
        variance = np.array(self.kernel.variance(places))
        self.condition_on_all(self.kernel.scale(places), mean, variance)
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def condition_on_all(self, scaled: Array, mean: Array, variance: Array) -> None:
        """Turns prior mean (P,) and variance (P,) of places (P, 2) in the kernel's axes into the posterior's."""
        self._sync()
        n = self._size
        if not n:
            return
        memory = np.empty(n * min(CHUNK, len(scaled)))
        for begin in range(0, len(scaled), CHUNK):
            part = slice(begin, min(begin + CHUNK, len(scaled)))
            columns = part.stop - begin
            whitened = memory[: n * columns].reshape(n, columns)
            self._factor.solve_in_place(self.kernel.of_scaled(self._scaled[:n], scaled[part], whitened))
            add_whitened(whitened, self._whitened[:n], mean[part], variance[part])

    def mean(self, places_m: ArrayLike) -> Array:
        """Mean (P,) of the depth at places (P, 2); cheaper than `predict`."""
        places = _places(places_m)
        self._sync()
        mean = np.asarray(self.prior_mean(places), float)
        if self._size:
            weights = self._factor.solve_transposed(self.whitened_residuals)
            scaled = self._scaled[: self._size]
            for begin in range(0, len(places), CHUNK):
                part = slice(begin, begin + CHUNK)
                mean[part] += weights @ self.kernel.of_scaled(scaled, self.kernel.scale(places[part]))
        return mean

    def posterior(self, places_m: ArrayLike) -> tuple[Array, Array]:
        """Mean (P,) and covariance (P, P) of the depths (without noise) at places (P, 2), from all centres."""
        places = _places(places_m)
        whitened = self.whiten(places)
        mean = np.asarray(self.prior_mean(places), float) + self.whitened_residuals @ whitened
        return mean, self.kernel(places, places) - whitened.T @ whitened

    def cross(self, a_m: ArrayLike, b_m: ArrayLike) -> Array:
        """Posterior covariance (A, B) of the depths at `a_m` (A, 2) and `b_m` (B, 2), from all centres."""
        a, b = _places(a_m), _places(b_m)
        return self.kernel(a, b) - self.whiten(a).T @ self.whiten(b)

    # ---------------------------------------------------------------- inside

    def _warn_of_short_support(self) -> None:
        usual = LOCAL_RATIO.get(self.kernel.name, 0.0) * self.config.length_scale_m
        if self.config.local and not self.kernel.compact and self.kernel.local_m < usual:
            text = (
                f"gp.support_m: {self.kernel.local_m:g} m is less than {LOCAL_RATIO[self.kernel.name]:g} length scales "
                f"({usual:g} m): the local subset of {self.kernel.name} then errs visibly, see docs/gp.md"
            )
            self.problems.append(text)
            warnings.warn(text, stacklevel=3)

    def _predict_stale(self, place_m: Array) -> tuple[float, float]:
        """`predict` at one place (1, 2) from what the factor holds, without merges that wait: for the gate."""
        n = self._factor.size
        whitened = self._factor.solve(self.kernel.of_scaled(self._scaled[:n], self.kernel.scale(place_m))[:, 0])
        variance = self.kernel.signal_variance_m2 - float(whitened @ whitened)
        return float(self.prior_mean(place_m)[0] + self._whitened[:n] @ whitened), math.sqrt(max(variance, 0.0))

    def _predict_local(self, places: Array) -> tuple[Array, Array]:
        """`predict` from the centres within d_eps: of each tile of d_eps / 4 in the kernel's axes, not of each place.

        The subset is a superset of each place's own, and depends on the place alone, not on the others asked for.
        """
        mean = np.asarray(self.prior_mean(places), float)
        std = np.sqrt(self.kernel.variance(places))
        if not self._size:
            return mean, std
        radius = self.kernel.local_radius
        side = radius / 4.0
        scaled = self.kernel.scale(places)
        centers = self._scaled[: self._size]
        residuals = self._depths_m[: self._size] - self.prior_mean(self._places_m[: self._size])
        tiles, group = np.unique(np.floor(scaled / side), axis=0, return_inverse=True)
        order = np.argsort(group.ravel(), kind="stable")
        bounds = np.searchsorted(group.ravel()[order], np.arange(len(tiles) + 1))
        for number, tile in enumerate(tiles):
            members = order[bounds[number] : bounds[number + 1]]
            gap = np.maximum(np.abs(centers - (tile + 0.5) * side) - 0.5 * side, 0.0)
            near = np.flatnonzero(np.einsum("nd,nd->n", gap, gap) <= radius**2)
            if not len(near):
                continue
            factor = Factor(len(near))
            own = self.kernel.of_scaled(centers[near], centers[near])
            own[np.diag_indices(len(near))] += self._noise_m2[near]
            factor.append(np.zeros((len(near), 0)), own)
            whitened = factor.solve_in_place(self.kernel.of_scaled(centers[near], scaled[members]))
            mean[members] += factor.solve(residuals[near]) @ whitened
            variance = self.kernel.signal_variance_m2 - np.einsum("np,np->p", whitened, whitened)
            std[members] = np.sqrt(np.maximum(variance, 0.0))
        return mean, std

    def _certain(self, size: int) -> bool:
        """Whether `size` centres can be factorized wherever they are, so that nothing is lost by doing it later.

        No pivot is less than the least noise variance; their rounding errors are within about size^2 eps times the
        largest variance (Higham 2002, theorems 10.3 and 10.7). The gate for outliers wants the factor each time anyway.
        """
        largest = 4.0 * self.kernel.signal_variance_m2 + self._most_noise_m2  # merging adds at most 4 k(p, p) of noise
        rounding = 4.0 * (size + 1) ** 2 * float(np.finfo(float).eps) * largest
        return self.config.outlier_sigmas == 0.0 and self._least_noise_m2 > rounding

    def _append(self, places: Array, depths: Array, noise_m2: Array) -> None:
        """Appends centres (m, 2), (m,), (m,); a refusal changes nothing."""
        n, m = self._size, len(depths)
        certain = self._certain(n + m)
        if not certain:
            self._sync()
        self._reserve(n + m)
        self._places_m[n : n + m] = places
        self._scaled[n : n + m] = self.kernel.scale(places)
        self._depths_m[n : n + m] = depths
        self._noise_m2[n : n + m] = noise_m2
        self._size = n + m
        if not certain:
            try:
                self._factorize()
            except IllConditionedError:
                self._size = n
                raise
        self.revision += 1

    def _factorize(self) -> None:
        """Appends the centres that are not in the factor yet to it."""
        n, size = self._factor.size, self._size
        if n == size:
            return
        scaled = self._scaled[n:size]
        own = self.kernel.of_scaled(scaled, scaled)
        own[np.diag_indices(size - n)] += self._noise_m2[n:size]
        self._factor.append(self.kernel.of_scaled(scaled, self._scaled[:n]), own)
        lower = self._factor.lower
        prior = self.prior_mean(self._places_m[n:size])
        residual = self._depths_m[n:size] - prior - lower[n:, :n] @ self._whitened[:n]
        for i in range(n, size):  # forward substitution of the new rows
            self._whitened[i] = (residual[i - n] - lower[i, n:i] @ self._whitened[n:i]) / lower[i, i]

    def _truncate(self, size: int) -> None:
        self._size = min(self._size, size)
        self._factor.truncate(size)

    def _settle(self) -> None:
        """Moves the centres that soundings were merged into; the factor forgets them and those after them."""
        if not self._moved:
            return
        for i in self._moved:
            self._places_m[i], self._depths_m[i], self._noise_m2[i] = self._groups[i].summary()
            self._scaled[i] = self.kernel.scale(self._places_m[i : i + 1])[0]
        self._factor.truncate(min(self._moved))
        self._moved.clear()

    def _sync(self) -> None:
        """Factorizes what waits: the centres from the first one on that merging has moved, and new ones."""
        if not self._moved and self._factor.size == self._size:
            return
        rows = slice(min([*self._moved, self._factor.size]), self._size)
        arrays = (self._places_m, self._scaled, self._depths_m, self._noise_m2)
        held = [x[rows].copy() for x in arrays]
        self._settle()
        try:
            self._factorize()
        except IllConditionedError:
            # Merging lowers the noise and may bring centres together. What was held before is known to work.
            for array, values in zip(arrays, held, strict=True):
                array[rows] = values
            self._factorize()
            self.problems.append(
                "merging made the covariance of the centres ill-conditioned: these soundings are not merged"
            )

    def _reserve(self, size: int) -> None:
        if size <= len(self._depths_m):
            return
        grow = max(size, 2 * len(self._depths_m)) - len(self._depths_m)
        self._places_m = np.pad(self._places_m, ((0, grow), (0, 0)))
        self._scaled = np.pad(self._scaled, ((0, grow), (0, 0)))
        self._depths_m, self._noise_m2, self._whitened = (
            np.pad(x, (0, grow)) for x in (self._depths_m, self._noise_m2, self._whitened)
        )


def add_whitened(whitened: Array, residuals: Array, mean: Array, variance: Array) -> None:
    """mean (P,) += residuals^T w, variance (P,) -= sum of w^2, for the whitened covariance w (n, P)."""
    if compiled.AVAILABLE:
        compiled.gp().add_whitened(whitened, residuals, mean, variance)
        return
    mean += residuals @ whitened
    variance -= np.einsum("np,np->p", whitened, whitened)


class _Group:
    """A centre and the soundings merged into it: together a measurement of the depth at their centroid.

    Their mean depth is the depth at the centroid, for a plane bottom exactly; for a curved one its error has the
    variance that the kernel gives to mean(f(p_i)) - f(centroid), which is added to the noise of the mean.
    """

    def __init__(self, kernel: Kernel, place_m: Array, depth_m: float, noise_std_m: float) -> None:
        self._kernel = kernel
        self._places_m = [place_m]
        self._depth_sum_m = depth_m
        self._noise_m2 = noise_std_m**2
        self._pair_sum = kernel.signal_variance_m2  # sum over all pairs of k(p_i, p_j)

    @property
    def full(self) -> bool:
        """Whether it takes no more: beyond, a sounding adds next to nothing."""
        return len(self._places_m) >= MERGED_AT_MOST

    def add(self, place_m: Array, depth_m: float) -> None:
        with_others = self._kernel(place_m[None], np.array(self._places_m)).sum()
        self._pair_sum += 2.0 * float(with_others) + self._kernel.signal_variance_m2
        self._places_m.append(place_m)
        self._depth_sum_m += depth_m

    def summary(self) -> tuple[Array, float, float]:
        """Place (2,), depth and noise variance of the centre."""
        n = len(self._places_m)
        places = np.array(self._places_m)
        centroid = places.sum(axis=0) / n
        to_centroid = float(self._kernel(centroid[None], places).sum()) / n
        curvature = self._pair_sum / n**2 - 2.0 * to_centroid + self._kernel.signal_variance_m2
        return centroid, self._depth_sum_m / n, self._noise_m2 / n + max(curvature, 0.0)


class _SpacingIndex:
    """Finds kept places within the minimum spacing of a new one, by a grid of cells of that size."""

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._cells: dict[tuple[int, int], list[tuple[float, float, int]]] = {}
        self._size = 0

    def _cell(self, north_m: float, east_m: float) -> tuple[int, int]:
        return math.floor(north_m / self._spacing_m), math.floor(east_m / self._spacing_m)

    def add(self, north_m: float, east_m: float) -> None:
        if self._spacing_m > 0.0:
            self._cells.setdefault(self._cell(north_m, east_m), []).append((north_m, east_m, self._size))
        self._size += 1

    def too_close(self, north_m: float, east_m: float) -> int | None:
        """Number of the nearest place that is closer than the spacing, None if there is none."""
        if self._spacing_m <= 0.0:
            return None
        row, column = self._cell(north_m, east_m)
        nearest, best = None, self._spacing_m
        for i in (row - 1, row, row + 1):
            for j in (column - 1, column, column + 1):
                for north, east, number in self._cells.get((i, j), ()):
                    distance = math.hypot(north - north_m, east - east_m)
                    if distance < best:
                        nearest, best = number, distance
        return nearest


def _places(places_m: ArrayLike) -> Array:
    places = np.asarray(places_m, dtype=float)
    if places.ndim != 2 or places.shape[1] != 2:
        raise ValueError(f"places_m: got shape {places.shape}; expected (P, 2): north, east (m)")
    return places


__all__ = ["Centers", "Counts", "IllConditionedError", "OnlineGp", "Outcome", "SoundingError"]
