"""Beside a mission of `ros2 launch`: shows its progress, and reports its recording as auv_lse mission does.

The launch file starts `python -m auv_lse_shore.mission.launched RUN_FOLDER` where this package is installed. SIGINT
starts the report; `ros2 launch` sends it when the mission has ended or Ctrl-C is pressed. A second one interrupts the
report. If the simulator stops the mission, the process reports why and ends, which ends the launch.
"""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from auv_lse_common.mission_file.settings import Settings
from auv_lse_run.mission.conductor import MissionError, follow, write_times
from auv_lse_run.mission.display import progress_of
from auv_lse_run.process.interrupt import Interrupt
from auv_lse_run.process.processes import LAST_STOP_S
from auv_lse_shore.mission.mission import report_mission

_PERIOD_S = 0.1


def main(arguments: Sequence[str] | None = None) -> int:
    """Follows the mission of a run folder to its end; returns the exit code of auv_lse mission."""
    folder = Path((sys.argv[1:] if arguments is None else arguments)[0])
    settings, console, interrupt = Settings.load(folder / "mission.yaml"), Console(), Interrupt()
    progress = progress_of(settings)
    try:
        marks = follow(progress, dict(os.environ), console, interrupt)
    except MissionError as error:
        console.print(f"error: {error}", soft_wrap=True)
        return 1
    is_complete = progress.phase == "finished"
    if "running" not in marks:
        console.print("interrupted before the first tick: nothing was recorded")
        return 130
    if not settings.record.folder:
        console.print("the mission was not recorded, so there is no report; record:=true records it", soft_wrap=True)
        return 0 if is_complete else 130
    until_s = time.monotonic() + LAST_STOP_S
    while not (interrupt.came and _is_closed(settings)) and time.monotonic() < until_s:
        time.sleep(_PERIOD_S)
    phases = write_times(folder, marks, {}, {})
    interrupt.release()
    return report_mission(folder, settings, time.monotonic() - marks["began"], phases, console, is_complete=is_complete)


def _is_closed(settings: Settings) -> bool:
    """Whether the recorder has completed the recording."""
    return (Path(settings.record.folder) / "metadata.yaml").exists()


if __name__ == "__main__":
    sys.exit(main())
