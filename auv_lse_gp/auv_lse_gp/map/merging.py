"""Merging: a sounding that is too close to a kept center is averaged into it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.covariance.kernels import Kernel

Array = NDArray[np.float64]

#: Soundings that one center is merged from, at most.
MAX_MERGED = 256

#: Only the last so many centers are merged into. Older ones stay as they are, so that neither the factor nor a map has
#: to be made anew when a vehicle crosses an old track (at 2000 centers that would take seconds).
MERGE_WINDOW = 32


class MergedCenter:
    """A center and the soundings merged into it: together a measurement of the depth at their centroid.

    Their mean depth is the depth at the centroid, for a plane bottom exactly; for a curved one its error has the
    variance that the kernel gives to mean(f(p_i)) - f(centroid), which is added to the noise of the mean. It is worked
    out when it is asked for, for all that were merged since then at once.
    """

    def __init__(self, kernel: Kernel, place_m: Sequence[float], depth_m: float, noise_std_m: float) -> None:
        """Starts with one sounding at `place_m` (2,)."""
        self._kernel = kernel
        self._places_m = [(float(place_m[0]), float(place_m[1]))]
        self._depth_sum_m = depth_m
        self._noise_m2 = noise_std_m**2
        self._pair_sum = kernel.signal_variance_m2  # sum over all pairs of k(p_i, p_j) of the first `_paired` places
        self._paired = 1

    @property
    def full(self) -> bool:
        """Whether it takes no more: beyond, a sounding adds next to nothing."""
        return len(self._places_m) >= MAX_MERGED

    def add(self, place_m: Sequence[float], depth_m: float) -> None:
        """Merges a sounding at `place_m` (2,) into it."""
        self._places_m.append((float(place_m[0]), float(place_m[1])))
        self._depth_sum_m += depth_m

    def summary(self) -> tuple[Array, float, float]:
        """Place (2,), depth and noise variance of the center."""
        n, kernel, variance = len(self._places_m), self._kernel, self._kernel.signal_variance_m2
        places = np.array(self._places_m)
        centroid = places.sum(axis=0) / n
        scaled = kernel.scale(places)
        new = np.concatenate([kernel.scale(centroid[None]), scaled[self._paired :]])
        at_centroid, *with_others = kernel.of_scaled(new, scaled)
        for number, row in enumerate(with_others, self._paired):
            self._pair_sum += 2.0 * float(row[:number].sum()) + variance
        self._paired = n
        to_centroid = float(at_centroid.sum()) / n
        curvature = self._pair_sum / n**2 - 2.0 * to_centroid + variance
        return centroid, self._depth_sum_m / n, self._noise_m2 / n + max(curvature, 0.0)
