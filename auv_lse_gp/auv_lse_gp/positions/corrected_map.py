"""A map and the log of its soundings, so that it can be rebuilt at corrected positions, with their uncertainty."""

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.store import Outcome
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.depth_sensitivity import DepthSensitivity
from auv_lse_gp.positions.sounding_log import SoundingLog

#: In a map in tiles, positions are checked at every n-th center of a vehicle's track. The centers between two of
#: these move if one of the two has.
CHECKED_EVERY = 8
#: A map is rebuilt when more than this share of its centers has shifted by more than this share of their
#: spacing since the last rebuild.
MANY_CENTERS, FAR_SHIFT = 0.1, 0.5


class CorrectedMap:
    """A map whose soundings can be moved.

    Attributes:
        own: Vehicles whose soundings are the map's own; those of other vehicles are samples, which must fit.
        paused: Whether soundings are only logged. The map lacks them until `rebuild`.
        seeds: Number in the log of the first sounding of each center (n,).
    """

    def __init__(self, depth_map: DepthMap, own: set[int]) -> None:
        self.map = depth_map
        self.log = SoundingLog()
        self.own = own
        self.paused = False
        self.seeds = np.zeros(0, dtype=np.int64)
        self._drift_m = np.zeros((0, 2))  # how far the first centers were shifted since the last rebuild
        self._sensitivity = DepthSensitivity(self.log)

    def add_soundings(self, vehicle: int, soundings: Soundings, correction: Correction | None) -> None:
        """Adds soundings of a vehicle in `own`."""
        ordered = soundings.in_order()
        positions = self.log.add(vehicle, ordered, correction, is_packet=False)
        if self.paused:
            return
        outcomes = self.map.add_soundings(np.column_stack([ordered.stamp_s, positions, ordered.depth_m]))
        self._remember(outcomes, np.arange(len(self.log) - len(ordered), len(self.log)))

    def add_samples(self, vehicle: int, samples: Soundings, correction: Correction | None) -> None:
        """Adds a mate's samples; those without a time (NaN) stay at their estimated positions."""
        positions = self.log.add(vehicle, samples, correction, is_packet=True)
        if self.paused:
            return
        outcomes = self.map.add_samples(np.column_stack([positions, samples.depth_m]), vehicle)
        self._remember(outcomes, np.arange(len(self.log) - len(samples), len(self.log)))

    def follow(self, correction: Correction, moved_m: float) -> bool:
        """Moves the soundings to their corrected positions if one of them has moved by more than `moved_m` (m).

        The map keeps its centers, which move with their first soundings, until many have moved far since the last
        rebuild (`MANY_CENTERS`, `FAR_SHIFT`). Then it is rebuilt.

        Returns:
            Whether the map was rebuilt.
        """
        gp, seeds = self.map.gp, self.seeds
        moved = self._moved(correction, seeds, moved_m)
        if not len(moved):
            return False
        positions = self.log.corrected_m(correction, seeds[moved])
        by = np.zeros((len(seeds), 2))
        by[moved] = positions - self.log.mapped_m[seeds[moved]]
        drift = by.copy()
        drift[: len(self._drift_m)] += self._drift_m
        if (_lengths_m(drift) > FAR_SHIFT * gp.config.min_spacing_m).mean() > MANY_CENTERS:
            self.rebuild(self.log.corrected_m(correction))
            return True
        self._drift_m = drift
        self.log.set_mapped(positions, seeds[moved])
        gp.shift(by)
        return False

    def _moved(self, correction: Correction, seeds: Ints, moved_m: float) -> Ints:
        """Numbers of the centers to move, because some are more than `moved_m` (m) from their corrected positions: all.

        In a map in tiles, these are only the ones that are too far off and those near them. Positions are checked at
        every `CHECKED_EVERY`th center along each vehicle's track.
        """
        if not self.map.gp.is_tiled:
            by = self.log.corrected_m(correction, seeds) - self.log.mapped_m[seeds]
            return np.arange(len(seeds) if _lengths_m(by).max(initial=0.0) > moved_m else 0)
        found = [np.zeros(0, dtype=np.int64)]
        for _, own in self.log.by_vehicle(seeds):
            along = own[np.argsort(self.log.stamps_s[seeds[own]], kind="stable")]
            checked = np.unique(np.append(np.arange(0, len(along), CHECKED_EVERY), len(along) - 1))
            numbers = seeds[along[checked]]
            by = self.log.corrected_m(correction, numbers) - self.log.mapped_m[numbers]
            far = np.flatnonzero(_lengths_m(by) > moved_m)
            begins, ends = checked[np.maximum(far - 1, 0)], checked[np.minimum(far + 1, len(checked) - 1)]
            is_near = np.zeros(len(along) + 1, dtype=np.int64)
            np.add.at(is_near, begins, 1)
            np.add.at(is_near, ends + 1, -1)
            found.append(along[np.cumsum(is_near[:-1]) > 0])
        return np.sort(np.concatenate(found))

    def rebuild(self, locations_m: Array) -> None:
        """Rebuilds the map at positions (n, 2): own soundings by time, then each mate's samples in order of arrival."""
        self.paused = False
        self.log.set_mapped(locations_m)
        self.seeds = self.seeds[:0]
        self._sensitivity.forget()
        self._drift_m = np.zeros((0, 2))
        self.map.clear()
        vehicles, stamps, depths = self.log.vehicles, self.log.stamps_s, self.log.depths_m
        is_own, packets = np.isin(vehicles, sorted(self.own)), self.log.packets
        own = np.flatnonzero(is_own)
        own = own[np.argsort(stamps[own], kind="stable")]
        self._remember(self.map.add_soundings(np.column_stack([stamps[own], locations_m[own], depths[own]])), own)
        for mate in np.unique(vehicles[~is_own]).tolist():
            theirs = np.flatnonzero(vehicles == mate)
            samples = np.column_stack([locations_m[theirs], depths[theirs]])
            self._remember(self.map.add_samples(samples, mate, packets[theirs]), theirs)

    def set_uncertainty(self, correction: Correction, vehicle: int = 0) -> None:
        """Sets the modes of the remaining common position errors of the map's centers.

        Args:
            correction: The correction that leaves these errors.
            vehicle: The vehicle whose next fix would remove the first two modes (`Centers.position_effect_m`); 0: no
                vehicle, and these two modes are zero.
        """
        self.map.gp.set_position_effect(self._effect(correction, vehicle))

    def _remember(self, outcomes: list[Outcome | None], numbers: Ints) -> None:
        kept = numbers[[outcome is Outcome.KEPT for outcome in outcomes]]
        if len(kept):
            self.seeds = np.concatenate([self.seeds, kept])

    def _effect(self, correction: Correction, vehicle: int) -> Array | None:
        """Depth change (n, 2 + modes) of the centers per mode: two that a fix would remove, then the strongest."""
        gp, seeds = self.map.gp, self.seeds
        if not len(seeds):
            return None
        self._sensitivity.update(correction, gp.slopes(), seeds)
        # Round to the 32 bits of the message to the planner.
        return np.asarray(self._sensitivity.effect(vehicle).astype(np.float32).astype(float))


def _lengths_m(by_m: Array) -> Array:
    """Lengths (n,) of shifts (n, 2); 0 where they are not finite."""
    lengths = np.sqrt(np.einsum("nd,nd->n", by_m, by_m))
    return np.where(np.isfinite(lengths), lengths, 0.0)
