"""The files that the project ships: missions, campaigns, viewer layouts, the systemd unit. No checkout is needed."""

from pathlib import Path

FOLDER = Path(__file__).with_name("shipped")


def shipped_file(name: str) -> Path:
    """The path of a shipped file.

    Args:
        name: "missions/default.yaml", or only its last part.

    Raises:
        FileNotFoundError: if there is none, with the names of all.
    """
    found = [path for path in _paths() if name in (path.name, path.relative_to(FOLDER).as_posix())]
    if len(found) != 1:
        raise FileNotFoundError(f"no shipped file is called {name}; there are {', '.join(shipped_files())}")
    return found[0]


def shipped_files() -> list[str]:
    """The names of all shipped files, such as "missions/default.yaml"."""
    return [path.relative_to(FOLDER).as_posix() for path in _paths()]


def _paths() -> list[Path]:
    return sorted(path for path in FOLDER.glob("*/*") if path.is_file())
