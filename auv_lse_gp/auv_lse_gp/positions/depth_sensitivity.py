"""Sensitivity of the expected depths of a map's centers to the unknowns of the position errors.

The sensitivity of center i is g_i' A_i: the slope g_i of the ground, and the derivatives A_i of its position with
respect to the unknowns of its vehicle. A map in tiles keeps sensitivities from one correction to the next: only those
of new centers, and of centers whose slope has changed, are computed. All are recomputed when knots are added, or
when the correction has turned or scaled tracks by `KEPT_TURN` since they were computed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.error_model import MANY_UNKNOWNS
from auv_lse_gp.positions.sounding_log import SoundingLog

#: Number of the strongest error modes passed to the map, in addition to the two that a fix would remove.
MODES = 8
#: Change of a track's heading (rad) or scale up to which sensitivities are kept: their error relative to their size.
KEPT_TURN = 0.005


@dataclass(slots=True)
class _Sensitivities:
    """Sensitivities of one vehicle's centers.

    Attributes:
        centers: Indices of the centers (n,).
        slopes: Slope at each (n, 2).
        rows: Sensitivities (n, the vehicle's unknowns).
        squares: rows' rows.
        knots_s: Times of the vehicle's knots.
        theta: The vehicle's unknowns for which all rows were computed.
    """

    centers: Ints
    slopes: Array
    rows: Array
    squares: Array
    knots_s: Array
    theta: Array


class DepthSensitivity:
    """Sensitivities of the centers whose vehicles have navigation data; those of others are zero."""

    def __init__(self, log: SoundingLog) -> None:
        self._log = log
        self._vehicles: dict[int, _Sensitivities] = {}
        self._correction: Correction | None = None
        self._count = 0  # of the centers

    def forget(self) -> None:
        """Forgets all sensitivities, so that the next ones depend on the data alone."""
        self._vehicles.clear()

    def update(self, correction: Correction, slopes: Array, seeds: Ints) -> None:
        """Updates the sensitivities after a correction.

        Args:
            slopes: Slope of the ground at each center (n, 2).
            seeds: Number in the log of each center's first sounding (n,); earlier centers come first.
        """
        known = {}
        for vehicle, own in self._log.by_vehicle(seeds):
            if vehicle in correction.model.vehicles:
                known[vehicle] = self._updated(correction, vehicle, own, slopes[own], seeds[own])
        self._vehicles, self._correction, self._count = known, correction, len(seeds)

    def _updated(self, correction: Correction, vehicle: int, own: Ints, slopes: Array, seeds: Ints) -> _Sensitivities:
        model = correction.model.vehicles[vehicle]
        theta, unknowns = correction.theta[model.block], model.block.stop - model.block.start
        old = self._vehicles.get(vehicle)
        if (
            old is None
            or not np.array_equal(old.knots_s, model.knots_s)
            or not np.array_equal(old.centers, own[: len(old.centers)])
            or model.turn_between(old.theta, theta) > KEPT_TURN
        ):
            old = _Sensitivities(
                own[:0], slopes[:0], np.zeros((0, unknowns)), np.zeros((unknowns, unknowns)), model.knots_s, theta
            )
        count = len(old.centers)
        stale = np.append(
            np.flatnonzero((old.slopes != slopes[:count]).any(axis=1)), np.arange(count, len(own), dtype=np.int64)
        )
        rows = np.concatenate([old.rows, np.zeros((len(own) - count, unknowns))])
        before, index = rows[stale], seeds[stale]
        jacobian = correction.own_jacobian(vehicle, self._log.stamps_s[index], self._log.raw_m[index])
        if jacobian is not None:
            rows[stale] = np.einsum("nd,ndu->nu", slopes[stale], jacobian)
        squares = old.squares + rows[stale].T @ rows[stale] - before.T @ before
        return _Sensitivities(own, slopes, rows, squares, old.knots_s, old.theta)

    def effect(self, vehicle: int) -> Array:
        """Depth change (n, 2 + modes) of the centers per mode: two that a fix would remove, then the strongest.

        Args:
            vehicle: The vehicle whose next fix would remove the first two modes (`Centers.position_effect_m`); 0: no
                vehicle, and these two modes are zero.

        Raises:
            ValueError: before the first `update`.
        """
        correction = self._correction
        if correction is None:
            raise ValueError("effect: there is no correction yet; call update() first")
        parts = [(correction.model.vehicles[number].block, own) for number, own in self._vehicles.items()]
        root = np.asarray(np.linalg.cholesky(correction.covariance), dtype=float)
        squares = np.zeros_like(root)
        for block, own in parts:
            squares[block, block] = own.squares
        fixed = correction.fix_sensitivity(vehicle) @ root
        if len(root) > MANY_UNKNOWNS:
            strongest = _strongest_of_many(root, squares, fixed)
        else:
            left = root @ np.linalg.cholesky(np.eye(len(root)) - fixed.T @ fixed)
            strongest = left @ np.linalg.eigh(left.T @ squares @ left)[1][:, ::-1][:, :MODES]
        modes = np.column_stack([root @ fixed.T, strongest])
        effect = np.zeros((self._count, modes.shape[1]))
        for block, own in parts:
            effect[own.centers] = own.rows @ modes[block]
        return effect


def _strongest_of_many(root: Array, squares: Array, fixed: Array) -> Array:
    """The `MODES` strongest modes (u, modes) that a fix would leave, by products with vectors alone.

    Args:
        root: Root of the unknowns' covariance (u, u).
        squares: Sum of the squares of the centers' sensitivities (u, u).
        fixed: What a fix would remove, F root (2, u).
    """
    shares, ways = np.linalg.svd(fixed, full_matrices=False)[1:]
    removed = ways.T * (1.0 - np.sqrt(np.maximum(1.0 - shares**2, 0.0)))

    def kept(v: Array) -> Array:
        """(I - fixed' fixed)^(1/2) v."""
        return np.asarray(v - removed @ (ways @ v))

    def seen(v: Array) -> Array:
        return kept(root.T @ (squares @ (root @ kept(v))))

    size = len(root)
    try:
        found = eigsh(LinearOperator((size, size), matvec=seen, dtype=float), MODES, v0=np.ones(size))
    except ArpackError:  # as if no center depends on an unknown
        found = eigh(seen(np.eye(size)), subset_by_index=(size - MODES, size - 1))
    return np.asarray(root @ kept(found[1][:, ::-1]))
