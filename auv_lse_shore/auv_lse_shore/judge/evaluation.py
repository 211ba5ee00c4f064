"""Judges a mission: maps from what was measured, compared with each other and with the true ground.

Everything is rebuilt from `RunData` with the same map core that flew, so a `Fleet` run, a recording of the ROS wiring
and a recording from a boat are judged alike. Means over the map are over the cells inside the operating area whose true
depth is known (over all cells inside, where there is no truth).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_gp.map.online import OnlineGp
from auv_lse_record.run_data import DepthSource, GroundGrid, RunData, VehicleRun
from auv_lse_shore.judge import certainty, isobath
from auv_lse_shore.judge.certainty import FLAT, FOUND, GUESSED, LIKELY, NOT_VISITED, PLACES_UNCERTAIN, Piece
from auv_lse_shore.judge.reliability import Reliability
from auv_lse_shore.judge.reward import Curves, reward_curves
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.judge.team_map import TeamMap, map_of, mission_settings, team_map
from auv_lse_shore.judge.tracks import least_separation, navigation_error, path_length_m, true_positions
from auv_lse_shore.judge.verdict import Verdict, judge

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


#: Number of places over which the risk is averaged at the steps before the end (at the end: over all).
RISK_PLACES = 1500

#: Probability from which on a place counts as surely on one side of the level.
SURE = 0.95


@dataclass(slots=True, kw_only=True)
class Evaluation:
    """A judged mission: the summary, and the maps and curves that the figures show.

    Attributes:
        run: The mission, with soundings at the places of `team_map`.
        settings: Settings of each vehicle, in order.
        team_map: Map from all soundings of all vehicles, in order of time, and its isobath.
        local: Each vehicle's own final map.
        alone_risk: Mean risk of each vehicle's map from its own soundings alone (cost/place).
        curves: Reward and bounds over steps.
        truth: Lines of the true isobath (empty without truth).
        scored: Cells judged, shape of the map.
        summary: The figures of merit.
    """

    run: RunData
    settings: list[PlannerSettings]
    team_map: TeamMap
    local: list[DepthField]
    alone_risk: tuple[float, ...]
    curves: Curves
    truth: list[Array]
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
    """The true ground on the grid that missions with these settings are judged on."""
    grid = OperatingArea(settings.area).grid(settings.gp.map_resolution_m)
    return GroundGrid.sample(ground, grid.north_m, grid.east_m, grid.inside)


def evaluate(run: RunData, bounds: int = 34) -> Evaluation:
    """Judges a mission.

    Args:
        run: The mission.
        bounds: Number of steps at which the bounds of the paper's own reward are recomputed for its methods; for
            others, and at the least, at start and end.

    Raises:
        ValueError: if there is no vehicle, or the true ground is not on the map's grid.
        ParameterError: if the parameters cannot be used.
    """
    team = team_map(run)
    run = team.run
    settings = mission_settings(run.parameters, max(v.vehicle for v in run.vehicles))
    settings = [settings[v.vehicle - 1] for v in run.vehicles]
    first, area = settings[0], team.area
    scored = team.field.grid.inside.copy()
    if run.ground is not None:
        if run.ground.depth_m.shape != scored.shape:
            raise ValueError(
                f"run.ground: shape {run.ground.depth_m.shape}; expected the map's {scored.shape} (see ground_grid)"
            )
        scored &= np.isfinite(run.ground.depth_m)
    local = [local_map(v, s, area, _tick_s(run)).field() for v, s in zip(run.vehicles, settings, strict=True)]
    some = _thinned(team.field.grid, scored)
    papers = first.planner.entry.of_paper
    curves = reward_curves(run, settings, area, bounds if papers else 2, some)
    return Evaluation(
        run=run,
        settings=settings,
        team_map=team,
        local=local,
        alone_risk=tuple(_risk_alone(v, s, some) for v, s in zip(run.vehicles, settings, strict=True)),
        curves=curves,
        truth=_true_isobath(run, first, scored),
        scored=scored,
    )


def _thinned(grid: Grid, scored: Mask) -> Array:
    """Every k-th of the places judged, about `RISK_PLACES` of them, for the risk over steps."""
    rows, columns = np.nonzero(scored)
    apart = max(1, round(len(rows) / RISK_PLACES))
    return np.column_stack([grid.north_m[rows], grid.east_m[columns]])[::apart]


def local_map(vehicle: VehicleRun, settings: PlannerSettings, area: OperatingArea, tick_s: float) -> DepthMap:
    """A vehicle's own map: in each tick its own soundings by stamp, then the team's samples by arrival."""
    depth_map = DepthMap(settings.gp, settings.level_set, area)
    own, heard = vehicle.soundings, vehicle.received
    ticks_own, ticks_heard = np.ceil(own.stamp_s / tick_s - 1e-9), np.ceil(heard.stamp_s / tick_s - 1e-9)
    done = 0
    for tick in np.unique(ticks_heard):
        count = int(np.searchsorted(ticks_own, tick, side="right"))
        depth_map.add_soundings(own[done:count].rows)
        for packet in heard[ticks_heard == tick].packets():
            depth_map.add_samples(packet.points_m, int(packet.vehicle[0]))
        done = count
    depth_map.add_soundings(own[done:].rows)
    return depth_map


def _risk_alone(vehicle: VehicleRun, settings: PlannerSettings, map_m: Array) -> float:
    """Mean risk at places (P, 2) given a vehicle's own soundings and nobody else's."""
    gp = OnlineGp(settings.gp)
    gp.add_all(vehicle.soundings.points_m)  # its own map refuses the same ones
    return float(LevelSet.of(settings.level_set).risk(*gp.predict(map_m)).mean())


def _tick_s(run: RunData) -> float:
    return float(parameters_for(run.parameters, "/sim_node").get("sim", {}).get("tick_s", 1.0))


def _true_isobath(run: RunData, settings: PlannerSettings, scored: Mask) -> list[Array]:
    if run.ground is None:
        return []
    depth = np.where(scored, run.ground.depth_m, np.nan)
    return isobath.trace(run.ground.north_m, run.ground.east_m, depth, settings.level_set.level_m)


def _summary(e: Evaluation) -> Summary:
    run, first, scored, curves = e.run, e.settings[0], e.scored, e.curves
    fleet = len(run.vehicles)
    truth = run.ground
    verdict = judge(e.team, first, truth, scored, e.truth) if truth is not None else None
    ideal = _without_navigation_error(e)
    walls = np.array([d.wall_s for v in run.vehicles for d in v.decisions])
    walls = walls[np.isfinite(walls)]
    papers = first.planner.entry.of_paper
    bound = _last(curves.bound_max[:-1]) if papers else None
    p_safe = e.team.p_safe[scored]
    level_set = LevelSet.of(first.level_set)
    risk_before, risk_after, *local_risk = (_planners_risk(f, level_set)[scored] for f in (e.prior, e.team, *e.local))
    reliability = None
    if truth is not None:
        reliability = Reliability.of(p_safe, truth.depth_m[scored] >= level_set.level_m)
    claim = None if truth is None else isobath.judge_claim(certainty.lines_of(e.pieces, FOUND), e.truth)

    def mean(values: Array) -> float:
        return float(values[scored].mean())

    def area(cells: Mask) -> float:
        return float(np.count_nonzero(cells)) * e.team.grid.resolution_m**2

    def not_found(reason: str) -> float:
        return certainty.length_of(e.pieces, LIKELY, reason) + certainty.length_of(e.pieces, GUESSED, reason)

    def known(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    def of(verdict: Verdict | None, value: Callable[[Verdict], float]) -> float | None:
        return None if verdict is None else known(value(verdict))

    navigation = [navigation_error(v) for v in run.vehicles]
    tracked = all(len(n) for n in navigation)
    separation = least_separation(run.vehicles)
    return Summary(
        vehicles=fleet,
        steps=run.steps,
        method=first.planner.method,
        seed=first.mission.seed,
        isobath_found_m=certainty.length_of(e.pieces, FOUND),
        isobath_likely_m=certainty.length_of(e.pieces, LIKELY),
        isobath_guessed_m=certainty.length_of(e.pieces, GUESSED),
        isobath_not_visited_m=not_found(NOT_VISITED),
        isobath_places_uncertain_m=not_found(PLACES_UNCERTAIN),
        isobath_flat_m=not_found(FLAT),
        isobath_found=None if claim is None else known(claim.found),
        isobath_found_error_m=None if claim is None else known(claim.mean_m),
        isobath_found_error_p95_m=None if claim is None else known(claim.percentile_95_m),
        isobath_made_up=None if claim is None else known(claim.made_up),
        isobath_true_m=None if truth is None else isobath.length_m(e.truth),
        isobath_error_m=of(verdict, lambda v: v.error.mean_m),
        isobath_error_p95_m=of(verdict, lambda v: v.error.percentile_95_m),
        isobath_length_m=isobath.length_m(certainty.lines_of(e.pieces)),
        risk_before=float(risk_before.mean()),
        risk_third=_at_third(curves.risk),
        risk_after=float(risk_after.mean()),
        mowing_risk=known(curves.mowing_risk),
        map_bound_promised=first.planner.family.bound_of == "map" and _promises(run),
        map_bound_kept=bool(risk_after.mean() <= curves.mowing_risk) if run.steps else None,
        loss_expected=mean(e.team.risk),
        loss_after=of(verdict, lambda v: v.loss),
        reliability_error=None if reliability is None else known(reliability.error),
        reliability_cells=None if reliability is None else reliability.cells,
        reliability_expected=None if reliability is None else reliability.expected,
        reliability_safe=None if reliability is None else reliability.safe,
        deep_m2=area(p_safe >= SURE),
        shallow_m2=area(p_safe <= 1.0 - SURE),
        unsure_m2=area((p_safe > 1.0 - SURE) & (p_safe < SURE)),
        f1=of(verdict, lambda v: v.f1),
        misclassified_m2=of(verdict, lambda v: v.false_safe_m2 + v.false_unsafe_m2),
        false_safe_m2=of(verdict, lambda v: v.false_safe_m2),
        false_unsafe_m2=of(verdict, lambda v: v.false_unsafe_m2),
        depth_rmse_m=of(verdict, lambda v: v.depth_rmse_m),
        area_m2=area(np.ones(len(p_safe), dtype=bool)),
        local_risk=tuple(float(own.mean()) for own in local_risk),
        alone_risk=e.alone_risk,
        local_risk_error=tuple(float(np.abs(own - risk_after).mean()) for own in local_risk),
        local_f1=None if truth is None else tuple(judge(own, first, truth, scored, e.truth).f1 for own in e.local),
        navigation_error_m=tuple(float(np.sqrt(np.mean(n**2))) for n in navigation) if tracked else None,
        navigation_error_end_m=tuple(float(n[-1]) for n in navigation) if tracked else None,
        place_error_m=_place_error(run),
        error_over_std=None if truth is None else known(_error_over_std(e)),
        f1_true_positions=of(ideal, lambda v: v.f1),
        misclassified_true_positions_m2=of(ideal, lambda v: v.false_safe_m2 + v.false_unsafe_m2),
        isobath_error_true_positions_m=of(ideal, lambda v: v.error.mean_m),
        distance_m=tuple(path_length_m(v) for v in run.vehicles),
        min_separation_m=separation,
        soundings=sum(len(v.soundings) for v in run.vehicles),
        samples_received=sum(len(v.received) for v in run.vehicles),
        packets_sent=len(run.sent),
        packets_received=len(run.received),
        delivery=len(run.received) / (len(run.sent) * (fleet - 1)) if fleet > 1 and run.sent else None,
        team_reward=float(curves.stepwise[-1]),
        lower_bound=bound,
        bound_kept=None if bound is None else bool(curves.stepwise[-1] >= bound),
        path_reward=float(curves.whole[-1]),
        path_bound_start=known(curves.whole_bound[0]) if papers else None,
        path_bound_max=_last(curves.whole_bound_max[:-1]) if papers else None,
        lawnmower_value=curves.naive_value,
        path_bound_kept=bool(curves.whole[-1] >= curves.naive_value) if run.steps and papers else None,
        planning_median_s=float(np.median(walls)) if len(walls) else None,
        planning_max_s=float(walls.max()) if len(walls) else None,
        sim_s=run.sim_s,
        wall_s=known(run.wall_s),
    )


def _planners_risk(field: DepthField, level_set: LevelSet) -> Array:
    """Bayes risk over the map by the prior's scale: what planners account for, and what the bound speaks of."""
    return level_set.risk(field.mean_m, field.prior_std_m)


