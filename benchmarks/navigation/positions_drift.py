"""What corrected positions are worth: the first table of docs/design/positions.md.

    python -m benchmarks.navigation.positions_drift --seeds 7500 20 --out positions.jsonl

Three vehicles mow the default area with dead-reckoned positions, packets and one surfacing each. Mowing takes no
account of the map,
so each flight is judged as if it had been one of several: soundings where dead reckoning booked them, as before; where
fixes, ranges and terrain say (`scripts/adjust`); the same without the fixes; and where they were truly taken. Rows of
the file that are there already are not flown again.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.team_map import map_of, mission_settings
from auv_lse_shore.judge.tracks import true_positions
from auv_lse_shore.judge.verdict import judge
from auv_lse_shore.positions.adjustment import adjust
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from benchmarks.command import end_with, parser_of
from benchmarks.results_file import FOLDER, appended, read

Array = NDArray[np.float64]

#: Conditions: drift in multiples of the default's, and standard deviation of the compass's harmonics (deg).
CONDITIONS = {"x1": (1.0, 0.0), "x3": (3.0, 0.0), "x10": (10.0, 0.0), "x1, compass by heading": (1.0, 1.0)}
WAYS = ("as before", "corrected", "corrected, nobody surfaces", "true positions")
FIGURES = ("isobath_m", "position_m", "risk", "loss", "error_over_std", "nees")


def settings_of(seed: int, drift: float, harmonic_deg: float, steps: int = 100) -> Settings:
    """A mission of three vehicles that mow and surface once; the smoother has the instruments' true accuracy."""
    return Settings.load(
        None,
        {
            "mission.seed": seed,
            "mission.steps": steps,
            "planner.method": "lawnmower",
            "packet.navigation": True,
            "positions.correct": False,  # mowing has no use for the map under way
            "positions.heading_std_deg": 0.71 * drift,
            "positions.heading_walk_deg_rth": 0.5 * drift,
            "positions.scale_std": 0.003 * drift,
            "sim.compass.bias_deg": 1.0 * drift,
            "sim.compass.bias_walk_deg_rth": 0.3 * drift,
            "sim.compass.harmonic_deg": harmonic_deg,
            "sim.gyro.bias_deg_h": 5.0 * drift,
            "sim.gyro.noise_deg_rth": 0.15 * drift,
            "sim.dvl.scale": 0.003 * drift,
            "sim.gps.surface_every_s": 12.0 * steps,
            "vehicle.surfacings": 0,  # by the clock alone
        },
    )


def flown(settings: Settings) -> RunData:
    """The mission."""
    ground = ground_of(settings)
    settings, _ = fit_to_ground(settings, ground)
    return Fleet(settings, ground).run()


def judged(run: RunData) -> dict[str, dict[str, float]]:
    """Figures of a flight by each of `WAYS`."""
    settings = mission_settings(run.parameters, 1)[0]
    area = OperatingArea(settings.area)
    raw = [_at(v, v.soundings.raw_positions_m) for v in run.vehicles]
    found: dict[str, dict[str, float]] = {}
    for way in WAYS:
        nees = float("nan")
        if way.startswith("corrected"):
            used = run if way == "corrected" else _without_fixes(run)
            adjustment = adjust([used])
            depth_map = DepthMap(settings.gp, settings.level_set, area)
            adjustment.fill(depth_map).set_uncertainty(adjustment.correction)
            vehicles = adjustment.runs[0].vehicles
            nees = _nees(run, adjustment.correction)
        else:
            vehicles = [_at(v, true_positions(v).locations_m) for v in run.vehicles] if way == "true positions" else raw
            depth_map = map_of(settings, area, Soundings.join(v.soundings for v in vehicles))
        found[way] = {**_figures(run, settings, depth_map.field()), "position_m": _off(vehicles, run), "nees": nees}
    return found


def _at(vehicle: VehicleRun, positions: Array) -> VehicleRun:
    soundings = dataclasses.replace(vehicle.soundings, north_m=positions[:, 0], east_m=positions[:, 1])
    return dataclasses.replace(vehicle, soundings=soundings)


def _without_fixes(run: RunData) -> RunData:
    vehicles = []
    for vehicle in run.vehicles:
        mates = [
            dataclasses.replace(
                mate, fix_raw_north_m=np.nan, fix_raw_east_m=np.nan, fix_north_m=np.nan, fix_east_m=np.nan
            )
            for mate in vehicle.mates
        ]
        vehicles.append(dataclasses.replace(vehicle, fixes=[], mates=mates))
    return dataclasses.replace(run, vehicles=vehicles)


