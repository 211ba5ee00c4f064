"""When a fix brings most: each vehicle surfaces once, at one part of the mission after another.

    python -m benchmarks.navigation.surfacing_time --seeds 7500 6

Three vehicles mow the default area, with a compass error by heading of one degree, so that little but the time of the
fix changes. Where they surface a second time, the second fix is left out. Each flight is judged after the dive, with
the fix and without it, against the same soundings at their true positions. Beside it stands how far off the position is
by
which a vehicle is led, that of its own filter: so far its legs are from where they were planned.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_data import RunData
from auv_lse_shore.campaign.statistics import interval
from benchmarks.command import end_with, parser_of
from benchmarks.navigation.positions_drift import flown, judged, settings_of

#: Parts of the mission at which the vehicles begin to climb.
PARTS = (0.2, 0.35, 0.5, 0.65, 0.8)
#: A leg's time (s) by the default parameters.
_LEG_S = 15.7
_FIX_S = 120.0


def settings_at(seed: int, part: float, steps: int) -> Settings:
    """The mission of `seed` with a surfacing of each vehicle after this part of it."""
    settings = settings_of(seed, 1.0, 1.0, steps)
    gps = dataclasses.replace(settings.sim.gps, surface_every_s=_LEG_S * steps * part)
    return dataclasses.replace(settings, sim=dataclasses.replace(settings.sim, gps=gps))


def with_first_fix(run: RunData) -> RunData:
    """The run with the fixes of each vehicle's first surfacing alone; what mates tell of fixes is left out."""
    vehicles, none = [], np.nan
    for vehicle in run.vehicles:
        first_s = min((fix.stamp_s for fix in vehicle.fixes), default=0.0)
        mates = [
            dataclasses.replace(mate, fix_raw_north_m=none, fix_raw_east_m=none, fix_north_m=none, fix_east_m=none)
            for mate in vehicle.mates
        ]
        fixes = [fix for fix in vehicle.fixes if fix.stamp_s < first_s + _FIX_S]
        vehicles.append(dataclasses.replace(vehicle, fixes=fixes, mates=mates))
    return dataclasses.replace(run, vehicles=vehicles)


def led_off_m(run: RunData) -> float:
    """Root mean square distance (m) of the position by which the vehicles are led from where they are."""
    apart = [vehicle.odometry[:, 1:3] - vehicle.truth[:, 1:3] for vehicle in run.vehicles]
    return float(np.sqrt((np.concatenate(apart) ** 2).sum(axis=1).mean()))


def row(seed: int, part: float, steps: int) -> dict[str, float]:
    """Figures of one flight."""
    run = flown(settings_at(seed, part, steps))
    by = judged(with_first_fix(run))
    fixed, without, true = by["corrected"], by["corrected, nobody surfaces"], by["true positions"]
    return {
        "isobath_m": fixed["isobath_m"] - true["isobath_m"],
        "isobath_without_m": without["isobath_m"] - true["isobath_m"],
        "position_m": fixed["position_m"],
        "position_without_m": without["position_m"],
        "risk": without["risk"] - fixed["risk"],
        "loss": without["loss"] - fixed["loss"],
        "led_m": led_off_m(run),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies and prints the table. Returns 0."""
    parser = parser_of("benchmarks.navigation.surfacing_time", __doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(7500, 6), metavar=("FIRST", "COUNT"), help="missions")
    parser.add_argument("--steps", type=int, default=100, help="legs of a mission")
    options = parser.parse_args(arguments)
    first, count = options.seeds
    print(
        "| fix at | missions | isobath above true positions (m) | without the fix | position error (m) | without "
        "| risk saved | loss saved | led off (m) |"
    )
    print("|---" * 9 + "|")
    for part in PARTS:
        rows = [row(seed, part, options.steps) for seed in range(first, first + count)]
        names = ("isobath_m", "isobath_without_m", "position_m", "position_without_m", "risk", "loss", "led_m")
        cells = " | ".join(str(interval([one[name] for one in rows])) for name in names)
        print(f"| {part:.0%} | {count} | {cells} |", flush=True)
    return 0


if __name__ == "__main__":
    end_with(main)
