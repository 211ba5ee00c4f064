"""Synthetic lakes: drowned river valleys generated from a seed."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.seeds import stream


@dataclass(frozen=True, slots=True)
class _Valley:
    """The random numbers of one lake; lengths in units of the window's half diagonal."""

    direction_rad: float
    bend: Array  # (2, 3): amplitude, wave number and phase of two bends
    offset: float
    width: Array  # (3,): mean, wave number, phase
    inlets: Array  # (I, 5): u, v, direction, length, width
    islands: Array  # (J, 5): north, east, radius, stretch, direction
    relief: Array  # (F, 3): north and east wave vectors and phase


def _draw(config: LakeConfig, rng: np.random.Generator) -> _Valley:
    scale = math.hypot(config.window.height_m, config.window.width_m) / 2.0
    direction = rng.uniform(0.0, math.pi)
    bend = np.stack(
        [rng.uniform([0.10, 0.04], [0.25, 0.12]), rng.uniform([2.0, 4.5], [3.5, 7.0]), rng.uniform(0, 2 * np.pi, 2)],
        axis=1,
    )
    offset = rng.uniform(-0.2, 0.2)
    width = np.array([rng.uniform(0.26, 0.36), rng.uniform(2.0, 5.0), rng.uniform(0.0, 2.0 * np.pi)])
    inlets = np.empty((config.inlets, 5))
    spread = (np.arange(config.inlets) + 0.5) / max(config.inlets, 1) * 1.8 - 0.9
    inlets[:, 0] = spread + rng.uniform(-0.12, 0.12, config.inlets)
    inlets[:, 1] = np.where(rng.permutation(config.inlets) % 2 == 0, 1.0, -1.0)  # which bank
    inlets[:, 2] = rng.uniform(-0.6, 0.6, config.inlets)
    inlets[:, 3] = rng.uniform(0.45, 0.8, config.inlets)
    inlets[:, 4] = rng.uniform(0.07, 0.13, config.inlets)
    islands = np.empty((config.islands, 5))
    islands[:, 0] = rng.uniform(-0.75, 0.75, config.islands)  # along the valley
    islands[:, 1] = rng.uniform(-0.6, 0.6, config.islands)  # across, in valley widths
    islands[:, 2] = rng.uniform(0.09, 0.15, config.islands)
    islands[:, 3] = rng.uniform(0.6, 1.0, config.islands)
    islands[:, 4] = rng.uniform(0.0, np.pi, config.islands)
    features = 48
    # Normal wave vectors: relief with a squared exponential covariance of one length scale.
    relief = np.concatenate(
        [
            rng.standard_normal((features, 2)) * scale / config.roughness_scale_m,
            rng.uniform(0, 2 * np.pi, (features, 1)),
        ],
        axis=1,
    )
    return _Valley(direction, bend, offset, width, inlets, islands, relief)


