"""Wheels in an empty folder of a machine without a checkout: every verb works or names what it lacks.

It also builds the worked example of docs/extending/adding-a-verb.md as a package of its own.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

if importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs the built workspace (scripts/test sets it up)", allow_module_level=True)

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "extending" / "adding-a-verb.md"
PACKAGES = tuple(
    f"auv_lse_{name}" for name in ("common", "run", "gp", "planner", "comms", "mavlink", "record", "sim", "shore")
)
#: Loads the parser of every verb; prints "verb: ok", or why it is not to be had.
PARSERS = """
import importlib
from auv_lse_run.command.find_verbs import PACKAGE_OF, find_verbs
from auv_lse_run.command.main import CommandError, _check_needs
verbs, problems = find_verbs()
assert not problems, problems
assert set(PACKAGE_OF) <= set(verbs)
for name, verb in verbs.items():
    try:
        _check_needs(verb)
    except CommandError as error:
        print(f"{name}: {error}")
        continue
    module = importlib.import_module(verb.module)
    assert module.parser().format_help().startswith("usage: auv_lse")
    assert module.__file__.startswith(SITE), module.__file__
    print(f"{name}: ok")
"""
#: Loads every node as the fork server does.
NODES = """
import importlib.metadata
nodes = importlib.metadata.entry_points(group="auv_lse.nodes")
assert len(nodes) == 8, nodes
for entry in nodes:
    assert callable(entry.load())
"""


def wheels_of(sources: list[Path], folder: Path) -> None:
    """Builds wheels and unpacks them."""
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-w", folder / "wheels"]
    environment = {**os.environ, "AUV_LSE_WHEELS": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    done = subprocess.run([*command, *sources], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    for wheel in (folder / "wheels").glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "site")


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A machine with wheels and messages alone: an empty working folder, and the environment of a new user."""
    folder = tmp_path_factory.mktemp("machine")
    example = folder / "example"
    (example / "lake_tools").mkdir(parents=True)
    setup, verbs, module = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for name, text in (("setup.py", setup), ("lake_tools/__init__.py", ""), ("lake_tools/verbs.py", verbs)):
        (example / name).write_text(text)
    (example / "lake_tools" / "deepest.py").write_text(module)
    wheels_of([*(ROOT / package for package in PACKAGES), example], folder)
    found = importlib.util.find_spec("auv_lse_msgs")
    assert found is not None
    assert found.origin is not None
    (folder / "messages").mkdir()
    for path in Path(found.origin).parents[1].glob("auv_lse_msgs*"):  # with its version
        (folder / "messages" / path.name).symlink_to(path)
    kept = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    paths = [folder / "site", folder / "messages"]
    for name in ("home", "empty"):
        (folder / name).mkdir()
    own = {"HOME": str(folder / "home"), "PYTHONPATH": os.pathsep.join(map(str, paths)), "OMP_NUM_THREADS": "1"}
    return folder, {**kept, **own}


def run(machine: tuple[Path, dict[str, str]], *command: str) -> subprocess.CompletedProcess[str]:
    folder, environment = machine
    words = [sys.executable, *command]
    return subprocess.run(words, cwd=folder / "empty", env=environment, capture_output=True, text=True, check=False)


def auv_lse(machine: tuple[Path, dict[str, str]], *words: str) -> str:
    done = run(machine, "-m", "auv_lse_run", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_verb_loads_or_names_what_it_lacks(machine: tuple[Path, dict[str, str]]) -> None:
    done = run(machine, "-c", f"SITE = {str(machine[0] / 'site')!r}\n{PARSERS}")
    assert done.returncode == 0, done.stderr
    answers = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    refused = {name: text for name, text in answers.items() if text != "ok"}
    assert set(refused) == {"bench", "faults", "wheels"}
    for name, text in refused.items():
        assert text.startswith(f"auv_lse {name} needs a checkout of the project")


def test_every_node_can_be_started(machine: tuple[Path, dict[str, str]]) -> None:
    done = run(machine, "-c", NODES)
    assert done.returncode == 0, done.stderr


def test_a_mission_file_is_checked_and_what_is_shipped_is_found(machine: tuple[Path, dict[str, str]]) -> None:
    shipped = {line.split()[0] for line in auv_lse(machine, "files").splitlines() if "/" in line}
    missions = ROOT / "auv_lse_run" / "auv_lse_run" / "shipped" / "missions"
    assert {f"missions/{path.name}" for path in missions.iterdir()} <= shipped
    default = Path(auv_lse(machine, "files", "missions/default.yaml").strip())
    assert default.is_relative_to(machine[0] / "site")
    assert "0 errors" in auv_lse(machine, "check", str(default))


def test_a_verb_of_another_package_is_one_line_and_one_module(machine: tuple[Path, dict[str, str]]) -> None:
    assert re.search(r"^  deepest +print the deepest sounding of a run$", auv_lse(machine, "--help"), re.MULTILINE)
    missing = run(machine, "-m", "auv_lse_run", "deepest", "nowhere")
    assert missing.returncode == 2
    assert missing.stderr.startswith("error: nowhere")
