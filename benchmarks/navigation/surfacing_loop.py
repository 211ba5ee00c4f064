"""Whether weighing a fix pays in closed loop: the default mission with its drift, and a part and a multiple of it.

    python -m benchmarks.navigation.surfacing_loop --seeds 7700 2

Each mission is simulated without surfacing, and with surfacing where that pays; it is judged after the dive.
Section `positions` has the instruments' true accuracy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.campaign.statistics import interval
from benchmarks.command import end_with, parser_of
from benchmarks.navigation.positions_drift import flown, judged

DRIFTS = (0.1, 1.0, 10.0)
FIGURES = ("isobath_m", "position_m", "risk", "loss", "error_over_std", "nees")


def settings_of(seed: int, drift: float, surfaces: bool, steps: int = 100) -> Settings:
    """The default mission with so many times the drift; the compass's error does not depend on the heading."""
    settings: dict[str, object] = {
        "mission.seed": seed,
        "mission.steps": steps,
        "positions.heading_std_deg": 0.71 * drift,
        "positions.heading_walk_deg_rth": 0.5 * drift,
        "positions.harmonic_std_deg": min(1.0, drift),
        "positions.scale_std": 0.003 * drift,
        "sim.compass.bias_deg": 1.0 * drift,
        "sim.compass.bias_walk_deg_rth": 0.3 * drift,
        "sim.compass.harmonic_deg": 0.0,
        "sim.gyro.bias_deg_h": 5.0 * drift,
        "sim.gyro.noise_deg_rth": 0.15 * drift,
        "sim.dvl.scale": 0.003 * drift,
    }
    return Settings.load(None, settings if surfaces else {**settings, "vehicle.surfacings": 0})


def row(seed: int, drift: float, surfaces: bool, steps: int) -> dict[str, float]:
    """Figures of one flight, and how often its vehicles surfaced."""
    run = flown(settings_of(seed, drift, surfaces, steps))
    by = judged(run)
    return {
        **by["corrected"],
        "true_m": by["true positions"]["isobath_m"],
        "surfacings": float(sum(len(v.fixes) for v in run.vehicles)),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies and prints the table. Returns 0."""
    parser = parser_of("benchmarks.navigation.surfacing_loop", __doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(7700, 2), metavar=("FIRST", "COUNT"), help="missions")
    parser.add_argument("--drifts", type=float, nargs="+", default=DRIFTS, help="times the default's drift")
    parser.add_argument("--steps", type=int, default=100, help="legs of a mission")
    options = parser.parse_args(arguments)
    first, count = options.seeds
    names = ("surfacings", "isobath_m", "true_m", *FIGURES[1:])
    print(
        "| drift | surfaces | missions | surfacings | isobath error (m) | at true positions (m) | position error (m) "
        "| final risk | true loss | (error/std)^2 | NEES |"
    )
    print("|---" * 11 + "|", flush=True)
    for drift in options.drifts:
        for surfaces in (False, True):
            rows = [row(seed, drift, surfaces, options.steps) for seed in range(first, first + count)]
            some = [interval([one[name] for one in rows]) if count > 2 else None for name in names]
            cells = [
                str(found) if found is not None else f"{np.mean([one[name] for one in rows]):.3g}"
                for found, name in zip(some, names, strict=True)
            ]
            how = "where it pays" if surfaces else "nobody"
            print(f"| x{drift:g} | {how} | {count} | " + " | ".join(cells) + " |", flush=True)
    return 0


if __name__ == "__main__":
    end_with(main)
