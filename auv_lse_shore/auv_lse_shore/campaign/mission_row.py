"""One mission of a campaign: simulated, evaluated, and summarized in a result row."""

import dataclasses
import os
import socket
import tempfile
import time
import traceback
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_data import RunData
from auv_lse_record.software import version
from auv_lse_shore.campaign.rows import CURVES, names_of
from auv_lse_shore.campaign.spec import Job
from auv_lse_shore.check.machine import check_priors
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.chart import with_chart
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import START_MOVED, fit_to_ground

#: Number of steps at which a mission's bounds are recomputed for its row.
BOUNDS = 11


def simulate(patterns: Mapping[str, Mapping[str, Any]], where: str, folder: Path) -> RunData:
    """Simulates a mission in this process; area and starts are fitted to the ground, as auv_lse mission does.

    The run's notes name starts that were moved.

    Args:
        patterns: Its complete mission file.
        folder: An existing folder for the chart of `sim.chart`; the evaluation needs it too.
    """
    settings = Settings.from_patterns(patterns, where)
    ground = ground_of(settings)
    settings, notes = fit_to_ground(settings, ground)
    check_priors(settings)
    run = Fleet(with_chart(settings, folder), ground).run()
    run.notes += [note for note in notes if note.startswith(START_MOVED)]
    return run


def simulate_and_evaluate(patterns: Mapping[str, Mapping[str, Any]], where: str, bounds: int = 34) -> Evaluation:
    """A mission simulated and evaluated in this process; `bounds` as for `evaluate`."""
    with tempfile.TemporaryDirectory(prefix="auv_lse_") as folder:
        return evaluate(simulate(patterns, where, Path(folder)), bounds)


def mission_row(job: Job) -> dict[str, Any]:
    """Simulates and evaluates one mission; its result row. An error becomes part of the row."""
    began = time.perf_counter()
    row = row_head(job)
    try:
        evaluation = simulate_and_evaluate(job.patterns, f"mission {job.id}", BOUNDS)
        row.update(_results(evaluation))
        row["status"] = "ok"
        row["error"] = "; ".join(evaluation.run.notes) or None
    except Exception as error:  # any error: the other missions continue
        row["status"] = "failed"
        row["error"] = f"{type(error).__name__}: {error}"
        row["traceback"] = traceback.format_exc()
    row["busy_s"] = time.perf_counter() - began
    row["finished_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
    row["worker"] = f"{socket.gethostname()}:{os.getpid()}"
    return row


def failed_row(job: Job, error: BaseException) -> dict[str, Any]:
    """The row of a mission whose workers died."""
    return {
        **row_head(job),
        "status": "failed",
        "error": f"{type(error).__name__}: {error}",
        "finished_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def row_head(job: Job) -> dict[str, Any]:
    """The columns that are known before the mission is simulated."""
    text = yaml.safe_dump(job.patterns, sort_keys=False)
    return {**names_of(job), "version": version(), "parameters": text}


def _results(e: Evaluation) -> dict[str, Any]:
    values = {field.name: getattr(e.summary, field.name) for field in dataclasses.fields(e.summary)}
    return {**values, **{name: getattr(e.curves, name).tolist() for name in CURVES}}
