"""Processor time of a default mission by part: `python -m benchmarks.mission_parts` prints it as JSON.

The map, the positions and the planner of vehicle 1 are timed by recomputing them from the recording of the mission;
what else its nodes took is `messages`. `auv_lse bench mission` compares the figures with those of a baseline.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_planner.planner_node import prepare
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_shore.replay.inputs import RecordedInputs, read_inputs, ticks_of
from auv_lse_shore.replay.recompute_decisions import recompute_decisions
from auv_lse_shore.replay.recompute_map import RecomputedMap
from benchmarks.command import end_with, parser_of
from benchmarks.mission import fly

#: The parts.
PARTS = (
    "map",
    "positions",
    "planner",
    "messages",
    "simulator",
    "recorder",
    "report",
    "start and end",
    "auv_lse --help",
)


def _used_s() -> float:
    """Processor time (s) of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


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
    """Flies a mission and returns the processor time (s) of each of `PARTS`, of the whole team."""
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies the mission that the command line asks for, and prints the processor time (s) of its parts."""
    parser = parser_of("benchmarks.mission_parts", __doc__)
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="arguments of auv_lse mission, after --")
    print(json.dumps(parts_s(*parser.parse_args(arguments).arguments)))


if __name__ == "__main__":
    end_with(main)
