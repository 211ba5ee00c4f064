"""The map of a vehicle: soundings in; depth, its uncertainty, risk and isobath on a grid out.

Theory of operation. The posterior of the whole grid is kept, and new centres are conditioned on all at once: with
the rows R = L22^-1 (k(new, grid) - L21 L11^-1 k(old, grid)) of the whitened covariance that they add, the mean grows
by R^T b_new and the variance shrinks by the sum of R^2. L21 L11^-1 is one small solve, so an update costs one pass of
k(old, grid), whatever the number of new centres. The last few centres stay provisional, since merging still moves
them: the state before them is kept, and they are conditioned on afresh each time.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular
from scipy.special import ndtri

from auv_lse_gp.area import Grid, OperatingArea
from auv_lse_gp.config import GpConfig
from auv_lse_gp.online import (
    CHUNK,
    MERGE_WINDOW,
    Centers,
    Counts,
    IllConditionedError,
    OnlineGp,
    Outcome,
    SoundingError,
    add_whitened,
)
from auv_lse_gp.risk import LevelSet

Array = NDArray[np.float64]

#: Probability that the true isobath is within the band of `DepthMap.isobath`, at any one place across it.
BAND_PROBABILITY = 0.95


@dataclasses.dataclass(frozen=True, slots=True)
class Field:
    """The posterior on the map's grid; arrays (ny, nx), NaN outside of the area.

    Attributes:
        grid: The grid.
        mean_m: Mean of the depth.
        std_m: Standard deviation of the depth.
        risk: Bayes risk.
        p_safe: Probability that the depth is at least the level.
        revision: Revision of the Gaussian process it was made from.
    """

    grid: Grid
    mean_m: Array
    std_m: Array
    risk: Array
    p_safe: Array
    revision: int

    @property
    def mean(self) -> Array:
        """`mean_m`."""
        return self.mean_m

    @property
    def std(self) -> Array:
        """`std_m`."""
        return self.std_m


@dataclasses.dataclass(frozen=True, slots=True)
class Isobath:
    """The estimated contour and its uncertainty band; every line is (n, 2): north, east (m).

    Attributes:
        lines: Contours of the mean depth at the level.
        shallow_edge: Edge of the band on the shallow side: P(f >= l) is (1 - band) / 2 there.
        deep_edge: Edge of the band on the deep side.
        band_probability: The band's probability.
    """

    lines: list[Array]
    shallow_edge: list[Array]
    deep_edge: list[Array]
    band_probability: float


class DepthMap:
    """A vehicle's own map, from its own soundings and its team's samples.

    Attributes:
        gp: The Gaussian process.
        level_set: Level and costs.
        area: The operating area.
        grid: The map's cells.
    """

    def __init__(self, gp_config: GpConfig, level_set: LevelSet, area: OperatingArea) -> None:
        """Starts with the prior."""
        self.gp = OnlineGp(gp_config)
        self.level_set = level_set
        self.area = area
        self.grid = area.grid(gp_config.map_resolution_m)
        self.last_problem = ""
        self._places_m = self.grid.places_m
        self._map = _GridPosterior(self.gp, self._places_m)
        self._field: Field | None = None

    @property
    def counts(self) -> Counts:
        """What became of the soundings and samples."""
        return self.gp.counts

    @property
    def centers(self) -> Centers:
        """The kernel centres."""
        return self.gp.centers

    @property
    def revision(self) -> int:
        """Changes whenever the map does."""
        return self.gp.revision

    def add_soundings(self, soundings: ArrayLike) -> list[Outcome | None]:
        """Takes the vehicle's own soundings, in the order of their stamps.

        Args:
            soundings: Stamp (s), north, east, depth (m) of each (n, 4); any order.

        Returns:
            What became of each, in the order given; None for one that was refused (counted, see `last_problem`).
        """
        rows = _rows("soundings", soundings, 4)
        outcomes: list[Outcome | None] = [None] * len(rows)
        for i in np.argsort(rows[:, 0], kind="stable"):
            outcomes[i] = self._add(*rows[i, 1:])
        return outcomes

    def add_samples(self, samples: ArrayLike) -> list[Outcome | None]:
        """Takes samples heard from the team, in the order given: north, east, depth (m) of each (n, 3)."""
        return [self._add(*row) for row in _rows("samples", samples, 3)]

    def field(self) -> Field:
        """The posterior on the grid, brought up to date."""
        revision = self.gp.revision
        if self._field is None or self._field.revision != revision:
            mean, std = self._map.update()
            risk, safe = self.level_set.risk(mean, std), self.level_set.p_safe(mean, std)
            fill = self.grid.fill
            self._field = Field(self.grid, fill(mean), fill(std), fill(risk), fill(safe), revision)
        return self._field

    def isobath(self) -> Isobath:
        """Contours of the mean at the level, and the band that holds the isobath with `BAND_PROBABILITY`."""
        field = self.field()
        quantile = float(ndtri(0.5 + BAND_PROBABILITY / 2.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            score = (field.mean_m - self.level_set.level_m) / np.maximum(field.std_m, 1e-9)
        return Isobath(
            lines=contours(self.grid, field.mean_m, self.level_set.level_m),
            shallow_edge=contours(self.grid, score, -quantile),
            deep_edge=contours(self.grid, score, quantile),
            band_probability=BAND_PROBABILITY,
        )

    def _add(self, north_m: float, east_m: float, depth_m: float) -> Outcome | None:
        try:
            return self.gp.add(float(north_m), float(east_m), float(depth_m))
        except SoundingError as error:
            self.last_problem = str(error)
        except IllConditionedError as error:
            self.gp.counts.refused += 1
            self.last_problem = str(error)
        return None


def contours(grid: Grid, values: Array, level: float) -> list[Array]:
    """Contour lines, each (n, 2): north, east (m), of values (ny, nx) at `level`; closed ones repeat their start."""
    from contourpy import contour_generator

    if min(values.shape) < 2:
        return []
    generator = contour_generator(x=grid.east_m, y=grid.north_m, z=np.ma.masked_invalid(values))
    return [np.asarray(line)[:, ::-1] for line in generator.lines(level)]


class _GridPosterior:
    """Mean and standard deviation at fixed places, kept up to date with an `OnlineGp`."""

    def __init__(self, gp: OnlineGp, places_m: Array) -> None:
        self._gp = gp
        self._places_m = places_m
        self._scaled = gp.kernel.scale(places_m)
        self._prior_mean = np.asarray(gp.prior_mean(places_m), float)
        self._provisional = MERGE_WINDOW if gp.config.merge else 0
        self._forget()

    def _forget(self) -> None:
        self._settled = Centers(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        self._mean = self._prior_mean.copy()
        self._variance = np.array(self._gp.kernel.variance(self._places_m))

    def update(self) -> tuple[Array, Array]:
        gp = self._gp
        if gp.config.local and not gp.kernel.compact:
            return gp.predict(self._places_m)
        centers = gp.centers
        n, old = len(centers), len(self._settled)
        if n < old or not (
            np.array_equal(centers.places_m[:old], self._settled.places_m)
            and np.array_equal(centers.depths_m[:old], self._settled.depths_m)
            and np.array_equal(centers.noise_std_m[:old], self._settled.noise_std_m)
        ):
            self._forget()
            old = 0
        settle = max(old, n - self._provisional)
        if n == old:
            return self._mean.copy(), np.sqrt(np.maximum(self._variance, 0.0))
        mean, variance = self._condition(old, settle, n)
        self._settled = Centers(centers.places_m[:settle], centers.depths_m[:settle], centers.noise_std_m[:settle])
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def _condition(self, old: int, settle: int, new: int) -> tuple[Array, Array]:
        """Conditions on centres old..settle for good, and on settle..new for the answer only."""
        gp = self._gp
        if old == 0 and settle == new:
            gp.condition_on_all(self._scaled, self._mean, self._variance)
            return self._mean.copy(), self._variance.copy()
        lower, whitened, centers = gp.cholesky, gp.whitened_residuals, gp.scaled_centers
        weights = gp.solve_transposed_leading(lower[old:new, :old].T, old) if old else None  # (old, m): L11^-T L21^T
        own, kept = lower[old:new, old:new], settle - old
        mean, variance = np.empty_like(self._mean), np.empty_like(self._variance)
        for begin in range(0, len(self._scaled), CHUNK):
            part = slice(begin, begin + CHUNK)
            if weights is None:
                rows = gp.whiten(self._places_m[part])
            else:
                rows = gp.kernel.of_scaled(centers[old:new], self._scaled[part])
                gp.kernel.subtract_weighted(centers[:old], weights, self._scaled[part], rows)
                rows = np.ascontiguousarray(solve_triangular(own, rows, lower=True, check_finite=False))
            add_whitened(rows[:kept], whitened[old:settle], self._mean[part], self._variance[part])
            mean[part], variance[part] = self._mean[part], self._variance[part]
            add_whitened(rows[kept:], whitened[settle:new], mean[part], variance[part])
        return mean, variance


def _rows(name: str, values: ArrayLike, width: int) -> Array:
    rows = np.asarray(values, dtype=float)
    if rows.size == 0:
        return np.zeros((0, width))
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name}: got shape {rows.shape}; expected (n, {width})")
    return rows
