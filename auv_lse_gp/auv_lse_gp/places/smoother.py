"""What one vehicle can find out about the places of its team, from what it measures and hears itself.

Theory of operation. Raw tracks and measurements are kept; every answer is computed anew from all of them. Only
measurements are shared among the vehicles, never estimates: a filter that took a mate's estimate as independent would
count the same fix again and again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.places import PlacesConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.error_model import TeamErrorModel
from auv_lse_gp.places.gauss_newton import TERRAIN_STEPS, solve
from auv_lse_gp.places.measurements import Fixes, FixMeasurement, RangeMeasurement, Ranges, usable
from auv_lse_gp.places.monotonic_clock import MonotonicClock
from auv_lse_gp.places.terrain_matching import Terrain, TerrainLikelihood
from auv_lse_gp.places.track import MateTrack, OwnTrack, Track

Array = NDArray[np.float64]

#: Fixes within this time (s) are of one surfacing, and count as one: the errors of GPS go on for minutes.
SURFACING_S = 120.0
#: A mate that seems to move faster than this (m/s) has not: its packet is wrong, or it started anew.
FASTEST_MPS = 6.0
#: A team starts within so far (m): a mate is not farther from the own start than this and what it can have gone since.
STARTS_APART_M = 1000.0
#: Ranges that are used at most; of more, an even choice.
MOST_RANGES = 300


class SurfacingFixes:
    """The fixes of one vehicle, gathered by surfacing."""

    def __init__(self, vehicle: int) -> None:
        """There is no fix yet."""
        self._vehicle = vehicle
        self._groups: list[list[tuple[float, ...]]] = []  # stamp, north, east, raw north, raw east, std

    def add(self, fix: Fix) -> bool:
        """Takes a fix; returns False if it cannot be one."""
        row = (fix.stamp_s, fix.north_m, fix.east_m, fix.raw_north_m, fix.raw_east_m, fix.std_m)
        if not all(math.isfinite(value) for value in row):
            return False
        if self._groups and row[1:5] == self._groups[-1][-1][1:5]:
            return True  # told again
        if self._groups and 0.0 <= fix.stamp_s - self._groups[-1][0][0] < SURFACING_S:
            self._groups[-1].append(row)
        else:
            self._groups.append([row])
        return True

    def rows(self, least_std_m: float) -> list[FixMeasurement]:
        """One row for each surfacing: the mean of its fixes, no better than one of them."""
        rows = []
        for group in self._groups:
            mean = np.mean(group, axis=0)
            rows.append(
                FixMeasurement(
                    vehicle=self._vehicle,
                    stamp_s=float(mean[0]),
                    place_m=(float(mean[1]), float(mean[2])),
                    raw_m=(float(mean[3]), float(mean[4])),
                    std_m=max(float(mean[5]), least_std_m),
                )
            )
        return rows


class PositionSmoother:
    """Corrects the places of a team, as one of its vehicles.

    Attributes:
        vehicle: Number of the vehicle.
        config: The configuration.
        clock: The vehicle's own clock.
        refused: Messages that cannot be right, and were not taken.
    """

    def __init__(self, vehicle: int, config: PlacesConfig) -> None:
        """Nothing is known yet."""
        self.vehicle = vehicle
        self.config = config
        self.refused = 0
        self.clock = MonotonicClock()
        self._own = OwnTrack()
        self._mates: dict[int, MateTrack] = {}
        self._surfacings = {vehicle: SurfacingFixes(vehicle)}
        self._ranges: list[RangeMeasurement] = []
        self._earlier_distance_m: dict[int, float] = {}
        self._doubtful: set[int] = set()  # mates heard once: nothing has confirmed where they are
        self._last: tuple[TeamErrorModel, Array] | None = None
        self._now_s = 0.0

    @property
    def tracks(self) -> dict[int, Track]:
        """Raw tracks by number: its own, and those of the mates that it has heard."""
        return {self.vehicle: self._own, **self._mates}

    @property
    def ranges(self) -> list[RangeMeasurement]:
        """All ranges measured; those by pings only from the mate's next packet on, which tells where it was then."""
        return [row for row in self._ranges if not row.by_ping or row.sent_s <= self._mates[row.sender].end_s]

    def fixes(self, vehicle: int) -> list[FixMeasurement]:
        """The surfacings of a vehicle that are known of."""
        found = self._surfacings.get(vehicle)
        return found.rows(self.config.fix_std_m) if found is not None else []

    @property
    def earlier_distance_m(self) -> dict[int, float]:
        """How far mates had gone before their first raw place that is known, where that is not 0."""
        return dict(self._earlier_distance_m)

    def add_dead_reckoning(self, place: DeadReckoning) -> None:
        """Takes the vehicle's own raw place; when its clock was set back, the track goes on where it was."""
        if not math.isfinite(place.stamp_s):
            self.refused += 1
            return
        time_s = self.clock.advance(place.stamp_s)
        if self._own.add(time_s, place.north_m, place.east_m, place.heading_rad):
            self._now_s = max(self._now_s, time_s)
        else:
            self.refused += 1

    def add_fix(self, fix: Fix) -> None:
        """Takes one of the vehicle's own fixes."""
        timed = dataclasses.replace(fix, stamp_s=self.clock.monotonic_s(fix.stamp_s))
        self.refused += not self._surfacings[self.vehicle].add(timed)

    def add_navigation(self, mate: MateNavigation) -> None:
        """Takes what a mate's packet told, and when it came; or a range by a ping."""
        if mate.by_ping:
            self._pinged(mate)
            return
        sent_s = mate.sent_s if math.isfinite(mate.sent_s) else mate.stamp_s
        if mate.source == self.vehicle or not self._possible(mate, sent_s):
            self.refused += 1
            return
        track = self._mates.get(mate.source, MateTrack())
        before = track.last
        if before is not None and not _reachable(mate, sent_s, before):
            self.refused += 1
            if mate.source not in self._doubtful:
                return
            self._forget(mate.source)  # one of the two is wrong; the next packet tells
            track, before = MateTrack(), None
        self._doubtful = (self._doubtful | {mate.source}) if before is None else (self._doubtful - {mate.source})
        track.add(sent_s, mate.raw_north_m, mate.raw_east_m)
        self._mates[mate.source] = track
        if before is None:
            self._earlier_distance_m[mate.source] = self._own.distance_m(sent_s)
        if mate.has_fix:
            self._mate_fixed(mate, float(before[0]) if before is not None else track.start_s, sent_s)
        row = RangeMeasurement(
            sender=mate.source,
            receiver=self.vehicle,
            sent_s=sent_s,
            arrived_s=self.clock.monotonic_s(mate.stamp_s),
            range_m=mate.travel_s * self.config.sound_speed_mps,
        )
        if usable(row) and len(self._own):
            self._ranges.append(row)

    def _possible(self, mate: MateNavigation, sent_s: float) -> bool:
        """Whether a mate can be where it says that it is, whatever it said before."""
        if not (math.isfinite(sent_s) and math.isfinite(mate.raw_north_m) and math.isfinite(mate.raw_east_m)):
            return False
        if not len(self._own):
            return True
        north_m, east_m = self._own.start_m
        off_m = math.hypot(mate.raw_north_m - north_m, mate.raw_east_m - east_m)
        return bool(off_m <= STARTS_APART_M + FASTEST_MPS * (self._own.end_s - self._own.start_s))

    def _forget(self, source: int) -> None:
        """Drops what a mate's first packet told: the place, its fix and its range."""
        del self._mates[source]
        self._surfacings.pop(source, None)
        self._earlier_distance_m.pop(source, None)
        self._ranges = [row for row in self._ranges if row.sender != source]

    def _pinged(self, mate: MateNavigation) -> None:
        """Takes a range by a ping, which says nothing of where the mate says that it is."""
        row = RangeMeasurement(
            sender=mate.source,
            receiver=self.vehicle,
            sent_s=mate.stamp_s,
            arrived_s=self.clock.monotonic_s(mate.stamp_s),
            range_m=mate.travel_s * self.config.sound_speed_mps,
            by_ping=True,
        )
        if mate.source in self._mates and usable(row) and len(self._own):
            self._ranges.append(row)

    def add_sample_positions(self, source: int, raw_m: Array) -> Array:
        """Takes the raw places (n, 2) of the samples of a packet, in order of time, after what it told of navigation.

        Returns:
            When they were measured (n,), as far as the mate's track tells; NaN if nothing is known of it.
        """
        times = np.full(len(raw_m), math.nan)
        track = self._mates.get(source)
        finite = np.isfinite(raw_m).all(axis=1)
        if track is None or not finite.any():
            return times
        if len(track) == 1 and self._own.start_s < track.start_s:
            # All start at about the same time, and sound from there on.
            track.begin(self._own.start_s, raw_m[finite][0])
            self._earlier_distance_m.pop(source)
        times[finite] = track.times_of(raw_m[finite])
        track.refine(times[finite], raw_m[finite])
        return times

    def _mate_fixed(self, mate: MateNavigation, since_s: float, sent_s: float) -> None:
        """Takes a mate's last fix, which it took since its packet before this one if that did not tell of it."""
        surfacings = self._surfacings.setdefault(mate.source, SurfacingFixes(mate.source))
        raw = np.array([mate.fix_raw_north_m, mate.fix_raw_east_m])
        nodes = self._mates[mate.source].nodes
        nodes = nodes[(nodes[:, 0] >= since_s) & (nodes[:, 0] <= sent_s)]
        gone = np.sqrt(((nodes[:, 1:3] - raw) ** 2).sum(axis=1))
        fix = Fix(
            stamp_s=float(nodes[np.argmin(gone), 0]) if np.isfinite(gone).all() else math.nan,
            north_m=mate.fix_north_m,
            east_m=mate.fix_east_m,
            raw_north_m=mate.fix_raw_north_m,
            raw_east_m=mate.fix_raw_east_m,
            std_m=self.config.fix_std_m,
        )
        self.refused += not surfacings.add(fix)

    def smooth(self, terrain: Terrain | None = None) -> Correction:
        """Finds the places by everything known so far.

        Args:
            terrain: Depths along the tracks; None, or `places.terrain: false`: they do not count.
        """
        fixes = [row for number in self._surfacings for row in self.fixes(number)]
        correction = smooth_team(
            self.config, self.tracks, fixes, _even(self.ranges, MOST_RANGES),
            terrain=terrain, earlier_distance_m=self._earlier_distance_m, last=self._last,
            references={self.vehicle}, stamp_s=self._now_s,
        )  # fmt: skip
        self._last = correction.model, correction.theta
        return correction


