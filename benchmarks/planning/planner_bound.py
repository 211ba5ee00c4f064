"""How often does a mission end below its bound, with and without the incumbent rule?

    python -m benchmarks.planning.planner_bound --missions 200 --out bound.jsonl
    python -m benchmarks.planning.planner_bound --table bound.jsonl

Missions differ in lake (synthetic lakes, and lakes drawn from the planner's own prior), number of vehicles (1 to 3)
and packet loss (0 to 50 %). Each is flown by `augmented`, with the incumbent rule and without, and by `tour`, which has
a budget instead of the rule. In a quarter of the team missions of `tour` a vehicle starts late, and in another quarter
one falls silent.

Let P_i = reward so far + Jbar at decision i, the expected reward of the mission, and g_i = Jbar minus the value of
continuing the last plan on the same data, the gain by the choice. The table counts missions in which

- *expected*: the choices of a vehicle lowered the expected reward, sum g_i < 0. Other changes of P come from new data;
  their expectation is zero where the reward telescopes, so the expected end is P_0 + sum g_i.
- *realized start*: the reward ends below P_0, the value of the plan at the start.
- *realized maximum*: the reward ends below the running maximum of the time-varying bound.
- *decisions*: share of decisions that violate the paper's condition Jbar_n >= Jbar_(n-m-1).

For `tour`, P_0 is the reward expected of mowing, *expected* counts missions in which a budget was negative, and
*decisions* the decisions at which it was. A vehicle's own map lacks soundings that it did not receive, while plans
count those of the whole team. Therefore the map of all soundings is compared with the largest P_0 of the vehicles, too.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import OnlineGp
from auv_lse_sim.ground.lake import SyntheticLake
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.planner_loop import light_mission, settings_for
from benchmarks.results_file import FOLDER, fly, read

SPAN_M = (250.0, 300.0)
RULES = (True, False)
METHODS = ("augmented", "tour")
LOSSES = (0.0, 0.25, 0.5)
#: Seed of the first synthetic lake.
FIRST = 8300


class PriorLake:
    """A lake drawn from the planner's own prior (random Fourier features of the Matern 5/2 kernel)."""

    def __init__(self, seed: int, features: int = 600) -> None:
        """Draws lake number `seed`."""
        rng = np.random.default_rng([seed, 77])
        config = GpConfig()
        # the spectrum of Matern 5/2 in the plane: a bivariate t with 5 degrees of freedom
        waves = rng.normal(size=(features, 2)) * np.sqrt(5.0 / rng.chisquare(5.0, (features, 1)))
        self._waves = waves / config.length_scale_m
        self._phases = rng.uniform(0.0, 2.0 * np.pi, features)
        self._scale = config.signal_std_m * np.sqrt(2.0 / features)
        self._mean = config.mean_depth_m

    def depth_m(self, north_m: Any, east_m: Any) -> Any:
        """Depth at any locations."""
        north, east = np.broadcast_arrays(np.asarray(north_m, float), np.asarray(east_m, float))
        angle = north[..., None] * self._waves[:, 0] + east[..., None] * self._waves[:, 1] + self._phases
        return self._mean + self._scale * np.cos(angle).sum(axis=-1)


def risk(posterior: Posterior, settings: PlannerSettings) -> float:
    """Bayes risk over the map."""
    columns = posterior.at(OperatingArea(settings.area).grid(settings.planner.map_spacing_m).locations_m)
    return float(LevelSet.of(settings.level_set).risk(columns.mean_m, np.sqrt(columns.data_var_m2)).sum())


