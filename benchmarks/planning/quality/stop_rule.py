"""How often the quality at which `mission.until` ends a mission is true, for several rules of when to end.

    python -m benchmarks.planning.quality.stop_rule --flights undiscovered.jsonl --vehicles 1 2

Takes missions flown by `benchmarks.planning.undiscovered`. The map of the soundings until then is judged every five
legs, as the planner does, from `FIRST_LEG` on, and compared with the true isobath. A rule ends a mission at the first
judgement at which the quality was met so many times in a row. Judgements are appended to a results file, so a run can
be stopped and continued.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map.certainty import FOUND, classify, lines_of
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.quality import QualityJudge
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.vehicle.until import JUDGE_LEGS
from auv_lse_shore.judge.isobath import length_m, trace
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.undiscovered_flights import ground_of, settings, where_of
from benchmarks.results_file import FOLDER, fly, read

#: Legs of a mission, and those after which maps are judged.
LEGS, FIRST_LEG = 100, 60
#: Limits (m) and shares that are asked for, of which each mission reaches some.
LIMITS_M, SHARES = (200.0, 400.0, 600.0, 800.0, 1000.0, 1400.0), (0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
#: Numbers of judgements in a row that have to meet the quality.
RULES = (1, 2, 3)

Line = dict[str, Any]


def judgements(kind: str, vehicles: int, name: str, real: str, soundings: Sequence[Sequence[float]]) -> Line:
    """Each judgement of a mission: legs; share found and limit (m) promised; share found and length missed (m)."""
    chosen = settings(vehicles)
    area, level = OperatingArea(chosen.area), chosen.level_set.level_m
    depth_map = DepthMap(chosen.gp, chosen.level_set, area)
    grid, judge = depth_map.grid, QualityJudge(chosen.gp, chosen.level_set, area)
    ground = ground_of(kind, name, where_of(vehicles), real)
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    lines = trace(grid.north_m, grid.east_m, depth, level)
    truth = resample(lines)
    rows, leg_s = np.array(soundings), MotionTable(chosen.motion).leg_length_m / chosen.vehicle.speed_mps
    taken, found = 0, []
    for legs in range(FIRST_LEG, LEGS + 1, JUDGE_LEGS):
        until = int(np.searchsorted(rows[:, 0], legs * leg_s, side="right"))
        depth_map.add_soundings(rows[taken:until])
        taken = until
        posterior = Posterior(chosen.gp)
        posterior.extend(depth_map.centers)
        quality = judge.judge(posterior)
        locations = np.column_stack([rows[:until, 1:3], np.zeros(until)])
        pieces = classify(depth_map.isobath().lines, depth_map.field(), chosen.gp.signal_std_m, locations)
        share = float(np.mean(near(lines_of(pieces, FOUND))(truth))) if len(truth) else 1.0
        found.append([legs, quality.found_share, quality.undiscovered_m, share, length_m(lines) * (1.0 - share)])
    return {"kind": kind, "vehicles": vehicles, "lake": name, "judgements": np.round(found, 4).tolist()}


def ended(met: Sequence[bool], rule: int) -> int | None:
    """Number of the judgement at which a rule ends a mission; None if it does not."""
    for i in range(rule - 1, len(met)):
        if all(met[i - rule + 1 : i + 1]):
            return i
    return None


def table(lines: Sequence[Line]) -> str:
    """What each rule did, over all missions and qualities asked for, in Markdown."""
    text = [
        "| asked | rule | ended | true at the end | missed by over a tenth | found by all later judgements |",
        "|---" * 6 + "|",
    ]
    for name, promised, actual, sign, asked in (
        ("length undiscovered", 2, 4, -1.0, LIMITS_M),
        ("share found", 1, 3, 1.0, SHARES),
    ):
        for rule in RULES:
            ends = []
            for line, value in itertools.product(lines, asked):
                rows = line["judgements"]
                met = [sign * row[promised] >= sign * value for row in rows]
                at = ended(met, rule)
                if at is not None:
                    short = sign * (value - rows[at][actual])
                    ends.append((short <= 0.0, short > 0.1 * value, all(met[at:])))
            if ends:
                shares = " | ".join(f"{100.0 * share:.0f} %" for share in np.mean(ends, axis=0))
                text.append(f"| {name} | {rule} in a row | {len(ends)} | {shares} |")
    return "\n".join(text)


def main(arguments: list[str] | None = None) -> None:
    """Judges what is missing in the file, and prints the table."""
    parser = parser_of("benchmarks.planning.quality.stop_rule", __doc__)
    parser.add_argument("--flights", type=existing_file, required=True, metavar="FILE", help="missions flown")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 2, 3], help="teams (default: all)")
    parser.add_argument("--out", type=Path, default=FOLDER / "stop_rule.jsonl", help="results (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions judged at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    done = {(line["kind"], line["vehicles"], line["lake"]) for line in read(options.out)}
    flown = [line for line in read(options.flights) if line["vehicles"] in options.vehicles]
    jobs = [(f["kind"], f["vehicles"], f["lake"], f["real"], f["soundings"]) for f in flown]
    for _ in fly(judgements, [job for job in jobs if job[:3] not in done], options.out, options.processes):
        pass
    print(table([line for line in read(options.out) if line["vehicles"] in options.vehicles]))


if __name__ == "__main__":
    end_with(main)
