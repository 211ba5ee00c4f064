"""Corrected positions of a team's soundings, with their uncertainty."""

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.positions.error_model import TeamErrorModel, TrackPositions


class Correction:
    """Corrected positions, estimated from the measurements up to a time.

    Attributes:
        stamp_s: Time of the last measurement (s).
        covariance: Covariance of the unknowns (unknowns, unknowns), see `error_model.py`.
        theta: The unknowns (unknowns,).
        refused: Number of ranges and fixes rejected as wrong.
    """

    def __init__(
        self, model: TeamErrorModel, theta: Array, covariance: Array, stamp_s: float, refused: int = 0
    ) -> None:
        self.model = model
        self.theta, self.covariance, self.stamp_s, self.refused = theta, covariance, stamp_s, refused

    @property
    def vehicles(self) -> list[int]:
        """Numbers of the vehicles whose positions it corrects."""
        return list(self.model.vehicles)

    def _positions(self, vehicle: int, stamps_s: Array, raw_m: Array) -> TrackPositions:
        own = self.model.vehicles[vehicle]
        return own.positions(own.track.at(np.asarray(stamps_s, dtype=float), np.asarray(raw_m, dtype=float)))

    def positions(self, vehicle: int, stamps_s: Array, raw_positions_m: Array) -> Array:
        """Corrected positions (n, 2); for a vehicle without navigation data, the raw ones.

        Args:
            stamps_s: Times (n,).
            raw_positions_m: Dead-reckoned positions (n, 2).
        """
        raw = np.asarray(raw_positions_m, dtype=float).reshape(-1, 2)
        if vehicle not in self.model.vehicles or not len(raw):
            return raw.copy()
        return self._positions(vehicle, stamps_s, raw).positions(self.theta)

    def jacobian(self, vehicle: int, stamps_s: Array, raw_positions_m: Array) -> Array:
        """Derivatives (n, 2, unknowns) of `positions` with respect to the unknowns."""
        raw = np.asarray(raw_positions_m, dtype=float).reshape(-1, 2)
        out = np.zeros((len(raw), 2, self.model.size))
        own = self.own_jacobian(vehicle, stamps_s, raw)
        if own is not None:
            out[:, :, self.model.vehicles[vehicle].block] = own
        return out

    def own_jacobian(self, vehicle: int, stamps_s: Array, raw_positions_m: Array) -> Array | None:
        """Derivatives (n, 2, block) of `positions` with respect to the vehicle's unknowns; None for an unknown
        vehicle."""
        if vehicle not in self.model.vehicles or not len(raw_positions_m):
            return None
        return self._positions(vehicle, stamps_s, raw_positions_m).jacobian(self.theta)

    def fix_sensitivity(self, vehicle: int) -> Array:
        """Matrix F (2, unknowns) of a fix of a vehicle at the end of its track; zero for an unknown vehicle.

        The fix would reduce the unknowns' covariance from C to C - C F' F C. F = U^-1 A with U U' = A C A' + R, the
        derivatives A of that position, and the covariance R of a fix.
        """
        if vehicle not in self.model.vehicles or not len(self.model.vehicles[vehicle].track):
            return np.zeros((2, self.model.size))
        track = self.model.vehicles[vehicle].track
        position = self.jacobian(vehicle, np.array([track.end_s]), track.nodes[-1:, 1:3])[0]
        measured = position @ self.covariance @ position.T + self.model.config.fix_std_m**2 * np.eye(2)
        return np.asarray(np.linalg.solve(np.linalg.cholesky(measured), position))

    def position(self, vehicle: int, stamp_s: float, raw_position_m: Array) -> tuple[Array, Array]:
        """One of `positions` (2,), and its covariance (2, 2), north and east (m2): zeros for an unknown vehicle."""
        raw = np.asarray(raw_position_m, dtype=float).reshape(1, 2)
        if vehicle not in self.model.vehicles:
            return raw[0].copy(), np.zeros((2, 2))
        found, block = self._positions(vehicle, np.array([stamp_s]), raw), self.model.vehicles[vehicle].block
        row = found.jacobian(self.theta)[0]
        return found.positions(self.theta)[0], np.asarray(row @ self.covariance[block, block] @ row.T)

    def position_std_m(self, vehicle: int, stamps_s: Array, raw_positions_m: Array) -> Array:
        """Standard deviations (n, 2) of `positions`, north and east (m); NaN for an unknown vehicle."""
        if vehicle not in self.model.vehicles:
            return np.full((len(raw_positions_m), 2), np.nan)
        block = self.model.vehicles[vehicle].block
        rows = self.jacobian(vehicle, stamps_s, raw_positions_m)[:, :, block]
        variances = np.einsum("ndu,uv,ndv->nd", rows, self.covariance[block, block], rows, optimize=True)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))
