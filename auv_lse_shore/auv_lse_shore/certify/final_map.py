"""The final map of a mission by the dense path, its isobath in pieces, and what may be missing."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from scipy.special import ndtr

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.level_set.lines import contours, near
from auv_lse_gp.map import certainty
from auv_lse_gp.map.certainty import Piece
from auv_lse_gp.map.depth_map import DepthField
from auv_lse_gp.map.undiscovered import Undiscovered, coarse_grid, undiscovered
from auv_lse_record.run_data import RunData
from auv_lse_shore.certify.dense import DenseMap, DensePrior, Measurements, dense_map
from auv_lse_shore.certify.recorded import Recorded
from auv_lse_shore.judge.team_map import map_of, sounded_locations
from auv_lse_shore.positions.adjustment import AdjustError, adjust, corrects_positions
from auv_lse_shore.positions.merging import merged

#: Support of a Wendland kernel / `gp.length_scale_m`: the correlation at one length scale is that of Matern 5/2.
_SUPPORT = {"wendland_c2": 3.3107}


@dataclass(frozen=True, slots=True, kw_only=True)
class FinalMap:
    """The final map.

    Attributes:
        run: All vehicles, with soundings at their positions in this map.
        field: The map on its grid.
        pieces: Its isobath, in pieces of one class.
        undiscovered: Isobath that may be missing.
        averages: Number of averages of soundings that the map is made from.
        positions: How the positions of soundings were estimated.
    """

    run: RunData
    area: OperatingArea
    field: DepthField
    pieces: list[Piece]
    undiscovered: Undiscovered
    averages: int
    positions: str


def dense_prior(gp: GpConfig, area: AreaConfig) -> DensePrior:
    """The prior of a mission file: with a known shore of depth h, the mean is h + s (m - h) for that of open ground, m.

    Raises:
        ParameterError: if its prior survey cannot be read.
    """
    first, open_ground = gp.length_scale_m, prior_mean(gp)
    bank, mean = shore_factor(area), open_ground
    if bank is not None:
        mean = partial(_banked, open_ground, bank, area.shore_depth_m)
    if gp.kernel in _SUPPORT:
        first = _SUPPORT[gp.kernel] * gp.length_scale_m
    return DensePrior(
        kernel=gp.kernel,
        std_m=gp.signal_std_m,
        lengths_m=(first, first * (gp.length_scale_2_m or gp.length_scale_m) / gp.length_scale_m),
        rotation_deg=gp.rotation_deg,
        mean=mean,
        std_soundings=gp.std_soundings,
        length_m=gp.length_scale_m,
        bank=bank,
        shore_m=area.shore_depth_m,
    )


def shore_factor(area: AreaConfig) -> Callable[[Array], Array] | None:
    """Factor s = 1 - exp(-d / 25 m), at least .05, at locations at distance d from the shore; None if there is none."""
    lines = [shapely.LineString(np.reshape(flat, (-1, 2))) for flat in area.shore.values()]
    if not lines:
        return None
    shore = shapely.union_all(lines)
    return lambda at_m: np.maximum(1.0 - np.exp(-shapely.distance(shapely.points(at_m), shore) / 25.0), 0.05)


def _banked(
    open_ground: Callable[[Array], Array], bank: Callable[[Array], Array], shore_m: float, at_m: Array
) -> Array:
    return np.asarray(shore_m + bank(at_m) * (open_ground(at_m) - shore_m))


def corrected_runs(recorded: Recorded) -> tuple[RunData, str]:
    """All vehicles with soundings at the best positions that the recordings support, and how these were estimated."""
    run = merged(recorded.runs)
    if not corrects_positions(run):
        return run, "as the vehicles recorded them"
    try:
        adjustment = adjust(recorded.runs)
        crossings = ", ranges and track crossings" if adjustment.correction.model.config.terrain else " and ranges"
        return merged(adjustment.runs), f"estimated from fixes{crossings}"
    except AdjustError as error:
        return run, f"as the vehicles recorded them: {error}"


def measurements(gp: GpConfig, own: Soundings, heard: Soundings | None = None) -> Measurements:
    """Averages of a vehicle's plausible soundings, and of the samples that it received."""
    rows = [SoundingGate().passed(list(own.in_order()))] + ([list(heard)] if heard is not None else [])
    points = Soundings.join(Soundings.from_rows(part) for part in rows if part).points_m if any(rows) else _NONE
    usable = np.isfinite(points).all(axis=1) & (points[:, 2] >= gp.min_depth_m) & (points[:, 2] <= gp.max_depth_m)
    return Measurements.averaged(points[usable, :2], points[usable, 2], gp.noise_std_m, gp.min_spacing_m)


