"""Processor time of a whole mission in the fleet engine, by part and by decision, and what `tour` adds to mowing."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.rows import Row, row

#: Processor time (s) of a mission of three, on an idle core.
GOAL_S = 15.0
#: Processor time (s) of a decision of three, on an idle core: in the mean, of the first, of any other.
MEAN_S, FIRST_S, LONGEST_S = 0.08, 3.0, 0.25
SEED = 9003
SMOKE = {"mission.steps": 4, "mission.vehicles": 2}
FULL = {"mission.vehicles": 3}
#: Parts of a mission whose functions are watched, and all, in the order of the rows. Judging comes after it.
WATCHED = ("planner", "positions", "map", "packets", "world")
PARTS = (*WATCHED, "rest", "judging")


@dataclass(frozen=True)
class Flown:
    """Processor time of a mission.

    Attributes:
        spent_s: By part, and of the whole mission without judging.
        decisions_s: Of each vehicle's decisions, in the order decided.
    """

    spent_s: dict[str, float]
    decisions_s: list[list[float]]


def timed(function: Callable[..., Any], times_s: list[float]) -> Callable[..., Any]:
    """A function that also appends the processor time (s) of each of its calls to `times_s`."""

    def call(*arguments: Any) -> Any:
        began = time.process_time()
        try:
            return function(*arguments)
        finally:
            times_s.append(time.process_time() - began)

    return call


def watched(fleet: Fleet) -> dict[str, list[list[float]]]:
    """Processor times (s) of the calls of each part to come, one list for each function.

    Those of `map` include `positions`: positions are corrected while the map takes what came.
    """
    times_s: dict[str, list[list[float]]] = defaultdict(list)

    def watch(owner: object, name: str, part: str) -> None:
        times_s[part].append([])
        setattr(owner, name, timed(getattr(owner, name), times_s[part][-1]))

    watch(fleet.world, "tick", "world")
    for cores in fleet.cores:
        watch(cores, "update_map", "map")
        if cores.corrector is not None:
            watch(cores.corrector, "correct", "positions")
        for name in ("receive", "next_packet"):
            watch(cores, name, "packets")
        watch(cores.planner, "decide", "planner")
    return times_s


def spent_s(times_s: Mapping[str, Sequence[Sequence[float]]]) -> dict[str, float]:
    """Sum (s) of what `watched` has measured so far, by part; that of `map` without `positions`."""
    spent = {part: sum(map(sum, times_s[part])) for part in WATCHED}
    spent["map"] -= spent["positions"]
    return spent


def flown(method: str, size: dict[str, Any]) -> Flown:
    """Processor time of one mission."""
    settings = Settings.load(None, {"planner.method": method, "mission.seed": SEED, **size})
    fleet = Fleet(settings, ground_of(settings))
    times_s = watched(fleet)
    began = time.process_time()
    run = fleet.run()
    mission_s = time.process_time() - began
    spent = spent_s(times_s)
    spent["rest"] = mission_s - sum(spent.values())
    spent["mission"] = mission_s
    began = time.process_time()
    evaluate(run, 1)
    spent["judging"] = time.process_time() - began
    return Flown(spent, times_s["planner"])


def run(*, smoke: bool = False) -> list[Row]:
    """All rows; `smoke`: at the smallest size, in seconds."""
    size = SMOKE if smoke else FULL
    for method in ("lawnmower", "tour", "augmented"):  # what is loaded at first use is loaded now: heads search a tree
        flown(method, SMOKE)
    mowing, touring = flown("lawnmower", size), flown("tour", size)
    team = f"{size['mission.vehicles']} vehicles"
    spent, without_s = touring.spent_s, mowing.spent_s
    whole = spent["mission"]
    rows = [
        row(
            f"mission, tour, {team}", whole, "s", "lawnmower", without_s["mission"] / whole,
            f"at most {GOAL_S:g} s with 3 vehicles", whole <= GOAL_S,
        ),
        row(f"mission, lawnmower, {team}", without_s["mission"], "s"),
    ]  # fmt: skip
    for part in PARTS:
        ratio = without_s[part] / spent[part] if spent[part] else None
        rows.append(row(f"{part}, tour, {team}", spent[part], "s", "lawnmower", ratio))
    every = [t for each in touring.decisions_s for t in each]
    firsts = [each[0] for each in touring.decisions_s]
    largest = max(t for each in touring.decisions_s for t in each[1:])
    for name, value, goal in (
        ("mean of all", sum(every) / len(every), MEAN_S),
        ("longest first", max(firsts), FIRST_S),
        ("longest other", largest, LONGEST_S),
    ):
        words = f"at most {1e3 * goal:g} ms of an idle core with 3 vehicles"
        rows.append(row(f"decision, {name}, tour, {team}", 1e3 * value, "ms", goal=words, holds=value <= goal))
    return rows
