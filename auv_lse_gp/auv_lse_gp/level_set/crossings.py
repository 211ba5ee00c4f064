"""Expected length of an isobath: the crossing intensity of a Gaussian field (Kac-Rice formula).

The expected length of the line f = l per area at a location is the density of f at l times the mean slope there,

    lambda = p(f = l) E[ |grad f| given f = l ],

in closed form from the joint normal distribution of depth and slope (Adler and Taylor, Random Fields and Geometry,
2007, theorem 11.2.1). Summed over ground it is exact: it needs no draws and no contour.
"""

import dataclasses
import math

import numpy as np
from scipy.special import ndtr

from auv_lse_common.support.arrays import Array

#: Directions over half a turn in the mean of |v|; 24 of them leave a relative error under .3 % for any distribution.
DIRECTIONS = 24


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class DepthAndSlope:
    """Joint normal distribution of depth and slope at each of P locations.

    Attributes:
        mean_m: Mean depth (P,).
        variance_m2: Variance of the depth (P,).
        slope: Mean slope north and east (m per m), shape (P, 2).
        covariance_m: Covariance of the depth with each slope (P, 2).
        slope_covariance: Covariance of the slopes (P, 2, 2).
    """

    mean_m: Array
    variance_m2: Array
    slope: Array
    covariance_m: Array
    slope_covariance: Array


def crossing_intensity(at: DepthAndSlope, level_m: float) -> Array:
    """Expected length of the isobath per area (m per m2) at each location, shape (P,); 0 where the depth is known."""
    known = at.variance_m2 <= 0.0
    variance = np.where(known, 1.0, at.variance_m2)
    off = level_m - at.mean_m
    gain = at.covariance_m / variance[:, None]  # slope given f = l: regression on the depth
    slope = at.slope + gain * off[:, None]
    covariance = at.slope_covariance - gain[:, :, None] * at.covariance_m[:, None, :]
    density = np.exp(-0.5 * off * off / variance) / np.sqrt(2.0 * math.pi * variance)
    return np.where(known, 0.0, density * mean_norm(slope, covariance))


def mean_norm(mean: Array, covariance: Array) -> Array:
    """E |v| of normal vectors in the plane with means (P, 2) and covariances (P, 2, 2), shape (P,).

    |v| is a quarter of the integral of |v . u| over all directions u, and E |N(a, b^2)| = 2 b phi(a / b) + a (2 Phi(a /
    b) - 1).
    """
    angle = (np.arange(DIRECTIONS) + 0.5) * math.pi / DIRECTIONS
    u = np.stack([np.cos(angle), np.sin(angle)])
    a = mean @ u
    b = np.sqrt(np.maximum(np.einsum("pij,id,jd->pd", covariance, u, u), 1e-300))
    ratio = np.clip(a / b, -1e3, 1e3)
    sums = 2.0 * b * np.exp(-0.5 * ratio * ratio) / math.sqrt(2.0 * math.pi) + a * (2.0 * ndtr(ratio) - 1.0)
    return np.asarray(0.5 * math.pi * sums.mean(axis=1))
