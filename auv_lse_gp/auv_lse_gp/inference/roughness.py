"""How rough the ground is near a place: the factor c^2 on the prior's variance that the soundings there show.

Every center is predicted from the centers farther away than `LEFT_OUT` length scales. With the prediction's error e and
its variance v under the prior, q = e^2 / v is 1 on average if the prior fits. (A prediction from all other centers
would only show the ground's roughness over one spacing of soundings, not between tracks.) The factor at a place p is

    c^2(p) = (LOCAL_WORTH g + sum_i k_i q_i) / (LOCAL_WORTH + sum_i k_i),    g = (w + sum_i q_i) / (w + n)

with weights k_i = exp(-|p - p_i|^2 / 2 h^2), h = `NEARBY` length scales. Far from all soundings it is the factor g of
the whole map, and that is 1 without soundings: the prior's variance counts as w = `gp.std_soundings` soundings.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.spatial import cKDTree

from auv_lse_gp.inference.posterior import Posterior

Array = NDArray[np.float64]

#: Distance within which centers are left out, and the standard deviation h of the weights, in `gp.length_scale_m`.
LEFT_OUT, NEARBY = 0.3, 0.5
#: Number of soundings that the factor of the whole map counts as at each place.
LOCAL_WORTH = 3.0
#: Largest number of weights that are computed together.
_WEIGHTS = 2_000_000


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Roughness:
    """Squared standardized errors of the centers' predictions.

    Attributes:
        places_m: Places (n, 2) of the centers.
        squares: q of each center (n,).
        length_m: The length scale of `LEFT_OUT` and `NEARBY`.
    """

    places_m: Array
    squares: Array
    length_m: float

    @classmethod
    def of(cls, posterior: Posterior, length_m: float) -> Roughness:
        """Predicts each center of a posterior."""
        places = posterior.centers.places_m
        return cls(places_m=places, squares=left_out_squares(posterior, LEFT_OUT * length_m), length_m=length_m)

    def sums(self, at_m: Array) -> Array:
        """Sums of k_i q_i and of k_i at places (P, 2), shape (P, 2)."""
        found = np.zeros((len(at_m), 2))
        if not len(self.squares):
            return found
        h, values = NEARBY * self.length_m, np.column_stack([self.squares, np.ones(len(self.squares))])
        rows = max(1, _WEIGHTS // len(self.squares))
        for first in range(0, len(at_m), rows):
            part = at_m[first : first + rows]
            apart = (part[:, None, 0] - self.places_m[:, 0]) ** 2 + (part[:, None, 1] - self.places_m[:, 1]) ** 2
            found[first : first + rows] = np.exp(apart / (-2.0 * h * h)) @ values
        return found

    def scale(self, at_m: Array, worth: float) -> Array:
        """Factor c^2 at places (P, 2), shape (P,); `worth` is `gp.std_soundings`."""
        return scale_of(self.sums(at_m), float(self.squares.sum()), len(self.squares), worth)


def scale_of(sums: Array, total: float, count: int, worth: float) -> Array:
    """Factor c^2 (P,) from `Roughness.sums` (P, 2), the sum of q over the whole map, and its number of centers."""
    if worth <= 0.0:  # no rescaling
        return np.ones(len(sums))
    whole = (worth + total) / (worth + count)
    return np.asarray((LOCAL_WORTH * whole + sums[:, 0]) / (LOCAL_WORTH + sums[:, 1]))


def left_out_squares(posterior: Posterior, radius_m: float) -> Array:
    """Squared standardized error (n,) of each center, predicted from the centers farther away than `radius_m`.

    With the inverse S of the data's covariance, uncertain positions included, and the centers B left out, the errors
    of all of B are S_BB^-1 (S r)_B and their covariance is S_BB^-1 (RW2006 section 5.4.2, for blocks).
    """
    n = posterior.data_rows
    if n == 0:
        return np.zeros(0)
    factor, residuals = posterior.factor, posterior.whitened_residuals[:n]
    half, _ = lapack.dpotri(np.array(factor.lower[:n, :n], order="F"), lower=1, overwrite_c=1)
    precision = np.tril(half) + np.tril(half, -1).T
    if posterior.places_uncertain:
        white = posterior.white_place_effect
        within, back = np.eye(white.shape[1]) + white.T @ white, factor.solve_transposed(white, n)
        residuals = residuals - white @ np.linalg.solve(within, white.T @ residuals)
        precision -= back @ np.linalg.solve(within, back.T)
    weighted = factor.solve_transposed(residuals, n)
    near = cKDTree(posterior.centers.places_m).query_ball_point(posterior.centers.places_m, radius_m)
    counts = np.array([len(found) for found in near])
    squares = np.empty(n)
    for count in np.unique(counts):  # blocks of one size are solved together
        own = np.flatnonzero(counts == count)
        blocks = np.array([near[i] for i in own])
        is_own = (blocks == own[:, None]).astype(float)
        solved = np.linalg.solve(precision[blocks[:, :, None], blocks[:, None, :]], is_own[:, :, None])[:, :, 0]
        error, variance = (solved * weighted[blocks]).sum(axis=1), (solved * is_own).sum(axis=1)
        squares[own] = error**2 / variance
    return squares
