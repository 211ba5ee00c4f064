"""Estimates the positions of a team on board one vehicle, from its measurements and received packets.

Raw tracks and measurements are stored, and each estimate uses all of them. Vehicles share measurements, not estimates,
so that no fix is counted twice.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.frames import FARTHEST_M
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.error_model import TeamErrorModel
from auv_lse_gp.positions.gauss_newton import TERRAIN_STEPS, solve
from auv_lse_gp.positions.measurements import Fixes, FixMeasurement, RangeMeasurement, Ranges, usable
from auv_lse_gp.positions.monotonic_clock import SET_AHEAD_S, MonotonicClock
from auv_lse_gp.positions.terrain_matching import Terrain, TerrainLikelihood
from auv_lse_gp.positions.track import MateTrack, OwnTrack, Track

#: Fixes within this time (s) count as one surfacing, since GPS errors are correlated over minutes.
SURFACING_S = 120.0
#: Largest plausible speed of a mate (m/s); if exceeded, its packet is wrong, or it restarted.
FASTEST_MPS = 6.0
#: Largest distance (m) between the starts of two vehicles. A mate is at most this far from this vehicle's start, plus
#: the distance it could have covered.
STARTS_APART_M = 1000.0
#: Times of sending and of reception that are farther apart (s) are of different clocks.
CLOCKS_APART_S = 60.0
#: A packet is sent at most this long (s) before the first dead-reckoned position, and `SET_AHEAD_S` after the last one.
EARLIEST_S = 3600.0
#: Maximum number of ranges; of more, the oldest are thinned out.
MAX_RANGES = 300


class SurfacingFixes:
    """The fixes of one vehicle, grouped by surfacing."""

    def __init__(self, vehicle: int) -> None:
        self._vehicle = vehicle
        self._groups: list[list[tuple[float, ...]]] = []  # stamp, north, east, raw north, raw east, std

    def __len__(self) -> int:
        """Number of fixes."""
        return sum(map(len, self._groups))

    def add(self, fix: Fix) -> bool:
        """Adds a fix; returns False if it is not finite."""
        row = (fix.stamp_s, fix.north_m, fix.east_m, fix.raw_north_m, fix.raw_east_m, fix.std_m)
        if not all(math.isfinite(value) for value in row):
            return False
        if self._groups and row[1:5] == self._groups[-1][-1][1:5]:
            return True  # a repetition
        if self._groups and 0.0 <= fix.stamp_s - self._groups[-1][0][0] < SURFACING_S:
            self._groups[-1].append(row)
        else:
            self._groups.append([row])
        return True

    def rows(self, least_std_m: float) -> list[FixMeasurement]:
        """One measurement per surfacing: the mean of its fixes, with the accuracy of one of them."""
        means = [np.mean(group, axis=0).tolist() for group in self._groups]
        return [
            FixMeasurement(
                vehicle=self._vehicle,
                stamp_s=stamp_s,
                position_m=(north_m, east_m),
                raw_m=(raw_north_m, raw_east_m),
                std_m=max(std_m, least_std_m),
            )
            for stamp_s, north_m, east_m, raw_north_m, raw_east_m, std_m in means
        ]


class PositionSmoother:
    """Estimates the positions of a team on board one of its vehicles.

    Attributes:
        refused: Number of messages rejected as implausible.
    """

    def __init__(self, vehicle: int, config: PositionsConfig) -> None:
        self.vehicle = vehicle
        self.config = config
        self.refused = 0
        self.clock = MonotonicClock()
        self._own = OwnTrack()
        self._mates: dict[int, MateTrack] = {}
        self._surfacings = {vehicle: SurfacingFixes(vehicle)}
        self._ranges: list[RangeMeasurement] = []
        self._earlier_distance_m: dict[int, float] = {}
        self._unconfirmed: set[int] = set()  # mates whose position no second packet has confirmed
        self._last: tuple[TeamErrorModel, Array] | None = None
        self._now_s = 0.0

    @property
    def tracks(self) -> dict[int, Track]:
        """Raw tracks by number of the vehicle: its own, and those of the mates heard."""
        return {self.vehicle: self._own, **self._mates}

    @property
    def ranges(self) -> list[RangeMeasurement]:
        """All ranges; one by ping is used after the mate's next packet has given its position at that time."""
        return [row for row in self._ranges if not row.by_ping or row.sent_s <= self._mates[row.sender].end_s]

    def fixes(self, vehicle: int) -> list[FixMeasurement]:
        """One averaged GPS fix per surfacing of a vehicle."""
        found = self._surfacings.get(vehicle)
        return found.rows(self.config.fix_std_m) if found is not None else []

    @property
    def fix_count(self) -> int:
        """Number of fixes of all vehicles."""
        return sum(map(len, self._surfacings.values()))

    @property
    def is_long(self) -> bool:
        """Whether the vehicle's track is long (`VehicleErrorModel.is_long`) in the last estimate."""
        return self._last is not None and self._last[0].vehicles[self.vehicle].is_long

    @property
    def earlier_distance_m(self) -> dict[int, float]:
        """Distance that mates had travelled before their first known dead-reckoned position, where not 0."""
        return dict(self._earlier_distance_m)

    def add_dead_reckoning(self, position: DeadReckoning) -> None:
        """Adds the vehicle's dead-reckoned position; the track continues if its clock is set back."""
        if not (math.isfinite(position.stamp_s) and max(abs(position.north_m), abs(position.east_m)) <= FARTHEST_M):
            self.refused += 1
            return
        time_s = self.clock.advance(position.stamp_s)
        if self._own.add(time_s, position.north_m, position.east_m, position.heading_rad):
            self._now_s = max(self._now_s, time_s)
        else:
            self.refused += 1

    def add_fix(self, fix: Fix) -> None:
        """Adds a fix of the vehicle."""
        timed = dataclasses.replace(fix, stamp_s=self.clock.monotonic_s(fix.stamp_s))
        self.refused += not self._surfacings[self.vehicle].add(timed)

    def add_navigation(self, mate: MateNavigation) -> None:
        """Adds the navigation data of a mate's packet with its travel time, or a range by ping."""
        if mate.by_ping:
            if mate.source in self._mates:
                self._add_range(mate, mate.stamp_s)
            return
        mate = self._timed(mate)
        sent_s = mate.sent_s
        if mate.source == self.vehicle or not self._possible(mate):
            self.refused += 1
            return
        track = self._mates.get(mate.source, MateTrack())
        before = track.last
        if before is not None and not _reachable(mate, sent_s, before):
            self.refused += 1
            if mate.source not in self._unconfirmed:
                return
            self._drop(mate.source)  # one of the two packets is wrong; the next one shows which
            track, before = MateTrack(), None
        known = self._unconfirmed
        self._unconfirmed = (known | {mate.source}) if before is None else (known - {mate.source})
        track.add(sent_s, mate.raw_north_m, mate.raw_east_m)
        self._mates[mate.source] = track
        if before is None:
            self._earlier_distance_m[mate.source] = self._own.distance_m(sent_s)
        if mate.has_fix:
            self._add_mate_fix(mate, float(before[0]) if before is not None else track.start_s, sent_s)
        self._add_range(mate, sent_s)

    def _timed(self, mate: MateNavigation) -> MateNavigation:
        """The navigation with its time of sending; without a usable one, that of reception, and then without a range.

        Tracks continue in time even where the clock of this vehicle was set back.
        """
        arrived_s = self.clock.monotonic_s(mate.stamp_s)
        if abs(mate.sent_s - arrived_s) <= CLOCKS_APART_S:
            return mate
        known = math.isfinite(mate.sent_s)
        return dataclasses.replace(mate, sent_s=arrived_s, travel_s=math.nan if known else mate.travel_s)

    def _possible(self, mate: MateNavigation) -> bool:
        """Whether a mate's reported position and time are plausible, regardless of its earlier packets."""
        if not (math.isfinite(mate.sent_s) and math.isfinite(mate.raw_north_m) and math.isfinite(mate.raw_east_m)):
            return False
        if not len(self._own):
            return True
        if not self._own.start_s - EARLIEST_S <= mate.sent_s <= self._own.end_s + SET_AHEAD_S:
            return False
        north_m, east_m = self._own.start_m
        off_m = math.hypot(mate.raw_north_m - north_m, mate.raw_east_m - east_m)
        return bool(off_m <= STARTS_APART_M + FASTEST_MPS * (self._own.end_s - self._own.start_s))

    def _drop(self, source: int) -> None:
        """Drops the data of a mate's first packet: position, fix and range."""
        del self._mates[source]
        self._surfacings.pop(source, None)
        self._earlier_distance_m.pop(source, None)
        self._ranges = [row for row in self._ranges if row.sender != source]

    def _add_range(self, mate: MateNavigation, sent_s: float) -> None:
        """Stores the range to a mate if it is usable."""
        row = RangeMeasurement(
            sender=mate.source,
            receiver=self.vehicle,
            sent_s=sent_s,
            arrived_s=self.clock.monotonic_s(mate.stamp_s),
            range_m=mate.travel_s * self.config.sound_speed_mps,
            by_ping=mate.by_ping,
        )
        if usable(row) and len(self._own):
            self._ranges.append(row)

    def add_sample_positions(self, source: int, raw_m: Array) -> Array:
        """Adds the dead-reckoned positions (n, 2) of a packet's samples, in order of time, after its navigation data.

        Returns:
            Their times (n,), estimated from the mate's track; NaN if it has none.
        """
        times = np.full(len(raw_m), math.nan)
        track = self._mates.get(source)
        finite = np.isfinite(raw_m).all(axis=1)
        if track is None or not finite.any():
            return times
        if len(track) == 1 and self._own.start_s < track.start_s:
            # All vehicles start at about the same time, and measure from then on.
            track.begin(self._own.start_s, raw_m[finite][0])
            self._earlier_distance_m.pop(source)
        times[finite] = track.times_of(raw_m[finite])
        track.refine(times[finite], raw_m[finite])
        return times

    def _add_mate_fix(self, mate: MateNavigation, since_s: float, sent_s: float) -> None:
        """Stores a mate's last fix, stamped when its track since the previous packet was nearest to it."""
        surfacings = self._surfacings.setdefault(mate.source, SurfacingFixes(mate.source))
        raw = np.array([mate.fix_raw_north_m, mate.fix_raw_east_m])
        nodes = self._mates[mate.source].nodes
        nodes = nodes[(nodes[:, 0] >= since_s) & (nodes[:, 0] <= sent_s)]
        apart = np.sqrt(((nodes[:, 1:3] - raw) ** 2).sum(axis=1))
        fix = Fix(
            stamp_s=float(nodes[np.argmin(apart), 0]) if np.isfinite(apart).all() else math.nan,
            north_m=mate.fix_north_m,
            east_m=mate.fix_east_m,
            raw_north_m=mate.fix_raw_north_m,
            raw_east_m=mate.fix_raw_east_m,
            std_m=self.config.fix_std_m,
        )
        self.refused += not surfacings.add(fix)

    def smooth(self, terrain: Terrain | None = None) -> Correction:
        """Estimates all positions from all data.

        Args:
            terrain: Depths along the tracks; ignored if None or with `positions.terrain: false`.
        """
        fixes = [row for number in self._surfacings for row in self.fixes(number)]
        model = self._model()
        correction = smooth_team(
            model, fixes, thinned(self.ranges, MAX_RANGES), stamp_s=self._now_s, terrain=terrain, last=self._last
        )
        self._last = correction.model, correction.theta
        return correction

    @property
    def theta(self) -> list[float] | None:
        """The unknowns of the last estimate, from which the next one starts; None before the first."""
        return None if self._last is None else self._last[1].tolist()

    def resume(self, theta: list[float]) -> None:
        """Starts the next estimate from `theta`, which the estimate from the present data had."""
        model = self._model()
        if len(theta) == model.size:
            self._last = model, np.array(theta)

    def _model(self) -> TeamErrorModel:
        older = self._last[0] if self._last is not None else None
        return TeamErrorModel(self.config, self.tracks, {self.vehicle}, self._earlier_distance_m, older)


