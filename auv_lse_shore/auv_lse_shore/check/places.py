"""Describes what was used of a mission file's file of places, and what was ignored."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.parameter_file import read_yaml
from auv_lse_common.mission_file.places_file import Places, read_places

#: Largest number of ignored features that are listed by name.
_MAX_LISTED = 8


def places_notes(mission: Path, area_file: Path | None = None) -> list[str]:
    """Sentences about a file of places; none if the mission has no such file.

    Args:
        mission: A mission file that could be read.
        area_file: File of places that replaces that of the mission file.

    Raises:
        ParameterError: if a file cannot be read.
    """
    files = [area_file] if area_file is not None else _files_of(mission)
    return [text for file in files for text in _notes(file, read_places(file))]


def _files_of(mission: Path) -> list[Path]:
    """The values of `area.file` in a mission file."""
    bodies = [body.get("ros__parameters") or {} for body in read_yaml(mission).values()]
    names = [body.get("area.file") for body in bodies]
    names += [body["area"].get("file") for body in bodies if isinstance(body.get("area"), dict)]
    return [mission.parent / name for name in names if name]


def _notes(file: Path, places: Places) -> list[str]:
    used = ["the area"] if places.area is not None else []
    used += [f"no-go area {name}" for name in places.no_go]
    used += ["the shore"] if places.shores else []
    used += [f"start of auv{number}" for number in sorted(places.starts)]
    used += [
        f"recovery place of {f'auv{number}' if number else 'all vehicles'}" for number in sorted(places.recoveries)
    ]
    notes = [f"{file.name}: used {', '.join(used)}"]
    if places.ignored:
        names = [repr(name) for name in places.ignored[:_MAX_LISTED]]
        more = f" and {len(places.ignored) - _MAX_LISTED} more" if len(places.ignored) > _MAX_LISTED else ""
        notes.append(
            f"{file.name}: ignored {', '.join(names)}{more}; only polygons, shores, starts and recovery places are used"
        )
    return notes