def _height(valley: _Valley, north: Array, east: Array) -> tuple[Array, Array]:
    """Depth in the valley (dimensionless, 1 at the thalweg), and the small relief (unit variance).

    Args:
        north: Locations in units of the half diagonal, from the window's middle.
        east: The same, east.
    """
    along = np.cos(valley.direction_rad) * north + np.sin(valley.direction_rad) * east
    across = -np.sin(valley.direction_rad) * north + np.cos(valley.direction_rad) * east

    def thalweg(u: Array) -> Array:
        result = np.full_like(u, valley.offset)
        for amplitude, wave, phase in valley.bend:
            result = result + amplitude * np.sin(wave * u + phase)
        return result

    mean, wave, phase = valley.width
    width = mean * (1.0 + 0.25 * np.sin(wave * along + phase))
    depth = np.exp(-0.5 * ((across - thalweg(along)) / width) ** 2)
    total = depth
    for u0, bank, lean, length, breadth in valley.inlets:
        v0 = float(thalweg(np.asarray(u0)))
        du, dv = along - u0, across - v0
        reach = bank * math.cos(lean) * dv + math.sin(lean) * du  # along the inlet, from the thalweg outwards
        side = bank * -math.sin(lean) * dv + math.cos(lean) * du
        # A trough of `length` that ends smoothly at its head and at the other bank.
        head = 1.0 / (1.0 + np.exp(np.clip((reach - length) / 0.06, -50.0, 50.0)))
        mouth = 1.0 / (1.0 + np.exp(np.clip(-reach / 0.06, -50.0, 50.0)))
        trough = 0.8 * head * mouth * np.exp(-0.5 * (side / breadth) ** 2)
        total = total + trough * (1.0 - depth)
    for u0, shift, radius, stretch, turn in valley.islands:
        v0 = float(thalweg(np.asarray(u0))) + shift * mean
        du, dv = along - u0, across - v0
        a = math.cos(turn) * du + math.sin(turn) * dv
        b = -math.sin(turn) * du + math.cos(turn) * dv
        total = total - 1.1 * np.exp(-0.5 * ((a / radius) ** 2 + (b / (radius * stretch)) ** 2))
    return total, _relief(valley.relief, north, east)


def _relief(waves: Array, north: Array, east: Array) -> Array:
    """Random Fourier features (Rahimi & Recht 2007): a sum of waves (F, 3), unit variance, in blocks of locations."""
    n, e = north.ravel(), east.ravel()
    relief = np.empty(n.shape)
    for i in range(0, n.size, 8192):
        j = slice(i, i + 8192)
        relief[j] = np.cos(
            np.multiply.outer(n[j], waves[:, 0]) + np.multiply.outer(e[j], waves[:, 1]) + waves[:, 2]
        ).sum(1)
    return relief.reshape(north.shape) * math.sqrt(2.0 / len(waves))


def _closed_shoals(shallow: Mask, cell_m2: float, least_m2: float) -> int:
    """Number of connected shallow patches of at least `least_m2` that do not touch the raster's edge."""
    labels, count = ndimage.label(shallow)
    edge = set(np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])).tolist())
    sizes = np.bincount(labels.ravel(), minlength=count + 1) * cell_m2
    return sum(1 for i in range(1, count + 1) if i not in edge and sizes[i] >= least_m2)


#: Node spacing (m) of a lake's table: a fifteenth of the small relief's wavelength.
TABLE_M = 4.0