def _promises(run: RunData) -> bool:
    """Whether every vehicle's first decision promised a part of its reward that later ones may not give up."""
    first = [v.decisions[0] for v in run.vehicles if v.decisions]
    return bool(first) and all(d.lower_bound > d.reward_so_far for d in first)


def _at_third(risk: Array) -> float | None:
    """Value of a curve over steps after a third of them; None if there is no such step."""
    third = round((len(risk) - 1) / 3.0)
    return float(risk[third]) if third > 0 and math.isfinite(risk[third]) else None


def _last(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if len(finite) else None


def _place_error(run: RunData) -> tuple[float, ...] | None:
    if any(len(v.truth) == 0 or len(v.soundings) == 0 for v in run.vehicles):
        return None
    apart = [v.soundings.places_m - true_positions(v).places_m for v in run.vehicles]
    return tuple(float(np.sqrt((a**2).sum(axis=1).mean())) for a in apart)


def _error_over_std(e: Evaluation) -> float:
    assert e.run.ground is not None
    error = (e.team.mean_m - e.run.ground.depth_m)[e.scored]
    return float(((error / e.team.std_m[e.scored]) ** 2).mean())


def _without_navigation_error(e: Evaluation) -> Verdict | None:
    """The verdict on the map from the soundings at their true positions; None without truth."""
    if e.run.ground is None or any(len(v.truth) == 0 for v in e.run.vehicles):
        return None
    soundings = Soundings.join(true_positions(v) for v in e.run.vehicles)
    return judge(map_of(e.settings[0], e.area, soundings).field(), e.settings[0], e.run.ground, e.scored, e.truth)
