"""Time and memory of the report, certificate and export of a long mission's recording.

    python -m benchmarks.planning.report_time [RUN]

Without RUN, a mission of three vehicles and 1,200 legs is flown in the fleet engine first, which takes much longer. Its
method is `lawnmower`, which plans fastest. The fleet engine publishes no maps, so the certificate of its recording
compares none: to measure that, give a recording of `scripts/mission`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_writer import write_run
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from benchmarks.command import end_with
from benchmarks.planning.day import square
from benchmarks.rows import Row, row

#: Legs and vehicles of the mission.
FULL, SMOKE = (1200, 3), (4, 1)
#: Goals of the report: wall-clock time (s), and memory of its largest process (MB).
REPORT_S, REPORT_MB = 60.0, 1500.0
#: What is measured: name, module and options.
COMMANDS = (
    ("report", "auv_lse_shore.replay", ("--report", "--out", "{out}")),
    ("certificate", "auv_lse_shore.certify", ("--out", "{out}/certificate")),
    ("export", "auv_lse_shore.export", ("--out", "{out}/export")),
)


def measured(run: Path, out: Path) -> Iterator[Row]:
    """The rows of a recording.

    Raises:
        RuntimeError: if a command fails.
    """
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
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning.report_time", description=__doc__)
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="run folder, or a recording")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="auv_lse_") as folder:
        for each in run() if options.run is None else measured(options.run, Path(folder)):
            print(f"{each['name']}: {each['value']:.1f} {each['unit']}", flush=True)
    return 0


if __name__ == "__main__":
    end_with(main)
