"""The corrected places of a team's soundings, and how well they are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.places.error_model import TeamErrorModel, TrackPositions

Array = NDArray[np.float64]


class Correction:
    """Where soundings were taken, by the measurements up to a time.

    Attributes:
        stamp_s: That time.
        covariance: Covariance of the unknowns (unknowns, unknowns), see `model.py`.
        theta: The unknowns (unknowns,).
        refused: How many ranges and fixes were refused as wrong.
    """

    def __init__(
        self, model: TeamErrorModel, theta: Array, covariance: Array, stamp_s: float, refused: int = 0
    ) -> None:
        """Takes a solution.

        Args:
            model: The unknowns, with the tracks of the vehicles, which may go on growing.
            theta: The unknowns (unknowns,).
            covariance: Their covariance.
            stamp_s: Time of the last measurement.
            refused: How many ranges and fixes were refused.
        """
        self._model = model
        self.theta, self.covariance, self.stamp_s, self.refused = theta, covariance, stamp_s, refused

    @property
    def vehicles(self) -> list[int]:
        """Numbers of the vehicles whose places it corrects."""
        return list(self._model.vehicles)

    @property
    def model(self) -> TeamErrorModel:
        """The unknowns."""
        return self._model

    def _sums(self, vehicle: int, stamps_s: Array, raw_m: Array) -> TrackPositions:
        own = self._model.vehicles[vehicle]
        return own.positions(own.track.at(np.asarray(stamps_s, dtype=float), np.asarray(raw_m, dtype=float)))

    def places(self, vehicle: int, stamps_s: Array, raw_places_m: Array) -> Array:
        """Corrected places (n, 2); the raw ones of a vehicle of which no navigation is known.

        Args:
            vehicle: Number of the vehicle that sounded.
            stamps_s: When (n,).
            raw_places_m: Raw places (n, 2).
        """
        raw = np.asarray(raw_places_m, dtype=float).reshape(-1, 2)
        if vehicle not in self._model.vehicles or not len(raw):
            return raw.copy()
        return self._sums(vehicle, stamps_s, raw).places(self.theta)

    def jacobian(self, vehicle: int, stamps_s: Array, raw_places_m: Array) -> Array:
        """Derivatives (n, 2, unknowns) of `places` with respect to the unknowns."""
        raw = np.asarray(raw_places_m, dtype=float).reshape(-1, 2)
        out = np.zeros((len(raw), 2, self._model.size))
        if vehicle in self._model.vehicles and len(raw):
            out[:, :, self._model.vehicles[vehicle].block] = self._sums(vehicle, stamps_s, raw).jacobian(self.theta)
        return out

    def fix_sensitivity(self, vehicle: int) -> Array:
        """What a fix of a vehicle where its track ends would tell, (2, unknowns): its rows F.

        The unknowns' covariance would fall from C to C - C F' F C, with the two rows F = U^-1 A, U U' = A C A' + R, A
        the derivatives of that place, and R the covariance of a fix. An unknown vehicle's tells nothing.
        """
        if vehicle not in self._model.vehicles or not len(self._model.vehicles[vehicle].track):
            return np.zeros((2, self._model.size))
        track = self._model.vehicles[vehicle].track
        place = self.jacobian(vehicle, np.array([track.end_s]), track.nodes[-1:, 1:3])[0]
        measured = place @ self.covariance @ place.T + self._model.config.fix_std_m**2 * np.eye(2)
        return np.asarray(np.linalg.solve(np.linalg.cholesky(measured), place))

    def place_std_m(self, vehicle: int, stamps_s: Array, raw_places_m: Array) -> Array:
        """Standard deviations (n, 2) of `places`, north and east; NaN for an unknown vehicle."""
        if vehicle not in self._model.vehicles:
            return np.full((len(raw_places_m), 2), np.nan)
        block = self._model.vehicles[vehicle].block
        rows = self.jacobian(vehicle, stamps_s, raw_places_m)[:, :, block]
        variances = np.einsum("ndu,uv,ndv->nd", rows, self.covariance[block, block], rows, optimize=True)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))
