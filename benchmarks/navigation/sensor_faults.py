"""What faults of the sounder do to a map, with the gate of own soundings and without it.

A mission's own soundings are damaged in one way after another, and go through the intake of a map. Printed is the map's
expected risk, and its true loss by the ground (both the mean cost of a cell), and what the gate has refused.

    python -m benchmarks.navigation.sensor_faults [--smoke]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with, parser_of

Array = NDArray[np.float64]


def spikes(rows: Array, rng: np.random.Generator) -> Array:
    """Two in a hundred are off by 10 m on average: fish, multipath."""
    wrong = rng.random(len(rows)) < 0.02
    rows[wrong, 3] += rng.exponential(10.0, wrong.sum()) * np.where(rng.random(wrong.sum()) < 0.5, -1.0, 1.0)
    return rows


def bursts(rows: Array, rng: np.random.Generator) -> Array:
    """Three wrong ones in a row, twenty times."""
    for start in rng.integers(0, len(rows) - 3, 20):
        rows[start : start + 3, 3] += rng.normal(0.0, 8.0, 3)
    return rows


def frozen(rows: Array, rng: np.random.Generator) -> Array:
    """The depth hangs for a minute, five times."""
    for start in rng.integers(0, len(rows) - 60, 5):
        rows[start : start + 60, 3] = rows[start, 3]
    return rows


def dropped(rows: Array, rng: np.random.Generator) -> Array:
    """A third is missing, as NaN."""
    rows[rng.random(len(rows)) < 0.33, 3] = np.nan
    return rows


def whole(rows: Array, rng: np.random.Generator) -> Array:
    """As they were."""
    return rows


FAULTS: tuple[Callable[[Array, np.random.Generator], Array], ...] = (whole, spikes, bursts, frozen, dropped)


class _NoGate(SoundingGate):
    """Lets everything pass."""

    def passed(self, rows: Iterable[Sequence[float]]) -> list[Sequence[float]]:
        return list(rows)


def judged(settings: Settings, ground: Ground, rows: Array, gate: SoundingGate) -> tuple[float, float]:
    """Mean risk and mean true loss of a cell of the map that these soundings make."""
    depth_map = DepthMap(settings.common.gp, settings.level_set, OperatingArea(settings.area))
    intake = MapIntake(depth_map)
    intake.gate = gate
    for row in rows:
        intake.add_soundings([row])
        intake.step(float(row[0]))
    field, level = depth_map.field(), settings.level_set
    inside = depth_map.grid.inside
    north, east = depth_map.grid.locations_m.T
    safe = ground.depth_m(north, east) >= level.level_m
    said = field.p_safe[inside] * level.cost_false_unsafe >= (1.0 - field.p_safe[inside]) * level.cost_false_safe
    cost = np.where(said & ~safe, level.cost_false_safe, 0.0) + np.where(~said & safe, level.cost_false_unsafe, 0.0)
    return float(np.mean(field.risk[inside])), float(np.mean(cost))


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 0."""
    p = parser_of("benchmarks.navigation.sensor_faults", __doc__)
    p.add_argument("--smoke", action="store_true", help="a few steps: shows only that it runs")
    options = p.parse_args(arguments)
    steps = 4 if options.smoke else 100
    settings = Settings.load(
        None, {"mission.vehicles": 1, "mission.steps": steps, "mission.seed": 9001, "planner.method": "fixed_tour"}
    )
    ground = ground_of(settings)
    soundings = Fleet(settings, ground).run().vehicles[0].soundings.rows
    print(f"one vehicle, {steps} steps, {len(soundings)} soundings; mean of a cell")
    print("| soundings | risk, no gate | risk, gate | loss, no gate | loss, gate | refused |")
    print("|---|---|---|---|---|---|")
    for fault in FAULTS:
        rows = fault(soundings.copy(), np.random.default_rng(7))
        gate = SoundingGate()
        (risk_0, loss_0), (risk_1, loss_1) = (judged(settings, ground, rows, g) for g in (_NoGate(), gate))
        refused = ", ".join(f"{n} {kind}" for kind, n in gate.counts.items()) or "0"
        print(f"| {fault.__name__} | {risk_0:.3f} | {risk_1:.3f} | {loss_0:.3f} | {loss_1:.3f} | {refused} |")
    return 0


if __name__ == "__main__":
    end_with(main)
