"""The content of recordings from which sounding positions are estimated: tracks, fixes, ranges, soundings."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_gp.positions.measurements import FixMeasurement, RangeMeasurement
from auv_lse_gp.positions.monotonic_clock import SET_AHEAD_S, MonotonicClock
from auv_lse_gp.positions.smoother import PositionSmoother
from auv_lse_gp.positions.track import Track
from auv_lse_gp.positions.track_segments import TrackSegments, segment_track
from auv_lse_record.run_data import RunData, VehicleRun

#: A vehicle's key is its number plus this times the number of its dive: vehicles of different dives differ.
KEYS_PER_DIVE = 1000
#: Number of track segments that are compared: more than under way, where time is short.
MAX_SEGMENTS = 1200


@dataclass(frozen=True, slots=True)
class Recording:
    """The recording of one vehicle in one run.

    Attributes:
        run: Number of the run, from 0.
        dive: Number of the dive, from 0.
    """

    run: int
    dive: int
    data: VehicleRun

    @property
    def key(self) -> int:
        """Number of the vehicle among those of all dives."""
        return KEYS_PER_DIVE * self.dive + self.data.vehicle

    @property
    def name(self) -> str:
        """Vehicle and run, as errors name it."""
        return f"auv{self.data.vehicle} of run {self.run + 1}"


def missing_in(vehicle: VehicleRun) -> str:
    """What a vehicle's recording lacks to be adjusted; "" if nothing."""
    if len(vehicle.dead_reckoning) < 2:
        return "no dead reckoning (topic dead_reckoning)"
    if not len(vehicle.soundings):
        return "no soundings (topic sounding)"
    return ""


def recordings_of(runs: Sequence[RunData]) -> list[Recording]:
    """Each vehicle of each run; recordings of different vehicles at the same time are of one dive."""
    dives: list[int] = []
    for run in runs:
        for dive in sorted(set(dives)):
            if all(_are_simultaneous(run, other) for other, number in zip(runs, dives, strict=False) if number == dive):
                dives.append(dive)
                break
        else:
            dives.append(max(dives, default=-1) + 1)
    return [Recording(n, dive, v) for n, (run, dive) in enumerate(zip(runs, dives, strict=True)) for v in run.vehicles]


def _are_simultaneous(one: RunData, other: RunData) -> bool:
    """Whether two recordings are of different vehicles under way at the same time."""
    spans = [[v.dead_reckoning[[0, -1], 0] for v in run.vehicles if len(v.dead_reckoning)] for run in (one, other)]
    if not all(spans) or {v.vehicle for v in one.vehicles} & {v.vehicle for v in other.vehicles}:
        return False
    starts, ends = zip(*((min(s[0] for s in span), max(s[1] for s in span)) for span in spans), strict=True)
    return bool(max(starts) < min(ends))


def raw_positions(vehicle: VehicleRun) -> Array:
    """Dead-reckoned positions (n, 2) of a vehicle's soundings; where they were not recorded, from its raw track, if it
    has one."""
    raw = vehicle.soundings.raw_positions_m
    track = vehicle.dead_reckoning
    if len(track) < 2:
        return raw
    between = np.column_stack([np.interp(vehicle.soundings.stamp_s, track[:, 0], track[:, c]) for c in (1, 2)])
    return np.where(np.isfinite(raw), raw, between)


def track_times_s(vehicle: VehicleRun, stamps_s: Array) -> Array:
    """Times (n,) on a vehicle's track of stamps (n,) that it recorded.

    The track is continuous where stamps jump ahead: the clock was set, or a log pauses.
    """
    recorded_s, clock = vehicle.dead_reckoning[:, 0], MonotonicClock()
    steps_s = np.diff(recorded_s)
    if not len(steps_s) or steps_s.min() < 0.0 or steps_s.max() <= SET_AHEAD_S:
        return stamps_s
    shifts_s = []
    for stamp_s in recorded_s.tolist():
        clock.advance(stamp_s)
        shifts_s.append(clock.set_back_s)
    row = np.clip(np.searchsorted(recorded_s, stamps_s, side="right"), 0, len(recorded_s) - 1)
    return np.asarray(
        stamps_s + np.array(shifts_s)[row]
    )  # of the row after a stamp: a jump counts from its second row on


