"""Evaluates a mission: rebuilds the maps from what was measured and compares them with the true ground.

The maps come from `RunData` and the vehicles' own map code, so a simulated run and a recording from a boat are
evaluated alike. Means over the map are over the cells inside the operating area whose true depth is known (over all
cells inside, where there is no truth).
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.certainty import Piece
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_planner.vehicle.until import plans_to_horizon
from auv_lse_record.run_data import DepthSource, GroundGrid, RunData, VehicleRun
from auv_lse_run.process.background import run_in_background
from auv_lse_shore.judge import figures_of_merit as merit
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.lawnmower import blank_map
from auv_lse_shore.judge.reward import Curves, reward_curves
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.judge.team_map import TeamMap, map_of, mission_settings, placed
from auv_lse_shore.judge.tracks import true_positions

#: Number of locations over which map risk is averaged at the steps before the end (at the end: over all).
RISK_LOCATIONS = 1500


@dataclass(slots=True, kw_only=True)
class Evaluation:
    """An evaluated mission: the summary, and the maps and curves that the figures show.

    Attributes:
        run: The mission, with soundings at the positions of `team_map`.
        settings: Settings of each vehicle, in order.
        team_map: Map from all soundings of all vehicles, in order of time, and its isobath.
        local: Each vehicle's own final map.
        ideal: The map from all soundings at their true positions; None if these are unknown.
        alone_risk: Map risk of each vehicle from its own soundings alone (cost/location).
        curves: Reward and bounds over steps.
        truth: Lines of the true isobath in the evaluated cells (empty without truth).
        truth_around: Those of all known ground, also outside the area: a found line may lie there.
        scored: Cells evaluated, shape of the map.
    """

    run: RunData
    settings: list[PlannerSettings]
    team_map: TeamMap
    local: list[DepthField]
    ideal: DepthField | None
    alone_risk: tuple[float, ...]
    curves: Curves
    truth: list[Array]
    truth_around: list[Array]
    scored: Mask
    summary: Summary = field(init=False)

    def __post_init__(self) -> None:
        """Computes the summary."""
        self.summary = _summary(self)

    @property
    def area(self) -> OperatingArea:
        """The operating area."""
        return self.team_map.area

    @property
    def planned_steps(self) -> int:
        """Number of steps of a complete mission."""
        return self.settings[0].mission.steps

    @property
    def prior(self) -> DepthField:
        """Map before the mission."""
        return self.team_map.prior

    @property
    def team(self) -> DepthField:
        """Map from all soundings."""
        return self.team_map.field

    @property
    def pieces(self) -> list[Piece]:
        """The estimated isobath, in pieces of one certainty."""
        return self.team_map.pieces


def ground_grid(settings: PlannerSettings, ground: DepthSource) -> GroundGrid:
    """The true ground on the grid on which missions with these settings are evaluated."""
    grid = OperatingArea(settings.area).grid(settings.gp.map_resolution_m, "gp.map_resolution_m")
    return GroundGrid.sample(ground, grid.north_m, grid.east_m, grid.inside)


def evaluate(run: RunData, bounds: int = 34, team: TeamMap | None = None, *, on_two_cores: bool = False) -> Evaluation:
    """Evaluates a mission.

    Args:
        bounds: Number of steps at which the bounds of the paper's reward are recomputed for its methods, at least 2;
            for other methods these are the first and the last.
        team: The map, if it is made already; its run is then evaluated.
        on_two_cores: Whether half of the work is done in a second process, for a user who waits.

    Raises:
        ValueError: if there is no vehicle, or the true ground is not on the map's grid.
        ParameterError: if the parameters cannot be used.
    """
    run, make_map = placed(run) if team is None else (team.run, lambda: team)
    settings = mission_settings(run.parameters, max(v.vehicle for v in run.vehicles))
    settings = [settings[v.vehicle - 1] for v in run.vehicles]
    first, area = settings[0], OperatingArea(settings[0].area)
    grid = area.grid(first.gp.map_resolution_m, "gp.map_resolution_m")
    scored = grid.inside.copy()
    if run.ground is not None:
        if run.ground.depth_m.shape != scored.shape:
            raise ValueError(
                f"run.ground has the shape {run.ground.depth_m.shape}, but the map has {scored.shape}. Sample it "
                "with ground_grid()"
            )
        scored &= np.isfinite(run.ground.depth_m)
    some = _thinned(grid, scored)
    fewer = len(settings) // 2  # local maps left to the other core, which has the reward besides
    replayed = partial(_replayed, run, settings, area, some, bounds if first.planner.entry.of_paper else 2, fewer)
    beside = run_in_background(replayed) if on_two_cores else replayed
    try:
        final = make_map()
        local = _local_fields(run, settings, area, slice(fewer, None))
    except BaseException:
        if on_two_cores:
            with contextlib.suppress(Exception):  # the first error is the one to report
                beside()
        raise
    curves, ideal, alone_risk, others = beside()
    return Evaluation(
        run=run,
        settings=settings,
        team_map=final,
        local=[*others, *local],
        ideal=ideal,
        alone_risk=alone_risk,
        curves=curves,
        truth=_true_isobath(run, first, scored),
        truth_around=_true_isobath(run, first, np.ones_like(scored)),
        scored=scored,
    )


def _thinned(grid: Grid, scored: Mask) -> Array:
    """About `RISK_LOCATIONS` of the evaluated cells, evenly spaced, over which the risk at each step is averaged."""
    rows, columns = np.nonzero(scored)
    apart = max(1, round(len(rows) / RISK_LOCATIONS))
    return np.column_stack([grid.north_m[rows], grid.east_m[columns]])[::apart]


def _replayed(
    run: RunData, settings: Sequence[PlannerSettings], area: OperatingArea, some: Array, bounds: int, first: int
) -> tuple[Curves, DepthField | None, tuple[float, ...], list[DepthField]]:
    """Half of the work.

    Curves, map at true positions, each vehicle's risk at `some` (P, 2) from its own soundings, and the map of each of
    the `first` vehicles.
    """
    curves = reward_curves(run, settings, area, bounds, some)
    alone = tuple(_risk_alone(v, s, some) for v, s in zip(run.vehicles, settings, strict=True))
    return curves, _ideal(run, settings[0], area), alone, _local_fields(run, settings, area, slice(first))


def _local_fields(
    run: RunData, settings: Sequence[PlannerSettings], area: OperatingArea, some: slice
) -> list[DepthField]:
    """Each vehicle's own final map, of some vehicles."""
    own = zip(run.vehicles[some], settings[some], strict=True)
    return [local_map(vehicle, of_vehicle, area, _tick_s(run)).field() for vehicle, of_vehicle in own]


