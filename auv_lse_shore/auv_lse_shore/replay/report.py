"""Renews the report of a mission from its recording."""

import json
import math
from pathlib import Path

from auv_lse_record.run_reader import read_run
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.judge.team_map import mission_settings
from auv_lse_shore.judge.true_ground import set_true_ground
from auv_lse_shore.report.progress import show_step
from auv_lse_shore.report.report import write_report
from auv_lse_shore.report.words import headlines


def report_again(run: Path, mission: Path | None, out: Path | None) -> list[str]:
    """Writes summary, isobath, figures and report page again.

    The true ground is known where the simulator's truth was recorded; a mission at sea has none.

    Args:
        run: The run folder, rosbag2 directory, or file of messages.
        mission: The mission file that was flown, if the recording does not hold it.
        out: Where to write, by default to the folder `run`, or beside the file `run`.

    Returns:
        The main figures, and where the page is: one line each.

    Raises:
        RecordingError: if it cannot be read.
        ParameterError: if its mission file does not fit this version of the software.
        OSError: if the folder cannot be written.
    """
    folder = out or (run if run.is_dir() else run.parent)
    show_step(f"reading {run}")
    data = read_run(run, mission=mission, wall_s=_wall_s(folder), read_area=read_area)
    set_true_ground(data, str(run))
    summary = write_report(data, folder, show_step)
    planned_steps = mission_settings(data.parameters, 1)[0].mission.steps
    return [*data.notes, *headlines(summary, planned_steps, data), str(folder / "report.html")]


def _wall_s(folder: Path) -> float:
    """The mission's wall-clock time (s) from the folder's summary; NaN without one."""
    try:
        found = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError, RecursionError):
        return math.nan
    value = found.get("wall_s") if isinstance(found, dict) else None
    return float(value) if isinstance(value, int | float) else math.nan
