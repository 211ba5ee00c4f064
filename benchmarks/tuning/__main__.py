"""Effect of a low and a high value of each tunable parameter: pictures and numbers for docs/evidence/tuning.md.

    python -m benchmarks.tuning --out docs/figures

Each parameter is simulated at three values over the same lakes, in the quick study's small mission, all else as in the
default mission. One lake is drawn; the figures of merit are means over all lakes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.user_error import error_text
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_shore.reproduce.study import SMALL, base_mission
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.tuning.knobs import KNOBS, Knob, shown

#: Names of the figures of merit shown.
MERITS = ("risk", "loss", "isobath_m", "own_risk", "planning_s")


def simulate(knob: Knob, value: float, seed: int) -> Evaluation:
    """One small mission with a parameter set."""
    wanted: Mapping[str, Any] = {**SMALL, "planner.method": knob.method, "mission.seed": seed, knob.parameter: value}
    settings = Settings.load(base_mission(), wanted)
    return evaluate(Fleet(settings, ground_of(settings)).run(), 2)


def merits(e: Evaluation) -> dict[str, float]:
    """The figures of merit of a mission (`MERITS`); NaN where there is none."""
    s = e.summary
    found = (s.risk_after, s.loss_after, s.isobath_error_m, float(np.mean(s.local_risk)), s.planning_median_s)
    return {name: float("nan") if value is None else float(value) for name, value in zip(MERITS, found, strict=True)}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="python -m benchmarks.tuning",
        description="Simulates small missions with a low, a default and a high value of each tunable parameter, and "
        "draws them for docs/evidence/tuning.md. Takes about 6 minutes on one idle core.",
    )
    p.add_argument("--out", type=Path, default=Path("runs/tuning"), metavar="DIR", help="folder (default: runs/tuning)")
    p.add_argument("--seeds", type=int, default=3, metavar="N", help="lakes; the first is drawn (default: 3)")
    p.add_argument(
        "--only", nargs="+", choices=[k.name for k in KNOBS], metavar="NAME",
        help=f"parameters to show (default: all: {', '.join(k.name for k in KNOBS)})",
    )  # fmt: skip
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulates and draws; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        if options.seeds < 1:
            raise ValueError(f"--seeds {options.seeds}: expected at least 1")
        options.out.mkdir(parents=True, exist_ok=True)
        for knob in KNOBS:
            if options.only is None or knob.name in options.only:
                _show(knob, options.seeds, options.out)
    except (OSError, ValueError) as error:
        print(f"error: {error_text(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; the pictures made so far are kept", file=sys.stderr)
        return 130
    return 0


def row(knob: Knob, means: Sequence[Mapping[str, float]]) -> str:
    """One parameter's row of the table: its values, and the results with each."""
    loss = ", ".join(f"{m['loss']:.2f}" for m in means)
    error_m = ", ".join(f"{m['isobath_m']:.1f}" for m in means)
    return f"{heading(knob)} {loss} | {error_m} |"


def heading(knob: Knob) -> str:
    """The first cells of a parameter's row: its name, the method, and the values."""
    values = ", ".join(f"{value:g}" for value in knob.values)
    return f"| `{knob.parameter}` (`{knob.method}`) | {f'{values} {knob.unit}'.strip()} |"


def _show(knob: Knob, seeds: int, folder: Path) -> None:
    """Simulates one parameter's missions, draws them, and prints its rows of the table."""
    from auv_lse_shore.report.figures import save
    from benchmarks.tuning.figure import tuning_figure  # matplotlib takes a second to load

    drawn: list[Evaluation] = []
    means: list[dict[str, float]] = []
    for value in knob.values:
        found: list[dict[str, float]] = []
        for seed in range(1, seeds + 1):
            print(f"{knob.parameter} {shown(knob, value)}: lake {seed} of {seeds}", file=sys.stderr, flush=True)
            mission = simulate(knob, value, seed)
            found.append(merits(mission))
            if seed == 1:
                drawn.append(mission)
        means.append({name: float(np.nanmean([row[name] for row in found])) for name in MERITS})
    print(row(knob, means), flush=True)
    save(tuning_figure(knob, drawn, means), folder / f"tuning_{knob.name}.png")
    numbers = {"parameter": knob.parameter, "method": knob.method, "seeds": seeds, "values": knob.values}
    (folder / f"tuning_{knob.name}.json").write_text(json.dumps({**numbers, "means": means}, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
