"""The places of recorded soundings, found by everything that all recordings together hold.

Every vehicle of every dive has errors of its own; what they share is the ground, and within a dive the ranges. In a
smoother under way each vehicle knows its mates by their packets. Here their own recordings stand in for them where they
are given.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.area import OperatingArea
from auv_lse_common.mission_file.sections.places import PlacesConfig, places_of
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.places.corrected_map import CorrectedMap
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.measurements import FixMeasurement, RangeMeasurement
from auv_lse_gp.places.smoother import PositionSmoother, smooth_team
from auv_lse_gp.places.terrain_matching import Terrain
from auv_lse_gp.places.track import Track
from auv_lse_gp.places.track_segments import TrackSegments, segment_track
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.judge.adjustment_errors import AdjustError

Array = NDArray[np.float64]

#: Vehicles of different dives are told apart by this many times the number of the dive.
_OF_DIVE = 1000
#: TrackSegments of track that are compared, and steps with the terrain: more than under way, where time is short.
MAX_SEGMENTS, TERRAIN_STEPS = 1200, 8
#: A sample heard is the sounding of a mate that is this near (m): a packet holds 32 bits of each number.
_SAME_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Moved:
    """What became of one vehicle's soundings.

    Attributes:
        run: Number of the run, from 0.
        vehicle: Number of the vehicle.
        key: Number by which it is known among the vehicles of all dives.
        soundings: How many were recorded.
        missing: What its recording lacks, so that its soundings stay where they are; "" if nothing.
        mean_m: Mean distance that they were moved.
        largest_m: Largest.
        std_m: Standard deviation of a place afterwards, each axis (root mean square over the soundings).
        fixes: SurfacingFixes used.
        ranges: Ranges measured to it by others or by it to others.
    """

    run: int
    vehicle: int
    key: int
    soundings: int
    missing: str
    mean_m: float = float("nan")
    largest_m: float = float("nan")
    std_m: float = float("nan")
    fixes: int = 0
    ranges: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Adjustment:
    """Runs with their soundings at the places found.

    Attributes:
        runs: The runs, with soundings, samples and their places' standard deviations replaced; odometry is as flown.
        moved: What became of each vehicle's soundings.
        ranges: Ranges measured, in all.
        refused: How many of them, and of the fixes, were refused as wrong.
        correction: The places found.
    """

    runs: list[RunData]
    moved: list[Moved]
    ranges: int
    refused: int
    correction: Correction

    def settle(self, depth_map: DepthMap) -> CorrectedMap:
        """Puts all soundings into an empty map, in order of time, run by run; the map is not told how sure they are."""
        placed = CorrectedMap(depth_map, {m.key for m in self.moved})
        key_of = {(m.run, m.vehicle): m.key for m in self.moved}
        for number, run in enumerate(self.runs):
            for vehicle in run.vehicles:
                own, raw = vehicle.soundings, _raw_places(vehicle)
                key = key_of[number, vehicle.vehicle]
                placed.log.add(key, own.stamp_s, raw, own.places_m, own.depth_m, None)
        placed.rebuild(np.concatenate([v.soundings.places_m for run in self.runs for v in run.vehicles]))
        return placed


def dives_of(runs: Sequence[RunData]) -> list[int]:
    """The dive of each run, from 0: recordings of different vehicles at the same time are of one dive."""
    dives: list[int] = []
    for run in runs:
        same = (
            d for d in sorted(set(dives)) if all(_together(run, o) for o, e in zip(runs, dives, strict=False) if e == d)
        )
        dives.append(next(same, max(dives, default=-1) + 1))
    return dives


def _together(one: RunData, other: RunData) -> bool:
    """Whether two recordings are of different vehicles under way at the same time."""
    spans = [[v.dead_reckoning[[0, -1], 0] for v in run.vehicles if len(v.dead_reckoning)] for run in (one, other)]
    if not all(spans) or {v.vehicle for v in one.vehicles} & {v.vehicle for v in other.vehicles}:
        return False
    starts, ends = zip(*((min(s[0] for s in span), max(s[1] for s in span)) for span in spans), strict=True)
    return bool(max(starts) < min(ends))


def missing_in(vehicle: VehicleRun) -> str:
    """What a vehicle's recording lacks to be adjusted; "" if nothing."""
    if len(vehicle.dead_reckoning) < 2:
        return "no dead reckoning (topic dead_reckoning)"
    if not len(vehicle.soundings):
        return "no soundings (topic sounding)"
    return ""


def wanted(run: RunData) -> bool:
    """Whether a run flew with corrected places, and recorded what they are found with."""
    if not any(not missing_in(vehicle) for vehicle in run.vehicles):
        return False
    number = run.vehicles[0].vehicle
    return bool(places_of(parameters_for(run.parameters, f"/auv{number}/gp_node"), "mission file").correct)


