"""Simulates a study: an estimate of its time, and its campaigns one after the other."""

import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.campaign.progress_display import progress_display
from auv_lse_shore.campaign.rows import Rows, columns_of
from auv_lse_shore.campaign.runner import CampaignState, locked, run_campaign
from auv_lse_shore.reproduce.study import Study


def estimate_s(study: Study, folder: Path, client: Any, threads: int, say: Callable[[str], object]) -> float:
    """Time (s) that the missions without a row will take.

    A setting with rows takes their mean time. For the others a tenth of a mission is simulated, and counts tenfold.

    Args:
        say: Takes a line for the user before the trial missions, and one after each of them.
    """
    from distributed import as_completed

    total = 0.0
    probes: dict[tuple[str, str], Any] = {}
    left: dict[tuple[str, str], int] = {}
    for name, spec in study.selected.items():
        rows = Rows(folder / name, columns_of(spec)).read()
        have = {row["id"] for row in rows if row["status"] == "ok"}
        for job in spec.jobs():
            if job.id in have:
                continue
            known = [row["busy_s"] for row in rows if row["group"] == job.group and row["busy_s"]]
            if known:
                total += sum(known) / len(known)
                continue
            common = job.patterns["/**"]
            kind = (name, str(common["planner"]["method"]))
            left[kind] = left.get(kind, 0) + 1
            if kind not in probes:
                short = max(2, int(common["mission"]["steps"]) // 10)
                probe = json.loads(json.dumps(job.patterns))
                probe["/**"]["mission"]["steps"] = short
                probes[kind] = client.submit(_probe_s, probe, common["mission"]["steps"] / short, pure=False)
    kinds = {future.key: kind for kind, future in probes.items()}
    if probes:
        say(f"estimating the time by {len(probes)} short missions")
    for done, future in enumerate(as_completed(probes.values()), 1):  # interrupted, `gather` logs a traceback
        say(f"  {done} of {len(probes)}")
        total += left[kinds[future.key]] * future.result()
    return total / threads


def _probe_s(patterns: Mapping[str, Any], factor: float) -> float:
    simulate_and_evaluate(patterns, "probe", 3)  # compiles and warms the caches
    began = time.perf_counter()
    simulate_and_evaluate(patterns, "probe", 3)
    return (time.perf_counter() - began) * factor


def run_study(
    study: Study, folder: Path, client: Any, finished: Callable[[str, CampaignState], object]
) -> dict[str, CampaignState]:
    """Simulates all campaigns of a study; within a budget, each gets its share of the remaining time.

    Missions that failed earlier are repeated.

    Args:
        folder: Its folder; each campaign has one of its name in it.
        client: `distributed.Client` of the cluster.
        finished: Called with the name and the state of each campaign when it has ended.

    Raises:
        ParameterError: if a setting cannot be used.
        CampaignError: if another process works on the folder, or the cluster is gone.
    """
    began = time.monotonic()
    states = {}
    for index, (name, spec) in enumerate(study.selected.items()):
        left = study.budget_s - (time.monotonic() - began)
        share = left * (0.8 if index == 0 and len(study.selected) > 1 else 1.0)
        most = "" if math.isinf(study.budget_s) else "as many as the time allows of "
        print(f"{name}: {len(spec.settings)} settings, {most}{len(spec.seeds)} seeds", flush=True)
        with locked(folder / name), progress_display() as show:
            states[name] = run_campaign(spec, folder / name, client, retry_failed=True, budget_s=share, progress=show)
        finished(name, states[name])
    return states
