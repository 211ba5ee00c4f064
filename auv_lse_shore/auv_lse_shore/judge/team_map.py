"""The map from all soundings of all vehicles, and the isobath in it, piece by piece."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.lines import near
from auv_lse_gp.map import certainty
from auv_lse_gp.map.certainty import CLASSES, Piece
from auv_lse_gp.map.depth_map import DepthField, DepthMap, Isobath
from auv_lse_gp.map.store import Outcome
from auv_lse_gp.map.undiscovered import Undiscovered, coarse_grid, undiscovered
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.isobath import write_geojson
from auv_lse_shore.positions.adjustment import Adjustment, adjust, corrects_positions
from auv_lse_shore.positions.merging import merged


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamMap:
    """The final map of all vehicles together.

    Attributes:
        run: The mission; with `positions.correct`, soundings are at the positions estimated from fixes, ranges and
            terrain.
        settings: The first vehicle's settings: level, costs and prior are the same for all.
        prior: The map before the first sounding.
        field: The map given all soundings, in order of time.
        isobath: Its contour at the level, with the band about it.
        pieces: That contour, in pieces of one class of certainty.
        undiscovered: What may be missing: isobath farther than `FOUND_WITHIN_M` from the pieces found.
    """

    run: RunData
    settings: PlannerSettings
    area: OperatingArea
    prior: DepthField
    field: DepthField
    isobath: Isobath
    pieces: list[Piece]
    undiscovered: Undiscovered

    @property
    def level_m(self) -> float:
        """Depth of the isobath (m)."""
        return self.settings.level_set.level_m


def mission_settings(parameters: Mapping[str, Mapping[str, Any]], vehicles: int) -> list[PlannerSettings]:
    """Planner settings of vehicles 1..K from a mission file's parameters.

    Raises:
        ParameterError: naming the parameter that cannot be used.
    """
    return [
        PlannerSettings.from_parameters(parameters_for(parameters, f"/auv{k}/planner_node"), f"mission file, auv{k}")
        for k in range(1, vehicles + 1)
    ]


def team_map(run: RunData) -> TeamMap:
    """The map of a mission; as `placed`."""
    return placed(run)[1]()


def placed(run: RunData) -> tuple[RunData, Callable[[], TeamMap]]:
    """A mission with its soundings at their best positions, and a function that makes its map.

    Where positions are corrected, the map includes their remaining uncertainty (`Posterior.position_variance`); the
    classes of the isobath's pieces use it as the vehicles' position error.

    Raises:
        ValueError: if there is no vehicle.
        ParameterError: if the parameters cannot be used.
    """
    if not run.vehicles:
        raise ValueError("run: there is no vehicle. Check that the recording has soundings and odometry")
    first = mission_settings(run.parameters, run.vehicles[0].vehicle)[-1]
    area = OperatingArea(first.area)
    if corrects_positions(run):
        adjustment = adjust([run])
        return merged(adjustment.runs), partial(adjusted_map, adjustment, first)

    def as_recorded() -> TeamMap:
        soundings = Soundings.join(v.soundings for v in run.vehicles)
        depth_map = DepthMap(first.gp, first.level_set, area)
        outcomes = depth_map.add_soundings(soundings.rows)
        locations_known = depth_map.field()
        if not any(len(v.dead_reckoning) for v in run.vehicles) and any(len(v.position_std_m) for v in run.vehicles):
            depth_map.gp.set_position_effect(_common_shift(run, depth_map, soundings.stamp_s, outcomes))
        return _team_map(run, first, area, depth_map, locations_known)

    return run, as_recorded


def _common_shift(run: RunData, depth_map: DepthMap, stamps_s: Array, outcomes: Sequence[Outcome | None]) -> Array:
    """Depth change (n, 2 K) of the centers if each of K vehicles' positions are one standard deviation north, or east.

    For positions that were estimated elsewhere: how their errors are related is unknown. One common shift of all of a
    vehicle's positions is the case in which more soundings help least.
    """
    order = np.argsort(stamps_s, kind="stable")
    seeds = np.array([i for i in order.tolist() if outcomes[i] is Outcome.KEPT], dtype=np.int64)
    vehicles = np.repeat(np.arange(len(run.vehicles)), [len(v.soundings) for v in run.vehicles])
    std_m = np.nan_to_num(np.concatenate([v.position_std_at(v.soundings.stamp_s) for v in run.vehicles]))
    by_std = depth_map.gp.slopes() * std_m[seeds]
    effect = np.zeros((len(seeds), len(run.vehicles), 2))
    effect[np.arange(len(seeds)), vehicles[seeds]] = by_std
    return effect.reshape(len(seeds), 2 * len(run.vehicles))


def adjusted_map(adjustment: Adjustment, settings: PlannerSettings) -> TeamMap:
    """The map of all runs of an adjustment; its run has the vehicles of all of them."""
    area = OperatingArea(settings.area)
    depth_map = DepthMap(settings.gp, settings.level_set, area)
    corrected = adjustment.fill(depth_map)
    locations_known = depth_map.field()
    corrected.set_uncertainty(adjustment.correction)
    return _team_map(merged(adjustment.runs), settings, area, depth_map, locations_known)


def _team_map(
    run: RunData, settings: PlannerSettings, area: OperatingArea, depth_map: DepthMap, locations_known: DepthField
) -> TeamMap:
    """As `team_map`, from the map and its field as if all positions were known."""
    prior = DepthMap(settings.gp, settings.level_set, area).field()
    isobath = depth_map.isobath()
    pieces = certainty.classify(
        isobath.lines,
        locations_known,
        settings.gp.signal_std_m,
        sounded_locations(run),
        shore_known=depth_map.gp.banks is not None,
    )
    return TeamMap(
        run=run,
        settings=settings,
        area=area,
        prior=prior,
        field=depth_map.field(),
        isobath=isobath,
        pieces=pieces,
        undiscovered=undiscovered(
            settings.gp,
            depth_map.centers,
            settings.level_set.level_m,
            coarse_grid(area, settings.gp.map_resolution_m),
            near(certainty.lines_of(pieces, certainty.FOUND)),
            depth_map.gp.banks,
        ),
    )


def map_of(settings: PlannerSettings, area: OperatingArea, soundings: Soundings) -> DepthMap:
    """A map from soundings, in the order given."""
    depth_map = DepthMap(settings.gp, settings.level_set, area)
    depth_map.add_soundings(soundings.rows)
    return depth_map


def sounded_locations(run: RunData) -> Array:
    """Positions of all soundings: north, east, the position's error per axis (m; NaN where unknown), shape (S, 3)."""
    return np.concatenate(
        [
            np.column_stack(
                [v.soundings.locations_m, np.sqrt((v.position_std_at(v.soundings.stamp_s) ** 2).mean(axis=1))]
            )
            for v in run.vehicles
        ]
    )