def smooth_team(
    model: TeamErrorModel,
    fixes: Sequence[FixMeasurement],
    ranges: Sequence[RangeMeasurement],
    *,
    stamp_s: float,
    terrain: Terrain | None = None,
    last: tuple[TeamErrorModel, Array] | None = None,
    terrain_steps: int = TERRAIN_STEPS,
) -> Correction:
    """Estimates the positions of a team.

    Args:
        fixes: The fixes, one per surfacing.
        stamp_s: Time of the last measurement.
        terrain: Depths along the tracks; ignored with `positions.terrain: false`.
        last: The previous model and its unknowns, for a warm start.
        terrain_steps: Maximum number of steps with the terrain.
    """
    start = model.warm_start(last[1], last[0]) if last is not None else np.zeros(model.size)
    likelihood = TerrainLikelihood(model, terrain) if terrain is not None and model.config.terrain else None
    used_fixes, used_ranges = Fixes(model, fixes).plausible(), Ranges(model, ranges).plausible()
    solution = solve(model, used_fixes, used_ranges, likelihood, start, terrain_steps)
    refused = len(fixes) - len(used_fixes) + len(ranges) - len(used_ranges) + solution.refused
    return Correction(model, solution.theta, solution.covariance, stamp_s, refused)


def _reachable(mate: MateNavigation, sent_s: float, before: Array) -> bool:
    """Whether a mate can have reached its position from the last one `before`: time, raw north and east (3,)."""
    gone = math.hypot(mate.raw_north_m - before[1], mate.raw_east_m - before[2])
    return bool(sent_s > before[0] and gone <= FASTEST_MPS * (sent_s - before[0]))


def thinned(rows: Sequence[RangeMeasurement], most: int) -> list[RangeMeasurement]:
    """At most `most` rows, with an equal share for each sender, in their order.

    A sender's rows are halved while there are too many, at last the oldest alone: each further row drops only one.
    """
    senders = {row.sender for row in rows}
    kept: set[int] = set()
    for sender in senders:
        own, share = [i for i, row in enumerate(rows) if row.sender == sender], most // len(senders)
        while len(own) > 2 * share:
            own = own[::2]
        paired = 2 * max(len(own) - share, 0)
        kept.update(own[:paired:2], own[paired:])
    return [rows[i] for i in sorted(kept)]
