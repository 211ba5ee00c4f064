"""The environment of a public planner, sgptools, which needs TensorFlow: installs it, and asks it for paths."""

import json
import subprocess
import sys
import venv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PEER = "sgptools==2.0.7"


def installer(python: Path) -> list[str]:
    """The command that installs a package into the environment of a Python."""
    return [str(python), "-m", "pip", "install", "-q"]


def environment(folder: Path) -> Path:
    """The Python of an environment with the peer in it; made first if it is not there.

    Raises:
        SystemExit: if the peer cannot be installed; the folder and pip's words are named.
    """
    python = folder / "bin" / "python"
    ready = folder / "peer-installed"
    if ready.exists() and ready.read_text() == PEER:
        return python
    print(f"installing {PEER} into {folder} (3 GB, some minutes) ...", file=sys.stderr, flush=True)
    venv.create(folder, with_pip=True)
    done = subprocess.run([*installer(python), PEER], check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{PEER} could not be installed into {folder}; pip said:\n{done.stderr.strip()[-2000:]}")
    ready.write_text(PEER)
    return python


def answer(python: Path, wanted: Mapping[str, Any]) -> list[list[list[float]]]:
    """What `peer_path.py` plans in the environment: for each vehicle waypoints (n, 2), north and east (m).

    Raises:
        SystemExit: if it fails; its last words are in the text.
    """
    script = Path(__file__).with_name("peer_path.py")
    done = subprocess.run([python, script], input=json.dumps(wanted), check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{script.name} failed in {python}:\n{done.stderr.strip()[-2000:]}")
    paths: list[list[list[float]]] = json.loads(done.stdout)
    return paths
