"""The isobath that a survey may have missed: its expected length, and a 95 % upper limit.

One prior is not enough for this: how much can hide between tracks depends on how rough the ground is. The result is
therefore an average over *hypotheses*, priors of several length scales, weighted by the marginal likelihood of the
soundings. The ground's roughness near each location scales their standard deviation (`Roughness`).

- *Expected length:* the crossing intensity (`level_set/crossings.py`), summed over the cells that are not located.
- *Upper limit:* the 95th percentile of the contour lengths of random draws from the averaged posterior there. Draws are
  prior draws (random Fourier features) that are conditioned on the soundings (Matheron's rule): no covariance among
  cells is needed. Each has a standard deviation of its own: the roughness rests on few independent errors. The seed
  is fixed, so the same soundings give the same limit.

In a long, narrow area, such as a river, these priors are too smooth across it: soundings along a channel hardly show
its banks. There the limit is at least the length of an isobath along both sides, where it is not located.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.banks import Banks, width_factor
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.posterior_in_parts import extend_in_parts, moments_in_parts
from auv_lse_gp.inference.roughness import degrees_of_freedom, variance_scales_in_parts
from auv_lse_gp.inference.work import FUNCTION, Work, finish, rows_per_part
from auv_lse_gp.level_set.crossings import crossing_intensity

#: Kernel of all hypotheses, and their length scales / `gp.length_scale_m`.
KERNEL = "matern52"
FACTORS = tuple(2.0 ** (k / 6.0) for k in range(-12, 9))
#: Number of soundings that `gp.signal_std_m` counts as in the weights of hypotheses. Soundings along tracks hardly tell
#: a long, rough scale from a short, smooth one: a larger number would decide between them, perhaps wrongly.
STD_WORTH = 1.0
#: Every n-th length scale is tried first.
COARSE = 3
#: Hypotheses of less weight are left out.
LEAST_WEIGHT = 0.01
#: Largest number of centers; of more, evenly many are left out.
MAX_CENTERS = 1200
#: Least expected length per area (m per m2) of ground that is listed: 1 m in a cell of 10 m.
LEAST_DENSITY = 0.01
#: Cells whose expected depth is more standard deviations off the level are neither in the expected length nor drawn: a
#: normal depth is so far off with probability 1e-15; of the draws, whose deviations vary, far less than one is.
NEAR_STD = 8.0
#: Approximate largest number of cells.
MAX_CELLS = 5000
#: An area more than this many times as long as wide is a channel.
LONG = 4.0
#: Draws for the upper limit, the waves that they are made of, and the limit's probability.
DRAWS, WAVES, LIMIT_PROBABILITY = 200, 500, 0.95


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """A posterior of one length scale.

    Attributes:
        posterior: With the standard deviation of the prior, `gp.signal_std_m`.
        weight: Its probability.
    """

    posterior: Posterior
    weight: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Undiscovered:
    """Isobath that is not located.

    Attributes:
        per_cell_m: Expected length in each cell (ny, nx); 0 where located, NaN outside the area.
        expected_m: Their sum.
        limit_m: Upper limit with probability `LIMIT_PROBABILITY`.
        length_scale_m: Mean length scale of the hypotheses by weight.
    """

    grid: Grid
    per_cell_m: Array
    expected_m: float
    limit_m: float
    length_scale_m: float

    def patches(self) -> list[tuple[float, float, float]]:
        """North, east (m) and expected length (m) of each patch of ground that may hide isobath, the longest first.

        A patch is connected cells with at least `LEAST_DENSITY` of expected length per area.
        """
        lengths = np.nan_to_num(self.per_cell_m)
        labels, count = ndimage.label(lengths >= LEAST_DENSITY * self.grid.resolution_m**2, np.ones((3, 3)))
        found = []
        for number in range(1, count + 1):
            rows, columns = np.nonzero(labels == number)
            weights = lengths[rows, columns]
            north = float(np.average(self.grid.north_m[rows], weights=weights))
            east = float(np.average(self.grid.east_m[columns], weights=weights))
            found.append((north, east, float(weights.sum())))
        return sorted(found, key=lambda patch: -patch[2])


def hypotheses_in_parts(config: GpConfig, centers: Centers, banks: Banks | None) -> Work[list[Hypothesis]]:
    """Posteriors of several length scales that the soundings support, by decreasing weight.

    Every third length scale is tried first, then those beside one that has some weight: the likelihood changes slowly.
    """
    centers = _thinned(centers)
    tried: dict[int, tuple[Posterior, float]] = {}
    wanted = list(range(0, len(FACTORS), COARSE))
    while wanted:
        for number in wanted:
            posterior = yield from _conditioned(config, centers, banks, FACTORS[number])
            tried[number] = posterior, _log_likelihood(posterior, STD_WORTH)
        best = max(log for _, log in tried.values())
        likely = [number for number, (_, log) in tried.items() if math.exp(log - best) >= LEAST_WEIGHT / len(FACTORS)]
        beside = {n + step for n in likely for step in range(1 - COARSE, COARSE)}
        wanted = sorted(n for n in beside if 0 <= n < len(FACTORS) and n not in tried)
    numbers = sorted(tried)
    posteriors, logs = [tried[n][0] for n in numbers], np.array([tried[n][1] for n in numbers])
    weights = np.exp(logs - max(logs))
    kept = weights / weights.sum() >= LEAST_WEIGHT
    weights = np.where(kept, weights, 0.0) / weights[kept].sum()
    order = np.argsort(-weights, kind="stable")
    return [Hypothesis(posterior=posteriors[i], weight=float(weights[i])) for i in order if weights[i] > 0.0]


def _conditioned(config: GpConfig, centers: Centers, banks: Banks | None, factor: float) -> Work[Posterior]:
    """The posterior of one length scale: a multiple of `gp.length_scale_m`."""
    prior = dataclasses.replace(
        config,
        kernel=KERNEL,
        length_scale_m=factor * config.length_scale_m,
        length_scale_2_m=factor * config.length_scale_2_m,
    )
    posterior = Posterior(prior, banks=banks)
    yield from extend_in_parts(posterior, centers)
    return posterior


def _thinned(centers: Centers) -> Centers:
    if len(centers) <= MAX_CENTERS:
        return centers
    rows = np.linspace(0, len(centers) - 1, MAX_CENTERS).round().astype(int)
    effect = centers.position_effect_m
    return Centers(
        centers.locations_m[rows],
        centers.depths_m[rows],
        centers.noise_std_m[rows],
        None if effect is None else effect[rows],
    )


def _log_likelihood(posterior: Posterior, worth: float) -> float:
    """Log likelihood of the data up to a constant, with the variance's scale integrated out."""
    n = posterior.data_rows
    determinant = 2.0 * float(np.log(np.diag(posterior.factor.lower)[:n]).sum())
    return -0.5 * determinant - 0.5 * (worth + n) * math.log(max(worth + n * posterior.residual_ratio, 1e-300))


