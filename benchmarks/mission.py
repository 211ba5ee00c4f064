"""A mission as real processes, with the processor time of each."""

import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One mission flown.

    Attributes:
        start_s: Processor time of each process until the first tick.
        processor_s: Processor time of each process until the mission's end.
        whole_processor_s: Processor time of all processes, the command's own with them, to the very end.
        report_processor_s: That of the evaluation and the report.
    """

    start_s: dict[str, float]
    processor_s: dict[str, float]
    whole_processor_s: float
    report_processor_s: float


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def fly(folder: Path, *arguments: str, **environment: str) -> Flight:
    """Flies a mission into a new run folder.

    Raises:
        RuntimeError: if it failed, with its output.
    """
    command = [sys.executable, "-m", "auv_lse_run", "mission", "--out", str(folder), *arguments]
    before_s = _children_s()
    process = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    processor_s = _children_s() - before_s
    if process.returncode:
        raise RuntimeError(f"the mission ended with {process.returncode}: {(process.stdout + process.stderr)[-2000:]}")
    times = json.loads((folder / "logs" / "times.json").read_text())
    return Flight(
        start_s=times["processor_start_s"],
        processor_s=times["processor_s"],
        whole_processor_s=processor_s,
        report_processor_s=times["processor_report_s"],
    )
