"""Terrain matching: tracks that cross must agree in depth at the crossing.

Depths z at positions p(theta) follow the Gaussian process, whose covariance S depends on the positions. A small shift
of position i changes its expected depth by the slope there: z = f(p^) + H (theta - theta^) + e, with H_i = g_i' A_i,
the position's derivatives A_i, g = sum_j alpha_j grad k(p_i, p_j) and alpha = S^-1 (z - m).

- The gradient is H' alpha, the information H' S^-1 H. There is no log-determinant: with a prior that is too wide, it
  would pull tracks together.
- Depths do not determine a common translation, rotation or scaling of all tracks. To add no false information in these
  directions N, gradient and information are projected with P = I - N (N' W N)^-1 N' W, where W is the prior precision.
"""

from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.covariance.prior_mean import PriorMean
from auv_lse_gp.inference.posterior import depth_slopes
from auv_lse_gp.inference.triangular import cholesky, solve_lower
from auv_lse_gp.positions.error_model import MANY_UNKNOWNS, TeamErrorModel, TrackPositions
from auv_lse_gp.positions.track_segments import TrackSegments


@dataclass(frozen=True, slots=True)
class Terrain:
    """Depths along the tracks, and the prior that relates them.

    Attributes:
        segments: The soundings, averaged along segments of track.
        kernel: Covariance of the depth.
        prior_mean: Mean of the depth, positions (P, 2) -> (P,).
        noise_std_m: Standard deviation of a segment's depth.
    """

    segments: TrackSegments
    kernel: Kernel
    prior_mean: PriorMean
    noise_std_m: float


class TerrainLikelihood:
    """Log likelihood of the segments' depths as a function of the unknowns."""

    def __init__(self, model: TeamErrorModel, terrain: Terrain) -> None:
        self._model, self._terrain = model, terrain
        self._last: tuple[Array, tuple[Array, Array, Array]] | None = None
        segments = terrain.segments
        self._groups: list[tuple[slice, slice, TrackPositions]] = []
        taken: list[Ints] = []
        for number in sorted(set(segments.vehicles.tolist()) & set(model.vehicles)):
            index = np.flatnonzero(segments.vehicles == number)
            vehicle = model.vehicles[number]
            begin = sum(len(t) for t in taken)
            taken.append(index)
            sums = vehicle.positions(vehicle.track.at(segments.stamps_s[index], segments.raw_m[index]))
            self._groups.append((vehicle.block, slice(begin, begin + len(index)), sums))
        self._depths_m = segments.depths_m[np.concatenate(taken)] if taken else np.zeros(0)

    def __len__(self) -> int:
        """Number of segments."""
        return len(self._depths_m)

    def cost(self, theta: Array) -> float:
        """Half the squared whitened residuals of the depths at `theta`.

        Raises:
            LinAlgError: if the covariance cannot be factorized.
        """
        white = self._factorized(theta)[2]
        return 0.5 * float(white @ white)

    def _factorized(self, theta: Array) -> tuple[Array, Array, Array]:
        """Positions (n, 2), factor L (n, n) and L^-1 (z - m) at `theta`; the last result is cached."""
        if self._last is None or not np.array_equal(self._last[0], theta):
            self._last = (theta.copy(), self._factorize(theta))
        return self._last[1]

    def _factorize(self, theta: Array) -> tuple[Array, Array, Array]:
        positions = np.zeros((len(self), 2))
        for _, rows, sums in self._groups:
            positions[rows] = sums.positions(theta)
        kernel = self._terrain.kernel
        scaled = kernel.scale(positions)
        covariance = kernel.of_scaled(scaled, scaled)
        covariance[np.diag_indices(len(positions))] += self._terrain.noise_std_m**2
        lower = cholesky(covariance)
        residuals = self._depths_m - self._terrain.prior_mean(positions)
        white = solve_lower(lower, residuals)
        return positions, lower, white

    def gradient(self, theta: Array, prior_precision: Array) -> tuple[Array, Array]:
        """Gradient (u,) of the log likelihood and information (u, u) at `theta`, projected.

        Args:
            theta: The unknowns (u,).
            prior_precision: Prior precision of each unknown (u,).

        Raises:
            LinAlgError: if the covariance cannot be factorized.
        """
        positions, lower, white = self._factorized(theta)
        alpha = solve_lower(lower, white, transposed=True)
        kernel = self._terrain.kernel
        slopes = depth_slopes(kernel, self._terrain.prior_mean, kernel.scale(positions), alpha, positions)
        rows = np.zeros((len(positions), self._model.size))
        for block, part, sums in self._groups:
            rows[part, block] = np.einsum("nd,ndu->nu", slopes[part], sums.jacobian(theta))
        whitened = solve_lower(lower, rows)
        common = self._model.common_modes(theta)
        weighted = prior_precision[:, None] * common
        removed = np.linalg.solve(common.T @ weighted, weighted.T)  # P = I - common removed
        if self._model.size > MANY_UNKNOWNS:
            gradient = rows.T @ alpha
            whitened -= (whitened @ common) @ removed
            return gradient - removed.T @ (common.T @ gradient), whitened.T @ whitened
        information = whitened.T @ whitened
        projection = np.eye(self._model.size) - common @ removed
        return projection.T @ (rows.T @ alpha), projection.T @ information @ projection
