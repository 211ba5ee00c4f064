"""The whole default mission as real processes, by phase: where the time goes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

from auv_lse_sim.record.bag import read_run

GOAL_S = 180.0


def run() -> list[dict[str, Any]]:
    """Flies the default mission once and reads its times.

    Raises:
        RuntimeError: if the mission failed, with its output.
    """
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        command = [sys.executable, "-m", "auv_lse_sim.engine.mission", "--out", str(folder)]
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

    def row(name: str, value: float, unit: str = "s", goal: str = "", holds: bool | None = None) -> dict[str, Any]:
        return {
            "name": f"mission: {name}", "value": value, "unit": unit, "against": "whole", "ratio": None, "goal": goal,
            "holds": holds,
        } | ({"ratio": value / total} if unit == "s" else {"against": ""})  # fmt: skip

    rows = [
        row("start of the processes", wall["start"]),
        row("waiting for planners", waited),
        row("messaging, maps, simulation, recording", wall["mission"] - waited),
        row("end of the processes", wall["ending"]),
        row("evaluation and report", report),
        row("whole", total, goal=f"<= {GOAL_S:.0f} s", holds=total <= GOAL_S),
        row("one decision, mean", 1e3 * sum(decisions) / len(decisions), "ms"),
        row("mission time over wall clock while flying", summary["sim_s"] / wall["mission"], "x"),
        row("recording", size / 1e6, "MB"),
    ]
    kinds: dict[str, float] = defaultdict(float)
    for name, seconds in processor.items():
        kinds[name.split(".")[-1]] += seconds
    rows += [row(f"processor time of {kind}", seconds, "cpu s") for kind, seconds in sorted(kinds.items())]
    return rows
