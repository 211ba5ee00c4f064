"""Compares the maps that vehicles published with dense ones from the same recording.

Each vehicle's published map is compared twice. First with the map of its recorded kernel centers, which may differ by
rounding alone. Then with the map of its recorded soundings and received samples, which shows whether the centers come
from measurements. Vehicles average, weight and locate soundings under way, with less data than is known afterwards, so
this tolerance is wider (docs/evidence/gp.md).

The last map of an interrupted mission may have parts of different age (`DepthMap.recent_field`) if it has more than
`DENSE_CENTERS` centers. Cells that differ from its centers are then noted, and only the soundings decide.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.map_codecs import DEPTH_STEP_M, RISK_STEP
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.certify.dense import DenseMap, Measurements, dense_map
from auv_lse_shore.certify.final_map import dense_prior, measurements
from auv_lse_shore.certify.recorded import PublishedMap

#: Largest difference of the published values from those of the recorded centers, besides a relative 1e-5: messages
#: round to steps, so half a step is expected.
ROUNDING_M, ROUNDING_P = 0.75 * DEPTH_STEP_M, 0.75 * RISK_STEP
#: Maps of more centers are computed tile by tile: tolerances in standard deviations, and relative.
DENSE_CENTERS, TILED_SIGMAS, TILED_STD = 1000, 0.2, 0.05
#: Largest difference of the published depth from that of the soundings, in published standard deviations and `LEAST_M`.
MAX_SIGMAS, LEAST_M = 4.0, 0.1
#: Largest standard deviation from the soundings / published one, to which a share of `gp.signal_std_m` is added.
MAX_STD_RATIO, LEAST_STD_SHARE = 3.0, 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One comparison.

    Attributes:
        passed: Whether all cells are within the tolerance.
        worst: Largest difference / tolerance.
        cells: Number of cells beyond the tolerance.
        north_m: Where the largest difference is; east_m likewise.
        published: The published value there, in `unit`.
        recomputed: The recomputed value there.
        tolerance: Largest difference allowed there.
    """

    vehicle: int
    what: str
    passed: bool
    worst: float
    cells: int
    north_m: float
    east_m: float
    published: float
    recomputed: float
    tolerance: float
    unit: str

    def location(self, origin: tuple[float, float] | None) -> dict[str, float]:
        """Where the largest difference is, with latitude and longitude if the origin (deg) is known."""
        location = {"north_m": round(self.north_m, 2), "east_m": round(self.east_m, 2)}
        if origin is not None:
            latitude, longitude = geodetic_from_local(self.north_m, self.east_m, *origin)
            location |= {"latitude_deg": round(float(latitude), 7), "longitude_deg": round(float(longitude), 7)}
        return location


def check_map(published: PublishedMap, settings: PlannerSettings, run: RunData) -> tuple[list[Check], list[str]]:
    """Compares one vehicle's published map.

    Args:
        run: All vehicles, at corrected positions.

    Returns:
        The comparisons, and what could not be compared.
    """
    field, vehicle = published.field, f"auv{published.vehicle}"
    grid = OperatingArea(settings.area).grid(settings.gp.map_resolution_m, "gp.map_resolution_m")
    inside = np.isfinite(field.mean_m)
    same_grid = inside.shape == grid.inside.shape and np.allclose(field.north_m, grid.north_m)
    if not same_grid or not np.allclose(field.east_m, grid.east_m) or field.level_m != settings.level_set.level_m:
        return [_other_ground(published, settings)], []
    at, prior = grid.locations_m, dense_prior(settings.gp, settings.area)
    shown = {name: np.asarray(getattr(field, name), dtype=float)[grid.inside] for name in ("mean_m", "std_m", "p_safe")}
    checks, notes = [], []
    if published.centers is None:
        notes.append(f"{vehicle}: its kernel centers are not recorded, so its map was compared with the soundings only")
    else:
        c = published.centers
        given = Measurements.of_centers(c.locations_m, c.depths_m, c.noise_std_m, c.position_effect_m)
        found = dense_map(prior, given, at)
        compared = _against_centers(published.vehicle, shown, found, settings, at)
        late = [check for check in compared if not check.passed and found.count > DENSE_CENTERS]
        checks += [check for check in compared if check not in late]
        if late:
            cells = max(check.cells for check in late)
            notes.append(
                f"{vehicle}: {cells} of {len(at)} cells of its map differ from its recorded kernel centers. Before a "
                "mission is over, large maps are published in parts; those cells were compared with the soundings only"
            )
    own = next((v for v in run.vehicles if v.vehicle == published.vehicle), None)
    if own is None:
        notes.append(f"{vehicle}: there is a map, but no sounding of this vehicle")
        return checks, notes
    measured = dense_map(prior, _measured_by(own, field.stamp_s, settings), at)
    return checks + _against_soundings(published, shown, measured, settings, at), notes


