"""One judge for all planners: the share of the true isobath on the map of all soundings, in the course of a mission."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map.certainty import FOUND, Piece, classify, lines_of
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_record.run_data import GroundGrid, RunData
from auv_lse_shore.judge.isobath import compare, length_m, trace
from auv_lse_shore.judge.team_map import team_map

#: Cell (m) of the judged map, larger where an area would have more than `MAX_CELLS`.
CELL_M, MAX_CELLS = 5.0, 16_000
#: Number of times at which a mission is judged, the last one its end.
TIMES = 12
#: A piece that is called found and lies farther than this (m) from every true isobath is a false claim.
FALSE_M = 20.0
#: Shares of the isobath to which the distance is measured.
SHARES = (0.5, 0.8, 0.95)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """The results of a mission.

    Attributes:
        found: Share of the true isobath found after equal parts of the mission: twelfths in the light loop,
            thirds in the whole simulation.
        risk: Risk of the map at the end, by the prior's scale, cost per location.
        true_loss: Cost of the map's wrong calls at the end, per location.
        false_share: Share of the line called found that is more than 20 m from every true isobath.
        error_m: Mean distance of the line called found from the true isobath.
        true_m: Length of the true isobath.
        missed_m: Length of the longest connected piece of the true isobath that was not found.
    """

    found: tuple[float, ...]
    risk: float
    true_loss: float
    false_share: float
    error_m: float
    true_m: float
    missed_m: float

    def distance(self, share: float) -> float:
        """Part of the mission after which a share of the isobath is found, interpolated; 1 if it never is."""
        curve = np.concatenate([[0.0], self.found])
        reached = np.flatnonzero(curve >= share)
        if not len(reached):
            return 1.0
        after = int(reached[0])
        low, high = curve[after - 1], curve[after]
        return float((after - 1 + (share - low) / max(high - low, 1e-9)) / (len(curve) - 1)) if after else 0.0


def judge(settings: PlannerSettings, ground: Any, rows: Sequence[tuple[float, float, float, float]]) -> Judgement:
    """Judges a mission over true ground by its soundings: time (s), north, east, depth (m), in order of time."""
    area, level = OperatingArea(settings.area), LevelSet.of(settings.level_set)
    south, north, west, east = area.extent_m
    cell_m = max(CELL_M, float(np.sqrt((north - south) * (east - west) / MAX_CELLS)))
    depth_map = DepthMap(dataclasses.replace(settings.gp, map_resolution_m=cell_m), settings.level_set, area)
    grid = depth_map.grid
    truth = GroundGrid.sample(ground, grid.north_m, grid.east_m, grid.inside)
    lines = _traced(truth, level)
    leg_s = MotionTable(settings.motion).leg_length_m / settings.vehicle.speed_mps
    end_s = settings.mission.steps * leg_s
    table = np.array(rows)
    sounded = np.column_stack([table[:, 1:3], np.zeros(len(table))])
    found: list[float] = []
    first, pieces = 0, []
    for number in range(1, TIMES + 1):
        last = len(table) if number == TIMES else int(np.searchsorted(table[:, 0], end_s * number / TIMES))
        depth_map.add_soundings(table[first:last])
        first = last
        field = depth_map.field()
        shore_known = depth_map.gp.banks is not None
        estimate = depth_map.isobath(field).lines
        pieces = classify(estimate, field, settings.gp.signal_std_m, sounded[:last], shore_known=shore_known)
        error = compare(lines_of(pieces, FOUND), lines)
        found.append(error.found if np.isfinite(error.found) else 1.0)
    return _judgement(found, field, pieces, truth, level)


def judgement_of(run: RunData) -> Judgement:
    """Judges a mission of the whole simulation, or its part so far, by its report's map."""
    team = team_map(run)
    ground = run.ground
    assert ground is not None, "a simulated mission has a ground"
    level = LevelSet.of(team.settings.level_set)
    error = compare(lines_of(team.pieces, FOUND), _traced(ground, level))
    share = error.found if np.isfinite(error.found) else 1.0
    return _judgement([share], team.field, team.pieces, ground, level)


def _traced(truth: GroundGrid, level: LevelSet) -> list[Array]:
    """The true isobath within the area."""
    depth_m = np.where(truth.scored, truth.depth_m, np.nan)
    return trace(truth.north_m, truth.east_m, depth_m, level.level_m)


def _judgement(
    shares: Sequence[float], field: DepthField, pieces: Sequence[Piece], truth: GroundGrid, level: LevelSet
) -> Judgement:
    """Of a map at the mission's end, and of its isobath in pieces."""
    known = truth.scored
    called, safe = level.safe(field.mean_m[known], field.std_m[known]), truth.depth_m[known] >= level.level_m
    costs = np.where(called, level.cost_false_safe, level.cost_false_unsafe) * (called != safe)
    found = lines_of(pieces, FOUND)
    # also outside the area, as between a steep shore and the first cell of water
    everywhere = trace(truth.north_m, truth.east_m, truth.depth_m, level.level_m)
    isobath = _traced(truth, level)
    return Judgement(
        found=tuple(shares),
        risk=float(level.risk(field.mean_m[known], field.prior_std_m[known]).mean()),
        true_loss=float(costs.mean()),
        false_share=_false_share(found, everywhere),
        error_m=compare(found, everywhere).estimate_mean_m,
        true_m=length_m(isobath),
        missed_m=longest_missed_m(isobath, found),
    )


def longest_missed_m(truth: Sequence[Array], found: Sequence[Array]) -> float:
    """Length (m) of the longest connected piece of true lines that lies near no line found; 0 without any."""
    is_near, longest = near(found), 0.0
    for line in truth:
        missed = ~is_near(resample([line]))
        if (line[0] == line[-1]).all():  # closed: begins behind its last location found
            missed = np.roll(missed, -1 - int(np.argmin(missed)))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], missed, [0]])))
        longest = max(longest, np.diff(edges)[::2].max(initial=0) * length_m([line]) / len(missed))
    return longest


def _false_share(found: Sequence[Array], truth: Sequence[Array]) -> float:
    """Share of lines that lies more than `FALSE_M` from every true one; 0 without lines."""
    points = resample(found)
    if not len(points):
        return 0.0
    return float(1.0 - near(truth, FALSE_M)(points).mean())