def write_isobath(
    team: TeamMap,
    path: Path,
    origin: tuple[float, float] | None,
    truth: list[Array],
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Writes the estimated isobath, its uncertainty band and, where known, the true isobath as GeoJSON.

    Each piece of the estimate is a feature with its class (found, likely, guessed), the reason why it is not found,
    and the median of its horizontal standard deviation (null where the ground has no slope).

    Args:
        origin: Latitude and longitude (deg) of north = east = 0, or None: then coordinates are local metres.
        truth: Lines of the true isobath; empty where it is not known.
        metadata: Further member of the collection.
    """
    common = {
        "depth_m": team.level_m,
        "seed": team.settings.mission.seed,
        "method": team.settings.planner.method,
    }
    features: list[tuple[Mapping[str, Any], list[Any]]] = [
        (
            {
                "name": "estimated isobath",
                "class": piece.kind,
                "reason": piece.reason,
                "length_m": round(piece.length_m, 1),
                "std_m": _finite(float(np.median(piece.std_m))),
                **common,
            },
            [piece.line],
        )
        for piece in sorted(team.pieces, key=lambda p: CLASSES.index(p.kind))
    ]
    band = f"{100.0 * team.isobath.band_probability:g} % band"
    features.append(({"name": f"shallow edge of the {band}", "class": "band", **common}, team.isobath.shallow_edge))
    features.append(({"name": f"deep edge of the {band}", "class": "band", **common}, team.isobath.deep_edge))
    if truth:
        features.append(({"name": "true isobath", "class": "true", **common}, truth))
    write_geojson(path, features, origin, metadata)


def _finite(value: float) -> float | None:
    return round(value, 1) if math.isfinite(value) else None
