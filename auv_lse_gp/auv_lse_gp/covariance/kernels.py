"""Covariance functions of the depth: stationary, in the plane, isotropic or with two axes.

Every kernel is signal_std^2 rho(r), with r the distance in units of the kernel's own length along each axis. Locations
are scaled once (`Kernel.scale`), so anisotropy costs nothing extra.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.gp import KERNELS, GpConfig
from auv_lse_common.support import compiled
from auv_lse_common.support.arrays import Array
from auv_lse_gp.compiled.modules import compiled_gp

#: Support of a Wendland kernel / its length scale: the correlation at one length scale is then that of a Matern 5/2
#: kernel (0.524), so that `length_scale_m` means the same for every kernel.
SUPPORT_RATIO = {"wendland_c2": 3.3107}


def _matern52(r: Array) -> Array:
    t = math.sqrt(5.0) * r
    return np.asarray((1.0 + t + t * t / 3.0) * np.exp(-t))


def _squared_exponential(r: Array) -> Array:
    return np.asarray(np.exp(-0.5 * r * r))


def _wendland_c2(r: Array) -> Array:
    # Wendland (1995), phi_{3,1}: positive definite in up to three dimensions, twice differentiable.
    q = np.maximum(1.0 - r, 0.0) ** 2
    return np.asarray(q * q * (4.0 * r + 1.0))


def _matern52_slope(r: Array) -> Array:
    t = math.sqrt(5.0) * r
    return np.asarray(-5.0 / 3.0 * (1.0 + t) * np.exp(-t))


def _squared_exponential_slope(r: Array) -> Array:
    return np.asarray(-np.exp(-0.5 * r * r))


def _wendland_c2_slope(r: Array) -> Array:
    return np.asarray(-20.0 * np.maximum(1.0 - r, 0.0) ** 3)


#: Correlation rho(r) by name.
CORRELATIONS: dict[str, Callable[[Array], Array]] = {
    "matern52": _matern52,
    "squared_exponential": _squared_exponential,
    "wendland_c2": _wendland_c2,
}

#: rho'(r) / r by name, finite at r = 0; the gradient of rho(|a - b|) with respect to a is this times (a - b).
SLOPES: dict[str, Callable[[Array], Array]] = {
    "matern52": _matern52_slope,
    "squared_exponential": _squared_exponential_slope,
    "wendland_c2": _wendland_c2_slope,
}


class Kernel:
    """The covariance function k(p, p') that a `GpConfig` describes.

    Attributes:
        name: One of `KERNELS`.
        index: Its number in `KERNELS`, for the compiled code.
        signal_variance_m2: k(p, p).
        length_m: The kernel's own length along the first axis: length scale, or support of a Wendland kernel.
        length_2_m: The same along the second axis.
        support_m: Distance along the first axis beyond which k is zero; infinite without compact support.
    """

    def __init__(self, config: GpConfig) -> None:
        self.name = config.kernel
        self.index = KERNELS.index(config.kernel)
        self.signal_variance_m2 = config.signal_std_m**2
        across = (config.length_scale_2_m or config.length_scale_m) / config.length_scale_m
        if self.name in SUPPORT_RATIO:
            self.length_m = self.support_m = SUPPORT_RATIO[self.name] * config.length_scale_m
        else:
            self.length_m, self.support_m = config.length_scale_m, math.inf
        self.length_2_m = across * self.length_m
        angle = math.radians(config.rotation_deg)
        along = np.array([math.cos(angle), math.sin(angle)])  # (north, east) of the first axis
        right = np.array([-math.sin(angle), math.cos(angle)])
        self._to_scaled = np.stack([along / self.length_m, right / self.length_2_m], axis=1)
        self._correlation = CORRELATIONS[self.name]
        self._slope = SLOPES[self.name]

    def scale(self, locations_m: Array) -> Array:
        """Locations (P, 2) in the kernel's axes and lengths, so that r is the Euclidean distance."""
        return np.ascontiguousarray(locations_m @ self._to_scaled)

    def variance(self, locations_m: Array | None = None) -> Array:
        """k(p, p) of each location (P,), or a scalar if none is given."""
        return np.full(() if locations_m is None else len(locations_m), self.signal_variance_m2)

    def __call__(self, a_m: Array, b_m: Array) -> Array:
        """Covariance (A, B) in m^2 of the depths at locations `a_m` (A, 2) and `b_m` (B, 2)."""
        return self.of_scaled(self.scale(np.asarray(a_m, float)), self.scale(np.asarray(b_m, float)))

    def of_scaled(self, a: Array, b: Array, out: Array | None = None) -> Array:
        """`__call__` for scaled locations, into `out` (A, B) if given."""
        if compiled.USE_NUMBA:
            out = np.empty((len(a), len(b))) if out is None else out
            compiled_gp().covariance(self.index, self.signal_variance_m2, a, b, out)
            return out
        if out is not None:
            out[...] = self.of_scaled_numpy(a, b)
            return out
        return self.of_scaled_numpy(a, b)

    def among_scaled(self, a: Array, out: Array) -> None:
        """Covariance (A, A) among scaled locations, into the upper triangle of `out`; half the time of `of_scaled`."""
        if compiled.USE_NUMBA:
            compiled_gp().upper_covariance(self.index, self.signal_variance_m2, a, out)
            return
        out[...] = self.of_scaled_numpy(a, a)

    def subtract_weighted(self, a: Array, weights: Array, b: Array, out: Array) -> None:
        """out (m, B) -= weights (A, m)^T k(a, b), for scaled locations; B may be very large."""
        if compiled.USE_NUMBA and weights.shape[1] <= 16:
            compiled_gp().subtract_weighted(
                self.index, self.signal_variance_m2, a, np.ascontiguousarray(weights), b, out
            )
            return
        for begin in range(0, len(b), 2048):
            part = slice(begin, begin + 2048)
            out[:, part] -= weights.T @ self.of_scaled(a, b[part])

    def of_scaled_numpy(self, a: Array, b: Array) -> Array:
        """`of_scaled` in NumPy: the reference for the compiled version."""
        dx = a[:, None, 0] - b[None, :, 0]
        dy = a[:, None, 1] - b[None, :, 1]
        return np.asarray(self.signal_variance_m2 * self._correlation(np.sqrt(dx * dx + dy * dy)))

    @property
    def slope_covariance(self) -> Array:
        """Prior covariance (2, 2) of the slopes north and east at a location."""
        at_zero = float(self._slope(np.zeros(1))[0])
        return np.asarray(-self.signal_variance_m2 * at_zero * self._to_scaled @ self._to_scaled.T)

    def slopes_of_scaled(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Covariances (A, B) of the slopes north and east at scaled locations `a` with the depths at `b`."""
        apart = a[:, None, :] - b[None, :, :]
        slopes = self.signal_variance_m2 * self._slope(np.sqrt(np.einsum("abd,abd->ab", apart, apart)))
        north, east = (slopes * (apart @ axis) for axis in self._to_scaled)
        return north, east

    def gradient_sums(self, a: Array, weights: NDArray[np.floating], b: Array) -> Array:
        """Gradient (A, 2), m^2 / m, of sum over j of weights[i, j] k(a_i, b_j) with respect to location a_i in metres.

        Args:
            a: Scaled locations (A, 2).
            weights: Weights (A, B), or (1, B): the same for all locations.
            b: Scaled locations (B, 2), held fixed even where they coincide with `a`.
        """
        if compiled.USE_NUMBA:
            sums, weights = np.empty((len(a), 2)), np.ascontiguousarray(weights, dtype=float)
            compiled_gp().gradient_sums(self.index, self.signal_variance_m2, a, weights, b, sums)
        else:
            sums = self.gradient_sums_numpy(a, weights, b)
        return np.asarray(sums @ self._to_scaled.T)

    def gradient_sums_numpy(self, a: Array, weights: NDArray[np.floating], b: Array) -> Array:
        """`gradient_sums` with respect to scaled locations, in NumPy: the reference for the compiled version."""
        apart = a[:, None, :] - b[None, :, :]
        slopes = self.signal_variance_m2 * self._slope(np.sqrt(np.einsum("abd,abd->ab", apart, apart)))
        return np.asarray(np.einsum("ab,abd->ad", weights * slopes, apart))
