"""One mission: a planner over a ground, in the light loop or the whole simulation, and its judgement."""

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.level_set.lines import resample
from auv_lse_planner.methods import families
from auv_lse_planner.methods.line_routes import SPACING_M, route_along
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.judge.isobath import trace
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from benchmarks.planning.planner_loop import light_mission
from benchmarks.planning.planners.interface import Planner, Steered, loaded, made
from benchmarks.planning.planners.judge import CELL_M, SHARES, Judgement, judge, judgement_of
from benchmarks.planning.planners.options import HINDSIGHT, OURS
from benchmarks.planning.planners.rivals import RIVALS
from benchmarks.planning.planners.sgptools_rivals import PEERS, maker

#: Number of times at which a mission of the whole simulation is judged.
THIRDS = 3
#: Share of packets lost in the light loop.
LOSS = 0.07
#: The method in whose place a planner of others flies, and its family.
REPLACED, REPLACED_FAMILY = "myopic", "benefit"


def mission(
    planner: str,
    parameters: Mapping[str, Any],
    vehicles: int,
    seed: int,
    steps: int,
    python: Path | None = None,
    whole: bool = False,
) -> dict[str, Any]:
    """Flies one mission; its figures.

    Args:
        planner: Name of a method or rival, of an entry point, or a Python file.
        parameters: Of the mission file, for the ground.
        seed: Of all random draws of the mission; that of made-up ground is one of its parameters.
        steps: Legs of each vehicle.
        python: That of the environment of sgptools; None: its planners cannot be flown.
        whole: Whether to fly in the whole simulation: drift, corrected positions, surfacings and the acoustic channel.

    Raises:
        ValueError: if the level does not occur in the area: any share of no isobath counts as all of it.
    """
    overrides = {**parameters, "mission.vehicles": vehicles, "mission.steps": steps, "mission.seed": seed}
    if whole:  # else the maps of the paper's methods would ignore the uncertainty of positions
        overrides |= {"positions.correct": True, "packet.navigation": True}
    else:
        overrides["vehicle.surfacings"] = 0
    ours = planner if planner in OURS else None
    overrides |= OURS[ours] if ours else {"planner.method": REPLACED}
    settings, ground = _fitted(overrides)
    own = PlannerSettings.from_parameters(parameters_for(settings.to_patterns(), "/auv1/settings"), "bench")
    if not _true_lines(own, ground):
        level_m = own.level_set.level_m
        raise ValueError(
            f"The ground has no isobath at {level_m:g} m in its area. Change level_set.level_m or the area."
        )
    if planner == HINDSIGHT:
        return _hindsight(own, ground)
    with nullcontext() if ours else _in_place(_maker(planner, python)):
        if whole:
            found, spent = whole_mission(settings, ground)
        else:
            began = _cpu_s()
            soundings = light_mission(own, ground, seed, LOSS)
            spent = _cpu_s() - began
            found = judge(own, ground, soundings)
    return {
        **dataclasses.asdict(found),
        **{_key(share): found.distance(share) for share in SHARES},
        "cpu_s": spent,
    }


def whole_mission(settings: Settings, ground: Any) -> tuple[Judgement, float]:
    """Flies a mission in the whole simulation; its judgement, and its processor time (s) without judging.

    The map is the report's: soundings of all vehicles at corrected positions, with their remaining uncertainty.
    """
    legs = settings.mission.vehicles * settings.mission.steps
    shares: list[float] = []  # found after each third but the last
    judging_s = 0.0

    def judge_after_thirds(fleet: Fleet) -> None:
        nonlocal judging_s
        travelled = sum(len(cores.log.decisions) for cores in fleet.cores)
        if len(shares) < THIRDS - 1 and travelled >= legs * (len(shares) + 1) / THIRDS:
            began = _cpu_s()
            shares.append(judgement_of(fleet.run_data()).found[-1])
            judging_s += _cpu_s() - began

    began = _cpu_s()
    run = Fleet(settings, ground).run(judge_after_thirds)
    spent = _cpu_s() - began - judging_s
    end = judgement_of(run)
    shares += [end.found[-1]] * (THIRDS - len(shares))  # more than once if the mission ended early
    return dataclasses.replace(end, found=tuple(shares)), spent


def _cpu_s() -> float:
    """Processor time (s) of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def _key(share: float) -> str:
    return f"to_{100.0 * share:.0f}"


def _fitted(overrides: dict[str, Any]) -> tuple[Settings, Any]:
    """Settings fitted to the ground as a mission's are, and the ground."""
    settings = Settings.load(None, overrides)
    ground = ground_of(settings)
    return fit_to_ground(settings, ground)[0], ground


def _maker(planner: str, python: Path | None) -> Callable[[], Planner]:
    if planner in PEERS:
        return maker(planner, python)
    return RIVALS[planner] if planner in RIVALS else loaded(planner)


@contextmanager
def _in_place(make: Callable[[], Planner]) -> Iterator[None]:
    """Lets a planner fly instead of `REPLACED`."""
    kept = families.CLASSES[REPLACED_FAMILY]
    families.CLASSES[REPLACED_FAMILY] = lambda context: Steered(made(make), context)
    try:
        yield
    finally:
        families.CLASSES[REPLACED_FAMILY] = kept


def _true_lines(settings: PlannerSettings, ground: Any) -> list[Any]:
    """The true isobath in the area."""
    grid = OperatingArea(settings.area).grid(CELL_M)
    at = grid.locations_m
    return trace(grid.north_m, grid.east_m, grid.fill(ground.depth_m(at[:, 0], at[:, 1])), settings.level_set.level_m)


def _hindsight(settings: PlannerSettings, ground: Any) -> dict[str, Any]:
    """Parts of the mission that a team would need that knew the true line: its vehicles share the route equally."""
    stretches = [resample([line], SPACING_M) for line in _true_lines(settings, ground)]
    start = np.array([settings.vehicle.start_north_m, settings.vehicle.start_east_m])
    leg_m = MotionTable(settings.motion).leg_length_m
    total_m = settings.mission.vehicles * settings.mission.steps * leg_m
    route = route_along(start, stretches, 10.0 * total_m)
    true_m = SPACING_M * sum(len(stretch) for stretch in stretches)
    parts = np.linspace(0.0, 1.0, 401)[1:]
    found = np.array([route.followed_m(part * total_m) / max(true_m, 1.0) for part in parts])
    to = {_key(share): float(parts[np.argmax(found >= share)]) if found[-1] >= share else 1.0 for share in SHARES}
    return {**to, "found": [float(x) for x in found[np.arange(1, 13) * 400 // 12 - 1]], "true_m": true_m}
