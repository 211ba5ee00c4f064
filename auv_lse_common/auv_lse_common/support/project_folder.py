"""The project's folder: config/, and where runs, dives and campaigns go unless told otherwise."""

from __future__ import annotations

import os
from pathlib import Path


def project_folder() -> Path:
    """The folder that the scripts name (AUV_LSE_ROOT), else that of the source tree, else the working directory.

    A package that colcon has installed knows no source tree: there the nodes' commands work where they are called.
    """
    named = os.environ.get("AUV_LSE_ROOT")
    if named:
        return Path(named)
    source = Path(__file__).resolve().parents[2]
    return source if (source / "config" / "missions").is_dir() else Path.cwd()
