"""Exports a mission's results to files for other programs."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

from auv_lse_common.support.atomic_files import written_whole
from auv_lse_common.support.plurals import counted
from auv_lse_record.run_reader import read_run
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.export.content import Export, ExportError
from auv_lse_shore.export.formats import formats
from auv_lse_shore.export.survey import Survey
from auv_lse_shore.judge.team_map import TeamMap, team_map


def export(run_folder: Path, folder: Path, picture: bool = False, survey: Survey | None = None) -> Iterator[str]:
    """Exports a run folder in every format into `folder`, which is made if needed; yields its progress, line by line.

    Raises:
        SurveyError: if a correction does not cover the recording.
        ExportError: if a format cannot be written.
        RecordingError, ParameterError: if the run folder cannot be read.
    """
    for module in formats():
        _check(module)
    yield f"reading {run_folder}"
    survey = survey or Survey()
    run = survey.reduce(read_run(run_folder, read_area=read_area))
    yield from run.notes
    yield f"mapping {counted(sum(len(v.soundings) for v in run.vehicles), 'sounding')}"
    yield from write_export(team_map(run), folder, survey, picture)


def write_export(team: TeamMap, folder: Path, survey: Survey, picture: bool = False) -> Iterator[str]:
    """Writes every format that can be written, all of them or nothing; yields what it writes, line by line.

    Args:
        team: The map, from soundings that `survey` has reduced.
        folder: Where the files go, made if needed.
        picture: Whether to draw `export.png` from the files.

    Raises:
        OSError: naming `folder` or the file.
    """
    yield f"writing to {folder}"
    discarded = set[str]()
    with written_whole(folder, discarded) as part:
        content = Export(team=team, folder=part, survey=survey, discarded=discarded)
        yield from write_formats(content, picture)
    yield from about_depths(content)


def write_formats(content: Export, picture: bool = False) -> Iterator[str]:
    """Writes every format that can be written into the content's folder; yields what it writes, line by line."""
    for module in formats():
        try:
            _check(module)
        except ExportError as error:
            yield f"  skipped: {error}"
        else:
            yield f"  {module.write(content)}"
    content.discard("export.png")
    if picture:
        from auv_lse_shore.export.picture import draw_export

        draw_export(content.folder, content.folder / "export.png")
        yield "  export.png"


def about_depths(content: Export) -> Iterator[str]:
    """Lines on the coordinates and depths of an export."""
    survey = content.survey
    yield f"coordinates: {content.reference.describe()}"
    depths = np.concatenate([vehicle.soundings.depth_m for vehicle in content.team.run.vehicles])
    if not len(depths):
        yield "depths: none was measured; the map shows the prior"
        return
    yield f"depths: {depths.min():.1f} to {depths.max():.1f} m below {survey.datum or f'the {survey.vertical_datum}'}"


def _check(module: ModuleType) -> None:
    getattr(module, "check", lambda: None)()
