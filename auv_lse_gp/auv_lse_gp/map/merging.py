"""Averages a sounding that is too close to a center into that center."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.covariance.kernels import Kernel

Array = NDArray[np.float64]

#: Maximum number of soundings per center.
MAX_MERGED = 256

#: Number of last centers that merging may change. Otherwise crossing an old track would recompute the factor and the
#: map (seconds at 2000 centers).
MERGE_WINDOW = 32


class MergedCenter:
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
        self._pair_sum = (
            self._kernel.signal_variance_m2
        )  # sum over all pairs of k(p_i, p_j) of the first `_paired` locations
        self._paired = 1

    def takes(self, noise_std_m: float) -> bool:
        """Whether it takes a sounding with this noise: not if it has many, and none with more noise than its own."""
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
