"""`python -m benchmarks.navigation.wrong_fixes`: which wrong fixes the correction of positions finds, in made-up
dives."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[2] / "auv_lse_gp" / "test"))

from positions_helpers import Sailed, messages, sail, smoother_of, surface

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from benchmarks.command import end_with

#: Vehicles, surfacings in all, how far the last fix of vehicle 1 is off (m).
CASES = ((3, 3, 20.0), (3, 3, 50.0), (3, 1, 30.0), (3, 1, 50.0), (1, 2, 30.0), (1, 2, 50.0), (1, 1, 50.0))
LEGS = 60


def _outcome(config: PositionsConfig, team: list[Sailed]) -> tuple[float, int]:
    """Error of the positions of vehicle 1 (m), and measurements refused."""
    heard = messages(np.random.default_rng(1), team, 0) if len(team) > 1 else []
    correction = smoother_of(config, team, 0, heard).smooth()
    own = team[0]
    off = correction.positions(1, own.times, own.raw) - own.true
    return float(np.sqrt((off**2).sum(axis=1).mean())), correction.refused


def dive(seed: int, vehicles: int, surfacings: int, off_m: float) -> tuple[float, float, float, bool]:
    """One dive: error of the positions of vehicle 1 with the right fix, without it and with the wrong one; was it
    refused.

    Args:
        seed: Of the dive.
        vehicles: Number of vehicles.
        surfacings: Fixes in all: one of each vehicle, then more of vehicle 1.
        off_m: How far the last fix of vehicle 1 is off, in any direction.
    """
    rng, config = np.random.default_rng(seed), PositionsConfig()
    team = [sail(rng, config, LEGS) for _ in range(vehicles)]
    for number in range(surfacings):
        mine = team[number % vehicles]
        surface(rng, mine, 600 + 60 * number + 440 * (number // vehicles))
    right, _ = _outcome(config, team)
    fix = team[0].fixes.pop()
    without, before = _outcome(config, team)
    way = rng.uniform(0.0, 2.0 * math.pi)
    position = {"north_m": fix.north_m + off_m * math.cos(way), "east_m": fix.east_m + off_m * math.sin(way)}
    team[0].fixes.append(dataclasses.replace(fix, **position))
    wrong, refused = _outcome(config, team)
    return right, without, wrong, refused > before


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.navigation.wrong_fixes",
        description="Made-up dives in which one fix is wrong: what that does to the positions.",
    )
    parser.add_argument("--seeds", type=int, default=8, metavar="N", help="dives of each kind (default: 8)")
    options = parser.parse_args(arguments)
    print("| vehicles | surfacings | off (m) | with the right fix | without it | with the wrong one | refused |")
    print("|---|---|---|---|---|---|---|")
    for case in CASES:
        dives = [dive(100 + seed, *case) for seed in range(options.seeds)]
        right, without, wrong = (float(np.mean(column)) for column in list(zip(*dives, strict=True))[:3])
        refused = sum(found for *_, found in dives)
        vehicles, surfacings, off_m = case
        print(
            f"| {vehicles} | {surfacings} | {off_m:.0f} | {right:.1f} | {without:.1f} | {wrong:.1f} | "
            f"{refused} of {len(dives)} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    end_with(main)