def adjust(runs: Sequence[RunData]) -> Adjustment:
    """Finds where the soundings of all runs were taken.

    Raises:
        AdjustError: if no vehicle's recording has what is needed, the runs have different origins, or share soundings.
        ParameterError: if the parameters cannot be used.
    """
    able = [(n, v) for n, run in enumerate(runs) for v in run.vehicles if not missing_in(v)]
    if not able:
        lacks = [f"auv{v.vehicle} of run {n + 1}: {missing_in(v)}" for n, run in enumerate(runs) for v in run.vehicles]
        raise AdjustError(
            "; ".join(lacks or ["no vehicle in any run"])
            + "; expected raw places beside the soundings, as recorded since vehicles keep them (docs/design/places.md)"
        )
    origins = {run.origin for run in runs}
    if len(origins) > 1:
        raise AdjustError(f"runs: have different origins {sorted(map(str, origins))}; expected one local frame for all")
    _refuse_doubles(able)
    first = runs[able[0][0]]
    nested = parameters_for(first.parameters, f"/auv{able[0][1].vehicle}/gp_node")
    config = places_of(nested, "mission file")
    settings = PlannerSettings.from_parameters(nested, "mission file", able[0][1].vehicle)
    dives = dives_of(runs)
    key_of = {(n, v.vehicle): _OF_DIVE * dives[n] + v.vehicle for n, run in enumerate(runs) for v in run.vehicles}
    keyed = {key_of[n, v.vehicle]: v for n, v in able}
    smoothers = {key: _told(vehicle, config) for key, vehicle in keyed.items()}
    tracks, fixes, ranges, before = _gathered(smoothers, keyed)
    plain = DepthMap(settings.gp, settings.level_set, OperatingArea(settings.area)).gp
    correction = smooth_team(
        config,
        tracks,
        fixes,
        ranges,
        references={min(k for k in smoothers if k // _OF_DIVE == d) for d in {k // _OF_DIVE for k in smoothers}},
        stamp_s=max(run.sim_s for run in runs),
        terrain=Terrain(_segments(keyed), plain.kernel, plain.prior_mean, settings.gp.noise_std_m),
        earlier_distance_m=before,
        terrain_steps=TERRAIN_STEPS,
    )
    moved: list[Moved] = []
    new: dict[int, VehicleRun] = {}
    for n, run in enumerate(runs):
        for vehicle in run.vehicles:
            key = key_of[n, vehicle.vehicle]
            if missing := missing_in(vehicle):
                count = len(vehicle.soundings)
                moved.append(Moved(run=n, vehicle=vehicle.vehicle, key=key, soundings=count, missing=missing))
                new[key] = vehicle
                continue
            new[key], report = _adjusted(vehicle, correction, key, n)
            used = sum(key in (row.sender, row.receiver) for row in ranges)
            report = dataclasses.replace(report, fixes=sum(f.vehicle == key for f in fixes), ranges=used)
            moved.append(report)
    new_runs = []
    for n, run in enumerate(runs):
        team = {key - _OF_DIVE * dives[n]: (old, new[key]) for key, old in keyed.items() if key // _OF_DIVE == dives[n]}
        vehicles = [_with_samples(new[key_of[n, vehicle.vehicle]], team) for vehicle in run.vehicles]
        new_runs.append(dataclasses.replace(run, vehicles=vehicles))
    return Adjustment(runs=new_runs, moved=moved, ranges=len(ranges), refused=correction.refused, correction=correction)


def _refuse_doubles(able: Sequence[tuple[int, VehicleRun]]) -> None:
    """Soundings that count twice make the map surer than it is; two measured apart differ in their last digits."""
    before: list[tuple[int, int, set[bytes]]] = []
    for n, vehicle in able:
        rows = {row.tobytes() for row in vehicle.soundings.points_m}
        for run, number, others in before:
            if run != n and len(rows & others) > 0.1 * min(len(rows), len(others)):
                raise AdjustError(
                    f"auv{vehicle.vehicle} of run {n + 1} has the soundings of auv{number} of run {run + 1}; expected "
                    "each recording once"
                )
        before.append((n, vehicle.vehicle, rows))


def _told(vehicle: VehicleRun, config: PlacesConfig) -> PositionSmoother:
    """A smoother that knows everything that a vehicle measured and heard."""
    smoother = PositionSmoother(vehicle.vehicle, config)
    for stamp, north, east, heading, depth in vehicle.dead_reckoning.tolist():
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp, heading_rad=heading, north_m=north, east_m=east, depth_m=depth)
        )
    for fix in vehicle.fixes:
        smoother.add_fix(fix)
    heard = vehicle.received
    samples = {
        (t, k): heard[(heard.stamp_s == t) & (heard.vehicle == k)].places_m
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


def _gathered(
    smoothers: dict[int, PositionSmoother], recorded: dict[int, VehicleRun]
) -> tuple[dict[int, Track], list[FixMeasurement], list[RangeMeasurement], dict[int, float]]:
    """Tracks, fixes, ranges and ways before the first known place, of all vehicles recorded or heard, by their keys."""
    tracks: dict[int, Track] = {}
    fixes: list[FixMeasurement] = []
    ranges: list[RangeMeasurement] = []
    before: dict[int, float] = {}
    for key, smoother in smoothers.items():
        team = key - smoother.vehicle
        for number, track in smoother.tracks.items():
            other = team + number
            if other in tracks or (other in smoothers and other != key):
                continue  # its own recording, or what an earlier one heard of it
            tracks[other] = track
            fixes += [dataclasses.replace(row, vehicle=other) for row in smoother.fixes(number)]
            if number in smoother.earlier_distance_m:
                before[other] = smoother.earlier_distance_m[number]
        for row in smoother.ranges:
            ends = team + row.sender, team + row.receiver
            deeper = 0.0
            if ends[0] in recorded and ends[1] in recorded:
                times = (row.sent_s, row.arrived_s)
                a, b = (
                    float(np.interp(t, recorded[k].dead_reckoning[:, 0], recorded[k].dead_reckoning[:, 4]))
                    for t, k in zip(times, ends, strict=True)
                )
                deeper = b - a
            ranges.append(dataclasses.replace(row, sender=ends[0], receiver=ends[1], deeper_m=deeper))
    return tracks, fixes, ranges, before


def _raw_places(vehicle: VehicleRun) -> Array:
    """Raw places (n, 2) of a vehicle's soundings; where they were not recorded, from its raw track, if it has one."""
    raw = vehicle.soundings.raw_places_m
    track = vehicle.dead_reckoning
    if len(track) < 2:
        return raw
    between = np.column_stack([np.interp(vehicle.soundings.stamp_s, track[:, 0], track[:, c]) for c in (1, 2)])
    return np.where(np.isfinite(raw), raw, between)


def _segments(keyed: Mapping[int, VehicleRun]) -> TrackSegments:
    rows = [
        np.column_stack([np.full(len(v.soundings), key), v.soundings.stamp_s, _raw_places(v), v.soundings.depth_m])
        for key, v in keyed.items()
    ]
    every = np.concatenate(rows)
    return segment_track(every[:, 0].astype(np.int64), every[:, 1], every[:, 2:4], every[:, 4], MAX_SEGMENTS)


def _adjusted(vehicle: VehicleRun, correction: Correction, key: int, run: int) -> tuple[VehicleRun, Moved]:
    """A vehicle with its soundings at their places, and what that changed."""
    stamps, raw = vehicle.soundings.stamp_s, _raw_places(vehicle)
    places = correction.places(key, stamps, raw)
    soundings = dataclasses.replace(vehicle.soundings, north_m=places[:, 0], east_m=places[:, 1])
    far = np.sqrt(((places - vehicle.soundings.places_m) ** 2).sum(axis=1))
    odometry = vehicle.odometry
    track = correction.model.vehicles[key].track
    place_std = correction.place_std_m(key, odometry[:, 0], track.at(odometry[:, 0]).raw_m)
    some = np.unique(np.linspace(0, len(stamps) - 1, 200).astype(int))
    std = correction.place_std_m(key, stamps[some], raw[some])
    report = Moved(
        run=run,
        vehicle=vehicle.vehicle,
        key=key,
        soundings=len(soundings),
        missing="",
        mean_m=float(far.mean()),
        largest_m=float(far.max()),
        std_m=float(np.sqrt((std**2).mean())),
    )
    return dataclasses.replace(vehicle, soundings=soundings, place_std_m=place_std), report


def _with_samples(vehicle: VehicleRun, team: Mapping[int, tuple[VehicleRun, VehicleRun]]) -> VehicleRun:
    """A vehicle whose samples heard are at the places of the soundings that they are, where those were recorded.

    Args:
        vehicle: The vehicle.
        team: The vehicles of its dive as recorded and as adjusted, by number.
    """
    heard = vehicle.received
    places = heard.places_m
    for source in np.unique(heard.vehicle).tolist():
        if source not in team:
            continue
        old, new = team[source]
        rows = np.flatnonzero(heard.vehicle == source)
        apart, index = cKDTree(_raw_places(old)).query(places[rows])
        same = apart <= _SAME_M
        places[rows[same]] = new.soundings[index[same]].places_m
    moved = dataclasses.replace(heard, north_m=places[:, 0], east_m=places[:, 1])
    return dataclasses.replace(vehicle, received=moved)
