"""`auv_lse wheels`: builds a wheel of each Python package of a checkout."""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from auv_lse_common.support.project_folder import project_folder


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse wheels."""
    p = argparse.ArgumentParser(
        prog="auv_lse wheels",
        description="Builds a wheel of each Python package into DIR. They install without ROS and without a checkout: "
        "python -m pip install --find-links DIR auv_lse_shore",
        epilog="Exit codes: 0; 1 a wheel cannot be built; 2 wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("folder", nargs="?", type=Path, metavar="DIR", help="folder of the wheels (default: build/wheels)")
    return p


def run(options: argparse.Namespace) -> int:
    """Builds the wheels; returns the exit code."""
    root = project_folder()
    folder = (options.folder or root / "build" / "wheels").resolve()
    sources = [path.parent for path in sorted(root.glob("auv_lse_*/setup.py"))]
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
    command += ["--no-build-isolation", "--wheel-dir", str(folder), *map(str, sources)]
    # Wheels name each other by version, not by path.
    done = subprocess.run(command, env={**os.environ, "AUV_LSE_WHEELS": "1"}, check=False)
    if done.returncode == 0:
        print(f"wheels: {folder}")
    return int(done.returncode != 0)
