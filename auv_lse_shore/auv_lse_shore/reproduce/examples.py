"""One fully recorded mission of each kind, for the paper's figures: simulated once, then read from its run folder."""

from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.atomic_files import written_whole
from auv_lse_record import run_reader, run_writer
from auv_lse_record.run_data import GroundGrid
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_shore.report.report import write_outputs
from auv_lse_shore.reproduce.study import Study, trial_name


def examples(study: Study, folder: Path, client: Any) -> dict[tuple[int, str], Evaluation]:
    """One mission of each of the study's `examples`, with full recording.

    Its seed is the trials' first, chosen in advance. Without a client, only those that exist already.
    """
    spec = study.campaigns["trials"]
    wanted = {trial_name(k, m): (k, m) for k, m in study.examples}
    jobs = {wanted[job.group]: job for job in spec.jobs() if job.seed == spec.seeds[0] and job.group in wanted}
    folders = {key: folder / "examples" / f"{key[0]}_auvs_{key[1]}" for key in jobs}
    flights = {
        key: client.submit(simulate_and_evaluate, job.patterns, f"example {job.group}", pure=False)
        for key, job in jobs.items()
        if client is not None and not folders[key].exists()
    }
    found: dict[tuple[int, str], Evaluation] = {}
    for key, run_folder in folders.items():
        if key in flights:
            found[key] = flights[key].result()
            _keep(found[key], run_folder)
        elif run_folder.exists():
            found[key] = evaluate(run_reader.read_run(run_folder, ground=_kept_ground(run_folder / "ground.npz")))
    return found


def _keep(evaluation: Evaluation, run_folder: Path) -> None:
    """Writes a run folder, complete or not at all."""
    with written_whole(run_folder.parent) as part:
        run = part / run_folder.name
        run_writer.write_run(evaluation.run, run)
        _keep_ground(evaluation.run.ground, run / "ground.npz")
        write_outputs(evaluation, run)


def _keep_ground(ground: GroundGrid | None, path: Path) -> None:
    if ground is not None:
        np.savez_compressed(
            path, north_m=ground.north_m, east_m=ground.east_m, depth_m=ground.depth_m, inside=ground.inside
        )


def _kept_ground(path: Path) -> GroundGrid | None:
    if not path.exists():
        return None
    with np.load(path) as kept:
        return GroundGrid(**{name: kept[name] for name in ("north_m", "east_m", "depth_m", "inside")})
