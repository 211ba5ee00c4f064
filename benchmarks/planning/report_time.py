"""Figures of a long mission from its run folder: decisions, recording, and time and memory of report and exports.

    python -m benchmarks.planning.report_time [RUN [--again VEHICLE]]

Decisions and processor times are those of the flight; report, certificate and export are made anew. Without RUN, a
mission of three vehicles and 1,200 legs is flown in the fleet engine first, which takes much longer. Its
method is `lawnmower`, which plans fastest. The fleet engine publishes no maps, so the certificate of its recording
compares none: to measure that, give a recording of `scripts/mission`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from unittest import mock

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_record.recording import Recording, recording_in
from auv_lse_record.run_writer import write_run
from auv_lse_shore.replay.inputs import read_inputs
from auv_lse_shore.replay.recompute_decisions import recompute_decisions
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with, parser_of
from benchmarks.planning.day import FIRST_MS, LONGEST_MS, MEAN_MS, square
from benchmarks.planning.planner_memory import private_mb
from benchmarks.rows import Row, row

#: Legs and vehicles of the mission.
FULL, SMOKE = (1200, 3), (4, 1)
#: Goals of the report: wall-clock time (s), and memory of its largest process (MB).
REPORT_S, REPORT_MB = 60.0, 1500.0
#: Legs of the mission's first and last part, whose decisions are compared.
PART_LEGS = 200
#: Largest recording (MB).
RECORDING_MB = 400.0
#: What is measured: name, module and options.
COMMANDS = (
    ("report", "auv_lse_shore.replay", ("--report", "--out", "{out}")),
    ("certificate", "auv_lse_shore.certify", ("--out", "{out}/certificate")),
    ("export", "auv_lse_shore.export", ("--out", "{out}/export")),
)


def _of_decisions(vehicle: int, decisions: Sequence[tuple[int, float]]) -> Iterator[Row]:
    """The rows of one vehicle's decisions: step and time (ms) of each."""
    steps, times_ms = np.array(decisions).T
    later, last = times_ms[1:], steps[-1]
    if not len(later):
        return
    for name, value_ms, goal_ms in (
        ("first decision", times_ms[0], FIRST_MS),
        ("other decisions, mean", later.mean(), MEAN_MS),
        ("other decisions, longest", later.max(), LONGEST_MS),
    ):
        yield row(f"auv{vehicle}: {name}", value_ms, "ms", goal=f"<= {goal_ms:g} ms", holds=value_ms <= goal_ms)
    yield row(f"auv{vehicle}: other decisions beyond {LONGEST_MS:g} ms", (later > LONGEST_MS).sum())
    if last > 2 * PART_LEGS:
        early = times_ms[(steps > 0) & (steps <= PART_LEGS)].mean()
        late = times_ms[steps > last - PART_LEGS].mean()
        yield row(f"auv{vehicle}: mean of legs 1 to {PART_LEGS}", early, "ms")
        yield row(f"auv{vehicle}: mean of the last {PART_LEGS} legs", late, "ms", "the first", late / early)


def flown(run: Path) -> Iterator[Row]:
    """The rows of the flight: wall-clock time of each vehicle's decisions, processor time, size of the recording."""
    decisions: dict[int, list[tuple[int, float]]] = {}
    path = recording_in(run)
    with Recording(path) as recording:
        for recorded in recording.values({"planner/bound"}):
            decisions.setdefault(recorded.vehicle, []).append((recorded.value.step, 1e3 * recorded.value.planning_s))
    for vehicle, found in sorted(decisions.items()):
        yield from _of_decisions(vehicle, found)
    clock = run / "logs" / "times.json"
    for name, value_s in json.loads(clock.read_text())["processor_s"].items() if clock.is_file() else ():
        yield row(f"{name}: processor time", value_s, "s")
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    size_mb = sum(file.stat().st_size for file in files) / 1e6
    yield row("recording", size_mb, "MB", goal=f"<= {RECORDING_MB:g} MB", holds=size_mb <= RECORDING_MB)


