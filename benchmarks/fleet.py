"""Processor time of a whole mission in the fleet engine, by part, and what the method `tour` adds to mowing."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.judge.evaluation import evaluate
from auv_lse_sim.settings import Settings
from auv_lse_sim.world.ground_source import ground_of
from benchmarks.rows import Row, row

#: Processor time (s) of a mission of three, on an idle core.
GOAL_S = 15.0
SEED = 9003
SMOKE = {"mission.steps": 4, "mission.vehicles": 2}
FULL = {"mission.vehicles": 3}
#: Parts of a mission, in the order of the rows. Judging comes after it.
PARTS = ("planner", "places", "map", "packets", "world", "rest", "judging")


def _timed(function: Callable[..., Any], part: str, spent_s: dict[str, float]) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        began = time.process_time()
        try:
            return function(*arguments)
        finally:
            spent_s[part] += time.process_time() - began

    return call


def flown(method: str, size: dict[str, Any]) -> dict[str, float]:
    """Processor time (s) of a mission by part, and of the whole mission without judging."""
    settings = Settings.load(None, {"planner.method": method, "mission.seed": SEED, **size})
    fleet = Fleet(settings, ground_of(settings))
    spent_s: dict[str, float] = defaultdict(float)

    def watch(owner: object, name: str, part: str) -> None:
        setattr(owner, name, _timed(getattr(owner, name), part, spent_s))

    watch(fleet.world, "tick", "world")
    for crew in fleet.crews:
        watch(crew, "update_map", "map")
        if crew.placer is not None:
            watch(crew.placer, "correct", "places")
        for name in ("hear", "say"):
            watch(crew, name, "packets")
        watch(crew.planner, "decide", "planner")
    began = time.process_time()
    run = fleet.run()
    spent_s["mission"] = time.process_time() - began
    spent_s["map"] -= spent_s["places"]  # places are corrected while the map takes what came
    spent_s["rest"] = spent_s["mission"] - sum(spent_s[part] for part in PARTS[:5])
    began = time.process_time()
    evaluate(run, 1)
    spent_s["judging"] = time.process_time() - began
    return spent_s


def run(*, smoke: bool = False) -> list[Row]:
    """All rows; `smoke`: at the smallest size, in seconds."""
    size = SMOKE if smoke else FULL
    flown("lawnmower", SMOKE)  # what is compiled at first use is compiled now
    mowing, touring = flown("lawnmower", size), flown("tour", size)
    team = f"{size['mission.vehicles']} vehicles"
    whole = touring["mission"]
    rows = [
        row(
            f"mission, tour, {team}", whole, "s", "lawnmower", mowing["mission"] / whole,
            f"at most {GOAL_S:g} s with 3 vehicles", whole <= GOAL_S,
        ),
        row(f"mission, lawnmower, {team}", mowing["mission"], "s"),
    ]  # fmt: skip
    for part in PARTS:
        ratio = mowing[part] / touring[part] if touring[part] else None
        rows.append(row(f"{part}, tour, {team}", touring[part], "s", "lawnmower", ratio))
    return rows
