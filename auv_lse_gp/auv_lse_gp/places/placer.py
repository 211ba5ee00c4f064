"""Puts a vehicle's soundings into its map where they were taken, as far as that is known by now.

What comes in is booked at the place by the last correction. Every `places.interval_s` the smoother finds the places
anew. Where one has moved by more than `places.moved_m`, the map is made again with all of them; in any case it is told
how uncertain they still are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_gp.depth_map import DepthMap
from auv_lse_gp.online import Outcome
from auv_lse_gp.places.book import SoundingBook
from auv_lse_gp.places.config import PlacesConfig
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.smoother import PlaceSmoother
from auv_lse_gp.places.terrain import Terrain

Array = NDArray[np.float64]

#: Ways in which all places may be wrong together that the map is told of: the strongest.
MODES = 8


class Placer:
    """The places of one vehicle's map.

    Attributes:
        map: The map.
        smoother: What finds the places.
        book: All soundings.
        correction: The places by the last call of the smoother; None before the first.
        rebooked: How often the map was made again.
    """

    def __init__(self, vehicle: int, config: PlacesConfig, depth_map: DepthMap) -> None:
        """Nothing is known yet; the map is empty."""
        self.vehicle = vehicle
        self.config = config
        self.map = depth_map
        self.smoother = PlaceSmoother(vehicle, config)
        self.book = SoundingBook()
        self.correction: Correction | None = None
        self.rebooked = 0
        self._seeds: list[int] = []  # number in the book of the sounding that each center began with
        self._period = 0

    def moved(self, place: DeadReckoning) -> None:
        """Takes the vehicle's raw place."""
        self.smoother.moved(place)

    def fixed(self, fix: Fix) -> None:
        """Takes a fix."""
        self.smoother.fixed(fix)

    def heard(self, mate: MateNavigation) -> None:
        """Takes what a packet told of its sender's navigation; its samples come after it."""
        self.smoother.heard(mate)

    def add_soundings(self, rows: Array) -> None:
        """Takes own soundings: stamp (s), north, east, depth, raw north, raw east (m) of each, (n, 6)."""
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        places = self.book.add(self.vehicle, rows[:, 0], rows[:, 4:6], rows[:, 1:3], rows[:, 3], self.correction)
        outcomes = self.map.add_soundings(np.column_stack([rows[:, 0], places, rows[:, 3]]))
        self._remember(outcomes, np.arange(len(self.book) - len(rows), len(self.book)))

    def add_samples(self, samples: Array, source: int) -> None:
        """Takes a mate's samples: raw north and east, depth (m) of each, (n, 3), in order of time."""
        stamps = self.smoother.sampled(source, samples[:, :2])
        raw = np.where(np.isfinite(stamps)[:, None], samples[:, :2], math.nan)
        places = self.book.add(source, stamps, raw, samples[:, :2], samples[:, 2], self.correction)
        outcomes = self.map.add_samples(np.column_stack([places, samples[:, 2]]), source)
        self._remember(outcomes, np.arange(len(self.book) - len(samples), len(self.book)))

    def step(self, now_s: float) -> bool:
        """Corrects places if it is time to; returns whether it did."""
        period = math.floor(now_s / self.config.interval_s + 1e-9)
        if period == self._period:
            return False
        self._period = period
        self.correct()
        return True

    def correct(self) -> None:
        """Finds the places anew, by everything known, and brings the map up to date."""
        gp = self.map.gp
        terrain = Terrain(self.book.pieces(), gp.kernel, gp.prior_mean, gp.config.noise_std_m)
        self.correction = self.smoother.smooth(terrain)
        places = self.book.corrected_m(self.correction)
        moved = np.sqrt(((places - self.book.booked_m) ** 2).sum(axis=1))
        if len(moved) and float(np.nanmax(moved)) > self.config.moved_m:
            self._rebuild(places)
        gp.set_place_effect(self._effect(self.correction))

    def _rebuild(self, places: Array) -> None:
        """Makes the map again: own soundings by time, then each mate's samples in the order in which they came."""
        self.book.rebook(places)
        self.rebooked += 1
        self._seeds.clear()
        self.map.clear()
        vehicles, depths = self.book.vehicles, self.book.depths_m
        own = np.flatnonzero(vehicles == self.vehicle)
        own = own[np.argsort(self.book.stamps_s[own], kind="stable")]
        rows = np.column_stack([self.book.stamps_s[own], places[own], depths[own]])
        self._remember(self.map.add_soundings(rows), own)
        for mate in np.unique(vehicles[vehicles != self.vehicle]).tolist():
            theirs = np.flatnonzero(vehicles == mate)
            samples = np.column_stack([places[theirs], depths[theirs]])
            self._remember(self.map.add_samples(samples, mate), theirs)

    def _remember(self, outcomes: list[Outcome | None], numbers: NDArray[np.int64]) -> None:
        self._seeds += [int(n) for n, outcome in zip(numbers, outcomes, strict=True) if outcome is Outcome.KEPT]

    def _effect(self, correction: Correction) -> Array | None:
        """What the strongest ways in which the centers' places may be wrong together are worth in depth (n, modes)."""
        gp, seeds = self.map.gp, np.array(self._seeds, dtype=np.int64)
        if not len(seeds):
            return None
        slopes = gp.posterior.slopes(gp.centers.places_m)
        rows = self.book.derivatives(correction, slopes, seeds)
        spread = rows @ np.linalg.cholesky(correction.covariance)
        values, ways = np.linalg.eigh(spread.T @ spread)
        effect = spread @ ways[:, ::-1][:, : min(MODES, len(values))]
        # As it is told to the planner: a message has 32 bits for each.
        return np.asarray(effect.astype(np.float32).astype(float))