def undiscovered(
    config: GpConfig,
    centers: Centers,
    level_m: float,
    grid: Grid,
    located: Callable[[Array], Mask],
    banks: Banks | None = None,
) -> Undiscovered:
    """The isobath that is not located.

    Args:
        level_m: Depth of the isobath (m).
        grid: The cells (`coarse_grid`).
        located: Whether the isobath is located at locations (P, 2): mask (P,).
        banks: The banks of the area; None: all ground is open.
    """
    return finish(undiscovered_in_parts(config, centers, level_m, grid, located, banks))


def undiscovered_in_parts(
    config: GpConfig,
    centers: Centers,
    level_m: float,
    grid: Grid,
    located: Callable[[Array], Mask],
    banks: Banks | None = None,
) -> Work[Undiscovered]:
    """As `undiscovered`."""
    cells = grid.locations_m
    is_located = located(cells)
    found = yield from hypotheses_in_parts(config, centers, banks)
    lengths = np.zeros(len(cells))
    drawn: list[float] = []
    for hypothesis, count in zip(found, _shares([h.weight for h in found]), strict=True):
        posterior = hypothesis.posterior
        relative, variance, position_variance = yield from moments_in_parts(posterior, cells)
        scales = yield from variance_scales_in_parts(posterior, config, cells, variance)
        scales = scales + width_factor(banks, cells, relative, config.signal_std_m)
        near = np.abs(level_m - relative) <= NEAR_STD * np.sqrt(scales * variance + position_variance)
        missing, drawn_at = np.flatnonzero(near & ~is_located), np.flatnonzero(near)
        each = (2.0 * posterior.data_rows + 15.0 * FUNCTION) * posterior.data_rows
        rows = rows_per_part(each)
        for first in range(0, len(missing), rows):
            part = missing[first : first + rows]
            expected = expected_lengths(posterior, cells[part], scales[part], level_m, grid.resolution_m)
            lengths[part] += hypothesis.weight * expected
            yield each * len(part)
        freedom = degrees_of_freedom(posterior, config)
        for depths in (yield from draws_in_parts(posterior, cells[drawn_at], scales[drawn_at], count, freedom)):
            relative[drawn_at] = depths
            drawn.append(outside_m(grid, relative, level_m, located))
            yield 10.0 * FUNCTION * len(cells)
    expected_m, mean_m = float(lengths.sum()), float(np.mean(drawn))
    # Contours on cells are a little too short, the expected length is not: the draws give its relative limit.
    limit_m = expected_m * float(np.quantile(drawn, LIMIT_PROBABILITY)) / mean_m if mean_m > 0.0 else expected_m
    limit_m = max(limit_m, along_channel_m(cells, grid.resolution_m, lengths, is_located))
    return Undiscovered(
        grid=grid,
        per_cell_m=grid.fill(lengths),
        expected_m=expected_m,
        limit_m=limit_m,
        length_scale_m=sum(h.weight * h.posterior.kernel.length_m for h in found),
    )


