"""Puts a vehicle's soundings into its map where they were taken, as far as that is known by now.

What comes in is booked at the place by the last correction. Every `places.interval_s` the smoother finds the places
anew. Where one has moved by more than `places.moved_m`, the map is made again with all of them; in any case it is told
how uncertain they still are.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.places import PlacesConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.places.corrected_map import CorrectedMap
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.smoother import PositionSmoother
from auv_lse_gp.places.sounding_log import SoundingLog
from auv_lse_gp.places.terrain_matching import Terrain

Array = NDArray[np.float64]


def corrector_for(vehicle: int, config: PlacesConfig, depth_map: DepthMap) -> PositionCorrector | None:
    """What places a vehicle's soundings by a configuration in force; None where they stay where they are told."""
    return PositionCorrector(vehicle, config, depth_map) if config.correct else None


class PositionCorrector:
    """The places of one vehicle's map.

    Attributes:
        corrected_map: The map and its soundings.
        smoother: What finds the places.
        correction: The places by the last call of the smoother; None before the first.
        rebuilds: How often the map was rebuilt.
    """

    def __init__(self, vehicle: int, config: PlacesConfig, depth_map: DepthMap) -> None:
        """Nothing is known yet; the map is empty."""
        self.vehicle = vehicle
        self.config = config
        self.corrected_map = CorrectedMap(depth_map, {vehicle})
        self.smoother = PositionSmoother(vehicle, config)
        self.correction: Correction | None = None
        self.rebuilds = 0
        self._raw: DeadReckoning | None = None
        self._period = 0

    @property
    def log(self) -> SoundingLog:
        """All soundings."""
        return self.corrected_map.log

    @property
    def place(self) -> DeadReckoning | None:
        """Where the vehicle is by the last correction, at the time of its last raw place; None before the first.

        The heading is the raw one.
        """
        if self._raw is None or self.correction is None:
            return None
        stamp_s = self._raw.stamp_s + self.smoother.clock.set_back_s
        raw_m = np.array([[self._raw.north_m, self._raw.east_m]])
        north_m, east_m = self.correction.places(self.vehicle, np.array([stamp_s]), raw_m)[0].tolist()
        return dataclasses.replace(self._raw, north_m=north_m, east_m=east_m)

    def add_dead_reckoning(self, place: DeadReckoning) -> None:
        """Takes the vehicle's raw place."""
        self.smoother.add_dead_reckoning(place)
        if math.isfinite(place.stamp_s + place.north_m + place.east_m):
            self._raw = place

    def add_fix(self, fix: Fix) -> None:
        """Takes a fix."""
        self.smoother.add_fix(fix)

    def add_navigation(self, mate: MateNavigation) -> None:
        """Takes what a packet told of its sender's navigation; its samples come after it."""
        self.smoother.add_navigation(mate)

    def add_soundings(self, rows: Array) -> None:
        """Takes own soundings: stamp (s), north, east, depth, raw north, raw east (m) of each, (n, 6)."""
        rows = np.column_stack([rows[:, 0] + self.smoother.clock.set_back_s, rows[:, 1:]])
        self.corrected_map.add_soundings(self.vehicle, rows, self.correction)

    def add_samples(self, samples: Array, source: int) -> None:
        """Takes a mate's samples: raw north and east, depth (m) of each, (n, 3), in order of time."""
        self.corrected_map.add_samples(
            source, self.smoother.add_sample_positions(source, samples[:, :2]), samples, self.correction
        )

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
        gp = self.corrected_map.map.gp
        terrain = Terrain(self.log.segments(), gp.kernel, gp.prior_mean, gp.config.noise_std_m)
        self.correction = self.smoother.smooth(terrain)
        places = self.log.corrected_m(self.correction)
        if self.corrected_map.moved_m(places) > self.config.moved_m:
            self.corrected_map.rebuild(places)
            self.rebuilds += 1
        self.corrected_map.set_uncertainty(self.correction, self.vehicle)
