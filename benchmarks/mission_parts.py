"""Processor time of a default mission by part, against a committed baseline: `auv_lse bench mission`.

A part that has grown by more than `MOST_GROWTH`, or a total beyond `MOST_TOTAL` of the best one reached, fails the
command. Times are in units of a calibration loop run before and after the measurement, one of array arithmetic, one of
datagrams between two threads and one of starting an interpreter: a machine twice as slow takes as many units, also one
that only has slower system calls. The map, the positions and the planner of vehicle 1 are timed by recomputing them
from the recording of the mission; what else its nodes took is `messages`.
"""

from __future__ import annotations

import json
import math
import platform
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_planner.planner_node import prepare
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_record.software import version
from auv_lse_shore.replay.inputs import RecordedInputs, read_inputs, ticks_of
from auv_lse_shore.replay.recompute_decisions import recompute_decisions
from auv_lse_shore.replay.recompute_map import RecomputedMap
from benchmarks.mission import fly
from benchmarks.rows import Row, row

#: Where the baseline is.
BASELINE = Path(__file__).with_name("mission_baseline.json")
#: Largest time of a part relative to the baseline, and of the total relative to the best total ever set as a baseline.
MOST_GROWTH, MOST_TOTAL = 1.15, 1.10
#: The parts, and the calibration loop that each resembles.
PARTS = {
    "map": "arrays",
    "positions": "arrays",
    "planner": "arrays",
    "messages": "datagrams",
    "simulator": "datagrams",
    "recorder": "datagrams",
    "report": "arrays",
    "start and end": "interpreter",
    "auv_lse --help": "interpreter",
}
#: Missions flown.
FLIGHTS = 3
#: Runs of each calibration loop before and after a mission.
REPEATS = 7
#: Round trips of the loop of datagrams: as long as the other loops (.3 s), so that the total weighs its parts alike.
DATAGRAMS = 3000
#: A part of less processor time (s) is compared with this much more: a share of it is noise.
NOISE_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """What a mission took when the baseline was made.

    Attributes:
        reason: Why it was made.
        made_with: Version and processor.
        units: Time of each part in units of its calibration loop.
        best_total: Smallest total of a baseline so far.
    """

    reason: str
    made_with: str
    units: Mapping[str, float]
    best_total: float

    @classmethod
    def read(cls, path: Path = BASELINE) -> Baseline:
        """The committed one."""
        return cls(**json.loads(path.read_text()))

    def write(self, path: Path = BASELINE) -> None:
        """Writes it to be committed."""
        values = {"reason": self.reason, "made_with": self.made_with, "best_total": round(self.best_total, 3)}
        units = {name: round(value, 4) for name, value in self.units.items()}
        path.write_text(json.dumps({**values, "units": units}, indent=1) + "\n")


def compared(baseline: Baseline, seconds: Mapping[str, float], units: Mapping[str, float]) -> list[Row]:
    """A row for each part, and one for the whole mission.

    Args:
        baseline: What the parts took before.
        seconds: Processor time (s) of each of `PARTS` now.
        units: The same in units of the calibration loops.
    """
    rows = []
    for name, before in baseline.units.items():
        ratio, spare = units[name] / before, NOISE_S * units[name] / max(seconds[name], 1e-9) / before
        goal, holds = f"<= {MOST_GROWTH:g}", ratio <= MOST_GROWTH + spare
        rows.append(row(f"mission: {name}", seconds[name], "cpu s", "baseline", ratio, goal=goal, holds=holds))
    ratio, goal = sum(units.values()) / baseline.best_total, f"<= {MOST_TOTAL:g}"
    holds = ratio <= MOST_TOTAL
    rows.append(row("mission: whole", sum(seconds.values()), "cpu s", "best baseline", ratio, goal=goal, holds=holds))
    return rows


def complaints(rows: list[Row]) -> list[str]:
    """The rows that fail the command, a sentence each."""
    return [
        f"{r['name'].removeprefix('mission: ')} takes {r['ratio']:.2f} times the processor time of the {r['against']}; "
        f"allowed: {r['goal']}"
        for r in rows
        if r["holds"] is False
    ]


def in_units(seconds: Mapping[str, float], loops: Mapping[str, float]) -> dict[str, float]:
    """Processor times (s) of parts in units of the calibration loops' (s)."""
    return {name: seconds[name] / loops[loop] for name, loop in PARTS.items()}


# ---------------------------------------------------------------- calibration


def _datagrams() -> None:
    kinds = (socket.AF_INET, socket.SOCK_DGRAM)
    with socket.socket(*kinds) as near, socket.socket(*kinds) as far:
        for end in (near, far):
            end.bind(("127.0.0.1", 0))
            end.settimeout(10.0)

        def answer() -> None:
            for _ in range(DATAGRAMS):
                data = _received(far, near)
                far.sendto(json.dumps(json.loads(data)).encode(), near.getsockname())

        answering = threading.Thread(target=answer, daemon=True)
        answering.start()
        message: dict[str, Any] = {"name": "auv1", "values": [float(i) for i in range(30)]}
        for i in range(DATAGRAMS):
            near.sendto(json.dumps({**message, "stamp": i}).encode(), far.getsockname())
            json.loads(_received(near, far))
        answering.join()


def _received(end: socket.socket, other: socket.socket) -> bytes:
    """The next datagram of `other`; nodes of other domains announce themselves on any port."""
    while (found := end.recvfrom(4096))[1] != other.getsockname():
        pass
    return found[0]


def _arrays() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((500, 2))
    apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    for _ in range(24):
        covariance = np.exp(-apart) + 0.01 * np.eye(len(apart))
        lower = np.linalg.cholesky(covariance)
        np.linalg.solve(lower, np.exp(-apart[:, :400]))


