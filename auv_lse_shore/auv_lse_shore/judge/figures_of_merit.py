"""The parts of a mission's summary, each computed from its inputs; `summary.Summary` describes the keys."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.certainty import (
    FLAT,
    FOUND,
    GUESSED,
    LIKELY,
    NOT_VISITED,
    POSITIONS_UNCERTAIN,
    Piece,
    found_within_m,
    length_of,
    lines_of,
)
from auv_lse_gp.map.depth_map import DepthField
from auv_lse_record.run_data import GroundGrid, RunData
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.reliability import Reliability
from auv_lse_shore.judge.reward import Curves
from auv_lse_shore.judge.tracks import least_separation, navigation_error, path_length_m, time_outside, true_positions
from auv_lse_shore.judge.verdict import judge

#: A location with at least this probability counts as surely on one side of the level.
SURE = 0.95


def isobath_found(pieces: Sequence[Piece], truth: Sequence[Array] | None, around: Sequence[Array]) -> dict[str, Any]:
    """Lengths of the estimated isobath by class and reason; with the true isobath (None: unknown), its error.

    Args:
        truth: The true isobath in the evaluated cells.
        around: That of all known ground.
    """

    def uncertain(reason: str) -> float:
        return length_of(pieces, LIKELY, reason) + length_of(pieces, GUESSED, reason)

    error = None if truth is None else isobath.compare(lines_of(pieces, FOUND), truth, around)
    return {
        "isobath_found_m": length_of(pieces, FOUND),
        "isobath_likely_m": length_of(pieces, LIKELY),
        "isobath_guessed_m": length_of(pieces, GUESSED),
        "isobath_not_visited_m": uncertain(NOT_VISITED),
        "isobath_positions_uncertain_m": uncertain(POSITIONS_UNCERTAIN),
        "isobath_flat_m": uncertain(FLAT),
        "isobath_found_within_m": found_within_m(pieces),
        "isobath_found": error and error.found,
        "isobath_found_error_m": error and error.estimate_mean_m,
        "isobath_found_error_p95_m": error and error.estimate_percentile_95_m,
        "isobath_made_up": error and error.made_up,
        "isobath_true_m": None if truth is None else isobath.length_m(truth),
        "isobath_length_m": isobath.length_m(lines_of(pieces)),
    }


def map_risk(
    prior: DepthField, team: DepthField, local: Sequence[DepthField], settings: PlannerSettings, scored: Mask
) -> dict[str, Any]:
    """Risk and expected loss of the maps over the evaluated cells, and the areas on each side of the level.

    Risk is computed with the prior's scale, which planners use and the bound refers to; loss with the scale of the
    published maps.
    """
    level_set = LevelSet.of(settings.level_set)
    before, after, *own = (level_set.risk(f.mean_m, f.prior_std_m)[scored] for f in (prior, team, *local))
    p_safe = team.p_safe[scored]

    def area(cells: Mask) -> float:
        return float(np.count_nonzero(cells)) * team.grid.resolution_m**2

    return {
        "risk_before": float(before.mean()),
        "risk_after": float(after.mean()),
        "loss_expected": float(team.risk[scored].mean()),
        "deep_m2": area(p_safe >= SURE),
        "shallow_m2": area(p_safe <= 1.0 - SURE),
        "unsure_m2": area((p_safe > 1.0 - SURE) & (p_safe < SURE)),
        "area_m2": area(np.ones(len(p_safe), dtype=bool)),
        "local_risk": tuple(float(risk.mean()) for risk in own),
        "local_risk_error": tuple(float(np.abs(risk - after).mean()) for risk in own),
    }


def against_truth(
    maps: Sequence[DepthField],
    ideal: DepthField | None,
    settings: PlannerSettings,
    ground: GroundGrid,
    scored: Mask,
    true_isobath: list[Array],
) -> dict[str, Any]:
    """Errors of the maps over the evaluated cells.

    Args:
        maps: The map from all soundings, then each vehicle's own.
        ideal: The map from all soundings at their true positions; None if these are unknown.
        scored: The cells evaluated, shape of the maps.
        true_isobath: Lines of the true isobath.
    """
    team, depth = maps[0], ground.depth_m[scored]
    found, *local = (judge(own, settings, ground, scored, true_isobath) for own in maps)
    best = None if ideal is None else judge(ideal, settings, ground, scored, true_isobath)
    reliability = Reliability.of(team.p_safe[scored], depth >= settings.level_set.level_m)
    return {
        "isobath_error_m": found.error.mean_m,
        "isobath_error_p95_m": found.error.percentile_95_m,
        "loss_after": found.loss,
        "reliability_error": reliability.error,
        "reliability_cells": reliability.cells,
        "reliability_expected": reliability.expected,
        "reliability_safe": reliability.safe,
        "f1": found.f1,
        "misclassified_m2": found.misclassified_m2,
        "false_safe_m2": found.false_safe_m2,
        "false_unsafe_m2": found.false_unsafe_m2,
        "depth_rmse_m": found.depth_rmse_m,
        "local_f1": tuple(own.f1 for own in local),
        "error_over_std": float((((team.mean_m - ground.depth_m)[scored] / team.std_m[scored]) ** 2).mean()),
        "f1_true_positions": best and best.f1,
        "misclassified_true_positions_m2": best and best.misclassified_m2,
        "isobath_error_true_positions_m": best and best.error.mean_m,
    }


def positions(run: RunData, settings: PlannerSettings) -> dict[str, Any]:
    """Position errors where the truth is known, distances, separation, and excursions from the area."""
    excursions = [time_outside(v, settings.area) for v in run.vehicles]
    navigation = [navigation_error(v) for v in run.vehicles]
    tracked = all(len(n) for n in navigation)
    placed = all(len(v.truth) and len(v.soundings) for v in run.vehicles)
    apart = [v.soundings.locations_m - true_positions(v).locations_m for v in run.vehicles] if placed else []
    return {
        "navigation_error_m": tuple(float(np.sqrt(np.mean(n**2))) for n in navigation) if tracked else None,
        "navigation_error_end_m": tuple(float(n[-1]) for n in navigation) if tracked else None,
        "position_error_m": tuple(float(np.sqrt((a**2).sum(axis=1).mean())) for a in apart) if placed else None,
        "distance_m": tuple(path_length_m(v) for v in run.vehicles),
        "min_separation_m": least_separation(run.vehicles),
        "outside_s": tuple(seconds for seconds, _ in excursions),
        "outside_max_m": tuple(farthest for _, farthest in excursions),
    }


def work(run: RunData) -> dict[str, Any]:
    """Counts of soundings, samples and packets, and the time that decisions took."""
    lost = _receptions_lost(run)
    walls = np.array([d.wall_s for v in run.vehicles for d in v.decisions])
    walls = walls[np.isfinite(walls)]
    return {
        "soundings": sum(len(v.soundings) for v in run.vehicles),
        "samples_received": sum(len(v.received) for v in run.vehicles),
        "packets_sent": len(run.sent),
        "packets_received": len(run.received),
        "packets_lost": lost,
        "delivery": len(run.received) / (len(run.received) + lost) if run.received or lost else None,
        "planning_median_s": float(np.median(walls)) if len(walls) else None,
        "planning_max_s": float(walls.max()) if len(walls) else None,
        "sim_s": run.mission_s,
        "wall_s": run.wall_s,
    }


def _receptions_lost(run: RunData) -> int:
    """Receptions that failed; packets that were still under way when the recording ended do not count."""
    tdma = section(TdmaConfig, parameters_for(run.parameters, "/auv1/modem_node"), "tdma", "mission file")
    ended_s = run.end_s - tdma.send_duration_s - tdma.travel_s
    late = [packet.payload for packet in run.sent if packet.stamp_s > ended_s]
    arrived = sum(packet.payload not in late for packet in run.received)
    return max((len(run.sent) - len(late)) * (len(run.vehicles) - 1) - arrived, 0)


def paper_reward(curves: Curves, of_paper: bool) -> dict[str, Any]:
    """The paper's reward, and its bounds for the paper's methods."""
    team_reward, path_reward, steps = float(curves.stepwise[-1]), float(curves.whole[-1]), len(curves.stepwise) - 1
    bounds: dict[str, Any] = {}
    if of_paper:
        lower_bound = _last(curves.bound_max[:-1])
        bounds = {
            "lower_bound": lower_bound,
            "bound_kept": None if lower_bound is None else team_reward >= lower_bound,
            "path_bound_start": float(curves.whole_bound[0]),
            "path_bound_max": _last(curves.whole_bound_max[:-1]),
            "path_bound_kept": path_reward >= curves.naive_value if steps else None,
        }
    return {
        "team_reward": team_reward,
        "path_reward": path_reward,
        "lawnmower_value": curves.naive_value,
        **bounds,
    }


def _last(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if len(finite) else None
