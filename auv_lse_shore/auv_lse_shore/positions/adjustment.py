"""Estimates where the soundings of whole recordings were taken.

Every vehicle of every dive has errors of its own. All dives share the ground, and the vehicles of a dive share ranges.
Under way, a vehicle has only its mates' packets. Here their own recordings replace these.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.sections.positions import positions_of
from auv_lse_common.support.arrays import Array
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.corrected_map import CorrectedMap
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.error_model import TeamErrorModel
from auv_lse_gp.positions.smoother import smooth_team
from auv_lse_gp.positions.terrain_matching import Terrain
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.positions.recordings import (
    Recording,
    TeamMeasurements,
    missing_in,
    raw_positions,
    recordings_of,
    segments_of,
    track_times_s,
)

#: Steps of terrain matching: more than under way, where time is short.
TERRAIN_STEPS = 8
#: Positions that are corrected at once: their derivatives take some kilobytes each.
_AT_ONCE = 10_000
#: A received sample is a mate's sounding within this distance (m): a packet rounds numbers to 32 bits.
SAME_POSITION_M = 0.05
#: Two recordings with more than this share of common soundings count as one.
SAME_RECORDING = 0.1


class AdjustError(ValueError):
    """Recordings that cannot be adjusted: they lack something, or do not belong together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleAdjustment:
    """The adjustment of one vehicle's soundings.

    Attributes:
        run: Number of the run, from 0.
        key: Its number among the vehicles of all dives.
        soundings: Number of soundings recorded.
        missing: What the recording lacks, so that its soundings were not moved; "" if nothing.
        mean_m: Mean distance by which soundings were moved.
        largest_m: Largest of these distances.
        std_m: Standard deviation of a position afterwards, each axis (root mean square over the soundings).
        fixes: Number of fixes used.
        ranges: Number of ranges measured to it or by it.
    """

    run: int
    vehicle: int
    key: int
    soundings: int
    missing: str = ""
    mean_m: float = float("nan")
    largest_m: float = float("nan")
    std_m: float = float("nan")
    fixes: int = 0
    ranges: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Adjustment:
    """Runs with their soundings at the estimated positions.

    Attributes:
        runs: The runs, with soundings, samples and the standard deviations of positions replaced; odometry is as
            recorded.
        vehicles: The adjustment of each vehicle of each run.
        refused: Number of ranges and fixes rejected as outliers.
    """

    runs: list[RunData]
    vehicles: list[VehicleAdjustment]
    ranges: int
    refused: int
    correction: Correction

    def fill(self, depth_map: DepthMap) -> CorrectedMap:
        """Puts all soundings into an empty map, run by run and in order of time, as if their positions were exact."""
        corrected = CorrectedMap(depth_map, {m.key for m in self.vehicles})
        recorded = [v for run in self.runs for v in run.vehicles]
        for vehicle, adjusted in zip(recorded, self.vehicles, strict=True):
            raw = raw_positions(vehicle)
            soundings = dataclasses.replace(vehicle.soundings, raw_north_m=raw[:, 0], raw_east_m=raw[:, 1])
            corrected.log.add(adjusted.key, soundings, None)
        corrected.rebuild(np.concatenate([v.soundings.locations_m for v in recorded]))
        return corrected


def corrects_positions(run: RunData) -> bool:
    """Whether a run's mission file asks for corrected positions, and its recording allows them to be estimated."""
    if all(missing_in(vehicle) for vehicle in run.vehicles):
        return False
    number = run.vehicles[0].vehicle
    return bool(positions_of(parameters_for(run.parameters, f"/auv{number}/gp_node"), "mission file").correct)


def adjust(runs: Sequence[RunData], crossings: bool = False) -> Adjustment:
    """Estimates where the soundings of all runs were taken.

    Args:
        crossings: Whether tracks that cross measured the same depth, even with `positions.terrain: false`.

    Raises:
        AdjustError: if every recording lacks what is needed, the runs have different origins, or share soundings.
        ParameterError: if the parameters cannot be used.
    """
    recordings = recordings_of(runs)
    usable = [r for r in recordings if not missing_in(r.data)]
    _check(runs, recordings, usable)
    first = usable[0]
    nested = parameters_for(runs[first.run].parameters, f"/auv{first.data.vehicle}/gp_node")
    config = positions_of(nested, "mission file")
    config = dataclasses.replace(config, terrain=config.terrain or crossings)
    settings = PlannerSettings.from_parameters(nested, "mission file", first.data.vehicle)
    team = TeamMeasurements.of(usable, config)
    gp = DepthMap(settings.gp, settings.level_set, OperatingArea(settings.area)).gp
    references = {min(r.key for r in usable if r.dive == dive) for dive in {r.dive for r in usable}}
    correction = smooth_team(
        TeamErrorModel(config, team.tracks, references, team.earlier_distance_m),
        team.fixes,
        team.ranges,
        stamp_s=max(run.end_s for run in runs),
        terrain=Terrain(segments_of(usable), gp.kernel, gp.prior_mean, settings.gp.noise_std_m),
        terrain_steps=TERRAIN_STEPS,
    )
    adjusted = {r.key: _adjusted(r.data, correction, r.key) for r in usable}
    new_runs = []
    for n, run in enumerate(runs):
        own = [r for r in recordings if r.run == n]
        mates = {r.data.vehicle: (r.data, adjusted[r.key]) for r in usable if own and r.dive == own[0].dive}
        vehicles = [_with_samples(adjusted.get(r.key, r.data), mates) for r in own]
        new_runs.append(dataclasses.replace(run, vehicles=vehicles))
    return Adjustment(
        runs=new_runs,
        vehicles=[_summary(r, team, correction, adjusted.get(r.key)) for r in recordings],
        ranges=len(team.ranges),
        refused=correction.refused,
        correction=correction,
    )