def local_map(vehicle: VehicleRun, settings: PlannerSettings, area: OperatingArea, tick_s: float) -> DepthMap:
    """A vehicle's own map: in each tick its own soundings by stamp, then the team's samples by arrival.

    Once the map is tiled, it takes all that is left together, as the vehicle does when it rebuilds its map after a
    position correction (`CorrectedMap.rebuild`): its own soundings, then the samples of each mate.
    """
    depth_map = DepthMap(settings.gp, settings.level_set, area)
    own, heard = vehicle.soundings, vehicle.received.in_order()
    ticks_own, ticks_heard = np.ceil(own.stamp_s / tick_s - 1e-9), np.ceil(heard.stamp_s / tick_s - 1e-9)
    done = begin = 0
    while begin < len(heard) and not depth_map.gp.is_tiled:
        end = int(np.searchsorted(ticks_heard, ticks_heard[begin], side="right"))
        count = int(np.searchsorted(ticks_own, ticks_heard[begin], side="right"))
        depth_map.add_soundings(own[done:count].rows)
        for packet in heard[begin:end].packets():
            depth_map.add_samples(packet.points_m, int(packet.vehicle[0]))
        done, begin = count, end
    depth_map.add_soundings(own[done:].rows)
    left = heard[begin:]
    for mate in np.unique(left.vehicle).tolist():
        theirs = left[left.vehicle == mate]
        depth_map.add_samples(theirs.points_m, mate, np.unique(theirs.stamp_s, return_inverse=True)[1])
    return depth_map