class SyntheticLake:
    """A drowned river valley generated from a seed; twice continuously differentiable inside its extent.

    A draw is a valley with a bending thalweg, side valleys, knolls and small relief. A logistic profile converts it
    to depths between the terrace and the deepest point, shifted so that the requested fraction of the window is
    deeper than the level. Around the window the banks rise to land. Draws without an island (a closed contour of at
    least 800 m2 inside the window) are rejected; the next draw of the same seed is used.

    Args:
        mission_seed: Used if `config.seed` is -1.

    Raises:
        ValueError: if 200 draws in a row have no island (inconsistent parameters).
    """

    def __init__(self, config: LakeConfig | None = None, mission_seed: int = 1) -> None:
        self.config = config or LakeConfig()
        self.seed = mission_seed if self.config.seed < 0 else self.config.seed
        self._window = self.config.window
        self._half_m = math.hypot(self._window.height_m, self._window.width_m) / 2.0
        span = self.config.deepest_m - self.config.terrace_m
        share = (self.config.level_m - self.config.terrace_m) / span
        self._level_logit = math.log(share / (1.0 - share))
        self._gain = 5.5 * self.config.steepness
        north, east = np.meshgrid(*self._window.axes(10.0), indexing="ij")
        for attempt in range(200):
            rng = stream(self.seed, "lake", attempt)
            self._valley = _draw(self.config, rng)
            height, _ = _height(self._valley, *self._unit(north, east))
            deep_share = rng.uniform(self.config.deep_share_low, self.config.deep_share_high)
            self._middle = float(np.quantile(height, 1.0 - deep_share))
            if self._good(self._formula(north, east)):
                self.attempt = attempt
                self._spline = self._tabulated()
                return
        w = self._window
        raise ValueError(
            f"sim.lake.islands {self.config.islands}: none of 200 lakes of seed {self.seed} has a closed shoal within "
            f"{w.height_m:.0f} m x {w.width_m:.0f} m. Make sim.lake.height_m and sim.lake.width_m larger or "
            "sim.lake.inlets fewer, or set sim.lake.islands to 0."
        )

    def _good(self, depth: Array) -> bool:
        cell = self._window.height_m * self._window.width_m / depth.size
        shallow = depth < self.config.level_m
        if not self.config.deep_share_low - 0.05 <= 1.0 - float(shallow.mean()) <= self.config.deep_share_high + 0.05:
            return False
        return self.config.islands == 0 or _closed_shoals(shallow, cell, 800.0) >= 1

    def _unit(self, north_m: Array, east_m: Array) -> tuple[Array, Array]:
        north, east = self._window.center
        return (north_m - north) / self._half_m, (east_m - east) / self._half_m

    @property
    def extent(self) -> Extent:
        """The window and its banks."""
        return self._window.grown(self.config.shore_m)

    @property
    def origin(self) -> None:
        """None: a synthetic lake has no geodetic position."""
        return None

    def _tabulated(self) -> RectBivariateSpline:
        """Tabulates the formula as a bicubic spline with nodes every TABLE_M, for speed."""
        e = self.extent
        north = np.linspace(e.north_min_m, e.north_max_m, math.ceil(e.height_m / TABLE_M) + 1)
        east = np.linspace(e.east_min_m, e.east_max_m, math.ceil(e.width_m / TABLE_M) + 1)
        return RectBivariateSpline(north, east, self._formula(*np.meshgrid(north, east, indexing="ij")))

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Water depth (m, positive down), any broadcastable shape; NaN on land and beyond the extent."""
        north, east = np.broadcast_arrays(np.asarray(north_m, float), np.asarray(east_m, float))
        e = self.extent
        inside = (north >= e.north_min_m) & (north <= e.north_max_m) & (east >= e.east_min_m) & (east <= e.east_max_m)
        water = self._spline.ev(
            np.where(inside, north, self._window.center[0]), np.where(inside, east, self._window.center[1])
        )
        return np.where(inside & (water > 0.0), water, np.nan)

    def _formula(self, north: Array, east: Array) -> Array:
        """Depth (m) by the family's formula; 0 or less on land."""
        height, relief = _height(self._valley, *self._unit(north, east))
        logit = np.clip(self._gain * (height - self._middle) + self._level_logit, -40.0, 40.0)
        rise = 1.0 / (1.0 + np.exp(-logit))
        span = self.config.deepest_m - self.config.terrace_m
        # Bounded relief keeps the terrace navigable in every draw.
        depth = self.config.terrace_m + span * rise + self.config.roughness_m * 2.0 * np.tanh(relief / 2.0)
        outside = np.maximum(
            np.maximum(self._window.north_min_m - north, north - self._window.north_max_m),
            np.maximum(self._window.east_min_m - east, east - self._window.east_max_m),
        )
        x = np.clip(outside / self.config.shore_m, 0.0, 1.0)
        bank = 1.0 - x * x * (3.0 - 2.0 * x)
        water: Array = depth * bank
        return water

    def describe(self) -> str:
        """Describes the lake and its parameters in one sentence."""
        w = self._window
        return (
            f"synthetic lake {self.seed} (drowned valley, {self.config.inlets} inlets, {self.config.islands} knolls), "
            f"{self.config.terrace_m:g} to {self.config.deepest_m:g} m deep in "
            f"{w.height_m:.0f} m x {w.width_m:.0f} m (north x east), banks rising to land around it"
        )
