"""The worked example of docs/extending/adding-a-method.md, built in a scratch tree and flown."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "extending" / "adding-a-method.md"
PACKAGES = ("auv_lse_common", "auv_lse_planner")

FLIGHT = """
import json
import auv_lse_planner.methods.waypoints as own
from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of

settings = Settings.load(None, {"planner.method": "cma_es", "planner.horizon": 4, "planner.iterations": 10,
                                "mission.vehicles": 1, "mission.steps": 6})
fleet = Fleet(settings, ground_of(settings))
run = fleet.run()
planner = fleet.cores[0].planner
paths = [planner.rollout.follow(d.plan).from_step(d.step) for d in run.vehicles[0].decisions]
positions = [path.states[:2, 1:].tolist() for path in paths]
print(json.dumps({
    "file": own.__file__,
    "family": type(planner._method).__name__,
    "iterations": [r.iterations for r in planner.records],
    "clearance_m": [planner.space.clearance_m(*position) for leg in positions for position in leg],
}))
"""


def build(folder: Path) -> list[str]:
    """Writes the page's code into copies of the packages; returns the files that it touches."""
    page, touched = PAGE.read_text(), []
    for section in re.split(r"^## ", page, flags=re.MULTILINE)[2:5]:
        (path,) = re.findall(r"`(auv_lse_\w+/auv_lse_\w+/[\w/]+\.py)`", section)[:1]
        touched.append(path)
        for block in re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL):
            file, first = folder / path, block.splitlines()[0] + "\n"
            text = file.read_text() if file.exists() else ""
            assert not text or text.count(first) == 1, f"{path} has no single line {first!r}"
            file.write_text(text.replace(first, block) if text else block)
    return touched


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("method")
    for package in PACKAGES:
        for source in (ROOT / package / package).rglob("*"):
            if source.is_file() and "__pycache__" not in source.parts:
                target = folder / source.relative_to(ROOT)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(source.read_bytes())
    touched = build(folder)
    assert len(set(touched)) == 3
    return folder


def test_the_method_of_the_page_decides_and_keeps_in_the_area(scratch: Path) -> None:
    path = os.pathsep.join([*(str(scratch / package) for package in PACKAGES), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": path, "AUV_LSE_NUMBA": "0"}  # to compile a new tree takes a minute
    done = subprocess.run([sys.executable, "-c", FLIGHT], env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    flown = json.loads(done.stdout.splitlines()[-1])
    assert flown["file"].startswith(str(scratch))
    assert flown["family"] == "Waypoints"
    assert len(flown["iterations"]) == 6
    assert min(flown["iterations"]) > 1
    assert min(flown["clearance_m"]) >= 0.0


def test_the_example_passes_the_projects_linter(scratch: Path) -> None:
    pytest.importorskip("ruff")
    own = scratch / "auv_lse_planner" / "auv_lse_planner" / "methods" / "waypoints.py"
    command = [sys.executable, "-m", "ruff", "check", "--config", str(ROOT / "pyproject.toml"), str(own)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=scratch)
    assert done.returncode == 0, done.stdout
