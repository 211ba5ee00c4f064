"""Tests the safety watch on random sequences with dropouts, outliers and flicker: no missed limits, no false trips.

Half of the sequences are healthy. In each of the others one limit is exceeded from some moment on, in one of the ways
of `FAULTS`. It must be answered within twice its patience: by its response, or by a warning if that is "warn".
"""

import argparse
import dataclasses
import itertools
import math
import multiprocessing
import random
import signal
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.sections.safety import RESPONSES, SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import AutopilotReport, SafetyWatch
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.vocabulary.frozen_sensor import REPEATS
from auv_lse_common.vocabulary.mission_run import Action, MissionRun, RunState, Stop
from benchmarks.faults.report import Report

SMALL = ("--sequences", "4000")
#: Faults by name: the exceeded limit, and how.
FAULTS = (
    "depth", "fence", "altitude", "battery", "leak", "autopilot", "pressure", "link", "mission time",
    "odometry with old stamps", "odometry silent", "odometry frozen", "odometry impossible",
    "altimeter silent", "altimeter frozen", "depth gauge frozen", "heading jumping", "charge silent",
)  # fmt: skip
#: Limits whose response is always "warn".
WARNINGS = ("altimeter", "depth gauge", "heading", "charge")
#: While a sensor is silent its last reading counts, which may be an outlier: then these limits may trip, too.
STANDING: dict[str, tuple[str, ...]] = {
    f"odometry {how}": ("depth", "fence") for how in ("silent", "frozen", "impossible")
}
STANDING["altimeter silent"] = ("altitude",)
#: Largest share of good readings while a limit is exceeded, of outliers, and of steps that begin a dropout.
FLICKER, OUTLIERS, DROPOUTS = 0.1, 0.02, 0.05
#: A strip too long for any vehicle to reach its end: corners, north and east (m).
_STRIP = (0.0, 0.0, 100.0, 0.0, 100.0, 1e5, 0.0, 1e5)
#: A value repeated over this distance (m) under water is frozen, for altimeter and depth gauge.
_FROZEN_M = 50.0
_LIMITS = ("depth", "altitude", "fence", "odometry", "link", "autopilot", "battery", "leak", "pressure", "mission_time")
_CHUNK = 250


