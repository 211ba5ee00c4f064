"""The whole default mission as real processes, by phase: where the time goes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from auv_lse_sim.record.bag import read_run
from benchmarks.rows import Row, row

GOAL_S = 180.0


def run(*, smoke: bool = False) -> list[Row]:
    """Flies the default mission once, or one vehicle for two steps as a smoke run, and reads its times.

    Raises:
        RuntimeError: if the mission failed, with its output.
    """
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        command = [sys.executable, "-m", "auv_lse_sim.engine.mission", "--out", str(folder)]
        command += ["--vehicles", "1", "--steps", "2"] if smoke else []
        process = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ})
        if process.returncode:
            raise RuntimeError(f"the mission ended with {process.returncode}: {process.stdout[-2000:]}")
        times = json.loads((folder / "logs" / "times.json").read_text())
        summary = json.loads((folder / "summary.json").read_text())
        planning = defaultdict(list)
        for vehicle in read_run(folder).vehicles:
            for decision in vehicle.decisions:
                planning[decision.now_s].append(decision.wall_s)
        size = sum(path.stat().st_size for path in (folder / "bag").iterdir())
    wall, processor = times["wall_s"], times["processor_s"]
    # decisions of one tick run side by side: the tick waits for the slowest
    waited = sum(max(group) for group in planning.values())
    decisions = [seconds for group in planning.values() for seconds in group]
    report = wall["report"]
    total = sum(wall.values())

    def part(name: str, seconds: float, goal: str = "", holds: bool | None = None) -> Row:
        share = seconds / total
        return row(f"mission: {name}", seconds, "s", against="whole", ratio=share, goal=goal, holds=holds)

    rows = [
        part("start of the processes", wall["start"]),
        part("waiting for planners", waited),
        part("messaging, maps, simulation, recording", wall["mission"] - waited),
        part("end of the processes", wall["ending"]),
        part("evaluation and report", report),
        part("whole", total, goal=f"<= {GOAL_S:.0f} s", holds=total <= GOAL_S),
        row("mission: one decision, mean", 1e3 * sum(decisions) / len(decisions), "ms"),
        row("mission: mission time over wall clock while flying", summary["sim_s"] / wall["mission"], "x"),
        row("mission: recording", size / 1e6, "MB"),
    ]
    kinds: dict[str, float] = defaultdict(float)
    for name, seconds in processor.items():
        kinds[name.split(".")[-1]] += seconds
    rows += [row(f"mission: processor time of {kind}", seconds, "cpu s") for kind, seconds in sorted(kinds.items())]
    return rows
