"""The map of a vehicle: soundings in; depth, its uncertainty, risk and isobath on a grid out.

The posterior of the whole grid is kept and only brought up to date (`kept.CachedMoments`). The last few centers stay
provisional, since merging still moves them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from auv_lse_common.mission_file.sections.area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.inference.cached_points import CachedMoments
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.merging import MERGE_WINDOW
from auv_lse_gp.map.online import Counts, OnlineGp, Outcome

Array = NDArray[np.float64]

#: Probability that the true isobath is within the band of `DepthMap.isobath`, at any one place across it.
BAND_PROBABILITY = 0.95


@dataclasses.dataclass(frozen=True, slots=True)
class DepthField:
    """The posterior on the map's grid; arrays (ny, nx), NaN outside of the area.

    Attributes:
        grid: The grid.
        mean_m: Mean of the depth.
        std_m: Standard deviation of the depth, by the scale that the soundings show.
        prior_std_m: The same by the prior's scale (`gp.signal_std_m`), which planners and their account use.
        risk: Bayes risk.
        p_safe: Probability that the depth is at least the level.
        variance_scale: That scale: the factor on the prior's variance (`Posterior.variance_scale`).
        revision: Revision of the Gaussian process it was made from.
    """

    grid: Grid
    mean_m: Array
    std_m: Array
    prior_std_m: Array
    risk: Array
    p_safe: Array
    variance_scale: float
    revision: int


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


@dataclasses.dataclass(slots=True)
class TeamSamples:
    """What became of one team mate's samples.

    Attributes:
        heard: How many came.
        outliers: How many did not fit the map.
        kept: How many became centers.
    """

    heard: int = 0
    outliers: int = 0
    kept: int = 0

    @property
    def suspicious(self) -> bool:
        """More than a tenth of them, and more than three, do not fit: a wrong place, a bad sensor, or forged ones."""
        return self.outliers > max(3.0, 0.1 * self.heard)


class DepthMap:
    """A vehicle's own map, from its own soundings and its team's samples.

    Attributes:
        team: What became of the team mates' samples, by the number of the vehicle.
        gp: The Gaussian process.
        level_set: Level and costs.
        area: The operating area.
        grid: The map's cells.
    """

    def __init__(self, gp_config: GpConfig, level_set: LevelSetConfig, area: OperatingArea) -> None:
        """Starts with the prior."""
        self.gp = OnlineGp(gp_config)
        self.level_set = LevelSet.of(level_set)
        self.area = area
        self.grid = area.grid(gp_config.map_resolution_m)
        self.team: dict[int, TeamSamples] = {}
        self._places_m = self.grid.places_m
        self._moments = CachedMoments(self.gp.posterior, self._places_m, MERGE_WINDOW if gp_config.merge else 0)
        self._field: DepthField | None = None

    @property
    def counts(self) -> Counts:
        """What became of the soundings and samples."""
        return self.gp.counts

    @property
    def last_problem(self) -> str:
        """Why the last sounding was refused that was; "" before any was."""
        return self.gp.last_problem

    @property
    def centers(self) -> Centers:
        """The kernel centers."""
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
        order = np.argsort(rows[:, 0], kind="stable")
        return _in_order_given(order, self.gp.add_all(rows[order, 1:]))

    def add_samples(self, samples: ArrayLike, source: int) -> list[Outcome | None]:
        """Takes the samples of a packet, in the order given.

        Samples are only taken if they fit this vehicle's own map (`gp.team_outlier_sigmas`), and, where they would be
        new centers, as long as samples hold less than half of `gp.max_centers`.

        Args:
            samples: North, east, depth (m) of each (n, 3).
            source: Number of the vehicle that they come from.

        Returns:
            What became of each; None for one that was refused (counted, see `last_problem`).
        """
        rows = _rows("samples", samples, 3)
        told = self.team.setdefault(source, TeamSamples())
        told.heard += len(rows)
        sigmas = self.gp.config.team_outlier_sigmas
        fit = np.ones(len(rows), dtype=bool)
        finite = np.isfinite(rows).all(axis=1)
        if sigmas > 0.0 and len(self.gp) and finite.any():
            fit[finite] = self.gp.fits(rows[finite, :2], rows[finite, 2], sigmas)
        told.outliers += int((~fit).sum())
        self.gp.counts.outliers += int((~fit).sum())
        room = self.gp.config.max_centers // 2 - sum(mate.kept for mate in self.team.values())
        taken = self.gp.add_all(rows[fit], max(room, 0))
        told.kept += taken.count(Outcome.KEPT)
        outliers: list[Outcome | None] = [Outcome.OUTLIER] * int((~fit).sum())
        return _in_order_given(np.concatenate([np.flatnonzero(fit), np.flatnonzero(~fit)]), taken + outliers)

    def clear(self) -> None:
        """Forgets all soundings and samples, to take them in again at other places."""
        self.gp.clear()
        self.team.clear()

    def field(self) -> DepthField:
        """The posterior on the grid, brought up to date."""
        revision = self.gp.revision
        if self._field is None or self._field.revision != revision:
            mean, variance, of_places = self._predict()
            scale = self.gp.posterior.variance_scale
            std = np.sqrt(scale * variance + of_places)
            self._field = DepthField(
                grid=self.grid,
                mean_m=self.grid.fill(mean),
                std_m=self.grid.fill(std),
                prior_std_m=self.grid.fill(np.sqrt(variance + of_places)),
                risk=self.grid.fill(self.level_set.risk(mean, std)),
                p_safe=self.grid.fill(self.level_set.p_safe(mean, std)),
                variance_scale=scale,
                revision=revision,
            )
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

    def _predict(self) -> tuple[Array, Array, Array]:
        """Mean, variance by the prior's scale, and what uncertain places add to it, at the grid's places; (P,) each."""
        posterior = self.gp.posterior  # brought up to date
        if not self.gp.config.local or self.gp.kernel.compact:
            return self._moments.update()
        mean, std = self.gp.predict(self._places_m)
        of_places = posterior.place_variance(self.gp.kernel.scale(self._places_m))
        return mean, np.maximum(std**2 - of_places, 0.0), of_places


def contours(grid: Grid, values: Array, level: float) -> list[Array]:
    """Contour lines, each (n, 2): north, east (m), of values (ny, nx) at `level`; closed ones repeat their start."""
    from contourpy import contour_generator

    if min(values.shape) < 2:
        return []
    generator = contour_generator(x=grid.east_m, y=grid.north_m, z=np.ma.masked_invalid(values))
    return [np.asarray(line)[:, ::-1] for line in generator.lines(level)]


def _rows(name: str, values: ArrayLike, width: int) -> Array:
    rows = np.asarray(values, dtype=float)
    if rows.size == 0:
        return np.zeros((0, width))
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name}: got shape {rows.shape}; expected (n, {width})")
    return rows


def _in_order_given(order: NDArray[np.int64], outcomes: list[Outcome | None]) -> list[Outcome | None]:
    """Outcomes (n) of soundings that were taken in an order (n,), as the soundings were given."""
    given: list[Outcome | None] = [None] * len(outcomes)
    for i, outcome in zip(order.tolist(), outcomes, strict=True):
        given[i] = outcome
    return given