class Sequence:
    """A vehicle with wrong readings, dropouts and one fault, if any, from `begin` on; it starts at a random time.

    Attributes:
        limit: The limit that its fault exceeds; "" if it is healthy.
        patience_s: The watch's patience.
        answered_s: Time from when the limit was truly exceeded to the answer; NaN before.
        wrong_limits: Limits that tripped falsely.
    """

    def __init__(self, name: str, fault: str = "") -> None:
        """Draws everything from the name."""
        self.rng = rng = random.Random(name)
        self.limit = next((limit for limit in (*WARNINGS, "odometry") if fault.startswith(limit)), fault)
        self._fault, self._is_faulty = fault, False
        self._flicker = rng.uniform(0.0, FLICKER)
        self.patience_s = rng.choice([2.0, 3.0, 5.0, 10.0])
        self._per_step = rng.choice([1, 1, 2, 5])
        self._step_s = self.patience_s / rng.choice([10, 12, 15, 20])
        self._outliers, self._dropouts = rng.uniform(0.0, OUTLIERS), rng.uniform(0.0, DROPOUTS)
        self._longest_gap_s, self._gap_until_s = 0.3 * self.patience_s, -math.inf
        self._healthy_s = rng.uniform(1.0, 3.0) * self.patience_s if fault else 6.0 * self.patience_s
        config = SafetyConfig(
            patience_s=self.patience_s,
            odometry_age_s=2.0 * self.patience_s,
            link_age_s=2.0 * self.patience_s,
            mission_time_s=self._healthy_s if self.limit == "mission time" else 0.0,
            **dict[str, Any](
                {f"{limit}_response": rng.choice(RESPONSES if fault else RESPONSES[1:]) for limit in _LIMITS}
            ),
        )
        named = self.limit.replace(" ", "_")
        self._response = "warn" if self.limit in WARNINGS or not fault else getattr(config, f"{named}_response")
        self.run = MissionRun(True, Stop(action=Action.SURFACE))
        self._watch = SafetyWatch(config, Fence(_STRIP, config.fence_margin_m), 10.0, True)
        self._now_s = rng.uniform(-1e3, 1e9)
        self._speed_mps, self._east_m = rng.uniform(1.0, 5.0), 10.0
        self._last = (50.0, 10.0, 4.0, 20.0)  # north, east, depth, altitude (m)
        self._is_turned = False  # a heading that jumps does so with each reading
        self.answered_s = math.nan
        self.wrong_limits: set[str] = set()

    def play(self) -> bool:
        """Plays it; returns whether the watch answered correctly."""
        self._advance(self._healthy_s)
        self.wrong_limits = set(self.run.limits) - {"mission time" if self.limit == "mission time" else ""}
        if not self._fault:
            return not self.wrong_limits
        self._is_faulty = True
        exceeded_s = self._now_s + self._delay_s()
        self._advance(exceeded_s - self._now_s + 2.0 * self.patience_s + 2.0 * self._step_s, exceeded_s)
        self.wrong_limits |= set(self.run.limits) - {self.limit, *STANDING.get(self._fault, ())}
        return not self.wrong_limits and not math.isnan(self.answered_s)

    def _delay_s(self) -> float:
        """Time (s) from the fault until the limit is truly exceeded, by an age or a distance."""
        if self._fault.startswith(("odometry", "link", "altimeter silent", "charge silent")):
            return 2.0 * self.patience_s
        if self._fault.endswith("frozen"):
            repeats_s = 2 * (REPEATS + 1) * self._step_s / self._per_step
            return max(_FROZEN_M / self._speed_mps, repeats_s) + self._longest_gap_s
        return 3.0 * self._step_s if self._fault == "mission time" else 0.0

    def _is_bad(self, fault: str) -> bool:
        """Whether a reading exceeds a limit: rarely without a fault (outlier), mostly with one (flicker)."""
        has = self._has(fault)
        return has != (self.rng.random() < (max(self._flicker, self._outliers) if has else self._outliers))

    def _has(self, fault: str) -> bool:
        return self._is_faulty and self._fault == fault

    def _advance(self, seconds: float, exceeded_s: float = math.inf) -> None:
        for _ in range(math.ceil(seconds / self._step_s - 1e-6)):
            self._now_s += self._step_s
            if self.rng.random() < self._dropouts and self._gap_until_s + self.patience_s < self._now_s:
                self._gap_until_s = self._now_s + self.rng.uniform(0.0, self._longest_gap_s)
            if self._now_s >= self._gap_until_s:
                for _ in range(self._per_step):
                    self._read()
            report = AutopilotReport(heard=not self._has("link"), armed=True, battery=0.9, leak=0)
            if self._is_bad("battery"):
                report = dataclasses.replace(report, battery=0.1)
            if self._has("charge silent"):
                report = dataclasses.replace(report, battery=math.nan)
            if self._is_bad("leak"):
                report = dataclasses.replace(report, leak=1)
            if self._is_bad("pressure"):
                report = dataclasses.replace(report, depth_problem="pressure and depth disagree")
            if self._is_bad("autopilot"):
                report = dataclasses.replace(report, disobeys="ignores its target")
            self._watch.autopilot(report)
            self._watch.step(self._now_s, self.run)
            if math.isnan(self.answered_s) and self._is_faulty and self._is_answered():
                self.answered_s = max(0.0, self._now_s - exceeded_s)

    def _is_answered(self) -> bool:
        if self._response == "warn":
            return self.limit in self._watch.warnings
        return self.limit in self.run.limits and self.run.status.state is not RunState.RUNNING

    def _read(self) -> None:
        """Passes on one reading of each sensor."""
        rng, jitter_m = self.rng, self.rng.gauss(0.0, 0.01)
        self._east_m += self._speed_mps * self._step_s / self._per_step
        north_m, east_m, depth_m, altitude_m = self._last
        if not self._has("odometry frozen"):
            north_m, east_m = 50.0 + jitter_m, self._east_m
        if not self._has("depth gauge frozen"):
            depth_m = 4.0 + jitter_m
        if not self._has("altimeter frozen"):
            altitude_m = 20.0 + jitter_m
        self._last = (north_m, east_m, depth_m, altitude_m)
        if not self._has("odometry silent"):
            is_impossible = self._has("odometry impossible") or rng.random() < 0.02
            age_s = 4.0 * self.patience_s if self._has("odometry with old stamps") else rng.uniform(0.0, 1.0)
            depth_m = math.nan if is_impossible else depth_m
            if not self._has("depth gauge frozen"):
                depth_m += 16.0 * self._is_bad("depth")
            if not self._has("odometry frozen"):
                north_m -= 400.0 * self._is_bad("fence")
            self._is_turned = self._has("heading jumping") and not self._is_turned
            heading_rad = 0.3 + math.pi * self._is_turned
            self._watch.odometry(self._now_s - age_s, heading_rad, north_m, east_m, depth_m, self._speed_mps)
        if not self._has("altimeter silent"):
            if not self._has("altimeter frozen"):
                low_m = rng.choice([0.5, 0.0, -1.0])
                altitude_m = low_m if self._is_bad("altitude") else rng.choice([altitude_m, math.nan])
            self._watch.altitude(altitude_m)


