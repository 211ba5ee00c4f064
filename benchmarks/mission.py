"""The whole default mission as real processes, with its time by phase and by node.

Also what the executor saves, as the ratio of two short missions, and the start and speed of a team of twenty.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.node.executor import CHOICE
from auv_lse_record.run_reader import read_run
from benchmarks.rows import Row, row

#: On two idle cores (s): the command until the report is there, until the first tick, processor time of everything.
GOAL_S, GOAL_START_S, GOAL_PROCESSOR_S = 45.0, 5.0, 70.0
GOAL_TEAM_START_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One mission flown.

    Attributes:
        wall_s: Wall clock by phase.
        whole_s: Wall clock from the command to its end.
        start_s: Processor time of each process until the first tick.
        processor_s: Processor time of each process until the mission's end.
        whole_processor_s: Processor time of all processes, the command's own with them, to the very end.
        report_processor_s: That of the evaluation and the report.
        summary: Its summary.json.
        planning_s: Wall clock of each decision, by the mission's time of its tick.
        recording_bytes: Size of the recording.
    """

    wall_s: dict[str, float]
    whole_s: float
    start_s: dict[str, float]
    processor_s: dict[str, float]
    whole_processor_s: float
    report_processor_s: float
    summary: dict[str, Any]
    planning_s: Mapping[float, list[float]]
    recording_bytes: int


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def fly(folder: Path, *arguments: str, **environment: str) -> Flight:
    """Flies a mission into a new run folder.

    Raises:
        RuntimeError: if it failed, with its output.
    """
    command = [sys.executable, "-m", "auv_lse_run", "mission", "--out", str(folder), *arguments]
    before_s, began = _children_s(), time.monotonic()
    process = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    processor_s, whole_s = _children_s() - before_s, time.monotonic() - began
    if process.returncode:
        raise RuntimeError(f"the mission ended with {process.returncode}: {process.stdout[-2000:]}")
    times = json.loads((folder / "logs" / "times.json").read_text())
    planning = defaultdict(list)
    for vehicle in read_run(folder).vehicles:
        for decision in vehicle.decisions:
            planning[decision.now_s].append(decision.wall_s)
    return Flight(
        wall_s=times["wall_s"],
        whole_s=whole_s,
        start_s=times["processor_start_s"],
        processor_s=times["processor_s"],
        whole_processor_s=processor_s,
        report_processor_s=times["processor_report_s"],
        summary=json.loads((folder / "summary.json").read_text()),
        planning_s=planning,
        recording_bytes=sum(path.stat().st_size for path in (folder / "bag").iterdir()),
    )


def _fly(*arguments: str, **environment: str) -> Flight:
    """As `fly`, into a folder that is not kept."""
    with tempfile.TemporaryDirectory() as parent:
        return fly(Path(parent) / "run", *arguments, **environment)


def run(*, smoke: bool = False) -> list[Row]:
    """Flies the default mission, or one vehicle for two steps as a smoke run, and what it is compared with.

    Raises:
        RuntimeError: if a mission failed, with its output.
    """
    flight = _fly(*(["--vehicles", "1", "--steps", "2"] if smoke else []))
    rows = [*_phases(flight), *_processes(flight)]
    return rows if smoke else [*rows, *_executors(), *_team()]


def _phases(flight: Flight) -> list[Row]:
    wall, planning = flight.wall_s, flight.planning_s
    # decisions of one tick run side by side: the tick waits for the slowest
    waited = sum(max(group) for group in planning.values())
    decisions = [seconds for group in planning.values() for seconds in group]
    total = flight.whole_s

    def part(name: str, seconds: float, goal_s: float | None = None) -> Row:
        goal, holds = ("", None) if goal_s is None else (f"<= {goal_s:.0f} s", seconds <= goal_s)
        return row(f"mission: {name}", seconds, "s", against="whole", ratio=seconds / total, goal=goal, holds=holds)

    return [
        part("the command itself, until it starts them and after the report", total - sum(wall.values())),
        part("start of the processes", wall["start"], GOAL_START_S),
        part("waiting for planners", waited),
        part("messaging, maps, simulation, recording", wall["mission"] - waited),
        part("end of the processes", wall["ending"]),
        part("evaluation and report", wall["report"]),
        part("whole, from the command to its end", total, GOAL_S),
        row("mission: one decision, mean", 1e3 * sum(decisions) / len(decisions), "ms"),
        row("mission: mission time over wall clock while flying", flight.summary["sim_s"] / wall["mission"], "x"),
        row("mission: recording", flight.recording_bytes / 1e6, "MB"),
    ]


def _processes(flight: Flight) -> list[Row]:
    """Processor time of each kind of node, at the start and while flying, and of everything."""
    start: dict[str, float] = defaultdict(float)
    flying: dict[str, float] = defaultdict(float)
    for name, seconds in flight.processor_s.items():
        kind = name.split(".")[-1] if name.endswith("_node") else "the vehicles' nodes"
        start[kind] += flight.start_s.get(name, 0.0)
        flying[kind] += seconds - flight.start_s.get(name, 0.0)
    whole_s = flight.whole_processor_s
    rows = []
    for kind in sorted(flying):
        for phase, seconds in (("start", start[kind]), ("flying", flying[kind])):
            name = f"mission: processor time of {kind}, {phase}"
            rows.append(row(name, seconds, "cpu s", against="whole", ratio=seconds / whole_s))
    rest_s = whole_s - sum(flight.processor_s.values())
    rows.append(row("mission: processor time of command, report, ending", rest_s, "cpu s", "whole", rest_s / whole_s))
    goal = f"<= {GOAL_PROCESSOR_S:.0f} cpu s"
    rows.append(row("mission: processor time, whole", whole_s, "cpu s", goal=goal, holds=whole_s <= GOAL_PROCESSOR_S))
    return rows


def _executors() -> list[Row]:
    """The same short mission by both executors: processor time while flying."""
    flying = {}
    for name in ("rclpy", "standing"):
        flight = _fly("--steps", "10", "--no-report", **{CHOICE: name})
        flying[name] = sum(flight.processor_s.values()) - sum(flight.start_s.values())
    ratio = flying["rclpy"] / flying["standing"]
    return [row("mission: processor time, 10 steps flying", flying["standing"], "cpu s", "rclpy's executor", ratio)]


def _team() -> list[Row]:
    """A team of twenty, for a few steps: does it start, and is it faster than the real one?"""
    flight = _fly("--vehicles", "20", "--steps", "3", "--no-report")
    start_s, speed = flight.wall_s["start"], flight.summary["sim_s"] / flight.wall_s["mission"]
    goal = f"<= {GOAL_TEAM_START_S:.0f} s"
    return [
        row("mission: 20 vehicles, start", start_s, "s", goal=goal, holds=start_s <= GOAL_TEAM_START_S),
        row("mission: 20 vehicles, mission time over wall clock", speed, "x", goal="> 1", holds=speed > 1.0),
    ]