_NONE: Array = np.zeros((0, 3))


def final_map(recorded: Recorded, run: RunData, positions: str) -> FinalMap:
    """The map of all soundings of all vehicles."""
    gp, level_set = recorded.settings.gp, recorded.settings.level_set
    area, prior = OperatingArea(recorded.settings.area), dense_prior(gp, recorded.settings.area)
    grid = area.grid(gp.map_resolution_m, "gp.map_resolution_m")
    parts = [measurements(gp, vehicle.soundings) for vehicle in run.vehicles]
    given = _joined(parts)
    found = dense_map(prior, given, grid.locations_m)
    field = _field(grid, found, level_set)
    informed = field.informed(gp.signal_std_m)
    lines = contours(grid.north_m, grid.east_m, field.mean_m, level_set.level_m, informed)
    shore_known = prior.bank is not None
    pieces = certainty.classify(lines, field, gp.signal_std_m, sounded_locations(run), shore_known=shore_known)
    # the length that may be missing was calibrated with the centers of the vehicles' maps
    all_soundings = Soundings.join(vehicle.soundings for vehicle in run.vehicles)
    centers = map_of(recorded.settings, area, all_soundings).centers
    return FinalMap(
        run=run,
        area=area,
        field=field,
        pieces=pieces,
        undiscovered=undiscovered(
            gp,
            centers,
            level_set.level_m,
            coarse_grid(area, gp.map_resolution_m),
            near(certainty.lines_of(pieces, certainty.FOUND)),
            Banks.of(area.config, level_set.level_m),
        ),
        averages=found.count,
        positions=positions,
    )


def _joined(parts: list[Measurements]) -> Measurements:
    """Averages of several vehicles, kept apart because their errors differ."""
    sizes = np.cumsum([0, *(len(part.locations_m) for part in parts)])
    starts = [part.starts + size for part, size in zip(parts, sizes, strict=False)]
    n = sum(len(part.starts) for part in parts)
    return Measurements(
        locations_m=np.concatenate([np.zeros((0, 2)), *(part.locations_m for part in parts)]),
        depths_m=np.concatenate([np.zeros(0), *(part.depths_m for part in parts)]),
        noise_m2=np.concatenate([np.zeros(0), *(part.noise_m2 for part in parts)]),
        starts=np.concatenate([np.zeros(0, dtype=np.int64), *starts]),
        effect_m=np.zeros((n, 0)),
    )


def _field(grid: Grid, found: DenseMap, level_set: LevelSetConfig) -> DepthField:
    """A dense map on the grid; the risk is that of the cheaper call."""
    p_safe = ndtr((found.mean_m - level_set.level_m) / np.maximum(found.std_m, 1e-9))
    risk = np.minimum(level_set.cost_false_safe * (1.0 - p_safe), level_set.cost_false_unsafe * p_safe)
    return DepthField(
        grid=grid,
        mean_m=grid.fill(found.mean_m),
        std_m=grid.fill(found.std_m),
        prior_std_m=grid.fill(found.prior_std_m),
        risk=grid.fill(risk),
        p_safe=grid.fill(p_safe),
        variance_scale=found.variance_scale,
        revision=0,
    )