def along_channel_m(cells: Array, cell_m: float, lengths: Array, is_located: Mask) -> float:
    """Length (m) of an isobath along both sides of a long, narrow area, where it is not located; 0 in other areas.

    Each slice of cells across the area has two sides. A side counts if none of its cells is located, and the expected
    length in it is more than 5 % of that of a line along it.

    Args:
        cells: The area's cells (P, 2).
        cell_m: Their size.
        lengths: Expected length (m) in each (P,).
        is_located: Whether the isobath is located there (P,).
    """
    if len(cells) < 3:
        return 0.0
    squares, axes = np.linalg.eigh(np.cov(cells.T))
    if squares[1] <= LONG**2 * squares[0]:
        return 0.0
    across, along = (cells @ axes).T
    slices = np.floor((along - along.min()) / cell_m).astype(np.int64)
    middle = np.bincount(slices, across) / np.maximum(np.bincount(slices), 1)  # a river may bend
    sides = 2 * slices + (across > middle[slices])
    may_be = np.bincount(sides, lengths) > (1.0 - LIMIT_PROBABILITY) * cell_m
    return cell_m * float(np.count_nonzero(may_be & (np.bincount(sides, is_located) == 0.0)))


def coarse_grid(area: OperatingArea, finest_m: float) -> Grid:
    """About `MAX_CELLS` cells over an area, of at least `finest_m`."""
    south, north, west, east = area.extent_m
    return area.grid(max(finest_m, area.cell_m(math.ceil(math.sqrt((north - south) * (east - west) / MAX_CELLS)))))


def expected_lengths(posterior: Posterior, cells: Array, scales: Array, level_m: float, cell_m: float) -> Array:
    """Expected length (m) of the isobath in cells (P, 2) of `cell_m` with variances scaled by (P,), shape (P,)."""
    at = posterior.depth_and_slope(cells)
    scaled = dataclasses.replace(
        at,
        variance_m2=scales * at.variance_m2 + posterior.position_variance(posterior.kernel.scale(cells)),
        covariance_m=scales[:, None] * at.covariance_m,
        slope_covariance=scales[:, None, None] * at.slope_covariance,
    )
    return crossing_intensity(scaled, level_m) * cell_m**2


def draws(posterior: Posterior, locations_m: Array, scales: Array, count: int, freedom: float) -> Array:
    """Random fields (count, P) from the posterior at locations (P, 2) with variances scaled by (P,).

    The scales are uncertain by a common factor, freedom / chi^2. Every call draws the same numbers. Depth errors from
    uncertain positions are not scaled.
    """
    return finish(draws_in_parts(posterior, locations_m, scales, count, freedom))


