"""The project's folder, with config/ and the default folders of runs, dives and campaigns."""

import os
from pathlib import Path


def project_folder() -> Path:
    """The folder in AUV_LSE_ROOT (set by the scripts), else the source tree, else the working directory."""
    named = os.environ.get("AUV_LSE_ROOT")
    if named:
        return Path(named)
    source = Path(__file__).resolve().parents[3]
    return source if (source / "config" / "missions").is_dir() else Path.cwd()
