"""A map and the book of its soundings: laid out anew at other places, and told how uncertain they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.online import Outcome
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.sounding_log import SoundingLog

Array = NDArray[np.float64]

#: Ways in which all places may be wrong together that the map is told of beside those that a fix would take away: the
#: strongest.
MODES = 8


class CorrectedMap:
    """A map whose soundings can be moved.

    Attributes:
        map: The map.
        book: All its soundings.
        own: Numbers of the vehicles whose soundings are its own; those of others are samples, which must fit them.
    """

    def __init__(self, depth_map: DepthMap, own: set[int]) -> None:
        """The map is empty yet."""
        self.map = depth_map
        self.log = SoundingLog()
        self.own = own
        self._seeds: list[int] = []  # number in the book of the sounding that each center began with

    def add_soundings(self, vehicle: int, rows: Array, correction: Correction | None) -> None:
        """Takes soundings of its own: stamp (s), north, east, depth, raw north, raw east (m) of each, (n, 6)."""
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        places = self.log.add(vehicle, rows[:, 0], rows[:, 4:6], rows[:, 1:3], rows[:, 3], correction)
        outcomes = self.map.add_soundings(np.column_stack([rows[:, 0], places, rows[:, 3]]))
        self._remember(outcomes, np.arange(len(self.log) - len(rows), len(self.log)))

    def add_samples(self, vehicle: int, stamps_s: Array, samples: Array, correction: Correction | None) -> None:
        """Takes a mate's samples: raw north and east, depth (m) of each, (n, 3); those of unknown time (NaN) stay."""
        raw = np.where(np.isfinite(stamps_s)[:, None], samples[:, :2], np.nan)
        places = self.log.add(vehicle, stamps_s, raw, samples[:, :2], samples[:, 2], correction)
        outcomes = self.map.add_samples(np.column_stack([places, samples[:, 2]]), vehicle)
        self._remember(outcomes, np.arange(len(self.log) - len(samples), len(self.log)))

    def moved_m(self, places_m: Array) -> float:
        """How far the farthest sounding is from where it would be booked, of places (n, 2)."""
        moved = np.sqrt(((places_m - self.log.mapped_m) ** 2).sum(axis=1))
        return float(np.nanmax(moved)) if np.isfinite(moved).any() else 0.0

    def rebuild(self, places_m: Array) -> None:
        """Makes the map again at places (n, 2): own soundings by time, then each mate's samples as they had come."""
        self.log.set_mapped(places_m)
        self._seeds.clear()
        self.map.clear()
        vehicles, stamps, depths = self.log.vehicles, self.log.stamps_s, self.log.depths_m
        mine = np.isin(vehicles, sorted(self.own))
        own = np.flatnonzero(mine)
        own = own[np.argsort(stamps[own], kind="stable")]
        self._remember(self.map.add_soundings(np.column_stack([stamps[own], places_m[own], depths[own]])), own)
        for mate in np.unique(vehicles[~mine]).tolist():
            theirs = np.flatnonzero(vehicles == mate)
            samples = np.column_stack([places_m[theirs], depths[theirs]])
            self._remember(self.map.add_samples(samples, mate), theirs)

    def set_uncertainty(self, correction: Correction, vehicle: int = 0) -> None:
        """Tells the map in which ways the places of its centers may still be wrong together.

        Args:
            correction: The places.
            vehicle: The vehicle whose fix would take away the first two of these ways (`Centers.place_effect_m`); 0:
                nobody's, and these two are nothing.
        """
        self.map.gp.set_place_effect(self._effect(correction, vehicle))

    def _remember(self, outcomes: list[Outcome | None], numbers: NDArray[np.int64]) -> None:
        self._seeds += [int(n) for n, outcome in zip(numbers, outcomes, strict=True) if outcome is Outcome.KEPT]

    def _effect(self, correction: Correction, vehicle: int) -> Array | None:
        """What the ways in which the centers' places may be wrong together are worth in depth (n, 2 + modes).

        The first two are those that a fix of the vehicle would take away, the others the strongest that it would leave.
        """
        gp, seeds = self.map.gp, np.array(self._seeds, dtype=np.int64)
        if not len(seeds):
            return None
        rows = self.log.derivatives(correction, gp.posterior.slopes(gp.centers.places_m), seeds)
        root = np.linalg.cholesky(correction.covariance)
        spread, told = rows @ root, correction.fix_sensitivity(vehicle) @ root
        left = spread @ np.linalg.cholesky(np.eye(len(root)) - told.T @ told)
        values, ways = np.linalg.eigh(left.T @ left)
        effect = np.column_stack([spread @ told.T, left @ ways[:, ::-1][:, : min(MODES, len(values))]])
        # As the planner is told: a message has 32 bits for each.
        return np.asarray(effect.astype(np.float32).astype(float))