def sequences(number: int, seed: int) -> Iterable[tuple[str, str]]:
    """Names and faults of `number` sequences: healthy, faulty, healthy, faulty with the next fault, ..."""
    faults = itertools.cycle(FAULTS)
    return ((f"{seed} {i}", next(faults) if i % 2 else "") for i in range(number))


def _play(chunk: list[tuple[str, str]]) -> list[tuple[str, float, str]]:
    """Of each sequence: its fault, the answer's time (in patiences), and what went wrong or ""."""
    found = []
    for name, fault in chunk:
        sequence = Sequence(name, fault)
        wrong = ""
        if not sequence.play():
            tripped = ", ".join(sorted(sequence.wrong_limits))
            wrong = f"sequence {name} ({fault or 'healthy'}): {f'{tripped} tripped' if tripped else 'not answered'}"
        found.append((fault, sequence.answered_s / sequence.patience_s, wrong))
    return found


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults watch`."""
    parser.add_argument(
        "--sequences", type=whole_from(1), default=200_000, metavar="N", help="how many (default: %(default)s)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """Plays the sequences on two cores; a row for each fault."""
    found: list[tuple[str, float, str]] = []
    with multiprocessing.Pool(2, initializer=_ignore_interrupts) as pool:
        for number, done in enumerate(pool.imap_unordered(_play, _chunks(options.sequences, options.seed))):
            found += done
            if number % 40 == 0:
                say(f"{len(found)} of {options.sequences} sequences")
    lost = [wrong for _, _, wrong in found if wrong]
    counts = Counter(fault for fault, _, _ in found)
    wrong = Counter(fault for fault, _, what in found if what)
    lines = ["| fault | sequences | wrong | longest time to the answer, in patiences |", "|---|---|---|---|"]
    for fault in ("", *FAULTS):
        longest = max((time for name, time, _ in found if name == fault and not math.isnan(time)), default=None)
        time = "-" if longest is None else f"{longest:.2f}"
        lines.append(f"| {fault or 'none'} | {counts[fault]} | {wrong[fault]} | {time} |")
    return Report([*lines, *lost[:10]], tried=len(found), survived=len(found) - len(lost), lost=lost[:10])


def _chunks(number: int, seed: int) -> list[list[tuple[str, str]]]:
    whole = list(sequences(number, seed))
    return [whole[i : i + _CHUNK] for i in range(0, len(whole), _CHUNK)]


def _ignore_interrupts() -> None:
    """In a process of the pool: Ctrl-C is the parent's, which ends them by SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
