"""A fast stand-in for the map's reward, to steer the search: facility location on the map's own places.

F(V) = sum over p in M of  max over v in V of  d(p, v),

d(p, v) the expected drop of risk at p from one measurement at v alone (given the data and the team mates' plans). F is
monotone and submodular, ranks paths like the exact drop (tested) and costs some microseconds. A measurement counts at
the nearest place of the map's grid. d is read from a table of the expected risk over two numbers, h = (l - m) / s and
phi = asin(s_after / s); for c1 = c2 and h = 0 the expected risk is linear in phi. A row of d is made when first used.
"""

from __future__ import annotations

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from auv_lse_common.compiled import compiled
from auv_lse_gp.area import Grid
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.map import MapReward

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Table of the expected risk: h from -H_MAX to H_MAX, phi from 0 to pi / 2.
H_MAX = 6.0
H_COUNT = 193
PHI_COUNT = 65
#: A measurement that lowers a variance by less than this fraction is taken to do nothing.
NEGLIGIBLE = 1e-3


def risk_table(level_set: LevelSet) -> Array:
    """Expected risk, shape (H_COUNT, PHI_COUNT), at h and phi."""
    h = np.linspace(-H_MAX, H_MAX, H_COUNT)[:, None]
    phi = np.linspace(0.0, 0.5 * math.pi, PHI_COUNT)[None, :]
    after, of_mean = np.broadcast_arrays(np.sin(phi), np.cos(phi))
    of_mean = np.where(np.broadcast_to(phi, of_mean.shape) >= 0.5 * math.pi, 0.0, of_mean)
    table = LevelSet(
        level_m=0.0, cost_false_safe=level_set.cost_false_safe, cost_false_unsafe=level_set.cost_false_unsafe
    ).expected_risk(-h, of_mean, after)
    return np.ascontiguousarray(table, dtype=float)


@compiled
def table_risk(table, h, phi):
    """Expected risk from the table, bilinear."""
    x = (h + H_MAX) * ((H_COUNT - 1) / (2.0 * H_MAX))
    if not (x > 0.0 and x < H_COUNT - 1):
        return 0.0
    y = phi * ((PHI_COUNT - 1) / (0.5 * math.pi))
    i = int(x)
    j = min(int(y), PHI_COUNT - 2)
    u = x - i
    v = y - j
    return (table[i, j] * (1.0 - v) + table[i, j + 1] * v) * (1.0 - u) + (
        table[i + 1, j] * (1.0 - v) + table[i + 1, j + 1] * v
    ) * u


@compiled
def read_table(table, h, phi, result):
    """`table_risk` for arrays (M,)."""
    for p in range(result.shape[0]):
        result[p] = table_risk(table, h[p], phi[p])


@compiled
def fill_row(row, covariance, noise, place, table, h, data_var, base_var, base_risk):
    """Drop of risk at every place of the map from one measurement at map place `place`."""
    scale = 1.0 / (covariance[place, place] + noise)
    for p in range(row.shape[0]):
        c = covariance[place, p]
        less = c * c * scale
        row[p] = 0.0
        if less > NEGLIGIBLE * base_var[p] and base_risk[p] > 1e-6:
            after = max(base_var[p] - less, 0.0)
            phi = math.asin(math.sqrt(min(after / data_var[p], 1.0)))
            drop = base_risk[p] - table_risk(table, h[p], phi)
            if drop > 0.0:
                row[p] = drop


class Surrogate:
    """Facility-location surrogate of a `MapReward` on the places of `grid`.

    Attributes:
        covariance: Of the map's places given data and team mates' plans, shape (M, M).
        rows: d(p, v), row v, shape (M, M); valid where `ready`.
        ready: Which rows are made, shape (M,).
        index: Number of the map's place at each grid node, nearest one for nodes outside, shape (N, E).
    """

    def __init__(self, grid: Grid, level_set: LevelSet) -> None:
        """Prepares for the map whose places are `grid.places_m`."""
        places = grid.places_m
        count = len(places)
        self._table = risk_table(level_set)
        self.grid = grid
        rows, columns = np.nonzero(grid.inside)
        number = np.full(grid.inside.shape, -1, dtype=np.int64)
        number[rows, columns] = np.arange(count)
        nearest = distance_transform_edt(~grid.inside, return_distances=False, return_indices=True)
        self.index: Ints = np.ascontiguousarray(number[nearest[0], nearest[1]])
        self.rows = np.zeros((count, count), dtype=np.float32)
        self.ready = np.zeros(count, dtype=np.bool_)
        self.covariance = np.zeros((0, 0))
        self._prior: NDArray[np.float32] | None = None

    def set(self, reward: MapReward) -> None:
        """Takes the data of one decision."""
        places = reward.places
        if self._prior is None:
            self._prior = reward.posterior.kernel.of_scaled(places.scaled, places.scaled).astype(np.float32)
        white = places.white.astype(np.float32)
        self.covariance = self._prior - white @ white.T
        std = np.sqrt(np.maximum(places.data_var_m2, 1e-12))
        self.h = (reward.level_set.level_m - places.mean_m) / std
        self.data_var = std**2
        self.base_var = np.maximum(places.planned_var_m2, 1e-12)
        phi = np.arcsin(np.sqrt(np.clip(self.base_var / self.data_var, 0.0, 1.0)))
        self.base_risk = np.empty(len(phi))
        read_table(self._table, self.h, phi, self.base_risk)
        self.noise = reward.posterior.noise_var_m2
        self.ready[:] = False

    def arguments(self) -> tuple[object, ...]:
        """The surrogate's part of the arguments of the compiled search."""
        g = self.grid
        return (
            self.rows,
            self.ready,
            self.covariance,
            self.noise,
            self._table,
            self.h,
            self.data_var,
            self.base_var,
            self.base_risk,
            self.index,
            float(g.north_m[0]),
            float(g.east_m[0]),
            float(g.resolution_m),
        )

    def values(self, places_m: Array) -> Array:
        """F (B,) of many paths with these places (B, P, 2)."""
        return np.asarray(values_of(self.arguments(), np.ascontiguousarray(places_m, dtype=float)))

    def value(self, places_m: Array) -> float:
        """F of the path with these places (P, 2)."""
        return float(self.values(places_m[None])[0])


@compiled
def add_place(
    rows,
    ready,
    covariance,
    noise,
    table,
    h,
    data_var,
    base_var,
    base_risk,
    index,
    north0,
    east0,
    cell,
    north,
    east,
    best,
):
    """Takes one place into `best` (M,), the drop at every place of the map so far."""
    i = min(max(round((north - north0) / cell), 0), index.shape[0] - 1)
    j = min(max(round((east - east0) / cell), 0), index.shape[1] - 1)
    place = index[i, j]
    row = rows[place]
    if not ready[place]:
        fill_row(row, covariance, noise, place, table, h, data_var, base_var, base_risk)
        ready[place] = True
    for p in range(best.shape[0]):
        if row[p] > best[p]:
            best[p] = row[p]


@compiled
def values_of(surrogate, places):
    """F (B,) of the places (B, P, 2) of many paths."""
    values = np.zeros(places.shape[0])
    best = np.empty(surrogate[5].shape[0], dtype=np.float32)
    for b in range(places.shape[0]):
        best[:] = 0.0
        for i in range(places.shape[1]):
            add_place(*surrogate, places[b, i, 0], places[b, i, 1], best)
        for p in range(best.shape[0]):
            values[b] += best[p]
    return values