def smooth_team(
    config: PlacesConfig,
    tracks: dict[int, Track],
    fixes: Sequence[FixMeasurement],
    ranges: Sequence[RangeMeasurement],
    *,
    references: set[int],
    stamp_s: float,
    terrain: Terrain | None = None,
    earlier_distance_m: dict[int, float] | None = None,
    last: tuple[TeamErrorModel, Array] | None = None,
    terrain_steps: int = TERRAIN_STEPS,
) -> Correction:
    """Finds the places of a team.

    Args:
        config: What is known before.
        tracks: Raw tracks by number of the vehicle.
        fixes: The fixes, one for each surfacing.
        ranges: The ranges.
        references: Vehicles whose clocks are references: one for each team.
        stamp_s: Time of the last measurement.
        terrain: Depths along the tracks.
        earlier_distance_m: How far a vehicle had gone before its first raw place that is known, if not 0.
        last: The unknowns before, and their values: where the search begins.
        terrain_steps: Steps with the terrain at most.
    """
    model = TeamErrorModel(config, tracks, references, earlier_distance_m)
    start = model.warm_start(last[1], last[0]) if last is not None else np.zeros(model.size)
    term = TerrainLikelihood(model, terrain) if terrain is not None and config.terrain else None
    believed_fixes, believed = Fixes(model, fixes).plausible(), Ranges(model, ranges).plausible()
    solution = solve(model, believed_fixes, believed, term, start, terrain_steps)
    refused = len(fixes) - len(believed_fixes) + len(ranges) - len(believed) + solution.refused
    return Correction(model, solution.theta, solution.covariance, stamp_s, refused)


def _reachable(mate: MateNavigation, sent_s: float, before: Array) -> bool:
    """Whether a mate can have come where it says that it is from where it was: time, raw north and east (3,)."""
    gone = math.hypot(mate.raw_north_m - before[1], mate.raw_east_m - before[2])
    return bool(sent_s > before[0] and gone <= FASTEST_MPS * (sent_s - before[0]))


def _even(rows: Sequence[RangeMeasurement], most: int) -> list[RangeMeasurement]:
    """At most so many of the rows, evenly chosen."""
    if len(rows) <= most:
        return list(rows)
    return [rows[i] for i in np.linspace(0, len(rows) - 1, most).astype(int)]
