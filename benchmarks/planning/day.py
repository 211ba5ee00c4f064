"""A working day: processor time of a leg, by part, in missions of up to thousands of legs, in the fleet engine.

The area grows with the legs of all vehicles, so that coverage is that of the default mission. A mission's cost of a leg
is that of its last quarter, where the map is largest. A mission of 200 legs or more also compares it with that of its
own legs 50 to 100. Long missions take minutes.
"""

import math
import resource
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.rows import Row, row

#: Legs and vehicles of each mission.
FULL = ((100, 1), (1000, 1), (2000, 1), (100, 3), (1000, 3))
SMOKE = ((4, 1),)
SEED = 9003
#: Parts of a mission whose functions are watched.
WATCHED = ("planner", "positions", "map", "packets", "world")
#: Area (m^2) for each leg of each vehicle.
AREA_M2 = 600.0 * 700.0 / 300.0
#: Legs of a mission of at least twice as many that its last quarter is compared with.
EARLY = (50, 100)
#: Goals: milliseconds of an idle core, and the cost of a leg relative to that of the shortest mission, and to that of
#: the mission's own early legs.
MEAN_MS, LONGEST_MS, FIRST_MS, GROWTH = 100.0, 500.0, 5000.0, 1.3


def square(legs: int, vehicles: int) -> dict[str, Any]:
    """Parameters of a mission over a square lake of the size that its legs cover."""
    side_m = max(math.sqrt(AREA_M2 * legs * vehicles), 200.0)
    a, b = -50.0, side_m - 50.0
    middle_m = 0.5 * (a + b)
    return {
        "mission.seed": SEED, "mission.steps": legs, "mission.vehicles": vehicles,
        "area.polygon_m": [a, a, b, a, b, b, a, b],
        "sim.lake.north_m": middle_m, "sim.lake.east_m": middle_m,
        "sim.lake.height_m": side_m, "sim.lake.width_m": side_m,
    }  # fmt: skip


def mission(legs: int, vehicles: int) -> tuple[list[Row], float]:
    """The rows of one mission, and its cost of a leg late in it (s)."""
    settings = Settings.load(None, square(legs, vehicles))
    fleet = Fleet(settings, ground_of(settings))
    times_s = watched(fleet)
    marks: list[dict[str, float]] = []
    at = (*(EARLY if legs >= 2 * EARLY[1] else ()), 0.75 * legs)
    began = time.process_time()
    while not fleet.finished and fleet.now_s < settings.longest_s:
        fleet.tick()
        if len(marks) < len(at) and fleet.cores[0].planner.decided >= at[len(marks)]:
            marks.append(spent_s(times_s))
    whole_s, end = time.process_time() - began, spent_s(times_s)
    late = {part: (end[part] - marks[-1][part]) / (0.25 * legs * vehicles) for part in WATCHED}
    cost_s = sum(late[part] for part in WATCHED if part != "world")
    size = f"{legs} legs, {vehicles} vehicle{'s' if vehicles > 1 else ''}"
    decisions = times_s["planner"]
    later = [t for each in decisions for t in each[1:]]
    counts = [cores.map.counts.full for cores in fleet.cores]
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    rows = [row(f"{size}: whole mission", whole_s, "s")]
    rows += [row(f"{size}: {part}", end[part], "s") for part in WATCHED]
    rows += [row(f"{size}: {part}, a leg in the last quarter", 1e3 * late[part], "ms") for part in WATCHED]
    for name, value_s, goal in (
        ("first decision, longest", max(each[0] for each in decisions), FIRST_MS),
        ("other decisions, mean", sum(later) / max(len(later), 1), MEAN_MS),
        ("other decisions, longest", max(later, default=0.0), LONGEST_MS),
    ):
        rows.append(row(f"{size}: {name}", 1e3 * value_s, "ms", goal=f"<= {goal:g} ms", holds=1e3 * value_s <= goal))
    rows += [
        row(f"{size}: centers of a vehicle", max(len(cores.map.gp) for cores in fleet.cores)),
        row(f"{size}: discarded soundings", sum(counts), goal="0", holds=not any(counts)),
        row(f"{size}: largest memory of the process so far, all vehicles", memory_mb, "MB"),
    ]
    if len(at) > 1:
        early_s = sum(marks[1][part] - marks[0][part] for part in WATCHED if part != "world")
        early_s /= (EARLY[1] - EARLY[0]) * vehicles
        rows.append(row(f"{size}: a leg in the last quarter, of the same mission", 1e3 * cost_s, "ms",
                        f"its legs {EARLY[0]} to {EARLY[1]}", cost_s / early_s,
                        f"<= {GROWTH:g} times", cost_s / early_s <= GROWTH))  # fmt: skip
    return rows, cost_s


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


def run(*, smoke: bool = False) -> list[Row]:
    """All rows; `smoke`: one mission of a few legs."""
    rows: list[Row] = []
    shortest: dict[int, float] = {}
    mission(*SMOKE[0])  # what is compiled or loaded at first use
    for legs, vehicles in SMOKE if smoke else FULL:
        found, cost_s = mission(legs, vehicles)
        growth = cost_s / shortest.setdefault(vehicles, cost_s)
        name = f"{legs} legs, {vehicles} vehicle{'s' if vehicles > 1 else ''}: a leg in the last quarter"
        goals = (f"<= {GROWTH:g} times", growth <= GROWTH)
        rows += [*found, row(name, 1e3 * cost_s, "ms", "the shortest mission", growth, *goals)]
    return rows