def _measured_by(vehicle: VehicleRun, until_s: float, settings: PlannerSettings) -> Measurements:
    own, heard = vehicle.soundings, vehicle.received
    return measurements(settings.gp, own[own.stamp_s <= until_s], heard[heard.stamp_s <= until_s])


def _against_centers(
    vehicle: int, shown: dict[str, Array], found: DenseMap, settings: PlannerSettings, at: Array
) -> list[Check]:
    tiled = found.count > DENSE_CENTERS
    mean_tolerance = ROUNDING_M + 1e-5 * np.abs(found.mean_m) + (TILED_SIGMAS * found.std_m if tiled else 0.0)
    std_tolerance = ROUNDING_M + (TILED_STD if tiled else 1e-5) * found.std_m
    of_centers = "against the recorded kernel centers"
    checks = [
        _check(vehicle, f"depth, {of_centers}", shown["mean_m"], found.mean_m, mean_tolerance, at, "m"),
        _check(vehicle, f"standard deviation, {of_centers}", shown["std_m"], found.std_m, std_tolerance, at, "m"),
    ]
    if not tiled:
        p_safe = ndtr((found.mean_m - settings.level_set.level_m) / np.maximum(found.std_m, 1e-9))
        tolerance = np.full(len(at), ROUNDING_P)
        checks.append(
            _check(vehicle, f"P(at least the level), {of_centers}", shown["p_safe"], p_safe, tolerance, at, "")
        )
    return checks


def _against_soundings(
    published: PublishedMap, shown: dict[str, Array], found: DenseMap, settings: PlannerSettings, at: Array
) -> list[Check]:
    std = shown["std_m"]
    tolerance = MAX_SIGMAS * np.hypot(std, LEAST_M)
    most = MAX_STD_RATIO * np.hypot(std, LEAST_STD_SHARE * settings.gp.signal_std_m)
    lacking = np.maximum(found.std_m, std)  # a published error larger than necessary is no fault
    return [
        _check(published.vehicle, "depth, against the soundings", shown["mean_m"], found.mean_m, tolerance, at, "m"),
        _check(published.vehicle, "standard deviation, against the soundings", std, lacking, most - std, at, "m"),
    ]


def _check(vehicle: int, what: str, shown: Array, found: Array, tolerance: Array, at: Array, unit: str) -> Check:
    apart = np.abs(shown - found) / tolerance
    apart[~np.isfinite(apart)] = np.inf  # a cell without a published value
    i = int(apart.argmax())
    return Check(
        vehicle=vehicle,
        what=what,
        passed=bool(apart[i] <= 1.0),
        worst=float(apart[i]),
        cells=int((apart > 1.0).sum()),
        north_m=float(at[i, 0]),
        east_m=float(at[i, 1]),
        published=float(shown[i]),
        recomputed=float(found[i]),
        tolerance=float(tolerance[i]),
        unit=unit,
    )


def _other_ground(published: PublishedMap, settings: PlannerSettings) -> Check:
    """The finding for a map of another area, cell size or level than the mission file's."""
    field = published.field
    return Check(
        vehicle=published.vehicle,
        what="area, cells and level of the map, against the mission file",
        passed=False,
        worst=float("inf"),
        cells=int(field.mean_m.size),
        north_m=float(field.north_m[0]),
        east_m=float(field.east_m[0]),
        published=float(field.level_m),
        recomputed=settings.level_set.level_m,
        tolerance=0.0,
        unit="m",
    )