def segments_of(recordings: Sequence[Recording]) -> TrackSegments:
    """The segments of the tracks along which the recorded soundings were made."""
    own = [(r.key, r.data.soundings, raw_positions(r.data)) for r in recordings]
    return segment_track(
        np.concatenate([np.full(len(soundings), key) for key, soundings, _ in own]),
        np.concatenate([track_times_s(r.data, r.data.soundings.stamp_s) for r in recordings]),
        np.concatenate([raw for _, _, raw in own]),
        np.concatenate([soundings.depth_m for _, soundings, _ in own]),
        MAX_SEGMENTS,
    )


@dataclass(slots=True)
class TeamMeasurements:
    """The measurements of all vehicles, by key.

    Attributes:
        tracks: Raw track of each vehicle.
        earlier_distance_m: Distance that a vehicle could have covered before its first known position.
    """

    tracks: dict[int, Track] = field(default_factory=dict)
    fixes: list[FixMeasurement] = field(default_factory=list)
    ranges: list[RangeMeasurement] = field(default_factory=list)
    earlier_distance_m: dict[int, float] = field(default_factory=dict)

    @classmethod
    def of(cls, recordings: Sequence[Recording], config: PositionsConfig) -> TeamMeasurements:
        """The measurements of recordings; a mate's own recording replaces what others received from it."""
        found, recorded = cls(), {r.key: r.data for r in recordings}
        for recording in recordings:
            dive = recording.key - recording.data.vehicle
            mates = {key - dive for key in recorded if dive < key < dive + KEYS_PER_DIVE}
            smoother = _replayed(recording.data, config, mates)
            for number, track in smoother.tracks.items():
                key = dive + number
                if key in found.tracks or (key in recorded and key != recording.key):
                    continue
                found.tracks[key] = track
                found.fixes += [dataclasses.replace(row, vehicle=key) for row in smoother.fixes(number)]
                if number in smoother.earlier_distance_m:
                    found.earlier_distance_m[key] = smoother.earlier_distance_m[number]
            for row in smoother.ranges:
                sender, receiver = dive + row.sender, dive + row.receiver
                deeper_m = 0.0
                if sender in recorded and receiver in recorded:
                    deeper_m = _depth_at(recorded[receiver], row.arrived_s) - _depth_at(recorded[sender], row.sent_s)
                found.ranges.append(dataclasses.replace(row, sender=sender, receiver=receiver, deeper_m=deeper_m))
        return found


def _depth_at(vehicle: VehicleRun, stamp_s: float) -> float:
    """Depth (m) of a vehicle at a time."""
    return float(np.interp(stamp_s, vehicle.dead_reckoning[:, 0], vehicle.dead_reckoning[:, 4]))


def _replayed(vehicle: VehicleRun, config: PositionsConfig, recorded: set[int]) -> PositionSmoother:
    """A smoother with all that a vehicle measured and received; samples refine only tracks of unrecorded mates."""
    smoother = PositionSmoother(vehicle.vehicle, config)
    for stamp, north, east, heading, depth in vehicle.dead_reckoning.tolist():
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp, heading_rad=heading, north_m=north, east_m=east, depth_m=depth)
        )
    fix_times_s = track_times_s(vehicle, np.array([fix.stamp_s for fix in vehicle.fixes]))
    for fix, time_s in zip(vehicle.fixes, fix_times_s.tolist(), strict=True):
        smoother.add_fix(dataclasses.replace(fix, stamp_s=time_s - smoother.clock.set_back_s))
    heard = vehicle.received[~np.isin(vehicle.received.vehicle, list(recorded))]
    samples = {
        (t, k): heard[(heard.stamp_s == t) & (heard.vehicle == k)].locations_m
        for t, k in {*zip(heard.stamp_s.tolist(), heard.vehicle.tolist(), strict=True)}
    }
    events = [(mate.stamp_s, 0, mate.source) for mate in vehicle.mates] + [(t, 1, k) for t, k in samples]
    mates = iter(vehicle.mates)
    for stamp, kind, source in sorted(events, key=lambda event: event[:2]):
        if kind == 0:
            smoother.add_navigation(next(mates))
        else:
            smoother.add_sample_positions(source, samples[stamp, source])
    return smoother
