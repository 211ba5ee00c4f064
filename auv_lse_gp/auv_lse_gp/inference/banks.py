"""Banks: near a shore the depth falls to the depth known there, however deep the ground beside it was sounded.

With the distance d to the shore and the depth h along it, the depth f is modeled as

    f(p) = h + s(p) (g(p) - h),    s(p) = 1 - exp(-d(p) / BANK_M),

where g is the Gaussian process of open ground. So the prior mean m becomes h + s (m - h), its standard deviation is s
times that of open ground, and a sounding of deep ground hardly constrains the bank beside it.

Computations use the *relative depth* r(p) = l + (f(p) - l) / s(p) for the level l. It is at least l exactly where f is,
so classes, risks and the isobath are the same. Its prior has the same covariance as open ground and the mean
m - (l - h) (1 / s - 1). A sounding's error becomes 1 / s times as large.

Banks differ in width, which s leaves out. A bank that is wider by a factor exp(e) changes the relative depth, for small
e, by -e (f - h) / s x / (exp(x) - 1) with x = d / BANK_M. Maps add the variance of that, as far as soundings leave it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_gp.covariance.prior_mean import PriorMean
from auv_lse_gp.inference.centers import Centers

#: Distance (m) from the shore at which the depth has covered 63 % of the way from the shore's to that of open ground.
BANK_M = 25.0
#: Standard deviation of the logarithm of a bank's width about `BANK_M`.
WIDTH_STD = 0.5
#: Least factor s, so that depths on the shore itself stay finite.
LEAST = 0.05
#: Largest spacing (m) of the locations along the shore by which the nearest piece of it is found.
SPACING_M = 4.0
#: Number of the nearest of these locations whose pieces of shore are compared.
_NEAREST = 8
#: Half of the distance (m) of the finite difference for the slope of s.
_SLOPE_M = 0.05


class Banks:
    """The banks of an operating area."""

    def __init__(self, shores_m: list[Array], shore_depth_m: float, level_m: float) -> None:
        """Builds the soundings of shores, polylines (n, 2) of at least two corners, from their depth and the level."""
        self._depth_m, self._level_m = shore_depth_m, level_m
        locations = [_along(line) for line in shores_m]
        self._locations_m = np.concatenate(locations)
        self._tree = cKDTree(self._locations_m)
        # The pieces of shore before and after each location; at an end of a line, of no length.
        before = np.concatenate([np.vstack([line[:1], line[:-1]]) for line in locations])
        after = np.concatenate([np.vstack([line[1:], line[-1:]]) for line in locations])
        self._pieces_m = np.stack([before, after]) - self._locations_m
        self._last: tuple[Array, Array] | None = None  # the locations of the last call, and their factors

    @classmethod
    def of(cls, area: AreaConfig, level_m: float) -> Banks | None:
        """The banks of an area whose shore is known; None if all of its edges are open."""
        shores = [np.reshape(flat, (-1, 2)) for flat in area.shore.values()]
        return cls(shores, area.shore_depth_m, level_m) if shores else None

    def factor(self, locations_m: Array) -> Array:
        """Factor s (P,) at locations (P, 2), read-only. A map asks several times for those of its cells."""
        if self._last is not None and np.array_equal(self._last[0], locations_m):
            return self._last[1]
        _, nearest = self._tree.query(locations_m, k=np.arange(1, min(_NEAREST, self._tree.n) + 1))
        pieces, off = self._pieces_m[:, nearest], np.asarray(locations_m)[:, None] - self._locations_m[nearest]
        squares = np.maximum(np.einsum("spkd,spkd->spk", pieces, pieces), 1e-12)
        along = np.clip(np.einsum("spkd,pkd->spk", pieces, off) / squares, 0.0, 1.0)
        rest = off - along[..., None] * pieces
        distance = np.sqrt(np.einsum("spkd,spkd->spk", rest, rest).min(axis=(0, 2)))
        factors: Array = np.maximum(1.0 - np.exp(-distance / BANK_M), LEAST)
        factors.setflags(write=False)
        self._last = (np.array(locations_m), factors)
        return factors

    def mean(self, open_ground: PriorMean) -> PriorMean:
        """Prior mean of the relative depth, from that of open ground."""

        def relative(locations_m: Array) -> Array:
            off = (self._level_m - self._depth_m) * (1.0 / self.factor(locations_m) - 1.0)
            return np.asarray(open_ground(locations_m) - off)

        return relative

    def relative(self, centers: Centers) -> Centers:
        """Measurements of depths as measurements of relative depths."""
        s, effect = self.factor(centers.locations_m), centers.position_effect_m
        return Centers(
            centers.locations_m,
            self._level_m + (centers.depths_m - self._level_m) / s,
            centers.noise_std_m / s,
            None if effect is None else effect / s[:, None],
        )

    def depths(self, locations_m: Array, relative_m: Array) -> Array:
        """Depths (P,) at locations (P, 2) from relative depths."""
        return np.asarray(self._level_m + self.factor(locations_m) * (relative_m - self._level_m))

    def width_variance(self, locations_m: Array, relative_m: Array) -> Array:
        """Variance (P,) of relative depths (P,) at locations (P, 2) from the unknown width of banks, without
        soundings."""
        s = np.minimum(self.factor(locations_m), 1.0 - 1e-12)
        rise_m = np.maximum(self.depths(locations_m, relative_m) - self._depth_m, 0.0)
        share = -np.log1p(-s) * (1.0 - s) / s  # x / (exp(x) - 1)
        return np.asarray((WIDTH_STD * rise_m / s * share) ** 2)

    def slopes(self, locations_m: Array, relative_m: Array, slopes: Array) -> Array:
        """Slopes (P, 2) of the depth at locations (P, 2) from relative depths (P,) and their slopes (P, 2)."""
        steps = _SLOPE_M * np.eye(2)
        of_factor = [(self.factor(locations_m + s) - self.factor(locations_m - s)) / (2.0 * _SLOPE_M) for s in steps]
        off = (relative_m - self._level_m)[:, None] * np.stack(of_factor, axis=1)
        return np.asarray(self.factor(locations_m)[:, None] * slopes + off)


def depths(banks: Banks | None, locations_m: Array, relative_m: Array, variance_m2: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (P,), (P,) of depths at locations (P, 2), from those of relative depths."""
    std_m = np.sqrt(variance_m2)
    if banks is None or not len(relative_m):
        return relative_m, std_m
    return banks.depths(locations_m, relative_m), banks.factor(locations_m) * std_m


def width_factor(banks: Banks | None, locations_m: Array, relative_m: Array, signal_std_m: float) -> Array:
    """Variance from the unknown width of banks at locations (P, 2), relative to the prior's, (P,); 0 on open ground."""
    if banks is None or not len(locations_m):
        return np.zeros(len(locations_m))
    return banks.width_variance(locations_m, relative_m) / signal_std_m**2


def _along(line_m: Array) -> Array:
    """Locations (P, 2) along a polyline (n, 2), its corners among them."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])
    at = np.union1d(lengths, np.arange(0.0, lengths[-1], SPACING_M))
    return np.column_stack([np.interp(at, lengths, line_m[:, k]) for k in (0, 1)])