def draws_in_parts(posterior: Posterior, locations_m: Array, scales: Array, count: int, freedom: float) -> Work[Array]:
    """As `draws`."""
    rng = stream(0, "undiscovered", count)
    kernel, centers, n = posterior.kernel, posterior.relative(posterior.centers), posterior.data_rows
    waves, shares = _waves(rng)
    amplitudes = (
        rng.standard_normal((2 * WAVES, count)) * np.sqrt(kernel.signal_variance_m2 * np.tile(shares, 2))[:, None]
    )

    def field(scaled: Array) -> Array:
        phases = scaled @ waves.T
        return np.asarray(np.hstack([np.cos(phases), np.sin(phases)]) @ amplitudes)

    common = freedom / rng.chisquare(freedom, count) if math.isfinite(freedom) else np.ones(count)
    data, effect = kernel.scale(centers.locations_m), centers.position_effect_m
    weights, location_weights = np.zeros((n, count)), np.zeros((n, count))
    if n:
        off = rng.standard_normal((n, count)) * centers.noise_std_m[:, None]
        each = 4.0 * WAVES * (FUNCTION + count)
        rows = rows_per_part(each)
        for first in range(0, n, rows):
            part = slice(first, min(first + rows, n))
            off[part] += field(data[part])
            yield each * (part.stop - first)
        weights = _weights(posterior, off)
        yield float(n * n * count)
    if n and effect is not None:
        location_weights = _weights(posterior, effect @ rng.standard_normal((effect.shape[1], count)))
        yield float(n * n * count)
    drawn = np.empty((len(locations_m), count))
    each = 2.0 * WAVES * (FUNCTION + count) + n * (FUNCTION + 2.0 * count)
    rows = rows_per_part(each)
    for first in range(0, len(locations_m), rows):
        part = slice(first, min(first + rows, len(locations_m)))
        locations = locations_m[part]
        scaled = kernel.scale(locations)
        cross = kernel.of_scaled(scaled, data)
        std = np.sqrt(scales[part, None] * common)
        drawn[part] = posterior.mean_m(locations)[:, None] + std * (field(scaled) - cross @ weights)
        if effect is not None:
            drawn[part] += cross @ location_weights
        yield each * len(locations)
    return np.asarray(drawn.T)


def _weights(posterior: Posterior, depths: Array) -> Array:
    """Weights (n, count) of the data's covariances in the posterior's mean, if the data had depths (n, count)."""
    return posterior.factor.solve_transposed(posterior.factor.solve(depths), posterior.data_rows)


def _waves(rng: np.random.Generator) -> tuple[Array, Array]:
    """Wave vectors (W, 2) per scaled distance, and the share of the variance of each (W,).

    The spectrum of a Matern 5/2 kernel in the plane is a t distribution with 5 degrees of freedom, so |k|^2 =
    5 (u^(-2/5) - 1) for a uniform u. Ground between tracks depends on rare short waves: they are drawn more often,
    u = v^3, each with less variance.
    """
    v = (np.arange(WAVES) + rng.random(WAVES)) / WAVES
    length = np.sqrt(5.0 * (v ** (-6.0 / 5.0) - 1.0))
    angle = (np.arange(WAVES) * 0.6180339887 + rng.random()) * 2.0 * math.pi  # any few neighbors cover all directions
    shares = v * v
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), shares / shares.sum()


def outside_m(grid: Grid, depth_m: Array, level_m: float, located: Callable[[Array], Mask]) -> float:
    """Length (m) of the contour of depths (P,) of the grid's cells that is not located."""
    from contourpy import contour_generator

    values = np.ma.masked_invalid(grid.fill(depth_m))
    lines = contour_generator(x=grid.east_m, y=grid.north_m, z=values).lines(level_m)
    starts = [line[:-1, ::-1] for line in lines]
    ends = [line[1:, ::-1] for line in lines]
    if not starts:
        return 0.0
    start, end = np.concatenate(starts), np.concatenate(ends)
    return float(np.hypot(*(end - start).T)[~located(0.5 * (start + end))].sum())


def _shares(weights: list[float]) -> list[int]:
    """`DRAWS` in whole numbers in proportion to weights."""
    edges = np.round(DRAWS * np.cumsum(weights)).astype(int)
    return [int(count) for count in np.diff(edges, prepend=0)]
