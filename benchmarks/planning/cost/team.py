"""A large team in the fleet engine: processor time of each vehicle's decisions and of its other parts, and the result.

    python -m benchmarks.planning.cost.team [--vehicles 20] [--legs 300] [--out RUN]

The area grows with the legs of all vehicles, as in `scripts/bench day`. Twenty vehicles with 300 legs take half an hour
of processor time. `python -m benchmarks.planning.report_time RUN --again VEHICLE` then repeats one vehicle's map and
planner alone, with their memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_data import RunData
from auv_lse_record.run_writer import write_run
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.judge.tracks import least_separation
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with, parser_of
from benchmarks.planning.day import LONGEST_MS, square, watched

Array = NDArray[np.float64]

#: The mission is divided into so many parts, whose costs are compared.
PARTS = 12
COLUMNS = ("planner", "map", "locations", "packets")
#: Figures of merit that are printed.
FIGURES = (
    "risk_before", "risk_after", "mowing_risk", "flown_risk", "isobath_found", "loss_expected", "loss_after",
    "delivery", "sim_s",
)  # fmt: skip


def _spent_ms(times_s: Mapping[str, list[list[float]]], vehicles: int) -> Array:
    """Processor time (ms) of each vehicle's `COLUMNS` so far, (vehicles, 4)."""
    sums = {part: [1e3 * sum(calls) for calls in lists] for part, lists in times_s.items()}
    locations = sums["locations"] or [0.0] * vehicles
    packets = [sums["packets"][2 * i] + sums["packets"][2 * i + 1] for i in range(vehicles)]
    rows = np.column_stack([sums["planner"], sums["map"], locations, packets])
    rows[:, 1] -= rows[:, 2]  # locations are corrected while the map takes what came
    return np.asarray(rows)


def flown(legs: int, vehicles: int) -> RunData:
    """Flies the mission and prints its costs."""
    settings = Settings.load(None, square(legs, vehicles))
    fleet = Fleet(settings, ground_of(settings))
    times_s = watched(fleet)
    marks = [(0, _spent_ms(times_s, vehicles))]
    print("| legs | " + " | ".join(COLUMNS) + " | sum, ms a leg | centers |\n|" + "---|" * 7)
    while not fleet.finished and fleet.now_s < settings.longest_s:
        fleet.tick()
        done, due = fleet.cores[0].planner.decided, round(len(marks) * legs / PARTS)
        if done >= due > marks[-1][0] or (fleet.finished and done > marks[-1][0]):
            marks.append((done, _spent_ms(times_s, vehicles)))
            before, cost = marks[-2][0], (marks[-1][1] - marks[-2][1]).mean(axis=0) / (done - marks[-2][0])
            centers = max(len(cores.map.gp) for cores in fleet.cores)
            cells = (f"{before + 1} to {done}", *(f"{c:.1f}" for c in cost), f"{cost.sum():.1f}", f"{centers}")
            print("| " + " | ".join(cells) + " |", flush=True)
    late = next(mark for mark in marks if mark[0] >= 0.75 * legs)
    last = (_spent_ms(times_s, vehicles) - late[1]) / max(legs - late[0], 1)
    print("\n| vehicle | first decision | mean | longest | beyond 0.5 s | " + " | ".join(COLUMNS) + " | centers "
          "| discarded |\n|" + "---|" * 11)  # fmt: skip
    for i, cores in enumerate(fleet.cores):
        first_ms, *rest = (1e3 * t for t in times_s["planner"][i])
        beyond = sum(t > LONGEST_MS for t in rest)
        cells = (f"{i + 1}", f"{first_ms:.0f} ms", f"{np.mean(rest):.1f} ms", f"{max(rest):.0f} ms", f"{beyond}",
                 *(f"{c:.1f} ms" for c in last[i]), f"{len(cores.map.gp)}", f"{cores.map.counts.full}")  # fmt: skip
        print("| " + " | ".join(cells) + " |")
    return fleet.run_data()


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies, prints the tables and judges the mission. Returns 0."""
    p = parser_of("benchmarks.planning.cost.team", __doc__)
    p.add_argument("--vehicles", type=int, default=20, help="vehicles, at least 2 (default: %(default)s)")
    p.add_argument("--legs", type=int, default=300, help="legs of each vehicle (default: %(default)s)")
    p.add_argument("--out", type=Path, metavar="RUN", help="new folder for a recording of the mission")
    options = p.parse_args(arguments)
    run = flown(options.legs, options.vehicles)
    if options.out is not None:
        write_run(run, options.out)
    summary = evaluate(run, 2).summary
    print("")
    for name in FIGURES:
        print(f"{name}: {getattr(summary, name)}")
    if summary.mowing_risk:
        print(f"risk_after / mowing_risk: {summary.risk_after / summary.mowing_risk:.3f}")
    print(f"least distance of two vehicles after a minute: {least_separation(run.vehicles):.1f} m")
    return 0


if __name__ == "__main__":
    end_with(main)
