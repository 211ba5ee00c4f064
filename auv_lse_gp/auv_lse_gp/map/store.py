"""The kernel centers of a map: one table, in which soundings are kept, merged and moved.

A sounding becomes a center, a row of the table, if it is at least the minimum spacing away from the first sounding of
every center. Otherwise it is merged into the nearest center if that is one of the last, and not less noisy.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support import compiled
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.compiled.modules import compiled_gp
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.inference.centers import Centers

#: Maximum number of soundings per center.
MAX_MERGED = 256
#: Number of last centers that merging may change. Otherwise crossing an old track would recompute the factor and the
#: map (seconds at 2000 centers).
MERGE_WINDOW = 32
#: Number of soundings that are converted to Python numbers at a time.
_AT_A_TIME = 10_000


class Outcome(enum.Enum):
    """The outcome of a sounding."""

    KEPT = "kept"
    TOO_CLOSE = "too_close"
    MERGED = "merged"
    OUTLIER = "outlier"
    FULL = "full"


class CenterStore:
    """The kernel centers.

    Up to a few thousand centers, comparing a sounding with all of them is faster than a sorted index.
    """

    def __init__(self, config: GpConfig, kernel: Kernel) -> None:
        self._config, self._kernel = config, kernel
        # north and east of the first sounding; then those of the measurement, its depth and noise
        self._table = GrowingRows(6)
        self._merges: dict[int, _Merged] = {}  # of the last centers
        self._changed: set[int] = set()  # centers whose rows lack merged soundings
        self._position_effect_m: Array | None = None
        # The least noise with which centers can be factorized wherever they are: rounding errors are below about n^2
        # eps times the largest variance (Higham 2002, theorems 10.3 and 10.7), and merging adds at most 4 k(p, p).
        largest_m2 = 4.0 * kernel.signal_variance_m2 + config.noise_std_m**2
        self._least_noise_m2 = 4.0 * (config.max_centers + 1) ** 2 * float(np.finfo(float).eps) * largest_m2

    def __len__(self) -> int:
        """Number of centers."""
        return len(self._table)

    @property
    def centers(self) -> Centers:
        """The centers: views, overwritten by later changes."""
        for number in sorted(self._changed):
            self._settle(number)
        rows, effect = self._table.rows, None
        if (known := self._position_effect_m) is not None:
            effect = np.zeros((len(rows), known.shape[1]))
            effect[: len(known)] = known
        return Centers(rows[:, 2:4], rows[:, 4], rows[:, 5], effect)

    def take(self, soundings: Array, noise_std_m: Array, max_new: int) -> list[Outcome]:
        """Adds soundings one after another.

        Args:
            soundings: North, east, depth (m), shape (n, 3).
            noise_std_m: Standard deviations of their noise (n,). One that is larger than a center's is not merged.
            max_new: Largest number of new centers.
        """
        size = len(self)
        near, new = self._spaced(soundings[:, :2], max(min(max_new, self._config.max_centers - size), 0))
        self._table.rows[size:, 2:5] = soundings[new]
        self._table.rows[size:, 5] = np.maximum(noise_std_m[new], math.sqrt(self._least_noise_m2))
        columns, outcomes = (near, new, soundings, noise_std_m), []
        # as Python's numbers, the soundings of a long survey take far more memory than the map: some at a time
        parts = (slice(first, first + _AT_A_TIME) for first in range(0, len(soundings), _AT_A_TIME))
        given = (row for part in parts for row in zip(*(column[part].tolist() for column in columns), strict=True))
        for number, is_new, (north_m, east_m, depth_m), noise_m in given:
            if is_new:
                size += 1
                if self._config.merge:
                    self._open(number, _Merged(self._kernel, (north_m, east_m), depth_m, noise_m))
                outcomes.append(Outcome.KEPT)
            elif number < 0:
                outcomes.append(Outcome.FULL)
            elif number in self._merges and self._merges[number].takes(noise_m):
                self._merges[number].add((north_m, east_m), depth_m, noise_m)
                self._changed.add(number)
                outcomes.append(Outcome.MERGED)
            else:
                outcomes.append(Outcome.TOO_CLOSE)
        return outcomes

    def shift(self, by_m: Array) -> None:
        """Moves each center and its merged soundings by (n, 2)."""
        rows = self._table.rows
        rows[:, 2:4] = self.centers.locations_m + by_m
        rows[:, :2] += by_m
        for number, merged in self._merges.items():
            merged.shift(by_m[number].tolist())

    def set_position_effect(self, effect_m: Array | None) -> None:
        """Sets `Centers.position_effect_m` (n, r) of the first n centers; later centers have no effect.

        Raises:
            ValueError: if there are more rows than centers.
        """
        if effect_m is not None and len(effect_m) > len(self):
            raise ValueError(f"position effect: {len(effect_m)} rows are more than the {len(self)} centers")
        self._position_effect_m = effect_m

    def _open(self, number: int, merged: _Merged) -> None:
        """Lets a new center take soundings, and closes the one before the last `MERGE_WINDOW`."""
        self._merges[number] = merged
        if number - MERGE_WINDOW in self._changed:
            self._settle(number - MERGE_WINDOW)
        self._merges.pop(number - MERGE_WINDOW, None)

    def _settle(self, number: int) -> None:
        """Writes a center with its merged soundings into the table."""
        location_m, depth_m, noise_m2 = self._merges[number].summary()
        noise_std_m = math.sqrt(max(noise_m2, self._least_noise_m2))
        self._table.rows[number, 2:] = (*location_m, depth_m, noise_std_m)
        self._changed.discard(number)

    def _spaced(self, locations_m: Array, max_new: int) -> tuple[Ints, Mask]:
        """Appends, one after another, the locations (n, 2) that no first sounding is too close to, at most `max_new`.

        Returns:
            For each location (n,): the number of the center that is too close, its own number if it is kept, or -1 if
            `max_new` are kept already; and a mask (n,) of the kept ones.
        """
        before, near = len(self), np.empty(len(locations_m), dtype=np.int64)
        self._table.reserve(before + len(locations_m))
        take = compiled_gp().take_spaced if compiled.USE_NUMBA else take_spaced_numpy
        take(self._table.buffer, before, self._config.min_spacing_m, locations_m, max_new, near)
        first = np.full(len(locations_m), -1)
        first[1:] = np.maximum.accumulate(near)[:-1]
        new = near > np.maximum(first, before - 1)
        self._table.resize(before + int(new.sum()))
        return near, new


class _Merged:
    """A center and the soundings merged into it: one measurement of the depth at their centroid.

    On a plane bottom, the mean of the depths is the depth at the centroid. On a curved one, it differs by mean(f(p_i))
    - f(centroid), whose variance under the kernel is added to the noise of the mean.
    """

    def __init__(self, kernel: Kernel, position_m: Sequence[float], depth_m: float, noise_std_m: float) -> None:
        self._kernel = kernel
        self._begin(position_m, depth_m, noise_std_m)

    def _begin(self, position_m: Sequence[float], depth_m: float, noise_std_m: float) -> None:
        self._locations_m = [(float(position_m[0]), float(position_m[1]))]
        self._depth_sum_m = depth_m
        self._noise_m2 = noise_std_m**2
        # sum over all pairs of k(p_i, p_j) of the first `_paired` locations
        self._pair_sum = self._kernel.signal_variance_m2
        self._paired = 1

    def takes(self, noise_std_m: float) -> bool:
        """Whether a sounding this noisy may be merged: there must be room, and it must not be noisier than these."""
        return len(self._locations_m) < MAX_MERGED and noise_std_m**2 <= self._noise_m2

    def add(self, position_m: Sequence[float], depth_m: float, noise_std_m: float) -> None:
        """Merges a sounding at `position_m` (2,); one with less noise than the center's replaces it."""
        if noise_std_m**2 < self._noise_m2:
            self._begin(position_m, depth_m, noise_std_m)
            return
        self._locations_m.append((float(position_m[0]), float(position_m[1])))
        self._depth_sum_m += depth_m

    def shift(self, by_m: Sequence[float]) -> None:
        """Moves all its soundings by (2,); their covariances stay the same."""
        self._locations_m = [(north_m + by_m[0], east_m + by_m[1]) for north_m, east_m in self._locations_m]

    def summary(self) -> tuple[Array, float, float]:
        """Location (2,), depth and noise variance of the center."""
        n, kernel, variance = len(self._locations_m), self._kernel, self._kernel.signal_variance_m2
        locations = np.array(self._locations_m)
        centroid = locations.sum(axis=0) / n
        scaled = kernel.scale(locations)
        new = np.concatenate([kernel.scale(centroid[None]), scaled[self._paired :]])
        at_centroid, *with_others = kernel.of_scaled(new, scaled)
        for number, row in enumerate(with_others, self._paired):
            self._pair_sum += 2.0 * float(row[:number].sum()) + variance
        self._paired = n
        to_centroid = float(at_centroid.sum()) / n
        curvature = self._pair_sum / n**2 - 2.0 * to_centroid + variance
        return centroid, self._depth_sum_m / n, self._noise_m2 / n + max(curvature, 0.0)


def take_spaced_numpy(kept: Array, size: int, spacing_m: float, locations: Array, max_new: int, near: Ints) -> None:
    """Finds the nearest kept location within the spacing, in NumPy: the reference for the compiled version.

    Args:
        kept: Rows that begin with north and east: `size` kept locations, then room for new ones.
        locations: Locations (n, 2).
        near: Receives the numbers (n,).
    """
    full = size + max_new
    for i, location in enumerate(locations):
        near[i] = -1
        if size and spacing_m > 0.0:
            apart = kept[:size, :2] - location
            squares = apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1]
            number = int(np.argmin(squares))
            if math.sqrt(squares[number]) < spacing_m:
                near[i] = number
        if near[i] < 0 and size < full:
            kept[size, :2] = location
            near[i] = size
            size += 1