def mission(number: int, method: str, rule: bool, steps: int, iterations: int, first: int = FIRST) -> dict[str, Any]:
    """Flies mission `number` by one method and rule over its lake, `first` the seed of number 0; gives its line."""
    vehicles, loss = 1 + number % 3, LOSSES[(number // 3) % 3]
    own = (number // 9) % 2 == 1
    height, width = SPAN_M
    ground: Any = PriorLake(number)
    if not own:
        ground = SyntheticLake(
            LakeConfig(
                seed=first + number,
                north_m=height / 2 - 20,
                east_m=width / 2 - 20,
                height_m=height,
                width_m=width,
                islands=0,
            )
        )
    settings = settings_for(
        method,
        vehicles,
        {"polygon_m": [-20.0, -20.0, height - 20, -20.0, height - 20, width - 20, -20.0, width - 20]},
        {"incumbent": rule, "iterations": iterations},
        mission={"steps": steps},
        vehicle={"depth_m": 0.0, "min_water_m": 0.0},
        gp={"min_depth_m": -1000.0},
    )
    late_s: dict[int, float] = {}
    silent_s: dict[int, float] = {}
    if method == "tour" and vehicles > 1:
        if number % 4 == 1:
            late_s = {vehicles: 100.0}
        if number % 4 == 2:
            silent_s = {1: 150.0}
    outcome = light_mission(settings, ground, number, loss, 0.3, late_s, silent_s)
    line: dict[str, Any] = {
        "number": number,
        "method": method,
        "rule": rule,
        "vehicles": vehicles,
        "loss": loss,
        "prior_lake": own,
        "steps": steps,
        "first": first,
        "per_vehicle": [],
    }
    together = OnlineGp(settings.gp)  # the map of all soundings, which the team brings home
    for boat in outcome.boats:
        for _, north_m, east_m, depth_m in boat.soundings:
            together.add(north_m, east_m, depth_m)
    team = Posterior(settings.gp)
    before = risk(team, settings)
    team.follow(together.centers)
    line["team_end"] = before - risk(team, settings)
    for boat in outcome.boats:
        records = boat.planner.records
        promised = np.array([r.expected_total for r in records])
        if method == "tour":
            posterior = boat.planner.posterior
            at_last_decision = risk(posterior, settings)
            posterior.follow(boat.gp.centers)
            end = records[-1].reward_so_far + at_last_decision - risk(posterior, settings)
            bound = np.array([r.lower_bound for r in records])
        else:
            end = float(promised[-1])  # the last leg's own reward is all that its Jbar holds
            bound = np.array([r.lower_bound for r in records])
        gains = np.array([r.expected_end - r.incumbent_value for r in records if np.isfinite(r.incumbent_value)])
        start = float(bound[0] if method == "tour" else promised[0])
        if method == "tour":
            gains = np.array([r.budget for r in records])
        line["per_vehicle"].append(
            {
                "start": start,
                "end": end,
                "bound_max": float(bound.max()),
                "gain": float(gains.min() if method == "tour" else gains.sum()),
                "violated": int(np.sum(gains < -1e-9)),
                "decisions": len(gains),
            }
        )
    return line


def table(lines: list[dict[str, Any]]) -> str:
    """Markdown table of rates."""
    head = [
        "method",
        "incumbent",
        "packets lost",
        "missions",
        "expected",
        "realized start",
        "realized maximum",
        "decisions",
    ]
    head += ["end - start, mean (95 % interval)", "team's map below the start", "its end - start"]
    text = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for method in METHODS:
        for rule in RULES:
            for loss in LOSSES:
                mine = [r for r in lines if (r["method"], r["rule"], r["loss"]) == (method, rule, loss)]
                if not mine:
                    continue
                boats = [r["per_vehicle"] for r in mine]
                expected = np.mean([any(v["gain"] < -1e-9 for v in b) for b in boats])
                start = np.mean([any(v["end"] < v["start"] - 1e-9 for v in b) for b in boats])
                top = np.mean([any(v["end"] < v["bound_max"] - 1e-9 for v in b) for b in boats])
                violated = sum(v["violated"] for b in boats for v in b) / sum(v["decisions"] for b in boats for v in b)
                over = np.array([np.mean([v["end"] - v["start"] for v in b]) for b in boats])
                cells = [method, "kept" if rule else "off", f"{loss:.0%}", str(len(mine))]
                cells += [f"{x:.0%}" for x in (expected, start, top, violated)]
                cells.append(_mean(over))
                if method == "tour":
                    least = np.array([r["team_end"] - max(v["start"] for v in r["per_vehicle"]) for r in mine])
                    cells += [f"{np.mean(least < 0.0):.0%}", _mean(least)]
                text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text)


def _mean(values: np.ndarray) -> str:
    """Mean with its 95 % interval."""
    error = 1.96 * values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return f"{values.mean():+.1f} ({values.mean() - error:+.1f} .. {values.mean() + error:+.1f})"


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.planner_bound", __doc__)
    parser.add_argument("--table", type=existing_file, help="only print the table of this results file")
    parser.add_argument(
        "--out",
        type=Path,
        default=FOLDER / "planner_bound.jsonl",
        help="results file, appended to (default: %(default)s)",
    )
    parser.add_argument("--missions", type=int, default=200, help="number of missions (default: %(default)s)")
    parser.add_argument(
        "--methods", nargs="+", default=list(METHODS), choices=METHODS, help="which of them (default: all)"
    )
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=25, help="legs of each vehicle (default: %(default)s)")
    parser.add_argument("--iterations", type=int, default=25, help="search budget (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions flown at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    if options.table:
        print(table(read(options.table)))
        return
    done = {(r["number"], r["method"], r["rule"], r["steps"], r["first"]) for r in read(options.out)}
    jobs = [(n, o, r) for n in range(options.missions) for o in options.methods for r in RULES if r or o != "tour"]
    jobs = [j for j in jobs if (*j, options.steps, options.first) not in done]
    print(f"{len(jobs)} missions to fly, {len(done)} in {options.out}", flush=True)
    sizes = (options.steps, options.iterations, options.first)
    for _ in fly(mission, [(*job, *sizes) for job in jobs], options.out, options.processes):
        pass
    print(table(read(options.out)))


if __name__ == "__main__":
    end_with(main)
