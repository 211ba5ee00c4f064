"""Adds a vehicle's soundings to its map at corrected positions.

New soundings are placed by the latest correction. Every `positions.interval_s` the smoother estimates all positions and
their uncertainty; in a long mission it waits for `LONG_INTERVALS`, unless a fix comes. The map's centers follow a
correction that moves one of them by more than `positions.moved_m`.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition, DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.corrected_map import CorrectedMap
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.smoother import PositionSmoother
from auv_lse_gp.positions.sounding_log import SoundingLog
from auv_lse_gp.positions.terrain_matching import Terrain

#: The map is rebuilt after one correction per this many centers, at least `MIN_REPEATED` and at most `MAX_REPEATED`:
#: a restart repeats those since the last rebuild, and a rebuild, whose cost grows with the map, is shared by them.
CENTERS_PER_REPEATED = 40
MIN_REPEATED, MAX_REPEATED = 20, 100
#: Number of intervals between corrections of a long track (`PositionSmoother.is_long`) without a new fix.
LONG_INTERVALS = 2


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """A rebuild of the map, from which a restart continues; JSON values.

    Attributes:
        before_s: Time of the correction before it; None if it was the first.
        theta: The unknowns of that correction.
    """

    now_s: float
    before_s: float | None
    theta: list[float] | None
    rebuilds: int
    revision: int


def corrector_for(vehicle: int, config: PositionsConfig, depth_map: DepthMap) -> PositionCorrector | None:
    """The corrector of a vehicle's map; None if `positions.correct` is off."""
    return PositionCorrector(vehicle, config, depth_map) if config.correct else None


