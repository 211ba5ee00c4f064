"""Missions of two versions of the software on the same lakes, compared lake by lake (docs/evidence/long-missions.md).

    export PYTHONPATH=$(echo OLD/auv_lse_* | tr ' ' :)  # of the older version alone
    python -m benchmarks.planning.cost.two_versions --fly 3 9600 old.jsonl
    python -m benchmarks.planning.cost.two_versions --fly 3 9600 now.jsonl
    python -m benchmarks.planning.cost.two_versions --table old.jsonl now.jsonl

OLD is a worktree of the older version. `--fly` appends the figures of one mission (vehicles, seed; otherwise default
parameters) as one JSON line. It imports only what both versions have. One process per mission, versions in turn, so
that other work on the machine slows both alike. Every vehicle's own final map is judged with the prior's standard
deviation, so versions that estimate it differently are judged alike; a team's figures are means over its vehicles.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.evaluation import ground_grid
from auv_lse_shore.judge.verdict import judge
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with, existing_file, parser_of

#: Figures of a mission: names in the file and in the table.
FIGURES = {
    "risk": "risk at the end",
    "loss": "actual loss",
    "found": "share of the isobath found",
    "mission_s": "processor time of the mission, with simulator (s)",
    "first_s": "first decision, longest of the team (s)",
    "others_s": "all other decisions of the team (s)",
}


def flown(vehicles: int, seed: int, **parameters: Any) -> dict[str, Any]:
    """Flies one mission; returns its figures."""
    settings = Settings.load(None, {"mission.vehicles": vehicles, "mission.seed": seed, **parameters})
    fleet = Fleet(settings, ground_of(settings))
    decisions_s: list[list[float]] = []
    for cores in fleet.cores:
        decisions_s.append(_time_decisions(cores.planner))
    began = time.process_time()
    fleet.run()
    mission_s = time.process_time() - began
    own = settings.planner_settings(1)
    ground, level = ground_grid(own, fleet.ground), LevelSet.of(settings.level_set)
    scored = fleet.cores[0].map.grid.inside & np.isfinite(ground.depth_m)
    truth = isobath.trace(ground.north_m, ground.east_m, np.where(scored, ground.depth_m, np.nan), level.level_m)
    fields = [replace(f, std_m=f.prior_std_m) for f in (cores.map.field() for cores in fleet.cores)]
    verdicts = [judge(f, own, ground, scored, truth) for f in fields]
    return {
        "vehicles": vehicles,
        "seed": seed,
        "risk": float(np.mean([level.risk(f.mean_m, f.std_m)[scored].mean() for f in fields])),
        "loss": float(np.mean([v.loss for v in verdicts])),
        "found": float(np.mean([v.error.found for v in verdicts])),
        "mission_s": mission_s,
        "first_s": max(each[0] for each in decisions_s),
        "others_s": sum(sum(each[1:]) for each in decisions_s),
    }


def _time_decisions(planner: Any) -> list[float]:
    """Processor times (s) of the decisions that a planner will make."""
    times_s: list[float] = []
    decide = planner.decide

    def timed(now_s: float) -> Any:
        began = time.process_time()
        decision = decide(now_s)
        times_s.append(time.process_time() - began)
        return decision

    planner.decide = timed
    return times_s


def table(before: Path, now: Path) -> str:
    """Means of both versions, and the mean change of each figure with its 95 % interval, for each size of team."""
    lines = []
    for path in (before, now):
        missions = [json.loads(line) for line in path.read_text().splitlines()]
        lines.append({(m["vehicles"], m["seed"]): m for m in missions})
    both = sorted(lines[0].keys() & lines[1].keys())
    text = []
    for vehicles in sorted({key[0] for key in both}):
        pairs = [(lines[0][key], lines[1][key]) for key in both if key[0] == vehicles]
        text += ["", f"| vehicles: {vehicles}, lakes: {len(pairs)} | before | now | change | ratio |"]
        text.append("|---|---|---|---|---|")
        for key, name in FIGURES.items():
            a, b = (np.array([pair[i][key] for pair in pairs]) for i in (0, 1))
            change, ratio = interval((b - a).tolist()), interval(np.log(b / a).tolist())
            half, (mean, low, high) = change.high - change.mean, np.exp([ratio.mean, ratio.low, ratio.high])
            text.append(
                f"| {name} | {a.mean():.3f} | {b.mean():.3f} | {change.mean:+z.3f} +- {half:.3f} "
                f"| {mean:.2f} ({low:.2f} to {high:.2f}) |"
            )
    return "\n".join(text[1:])


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.cost.two_versions", __doc__)
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--fly", nargs=3, metavar=("VEHICLES", "SEED", "FILE"), help="fly one mission")
    wanted.add_argument("--table", type=existing_file, nargs=2, metavar=("BEFORE", "NOW"), help="print the comparison")
    options = parser.parse_args(arguments)
    if options.table:
        print(table(*options.table))
        return
    vehicles, seed, path = options.fly
    flown(int(vehicles), 1, **{"mission.steps": 4})  # what is compiled or loaded at first use
    line = flown(int(vehicles), int(seed))
    with Path(path).open("a") as file:
        file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    end_with(main)
