"""Repeats the mission of one row with full recording."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import pyarrow.parquet
import yaml

from auv_lse_record.run_writer import write_run
from auv_lse_shore.campaign.cluster import CampaignError
from auv_lse_shore.campaign.mission_row import BOUNDS, simulate
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.report.report import write_outputs


def rerun(folder: Path, wanted: str, to: Path | None) -> tuple[Path, list[str]]:
    """Repeats the mission of one row with full recording, into a run folder with bag, summary, figures and report.

    Args:
        wanted: The row's id, or its first characters.
        to: Run folder; None for one in the campaign's folder.

    Returns:
        The run folder, and the summary keys that differ from the row (except times).

    Raises:
        CampaignError: if no row or several rows match.
        Exception: the error with which the mission fails.
    """
    paths = sorted((folder / "rows").glob(f"{wanted}*.parquet"))
    if len(paths) != 1:
        found = ", ".join(path.stem for path in paths[:3]) or "none"
        raise CampaignError(
            f"--rerun {wanted}: {len(paths)} missions of {folder} have ids that begin with it ({found}). "
            "auv_lse campaign SPEC.yaml --out DIR --list shows the ids"
        )
    (row,) = pyarrow.parquet.read_table(paths[0]).to_pylist()
    to = to or folder / "reruns" / str(row["id"])
    if to.exists() and any(to.iterdir()):
        raise CampaignError(f"{to} is not empty. Choose a new folder with --to")
    to.mkdir(parents=True, exist_ok=True)
    run = simulate(yaml.safe_load(row["parameters"]), f"mission {row['id']}", to)
    write_run(run, to)
    summary = write_outputs(evaluate(run, BOUNDS), to)
    now = {field.name: getattr(summary, field.name) for field in dataclasses.fields(summary)}
    timed = {"wall_s", "planning_median_s", "planning_max_s"}
    changed = [name for name, value in now.items() if name not in timed and not _same(value, row.get(name))]
    return to, changed if row["status"] == "ok" else []


def _same(now: Any, then: Any) -> bool:
    if isinstance(now, tuple):
        return isinstance(then, list) and len(now) == len(then) and all(map(_same, now, then))
    if isinstance(now, float) and math.isnan(now):
        return then is None or bool(then != then)
    return bool(now == then)
