"""The safety watch over random sequences: with dropouts, outliers and flicker it misses nothing and trips for nothing.

AUV_LSE_SAFETY_SEQUENCES sets the number of sequences; the default takes a few seconds.
"""

from __future__ import annotations

import dataclasses
import math
import os
import random

import pytest

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import AutopilotReport, SafetyWatch
from auv_lse_common.vocabulary.mission_run import Action, MissionRun, Stop

SEQUENCES = int(os.environ.get("AUV_LSE_SAFETY_SEQUENCES", "2000"))
SQUARE = (0.0, 0.0, 100.0, 0.0, 100.0, 200.0, 0.0, 200.0)
FAULTS = ("depth", "fence", "altitude", "battery", "leak", "autopilot", "odometry", "link")


class Sequence:
    """A vehicle with wrong readings, gaps and one fault, if any, from `from_s` on; it starts at a random time."""

    def __init__(self, rng: random.Random, fault: str = "", flicker: float = 0.0) -> None:
        self.rng, self.fault, self.flicker = rng, fault, flicker
        self.patience_s = rng.choice([2.0, 3.0, 5.0, 10.0])
        self.per_step = rng.choice([1, 1, 2, 5])
        self.step_s = self.patience_s / rng.choice([10, 12, 15, 20])
        self.outliers = rng.uniform(0.0, 0.02)
        self.gaps = rng.uniform(0.0, 0.05)
        self.longest_gap_s = 0.3 * self.patience_s
        self.gap_until_s = -math.inf
        ages = {"odometry_age_s": 2.0 * self.patience_s, "link_age_s": 2.0 * self.patience_s}
        config = SafetyConfig(patience_s=self.patience_s, altitude_response="surface", **ages)
        self.run = MissionRun(True, Stop(action=Action.SURFACE))
        self.watch = SafetyWatch(config, Fence(SQUARE, config.fence_margin_m), 10.0, True)
        self.now_s = rng.uniform(-1e3, 1e9)
        self.faulty = False

    def wrong(self) -> bool:
        """Whether a reading shows the opposite of the truth: an outlier, or a good value while the fault flickers."""
        share = self.flicker if self.faulty else 0.0
        return self.rng.random() < max(self.outliers, share)

    def bad(self, limit: str) -> bool:
        return (self.faulty and self.fault == limit) != self.wrong()

    def advance(self, seconds: float) -> None:
        for _ in range(math.ceil(seconds / self.step_s - 1e-6)):
            self.now_s += self.step_s
            if self.rng.random() < self.gaps and self.gap_until_s + self.patience_s < self.now_s:
                self.gap_until_s = self.now_s + self.rng.uniform(0.0, self.longest_gap_s)
            if self.now_s >= self.gap_until_s:
                for _ in range(self.per_step):
                    self.read()
            lost = self.faulty and self.fault == "link"
            is_low, leaks = self.bad("battery"), self.bad("leak")
            report = AutopilotReport(heard=not lost, armed=True, battery=0.1 if is_low else 0.9, leak=int(leaks))
            disobeys = "ignores its target" if self.bad("autopilot") else ""
            self.watch.autopilot(dataclasses.replace(report, disobeys=disobeys))
            self.watch.step(self.now_s, self.run)

    def read(self) -> None:
        jitter_m = self.rng.gauss(0.0, 0.01)
        north_m = 50.0 + jitter_m - 400.0 * self.bad("fence")
        stale = self.faulty and self.fault == "odometry"
        depth_m = 4.0 + jitter_m + 16.0 * self.bad("depth")
        stamp_s = self.now_s - (4.0 * self.patience_s if stale else self.rng.uniform(0.0, 1.0))
        if self.rng.random() < 0.02:
            depth_m = math.nan
        self.watch.odometry(stamp_s, 0.3, north_m, 50.0, depth_m, 1.0)
        low_m = self.rng.choice([0.5, 0.0, -1.0])
        self.watch.altitude(low_m if self.bad("altitude") else self.rng.choice([20.0 + jitter_m, math.nan]))


@pytest.mark.parametrize("fault", FAULTS)
def test_a_limit_that_is_exceeded_for_twice_its_patience_is_never_unanswered(fault: str) -> None:
    for seed in range(SEQUENCES // len(FAULTS) // 2):
        rng = random.Random(f"{fault} {seed}")
        sequence = Sequence(rng, fault, flicker=rng.uniform(0.0, 0.1))
        sequence.advance(rng.uniform(1.0, 3.0) * sequence.patience_s)
        assert sequence.run.limits == {}, seed
        sequence.faulty = True
        age_s = 2.0 * sequence.patience_s if fault in ("odometry", "link") else 0.0
        sequence.advance(age_s + 2.0 * sequence.patience_s + 2.0 * sequence.step_s)
        assert fault in sequence.run.limits, (seed, vars(sequence))


def test_a_healthy_vehicle_with_a_few_outliers_never_trips() -> None:
    for seed in range(SEQUENCES // 2):
        sequence = Sequence(random.Random(f"healthy {seed}"))
        sequence.advance(6.0 * sequence.patience_s)
        assert sequence.run.limits == {}, (seed, vars(sequence))