class PositionCorrector:
    """Corrects the positions of the soundings in one vehicle's map.

    Attributes:
        correction: The latest correction; None before the first.
        checkpoint: Set if the last step rebuilt the map; a restart needs the last one, see `skip_to`.
    """

    def __init__(self, vehicle: int, config: PositionsConfig, depth_map: DepthMap) -> None:
        self.vehicle = vehicle
        self.config = config
        self.corrected_map = CorrectedMap(depth_map, {vehicle})
        self.smoother = PositionSmoother(vehicle, config)
        self.correction: Correction | None = None
        self.rebuilds = 0
        self.checkpoint: Checkpoint | None = None
        self._skipped_to: Checkpoint | None = None
        self._corrected_s: float | None = None
        self._repeated = 0  # corrections since the last rebuild
        self._raw: DeadReckoning | None = None
        self._period = self._corrected_in = 0  # number of this interval, and of that with the last correction
        self._fixes = 0  # number of fixes in the last correction

    @property
    def log(self) -> SoundingLog:
        """All soundings."""
        return self.corrected_map.log

    @property
    def position(self) -> CorrectedPosition | None:
        """The vehicle's corrected position at its last dead-reckoned position, with the raw heading; None before a
        correction."""
        if self._raw is None or self.correction is None:
            return None
        stamp_s = self.smoother.clock.monotonic_s(self._raw.stamp_s)
        raw_m = np.array([[self._raw.north_m, self._raw.east_m]])
        position_m, covariance_m2 = self.correction.position(self.vehicle, stamp_s, raw_m)
        (north_m, east_m), ((north, north_east), (_, east)) = position_m.tolist(), covariance_m2.tolist()
        return CorrectedPosition(
            stamp_s=self._raw.stamp_s,
            heading_rad=self._raw.heading_rad,
            north_m=north_m,
            east_m=east_m,
            depth_m=self._raw.depth_m,
            covariance=((0.0, 0.0, 0.0), (0.0, north, north_east), (0.0, north_east, east)),
        )

    def add_dead_reckoning(self, position: DeadReckoning) -> None:
        """Adds the vehicle's dead-reckoned position."""
        refused = self.smoother.refused
        self.smoother.add_dead_reckoning(position)
        if self.smoother.refused == refused:
            self._raw = position

    def add_fix(self, fix: Fix) -> None:
        """Adds a position fix of the vehicle."""
        self.smoother.add_fix(fix)

    def add_navigation(self, mate: MateNavigation) -> None:
        """Adds the navigation data of a mate's packet; call it before its samples."""
        self.smoother.add_navigation(mate)

    def add_soundings(self, soundings: Soundings) -> None:
        """Adds the vehicle's soundings."""
        timed = dataclasses.replace(soundings, stamp_s=soundings.stamp_s + self.smoother.clock.set_back_s)
        self.corrected_map.add_soundings(self.vehicle, timed, self.correction)

    def add_samples(self, samples: Array, source: int) -> None:
        """Adds a mate's samples: raw north and east, depth (m), (n, 3), in order of time."""
        stamps_s = self.smoother.add_sample_positions(source, samples[:, :2])
        raw = np.where(np.isfinite(stamps_s), samples[:, :2].T, np.nan)
        north, east, depth = samples.T
        timed = Soundings(
            stamp_s=stamps_s, north_m=north, east_m=east, depth_m=depth, raw_north_m=raw[0], raw_east_m=raw[1]
        )
        self.corrected_map.add_samples(source, timed, self.correction)

    def skip_to(self, checkpoint: Checkpoint) -> None:
        """Prepares for repeated inputs: up to a checkpoint, they are only logged and nothing is estimated."""
        self._skipped_to, self.corrected_map.paused = checkpoint, True

    def end_skip(self) -> None:
        """Rebuilds the map of the repeated inputs."""
        if self._skipped_to is not None:
            checkpoint, self._skipped_to = self._skipped_to, None
            self.correct(rebuild=True)
            self.rebuilds, self.corrected_map.map.gp.revision = checkpoint.rebuilds, checkpoint.revision

    def step(self, now_s: float) -> bool:
        """Corrects positions if it is time to; returns whether it did."""
        self.checkpoint = None
        period = math.floor(now_s / self.config.interval_s + 1e-9)
        if period == self._period:
            return False
        self._period = period
        skipped = self._skipped_to
        if skipped is not None and now_s < skipped.now_s:
            if skipped.theta is not None and now_s == skipped.before_s:
                self.smoother.resume(skipped.theta)
            return True
        if skipped is None and self._can_wait:
            return False
        self._corrected_in, self._fixes = period, self.smoother.fix_count
        before_s, theta, rebuilds = self._corrected_s, self.smoother.theta, self.rebuilds
        self._corrected_s = now_s
        if skipped is not None:
            self.end_skip()
            return True
        self.correct()
        if self.rebuilds > rebuilds:
            revision = self.corrected_map.map.gp.revision
            self.checkpoint = Checkpoint(
                now_s=now_s, before_s=before_s, theta=theta, rebuilds=self.rebuilds, revision=revision
            )
        return True

    @property
    def _can_wait(self) -> bool:
        """Whether the correction of this interval can be left out: see `LONG_INTERVALS`."""
        is_early = 0 < self._period - self._corrected_in < LONG_INTERVALS
        return is_early and self.smoother.is_long and self.smoother.fix_count == self._fixes

    def correct(self, rebuild: bool = False) -> None:
        """Estimates all positions and updates the map; `rebuild`: even if no sounding has moved far."""
        gp = self.corrected_map.map.gp
        terrain = Terrain(self.log.segments(), gp.kernel, gp.prior_mean, gp.config.noise_std_m)
        self.correction = self.smoother.smooth(terrain)
        self._repeated += 1
        most = min(max(len(gp) // CENTERS_PER_REPEATED, MIN_REPEATED), MAX_REPEATED)
        if rebuild or self._repeated >= most:
            self.corrected_map.rebuild(self.log.corrected_m(self.correction))
            rebuilt = True
        else:
            rebuilt = self.corrected_map.follow(self.correction, self.config.moved_m)
        if rebuilt:
            self.rebuilds += 1
            self._repeated = 0
        self.corrected_map.set_uncertainty(self.correction, self.vehicle)