def _check(runs: Sequence[RunData], recordings: Sequence[Recording], usable: Sequence[Recording]) -> None:
    """Raises AdjustError for runs that cannot be adjusted together.

    Soundings that count twice would make the map overconfident; two measured apart differ in their last digits.
    """
    if not usable:
        missing = [f"{r.name}: {missing_in(r.data)}" for r in recordings] or ["no vehicle in any run"]
        raise AdjustError(
            f"{'; '.join(missing)}. Adjusting needs dead-reckoned positions beside the soundings: record the "
            "dive with this version (docs/design/positions.md)"
        )
    origins = {run.origin for run in runs}
    if len(origins) > 1:
        raise AdjustError(
            f"runs have different origins, {sorted(map(str, origins))}. Set the same area.origin_lat_deg and "
            "origin_lon_deg"
        )
    rows = [{row.tobytes() for row in r.data.soundings.points_m} for r in usable]
    for i, one in enumerate(usable):
        for other, others in zip(usable[:i], rows, strict=False):
            if one.run != other.run and len(rows[i] & others) > SAME_RECORDING * min(len(rows[i]), len(others)):
                raise AdjustError(
                    f"{one.name} has the soundings of {other.name}, so they would count twice. Leave one of them out"
                )


def _adjusted(vehicle: VehicleRun, correction: Correction, key: int) -> VehicleRun:
    """A vehicle with its soundings at their estimated positions."""
    times_s = track_times_s(vehicle, vehicle.soundings.stamp_s)
    positions = _in_pieces(correction.positions, key, times_s, raw_positions(vehicle))
    stamps = track_times_s(vehicle, vehicle.odometry[:, 0])
    track = correction.model.vehicles[key].track
    return dataclasses.replace(
        vehicle,
        soundings=dataclasses.replace(vehicle.soundings, north_m=positions[:, 0], east_m=positions[:, 1]),
        position_std_m=_in_pieces(correction.position_std_m, key, stamps, track.at(stamps).raw_m),
    )


def _in_pieces(computed: Callable[[int, Array, Array], Array], key: int, stamps_s: Array, raw_m: Array) -> Array:
    """Values (n, 2) of a vehicle's positions (n, 2) at times (n,), computed piece by piece."""
    starts = range(0, max(len(stamps_s), 1), _AT_ONCE)
    return np.concatenate([computed(key, stamps_s[i : i + _AT_ONCE], raw_m[i : i + _AT_ONCE]) for i in starts])


def _summary(
    recording: Recording, team: TeamMeasurements, correction: Correction, adjusted: VehicleRun | None
) -> VehicleAdjustment:
    old, key = recording.data, recording.key
    summary = VehicleAdjustment(
        run=recording.run, vehicle=old.vehicle, key=key, soundings=len(old.soundings), missing=missing_in(old)
    )
    if adjusted is None:
        return summary
    distance = np.sqrt(((adjusted.soundings.locations_m - old.soundings.locations_m) ** 2).sum(axis=1))
    some = np.unique(np.linspace(0, len(distance) - 1, 200).astype(int))
    times_s = track_times_s(old, old.soundings.stamp_s)
    std = correction.position_std_m(key, times_s[some], raw_positions(old)[some])
    return dataclasses.replace(
        summary,
        mean_m=float(distance.mean()),
        largest_m=float(distance.max()),
        std_m=float(np.sqrt((std**2).mean())),
        fixes=sum(fix.vehicle == key for fix in team.fixes),
        ranges=sum(key in (row.sender, row.receiver) for row in team.ranges),
    )


def _with_samples(vehicle: VehicleRun, mates: dict[int, tuple[VehicleRun, VehicleRun]]) -> VehicleRun:
    """A vehicle whose received samples are moved with the mates' soundings that they repeat.

    Args:
        mates: Recorded and adjusted vehicles of its dive, by number.
    """
    heard = vehicle.received
    positions = heard.locations_m
    for source in np.unique(heard.vehicle).tolist():
        if source in mates:
            old, new = mates[source]
            rows = np.flatnonzero(heard.vehicle == source)
            apart, index = cKDTree(raw_positions(old)).query(positions[rows])
            same = apart <= SAME_POSITION_M
            positions[rows[same]] = new.soundings[index[same]].locations_m
    return dataclasses.replace(
        vehicle, received=dataclasses.replace(heard, north_m=positions[:, 0], east_m=positions[:, 1])
    )
