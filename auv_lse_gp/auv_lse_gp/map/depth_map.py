"""The map of a vehicle: computes depth, uncertainty, risk and isobath on a grid from soundings.

The posterior on the grid is cached (`CachedMoments`). The last centers are provisional, since merging still moves them.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.inference.banks import Banks, depths, width_factor
from auv_lse_gp.inference.cached_points import CachedMoments
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.inference.tiled_posterior import TiledMoments
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import contours
from auv_lse_gp.map.online import Counts, OnlineGp
from auv_lse_gp.map.store import MERGE_WINDOW, Outcome

#: Probability that the true isobath lies within the band of `DepthMap.isobath`, at any one location along it.
BAND_PROBABILITY = 0.95
#: Half the width of that band in standard deviations.
BAND_SIGMAS = float(ndtri(0.5 + BAND_PROBABILITY / 2.0))
#: Number of cells beyond which a map is published less often.
MANY_CELLS = 50_000
#: Least share of the variance of open ground that data have removed where contours pass the border, and below a
#: likely piece of the isobath.
INFORMED = 0.5
#: Number of multiplications for the tiles of `DepthMap.recent_field`: about a second.
RECENT_WORK = 2e10


@dataclasses.dataclass(frozen=True, slots=True)
class DepthField:
    """The posterior on the map's grid; arrays (ny, nx), NaN outside the area.

    Attributes:
        mean_m: Mean of the depth.
        std_m: Standard deviation of the depth, rescaled by the ground's roughness near each location (`Roughness`), and
            by the unknown width of banks (`width_factor`).
        prior_std_m: Standard deviation with the prior's scale (`gp.signal_std_m`), which planners use.
        p_safe: Probability that the depth is at least the level.
        variance_scale: Mean over the cells of the factor by which their variances were rescaled.
    """

    grid: Grid
    mean_m: Array
    std_m: Array
    prior_std_m: Array
    risk: Array
    p_safe: Array
    variance_scale: float
    revision: int

    def informed(self, signal_std_m: float) -> Mask:
        """Where data have removed at least `INFORMED` of the variance of open ground, (ny, nx).

        Args:
            signal_std_m: Standard deviation of the depth of open ground before the first sounding, `gp.signal_std_m`.
        """
        with np.errstate(invalid="ignore"):
            return np.asarray(1.0 - (self.prior_std_m / signal_std_m) ** 2 >= INFORMED)


@dataclasses.dataclass(frozen=True, slots=True)
class Moments:
    """Moments of the posterior at locations, (P,) each; of relative depths, if there are banks.

    Attributes:
        variance_m2: Variance with exact positions, by the prior's scale.
        position_variance_m2: Variance that uncertain positions add.
        scales: Factor on the variance that the ground's roughness near each location shows.
    """

    mean_m: Array
    variance_m2: Array
    position_variance_m2: Array
    scales: Array


@dataclasses.dataclass(frozen=True, slots=True)
class Isobath:
    """The estimated contour and its uncertainty band; every line is (n, 2): north, east (m).

    Attributes:
        lines: Contours of the mean depth at the level.
        shallow_edge: Shallow edge of the band: the mean depth is `BAND_SIGMAS` standard deviations less than the level.
        deep_edge: Deep edge of the band: as much more.
    """

    lines: list[Array]
    shallow_edge: list[Array]
    deep_edge: list[Array]
    band_probability: float


@dataclasses.dataclass(slots=True)
class TeamSamples:
    """Counts of one team mate's samples.

    Attributes:
        heard: Samples received.
        outliers: Samples that did not fit the map, or were down-weighted because they contradict others.
        kept: Samples that became centers.
    """

    heard: int = 0
    outliers: int = 0
    kept: int = 0

    @property
    def suspicious(self) -> bool:
        """Whether more than a tenth, and more than three, do not fit: wrong position, bad sensor, or forged samples."""
        return self.outliers > max(3.0, 0.1 * self.heard)


class DepthMap:
    """A vehicle's map, from its own soundings and its team mates' samples.

    Attributes:
        team: Counts of team mates' samples, by the number of the vehicle.
    """

    def __init__(self, gp_config: GpConfig, level_set: LevelSetConfig, area: OperatingArea) -> None:
        self.level_set = LevelSet.of(level_set)
        self.gp = OnlineGp(gp_config, banks=Banks.of(area.config, self.level_set.level_m))
        self.grid = area.grid(gp_config.map_resolution_m, "gp.map_resolution_m")
        self.team: dict[int, TeamSamples] = {}
        self._locations_m = self.grid.locations_m
        self._provisional = MERGE_WINDOW if gp_config.merge else 0
        self._moments: CachedMoments | TiledMoments | None = None  # of the map as it is now, dense or tiled
        self._field: DepthField | None = None

    @property
    def counts(self) -> Counts:
        """Number of soundings and samples by outcome."""
        return self.gp.counts

    @property
    def last_problem(self) -> str:
        """Reason of the last rejected sounding; "" without one."""
        return self.gp.last_problem

    @property
    def centers(self) -> Centers:
        """The kernel centers."""
        return self.gp.centers

    @property
    def revision(self) -> int:
        """Changes whenever the map does."""
        return self.gp.revision

    @property
    def publish_period_s(self) -> float:
        """Time (s) between published maps: `gp.publish_period_s`, beyond `MANY_CELLS` in proportion to the cells."""
        return self.gp.config.publish_period_s * max(1.0, len(self._locations_m) / MANY_CELLS)

    def add_soundings(self, soundings: Soundings | ArrayLike) -> list[Outcome | None]:
        """Adds the vehicle's own soundings, in the order of their stamps.

        Args:
            soundings: Soundings in any order, or rows of them as in `Soundings.from_rows`.

        Returns:
            The outcome of each, in the order given; None if it was rejected (counted, see `last_problem`).

        Raises:
            ValueError: for rows of another shape.
        """
        given = soundings if isinstance(soundings, Soundings) else Soundings.from_rows(soundings)
        order = np.argsort(given.stamp_s, kind="stable")
        outcomes: list[Outcome | None] = [None] * len(given)
        for i, outcome in zip(order.tolist(), self.gp.add_all(given.points_m[order]), strict=True):
            outcomes[i] = outcome
        return outcomes

    def add_samples(self, samples: ArrayLike, source: int, packets: Ints | None = None) -> list[Outcome | None]:
        """Adds the samples of a packet from vehicle `source`, in the order given.

        Those that contradict the map or each other are down-weighted (`consistency.py`).

        Samples must fit this vehicle's map (`gp.team_outlier_sigmas`). They become at most half of `gp.max_centers`.

        Args:
            samples: North, east, depth (m), (n, 3).
            packets: Number of each sample's packet (n,), in order; None: they are of one packet.

        Returns:
            The outcome of each; None if it was rejected (counted, see `last_problem`).

        Raises:
            ValueError: for another shape.
        """
        rows = np.asarray(samples, dtype=float)
        if rows.size == 0:
            rows = np.zeros((0, 3))
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise ValueError(f"samples must be north, east, depth (m) of shape (n, 3), not {rows.shape}")
        config, tally = self.gp.config, self.team.setdefault(source, TeamSamples())
        room = config.max_centers // 2 - sum(mate.kept for mate in self.team.values())
        outcomes, fit = self.gp.add_if_fitting(rows, config.team_outlier_sigmas, max(room, 0), packets)
        tally.heard += len(rows)
        tally.outliers += int((~fit).sum())
        tally.kept += outcomes.count(Outcome.KEPT)
        return outcomes

    def clear(self) -> None:
        """Drops all soundings and samples."""
        self.gp.clear()
        self.team.clear()

    def field(self) -> DepthField:
        """The posterior on the grid."""
        if self._field is None or self._field.revision != self.gp.revision:
            self._field = self._computed(math.inf)
        return self._field

    def recent_field(self) -> DepthField:
        """As `field`, in bounded time: tiles of a large map beyond the work budget keep earlier values.

        A map that is not tiled is always up to date.
        """
        if self._field is not None and self._field.revision == self.gp.revision:
            return self._field
        return self._computed(RECENT_WORK) if self.gp.is_tiled else self.field()

    def _computed(self, most_work: float) -> DepthField:
        moments = Moments(*self._predict(most_work))
        signal_std_m = self.gp.config.signal_std_m
        return field_of(self.grid, moments, self.level_set, self.gp.banks, signal_std_m, self.gp.revision)

    def isobath(self, field: DepthField | None = None) -> Isobath:
        """Contours of the mean at the level, and the band with probability `BAND_PROBABILITY`.

        Args:
            field: The posterior on the grid; None: `field`.
        """
        field = field or self.field()
        level_m, half_m = self.level_set.level_m, BAND_SIGMAS * field.std_m
        axes, informed = (self.grid.north_m, self.grid.east_m), field.informed(self.gp.config.signal_std_m)
        return Isobath(
            lines=contours(*axes, field.mean_m, level_m, informed),
            shallow_edge=contours(*axes, field.mean_m + half_m, level_m, informed),
            deep_edge=contours(*axes, field.mean_m - half_m, level_m, informed),
            band_probability=BAND_PROBABILITY,
        )

    def _predict(self, most_work: float) -> tuple[Array, Array, Array, Array]:
        """The values of `Moments`."""
        gp = self.gp
        if gp.is_tiled:
            tiled = gp.tiled  # up to date
            if not isinstance(self._moments, TiledMoments):
                self._moments = TiledMoments(tiled, self._locations_m, gp.config.length_scale_m)
            moments = self._moments.update(most_work)
            return *moments, self._moments.scales(gp.config.std_soundings)
        posterior = gp.posterior  # updates it
        if not isinstance(self._moments, CachedMoments):
            self._moments = CachedMoments(posterior, self._locations_m, self._provisional)
        mean, variance, position_variance = self._moments.update()
        return mean, variance, position_variance, variance_scales(posterior, gp.config, self._locations_m, variance)


def field_of(
    grid: Grid, moments: Moments, level_set: LevelSet, banks: Banks | None, signal_std_m: float, revision: int
) -> DepthField:
    """The map on a grid, from the moments at its cells."""
    locations, relative, variance = grid.locations_m, moments.mean_m, moments.variance_m2
    scales = moments.scales + width_factor(banks, locations, relative, signal_std_m)
    mean, std = depths(banks, locations, relative, scales * variance + moments.position_variance_m2)
    _, prior_std = depths(banks, locations, relative, variance + moments.position_variance_m2)
    return DepthField(
        grid=grid,
        mean_m=grid.fill(mean),
        std_m=grid.fill(std),
        prior_std_m=grid.fill(prior_std),
        risk=grid.fill(level_set.risk(mean, std)),
        p_safe=grid.fill(level_set.p_safe(mean, std)),
        variance_scale=float(scales.mean()) if len(scales) else 1.0,
        revision=revision,
    )