def _off(vehicles: Sequence[VehicleRun], run: RunData) -> float:
    """Root mean square distance (m) of soundings from where they were taken."""
    pairs = zip(vehicles, run.vehicles, strict=True)
    apart = [new.soundings.locations_m - true_positions(old).locations_m for new, old in pairs]
    return float(np.sqrt((np.concatenate(apart) ** 2).sum(axis=1).mean()))


def _nees(run: RunData, correction: Any) -> float:
    """Mean of the positions' errors, squared and over their covariance, each axis: 1 is honest."""
    values = []
    for vehicle in run.vehicles:
        some = np.arange(100, len(vehicle.soundings), 200)
        stamps, raw = vehicle.soundings.stamp_s[some], vehicle.soundings.raw_positions_m[some]
        error = correction.positions(vehicle.vehicle, stamps, raw) - true_positions(vehicle).locations_m[some]
        for e, rows in zip(error, correction.jacobian(vehicle.vehicle, stamps, raw), strict=True):
            values.append(e @ np.linalg.solve(rows @ correction.covariance @ rows.T, e) / 2.0)
    return float(np.mean(values))


def _figures(run: RunData, settings: Any, field: DepthField) -> dict[str, float]:
    assert run.ground is not None
    scored = field.grid.inside & np.isfinite(run.ground.depth_m)
    depth = np.where(scored, run.ground.depth_m, np.nan)
    truth = isobath.trace(run.ground.north_m, run.ground.east_m, depth, settings.level_set.level_m)
    verdict = judge(field, settings, run.ground, scored, truth)
    error = ((field.mean_m - run.ground.depth_m) / field.std_m)[scored]
    return {
        "isobath_m": verdict.error.mean_m,
        "risk": float(LevelSet.of(settings.level_set).risk(field.mean_m[scored], field.prior_std_m[scored]).mean()),
        "loss": verdict.loss,
        "error_over_std": float((error**2).mean()),
    }


def rows_of(seeds: Sequence[int], path: Path, steps: int = 100) -> Iterator[dict[str, Any]]:
    """The rows, those of the file first; each new one is appended to it."""
    before = read(path)
    done = {(row["seed"], row["condition"]) for row in before}
    yield from (row for row in before if row["seed"] in seeds)
    for seed in seeds:
        for condition, (drift, harmonic_deg) in CONDITIONS.items():
            if (seed, condition) in done:
                continue
            row = {"seed": seed, "condition": condition, **judged(flown(settings_of(seed, drift, harmonic_deg, steps)))}
            with appended(path) as file:
                file.write(json.dumps(row) + "\n")
            yield row


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The table's lines, in Markdown: means with 95 % intervals, and the change of the isobath's error, paired."""
    lines = [
        "| drift | positions | missions | isobath error (m) | against before, paired (m) | position error (m) "
        "| NEES of positions | final risk | true loss | (error/std)^2 |",
        "|---" * 10 + "|",
    ]
    for condition in CONDITIONS:
        own = [row for row in rows if row["condition"] == condition]
        for way in WAYS if own else ():
            cells = {name: str(interval([row[way][name] for row in own])) for name in FIGURES}
            paired = str(interval([row[way]["isobath_m"] - row[WAYS[0]]["isobath_m"] for row in own]))
            values = [cells["isobath_m"], paired if way != WAYS[0] else "", cells["position_m"], cells["nees"]]
            values += [cells["risk"], cells["loss"], cells["error_over_std"]]
            lines.append(f"| {condition} | {way} | {len(own)} | " + " | ".join(values) + " |")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulates the missing missions and prints the table. Returns 0, 130 after Ctrl-C."""
    parser = parser_of("benchmarks.navigation.positions_drift", __doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(7500, 20), metavar=("FIRST", "COUNT"), help="missions")
    parser.add_argument(
        "--out",
        type=Path,
        default=FOLDER / "positions_drift.jsonl",
        metavar="FILE",
        help="the rows (default: %(default)s)",
    )
    parser.add_argument("--steps", type=int, default=100, help="legs of a mission")
    options = parser.parse_args(arguments)
    first, count = options.seeds
    rows = []
    try:
        for row in rows_of(range(first, first + count), options.out, options.steps):
            rows.append(row)
            if sys.stderr.isatty():
                print(end=f"{len(rows)} of {count * len(CONDITIONS)}\r", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on from here", file=sys.stderr)
        return 130
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    end_with(main)