def decided_again(run: Path, vehicle: int) -> Iterator[Row]:
    """The rows of one vehicle's decisions, decided again from the recorded inputs: processor time, and memory.

    The memory is what map and planner take. In a recording of `scripts/mission`, maps are read instead of computed.
    """
    inputs = read_inputs(run)
    settings = Settings.from_patterns(inputs.parameters, str(run))
    decisions: list[tuple[int, float]] = []
    decide, before_mb, held_mb = VehiclePlanner.decide, private_mb(), [0.0]

    def timed(planner: VehiclePlanner, now_s: float) -> Decision:
        step, began_s = planner.decided, time.process_time()
        decision = decide(planner, now_s)
        decisions.append((step, 1e3 * (time.process_time() - began_s)))
        held_mb.append(private_mb() - before_mb)
        return decision

    with mock.patch.object(VehiclePlanner, "decide", timed):
        recompute_decisions(inputs.vehicles[vehicle], settings, inputs.lockstep, 1e-6, lambda share: None)
    yield from _of_decisions(vehicle, decisions)
    yield row(f"auv{vehicle}: largest memory", max(held_mb), "MB")


def measured(run: Path, out: Path) -> Iterator[Row]:
    """The rows of a flight, then those of the commands that read its recording.

    Raises:
        RuntimeError: if a command fails.
    """
    yield from flown(run)
    for name, module, options in COMMANDS:
        command = [sys.executable, "-m", module, str(run), *(part.format(out=out) for part in options)]
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        assert process.stderr is not None
        errors = process.stderr.read().decode()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s, memory_mb = time.perf_counter() - began, usage.ru_maxrss / 1024.0
        if process.returncode not in (0, 1, 3):  # certify: 1 and 3 are verdicts
            raise RuntimeError(f"{' '.join(command)}: exit code {process.returncode}: {errors}")
        is_report = name == "report"
        yield from (
            row(f"{name}: time", wall_s, "s", goal=f"<= {REPORT_S:g} s" if is_report else "",
                holds=wall_s <= REPORT_S if is_report else None),
            row(f"{name}: processor time", usage.ru_utime + usage.ru_stime, "s"),
            row(f"{name}: memory of the largest process", memory_mb, "MB",
                goal=f"<= {REPORT_MB:g} MB" if is_report else "",
                holds=memory_mb <= REPORT_MB if is_report else None),
        )  # fmt: skip


def run(*, smoke: bool = False) -> list[Row]:
    """Flies and records a mission, and measures."""
    legs, vehicles = SMOKE if smoke else FULL
    settings = Settings.load(None, {**square(legs, vehicles), "planner.method": "lawnmower"})
    with tempfile.TemporaryDirectory(prefix="auv_lse_") as folder:
        write_run(Fleet(settings, ground_of(settings)).run(), Path(folder))
        return list(measured(Path(folder), Path(folder)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the rows of a given recording, or of a mission flown here."""
    parser = parser_of("benchmarks.planning.report_time", __doc__)
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="run folder, or a recording")
    parser.add_argument("--again", type=int, metavar="VEHICLE", help="only decide again what a vehicle of RUN decided")
    options = parser.parse_args(arguments)
    if options.again is not None and options.run is None:
        parser.error("--again needs RUN")
    with tempfile.TemporaryDirectory(prefix="auv_lse_") as folder:
        if options.run is None:
            rows: Iterable[Row] = run()
        else:
            again = options.again
            rows = measured(options.run, Path(folder)) if again is None else decided_again(options.run, again)
        for each in rows:
            ratio = "" if each.get("ratio") is None else f" ({each['ratio']:.2f} times {each['against']})"
            print(f"{each['name']}: {each['value']:.1f} {each['unit']}{ratio}", flush=True)
    return 0


if __name__ == "__main__":
    end_with(main)
