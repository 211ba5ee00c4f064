"""Which prior makes the best map of the same soundings?

    python -m benchmarks.navigation.gp_prior --lakes 20 --out prior.jsonl
    python -m benchmarks.navigation.gp_prior --table prior.jsonl

Flies one mission per lake in the fleet engine, with the default prior, and maps its soundings anew with each kernel,
length scale and standard deviation. The soundings are where the default prior sent the vehicles: what another prior
would have them do is what `scripts/campaign config/campaigns/prior.yaml` flies. Lakes from 8200 on are development's.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_shore.campaign.mission_row import simulate
from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.reliability import Reliability
from auv_lse_shore.judge.team_map import map_of, mission_settings
from auv_lse_shore.judge.verdict import judge
from auv_lse_shore.reproduce.study import base_mission
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.results_file import FOLDER, appended, read

FIRST_LAKE = 8200
#: Measures of a map: key, heading.
MEASURES = (
    ("loss", "true loss"),
    ("risk", "risk"),
    ("loss_expected", "expected loss"),
    ("isobath_error_m", "isobath error (m)"),
    ("depth_rmse_m", "depth error (m, RMS)"),
    ("reliability_error", "reliability error"),
)
#: One vehicle in 500 m x 400 m.
SMALL = {
    "mission.vehicles": 1,
    "area.polygon_m": [-50.0, -50.0, 450.0, -50.0, 450.0, 350.0, -50.0, 350.0],
    "sim.lake.north_m": 200.0,
    "sim.lake.east_m": 150.0,
    "sim.lake.height_m": 500.0,
    "sim.lake.width_m": 400.0,
}


def lines_of(lake: int, method: str, small: bool, priors: list[tuple[str, float, float]]) -> list[dict[str, Any]]:
    """The maps of one mission by each prior (kernel, length scale and standard deviation in metres)."""
    overrides: dict[str, Any] = {"mission.seed": lake, "planner.method": method, **(SMALL if small else {})}
    run = simulate(Settings.load(base_mission(), overrides).to_patterns(), f"lake {lake}", Path())
    settings = mission_settings(run.parameters, 1)[0]
    ground = run.ground
    if ground is None:
        raise ValueError(f"lake {lake}: no truth to judge by; expected a simulated mission")
    scored = ground.scored
    truth = isobath.trace(
        ground.north_m, ground.east_m, np.where(scored, ground.depth_m, np.nan), settings.level_set.level_m
    )
    soundings = Soundings.join(v.soundings for v in run.vehicles)
    lines = []
    for kernel, length_m, std_m in priors:
        gp = dataclasses.replace(settings.gp, kernel=kernel, length_scale_m=length_m, signal_std_m=std_m)
        own = dataclasses.replace(settings, gp=gp)
        field = map_of(own, OperatingArea(own.area), soundings).field()
        verdict = judge(field, own, ground, scored, truth)
        reliability = Reliability.of(field.p_safe[scored], ground.depth_m[scored] >= own.level_set.level_m)
        lines.append(
            {
                "lake": lake,
                "method": method,
                "small": small,
                "prior": [kernel, length_m, std_m],
                "loss": verdict.loss,
                "risk": float(LevelSet.of(own.level_set).risk(field.mean_m[scored], field.prior_std_m[scored]).mean()),
                "loss_expected": float(field.risk[scored].mean()),
                "isobath_error_m": verdict.error.mean_m,
                "depth_rmse_m": verdict.depth_rmse_m,
                "reliability_error": reliability.error,
            }
        )
    return lines


def table(lines: list[dict[str, Any]]) -> str:
    """Markdown table: of each prior the mean over lakes, and the difference to the default one lake by lake."""
    text = ["| kernel, length scale, std | lakes | " + " | ".join(heading for _, heading in MEASURES) + " |"]
    text.append("|---" * (len(MEASURES) + 2) + "|")
    default = Settings.load(base_mission()).common.gp
    base_prior = [default.kernel, default.length_scale_m, default.signal_std_m]
    base = {r["lake"]: r for r in lines if r["prior"] == base_prior}
    for prior in sorted({tuple(r["prior"]) for r in lines}):
        mine = {r["lake"]: r for r in lines if tuple(r["prior"]) == prior}
        cells = []
        for key, _ in MEASURES:
            change = interval([r[key] - base[lake][key] for lake, r in mine.items() if lake in base])
            cells.append(f"{np.mean([r[key] for r in mine.values()]):.3g} ({change.mean:+.2g} ± {change.half:.2g})")
        text.append(f"| {prior[0]}, {prior[1]:g} m, {prior[2]:g} m | {len(mine)} | " + " | ".join(cells) + " |")
    return "\n".join(text)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.navigation.gp_prior", __doc__)
    parser.add_argument("--table", type=existing_file, help="only print the table of this results file")
    parser.add_argument(
        "--out", type=Path, default=FOLDER / "gp_prior.jsonl", help="results file, appended to (default: %(default)s)"
    )
    parser.add_argument("--lakes", type=int, default=20, help=f"lakes, from {FIRST_LAKE} on (default: %(default)s)")
    parser.add_argument("--method", default="tour", help="planner.method (default: %(default)s)")
    parser.add_argument("--small", action="store_true", help="one vehicle in 500 m x 400 m (default: the field trial)")
    parser.add_argument("--kernels", nargs="+", default=["matern52"], help="kernels (default: %(default)s)")
    parser.add_argument("--lengths", nargs="+", type=float, default=[55.0, 70.0, 85.0, 100.0], help="length scales (m)")
    parser.add_argument("--stds", nargs="+", type=float, default=[6.0, 8.0, 10.0], help="standard deviations (m)")
    options = parser.parse_args(arguments)
    if options.table:
        print(table(read(options.table)))
        return
    priors = list(itertools.product(options.kernels, options.lengths, options.stds))
    done = {r["lake"] for r in read(options.out)}
    for lake in range(FIRST_LAKE, FIRST_LAKE + options.lakes):
        if lake in done:
            continue
        with appended(options.out) as file:
            file.writelines(json.dumps(line) + "\n" for line in lines_of(lake, options.method, options.small, priors))
        print(f"lake {lake} done", flush=True)
    print(table(read(options.out)))


if __name__ == "__main__":
    end_with(main)
