"""Describes what was used of a mission file's file of positions, and what was ignored."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.parameter_file import read_yaml
from auv_lse_common.mission_file.position_roles import Positions
from auv_lse_common.mission_file.positions_file import read_positions

#: Largest number of ignored features that are listed by name.
_MAX_LISTED = 8


def positions_notes(mission: Path, area_file: Path | None = None) -> list[str]:
    """Sentences about a file of positions; none if the mission has no such file.

    Args:
        mission: A mission file that could be read.
        area_file: File of positions that replaces that of the mission file.

    Raises:
        ParameterError: if a file cannot be read.
    """
    files = [area_file] if area_file is not None else _files_of(mission)
    return [text for file in files for text in _notes(file, read_positions(file))]


def _files_of(mission: Path) -> list[Path]:
    """The values of `area.file` in a mission file."""
    bodies = [body.get("ros__parameters") or {} for body in read_yaml(mission).values()]
    names = [body.get("area.file") for body in bodies]
    names += [body["area"].get("file") for body in bodies if isinstance(body.get("area"), dict)]
    return [mission.parent / name for name in names if name]


def _notes(file: Path, positions: Positions) -> list[str]:
    used = ["the area"] if positions.area is not None else []
    used += [f"no-go area {name}" for name in positions.no_go]
    used += ["the shore"] if positions.shores else []
    used += [f"start of auv{number}" for number in sorted(positions.starts)]
    used += [
        f"recovery position of {f'auv{number}' if number else 'all vehicles'}"
        for number in sorted(positions.recoveries)
    ]
    notes = [f"{file.name}: used {', '.join(used)}"]
    if positions.ignored:
        names = [repr(name) for name in positions.ignored[:_MAX_LISTED]]
        more = f" and {len(positions.ignored) - _MAX_LISTED} more" if len(positions.ignored) > _MAX_LISTED else ""
        notes.append(
            f"{file.name}: ignored {', '.join(names)}{more}; it uses polygons, shores, starts and recovery positions"
        )
    return notes