def _risk_alone(vehicle: VehicleRun, settings: PlannerSettings, map_m: Array) -> float:
    """Mean risk at locations (P, 2) given a vehicle's own soundings alone."""
    gp = blank_map(settings)
    gp.add_all(vehicle.soundings.points_m)  # its own map discards the same ones
    return float(LevelSet.of(settings.level_set).risk(*gp.predict(map_m)).mean())


def _tick_s(run: RunData) -> float:
    return float(parameters_for(run.parameters, "/sim_node").get("sim", {}).get("tick_s", 1.0))


def _true_isobath(run: RunData, settings: PlannerSettings, scored: Mask) -> list[Array]:
    if run.ground is None:
        return []
    depth = np.where(scored, run.ground.depth_m, np.nan)
    return isobath.trace(run.ground.north_m, run.ground.east_m, depth, settings.level_set.level_m)


def _summary(e: Evaluation) -> Summary:
    run, first, ground, curves = e.run, e.settings[0], e.run.ground, e.curves
    found: dict[str, Any] = {
        **merit.isobath_found(e.pieces, None if ground is None else e.truth, e.truth_around),
        "isobath_undiscovered_m": e.team_map.undiscovered.expected_m,
        "isobath_undiscovered_limit_m": e.team_map.undiscovered.limit_m,
        **merit.map_risk(e.prior, e.team, e.local, first, e.scored),
        **merit.positions(run, first),
        **merit.work(run),
        **merit.paper_reward(curves, first.planner.entry.of_paper),
        "risk_third": _at_third(curves.risk),
        "mowing_risk": curves.mowing_risk,
        "flown_risk": curves.flown_risk,
        "alone_risk": e.alone_risk,
        "void_plans": tuple(sum(d.void for d in v.decisions) for v in run.vehicles)
        if first.planner.family.bound_of == "map"
        else None,
        "map_bound_promised": first.planner.family.bound_of == "map" and _has_bound(run, first),
    }
    if absent := absent_vehicles(run):  # planners shared the work; who failed to receive is unknown
        found |= {"mowing_risk": None, "delivery": None}
    if run.steps < e.planned_steps or absent:  # the bounds are those of a complete mission
        found |= {"bound_kept": None, "path_bound_kept": None, "map_bound_kept": None, "map_bound_promised": False}
    else:
        found["map_bound_kept"] = found["risk_after"] <= curves.mowing_risk
    if ground is not None:
        found |= merit.against_truth([e.team, *e.local], e.ideal, first, ground, e.scored, e.truth)
    found |= {"vehicles": len(run.vehicles), "steps": run.steps, "seed": first.mission.seed}
    found["unreachable_m2"] = e.area.unreachable_m2
    found |= {"method": first.planner.method, "goal": first.mission.goal}
    found["quality_asked"] = first.mission.until.text or None
    found["quality_reached"] = run.steps < e.planned_steps and all(
        bool(v.decisions) and v.decisions[-1].plan.quality_reached for v in run.vehicles
    )
    return Summary.of_known(found)


def absent_vehicles(run: RunData) -> list[int]:
    """Numbers of the vehicles that flew the mission, but whose data `run` lacks; none for a survey."""
    if not run.steps:
        return []
    team = mission_settings(run.parameters, 1)[0].mission.vehicles
    return sorted({*range(1, team + 1)} - {v.vehicle for v in run.vehicles})


def _ideal(run: RunData, settings: PlannerSettings, area: OperatingArea) -> DepthField | None:
    """The map from all soundings at their true positions; None where these are unknown."""
    if run.ground is None or any(len(v.truth) == 0 for v in run.vehicles):
        return None
    return map_of(settings, area, Soundings.join(true_positions(v) for v in run.vehicles)).field()


def _has_bound(run: RunData, settings: PlannerSettings) -> bool:
    """Whether every first decision has a lower bound above its reward so far; later decisions keep this bound.

    A mission that is planned for a share found has no bound.
    """
    if plans_to_horizon(settings):
        return False
    first = [v.decisions[0] for v in run.vehicles if v.decisions]
    return bool(first) and all(d.lower_bound > d.reward_so_far for d in first)


def _at_third(risk: Array) -> float | None:
    """Value of a curve over steps after a third of them; None if there is no such step."""
    third = round((len(risk) - 1) / 3.0)
    return float(risk[third]) if third > 0 else None