def _interpreter() -> None:
    subprocess.run([sys.executable, "-c", "import numpy, scipy.linalg, yaml"], check=True)


#: Their processor times are the units. Other loops need a new baseline, with its `best_total` set by hand.
LOOPS: dict[str, Callable[[], None]] = {"arrays": _arrays, "datagrams": _datagrams, "interpreter": _interpreter}


def _used_s() -> float:
    """Processor time (s) of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def calibrated() -> dict[str, float]:
    """Processor time (s) of each calibration loop: the median of several runs, in turn.

    A mission of half a minute meets the machine as it is on average, not at its best.
    """
    times: dict[str, list[float]] = {name: [] for name in LOOPS}
    for _ in range(REPEATS):
        for name, loop in LOOPS.items():
            began = _used_s()
            loop()
            times[name].append(_used_s() - began)
    return {name: statistics.median(seconds) for name, seconds in times.items()}


# ---------------------------------------------------------------- measurement


@contextmanager
def _timed(kind: type, method: str, times: dict[str, float], name: str) -> Iterator[None]:
    """Adds the processor time of a method's calls to `times[name]`."""
    original = getattr(kind, method)

    def call(*arguments: Any, **named: Any) -> Any:
        began = time.process_time()
        try:
            return original(*arguments, **named)
        finally:
            times[name] = times.get(name, 0.0) + time.process_time() - began

    setattr(kind, method, call)
    try:
        yield
    finally:
        setattr(kind, method, original)


def _recomputed(inputs: RecordedInputs) -> dict[str, float]:
    """Processor time (s) of vehicle 1's map, positions and planner."""
    times: dict[str, float] = {}
    prepare()  # compiled code, which nodes have before they start
    settings, own = Settings.from_patterns(inputs.parameters, "the recording"), inputs.vehicles[1]
    again = RecomputedMap(own, settings.planner_settings(1), settings.positions_in_force(1), inputs.lockstep)
    events = sorted([*((s, 0) for s in ticks_of(own)), *((m.stamp_s, 1) for m in own.maps)])
    began = time.process_time()
    with _timed(PositionCorrector, "step", times, "positions"):
        for now_s, is_published in events:
            if is_published:
                again.map.isobath(again.map.recent_field())
            else:
                again.advance(now_s)
    times["map"] = time.process_time() - began - times["positions"]
    with _timed(VehiclePlanner, "decide", times, "planner"):
        recompute_decisions(own, settings, inputs.lockstep, 0.0, lambda share: None)
    return times


def _help_s() -> float:
    began = _used_s()
    subprocess.run([sys.executable, "-m", "auv_lse_run", "--help"], check=True, capture_output=True)
    return _used_s() - began


def parts_s(*arguments: str) -> dict[str, float]:
    """Flies a mission and returns the processor time (s) of each of `PARTS`, of the whole team.

    Args:
        arguments: Those of `auv_lse mission`.
    """
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        flight = fly(folder, *arguments)
        inputs = read_inputs(folder)
    start, whole = flight.start_s, flight.processor_s
    flying = {name: seconds - start.get(name, 0.0) for name, seconds in whole.items()}
    own = _recomputed(inputs)
    others = ("sim_node", "recorder_node")
    vehicles = {name: seconds for name, seconds in flying.items() if name not in others}
    share = sum(vehicles.values()) / max(vehicles["auv1"], 1e-9)  # of the team to vehicle 1
    return {
        "map": share * own["map"],
        "positions": share * own["positions"],
        "planner": share * own["planner"],
        "messages": share * max(vehicles["auv1"] - sum(own.values()), 0.0),
        "simulator": flying["sim_node"],
        "recorder": flying["recorder_node"],
        "report": flight.report_processor_s,
        "start and end": flight.whole_processor_s - flight.report_processor_s - sum(flying.values()),
        "auv_lse --help": min(_help_s() for _ in range(3)),
    }


def median_of(
    flights: Sequence[tuple[Mapping[str, float], Mapping[str, float]]],
) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds and units of each part, from the flight in which it took the median number of units.

    Args:
        flights: Processor times (s) of the parts, and of the calibration loops beside them.
    """
    seconds, units = {}, {}
    for name in PARTS:
        each = sorted((in_units(own, loops)[name], own[name]) for own, loops in flights)
        units[name], seconds[name] = each[len(each) // 2]
    return seconds, units


def _calibrated_flight(*arguments: str) -> tuple[dict[str, float], dict[str, float]]:
    """Processor time (s) of the parts of a mission, and that of the calibration loops in the same minute."""
    before = calibrated()
    seconds = parts_s(*arguments)
    after = calibrated()
    return seconds, {name: 0.5 * (before[name] + after[name]) for name in LOOPS}


def run(*, smoke: bool = False, new_baseline: str = "") -> list[Row]:
    """Measures and compares; writes a new baseline first if a reason for one is given.

    Each part counts as in the flight with the median number of units, by the calibration before and after that
    flight: a virtual machine's speed changes from minute to minute. A smoke run flies one vehicle for two steps and
    compares with nothing.
    """
    arguments = ["--vehicles", "1", "--steps", "2"] if smoke else []
    flights = [_calibrated_flight(*arguments) for _ in range(1 if smoke else FLIGHTS)]
    seconds, units = median_of(flights)
    if smoke:
        return [row(f"mission: {name}", seconds[name], "cpu s") for name in PARTS]
    if new_baseline:
        best = Baseline.read().best_total if BASELINE.exists() else math.inf
        made_with = f"{version()}, Python {platform.python_version()}"
        best = min(best, sum(units.values()))
        Baseline(reason=new_baseline, made_with=made_with, units=units, best_total=best).write()
    return compared(Baseline.read(), seconds, units)
