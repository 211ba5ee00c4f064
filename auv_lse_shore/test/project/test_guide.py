"""The guide's commands are accepted, its files are valid, and what needs no hardware runs, page after page."""

from __future__ import annotations

import argparse
import importlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # pytest's importlib mode does not find `guide_pages` by itself

from guide_pages import GUIDE, PAGES, ROOT, Block, blocks

from auv_lse_common.mission_file.settings import Settings
from auv_lse_run.command import parsing
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.campaign.spec import CampaignSpec

#: Pages whose commands run, in this order: later ones use what earlier ones leave (runs/first, survey.csv).
RUN = ("first-mission", "your-own-lake", "bench-to-water", "bluerov2", "blueboat", "after-the-dive", "campaigns")

#: Legs that a mission of the guide has here, instead of its own number.
STEPS = 5

#: Commands of other programs: their names alone are known here.
FOREIGN = {
    ".", "cat", "cd", "colcon", "cp", "dask", "docker", "export", "pip", "pre-commit", "rosdep", "rviz2", "sed",
    "source", "ssh-copy-id", "sudo", "use_environment",
}  # fmt: skip

#: Scripts that are no verbs of auv_lse.
SCRIPTS = ("scripts/docs", "scripts/setup", "scripts/test", "scripts/environment.sh")

#: Files that each page promises, below the folder in which it was followed.
PROMISED = {
    "first-mission": ["runs/first/report.html", "runs/first/isobath.geojson", "runs/first/mission.yaml"],
    "your-own-lake": [
        "gp.yaml", "lake-map.png", "runs/lake/export/isobath.kml", "runs/lake/mission.yaml", "vehicles.yaml",
    ],
    "bench-to-water": ["team.key", "auv2.policy.xml"],
    "bluerov2": ["vehicle.yaml"],
    "blueboat": ["vehicle-boat.yaml"],
    "after-the-dive": [
        "adjusted/moved.md", "adjusted/before_and_after.csv", "runs/first/export/isobath.qgs",
        "runs/first/export/risk.tif", "runs/first/export/export.png", "report/report.html", "mission.html", "steps.csv",
    ],
}  # fmt: skip

SHELL = [block for page in PAGES for block in blocks(page) if block.language == "sh"]
FILES = [block for page in PAGES for block in blocks(page) if block.title]


def name(block: Block) -> str:
    return f"{block.page.stem}:{block.line}"


class ParsedError(BaseException):
    """The command line was accepted."""


def call_of(words: list[str]) -> tuple[str, list[str]] | None:
    """The module that takes a command line of this project, and its arguments; None for one of another program."""
    if words[:2] == ["python", "-m"]:
        return words[2], words[3:]
    name = words[0].removeprefix("scripts/")
    if words[0] in SCRIPTS or (name == words[0] and name != "auv_lse"):
        return None
    return "auv_lse_run.command.main", words[1:] if name in ("auv_lse", "run") else [name, *words[1:]]


def accept(module: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets a module parse its command line, and nothing more."""
    for where, name in ((argparse.ArgumentParser, "parse_args"), (parsing, "parsed")):
        parse = getattr(where, name)

        def parse_only(*given: object, parse: Callable[..., object] = parse) -> None:
            parse(*given)
            raise ParsedError

        monkeypatch.setattr(where, name, parse_only)
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    found = importlib.import_module(module)
    main = found if hasattr(found, "main") else importlib.import_module(f"{module}.__main__")
    with pytest.raises(ParsedError):
        main.main()


@pytest.mark.parametrize("block", SHELL, ids=name)
def test_each_command_line_is_accepted(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    for words in block.commands():
        known = call_of(words)
        if known:
            accept(*known, monkeypatch)
            monkeypatch.undo()
        elif words[0] == "ros2":
            check_ros2(words)
        elif not words[0].startswith("scripts/"):
            assert words[0] in FOREIGN or words[:2] == ["python", "my_driver.py"], words


def check_ros2(words: list[str]) -> None:
    """A launch file or executable of this project is there, and takes these arguments."""
    kind, package, target, *arguments = words[1:]
    if package == "foxglove_bridge":  # of ROS
        return
    if kind == "launch":
        text = (ROOT / package / "launch" / target).read_text()
        for argument in arguments:
            assert f'"{argument.partition(":=")[0]}"' in text, words
    else:
        assert kind == "run", words
        assert f"{target} = " in (ROOT / package / "setup.py").read_text(), words


@pytest.mark.parametrize("block", [block for block in FILES if block.language == "yaml"], ids=name)
def test_each_mission_file_is_valid(block: Block, tmp_path: Path) -> None:
    file = tmp_path / block.title
    file.write_text(block.text)
    shutil.copy(ROOT / "config" / "missions" / "lake.geojson", tmp_path)  # as the page copies it
    if "ros__parameters" in block.text:
        Settings.load(file, read_area=read_area)
    else:
        assert CampaignSpec.load(file).jobs()


@pytest.mark.parametrize("page", GUIDE, ids=[page.stem for page in GUIDE])
def test_a_page_opens_with_its_readers(page: Path) -> None:
    title, first = page.read_text().split("\n\n")[:2]
    assert re.match(r"# \S", title)
    assert re.match(r"For [^:]+: [^.]+\.", first), first


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like the project's, whose missions are short, in which the first page was followed."""
    made = tmp_path_factory.mktemp("guide")
    (made / "scripts").mkdir()
    for script in (ROOT / "scripts").iterdir():
        shim = made / "scripts" / script.name
        if script.name == "environment.sh":
            shim.write_text(f'. "{script}"\n')
            continue
        more = f" --steps {STEPS}" if script.name == "mission" else ""
        shim.write_text(f'#!/bin/sh\nexec "{script}" "$@"{more}\n')
        shim.chmod(0o755)
    (made / "bin").mkdir()
    shim = made / "bin" / "auv_lse"
    short = f'[ "$1" != mission ] || set -- "$@" --steps {STEPS}\n'
    shim.write_text(f'#!/bin/sh\n{short}exec "{ROOT}/scripts/auv_lse" "$@"\n')
    shim.chmod(0o755)
    (made / "config").symlink_to(ROOT / "config")
    follow("first-mission", made)
    return made


def survey() -> str:
    """Soundings of the whole of a valley, in place of the few that a short mission takes."""
    rows = ["east_m,north_m,depth_m"]
    for north_m in range(-20, 540, 20):
        rows += [f"{east_m},{north_m},{20.0 - abs(east_m - 250.0) / 25.0:.2f}" for east_m in range(-20, 540, 20)]
    return "\n".join(rows) + "\n"


def follow(page: str, folder: Path) -> None:
    """Saves the files of a page and runs its commands, from top to bottom."""
    for block in blocks(ROOT / "docs" / "guide" / f"{page}.md"):
        if block.title:
            (folder / block.title).write_text(block.text)
        if not block.runs:
            continue
        done = subprocess.run(
            ["bash", "-e", "-c", block.text], cwd=folder, text=True, capture_output=True, timeout=300, check=False,
            env={**os.environ, "PYTHONWARNINGS": "", "PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
        )  # fmt: skip
        if block.text.endswith("soundings.csv survey.csv\n"):
            (folder / "survey.csv").write_text(survey())
        assert done.returncode == 0, f"{name(block)}:\n{block.text}{done.stdout[-3000:]}{done.stderr[-3000:]}"


@pytest.mark.ros
@pytest.mark.mission
@pytest.mark.parametrize("page", RUN)
def test_a_page_can_be_followed(page: str, folder: Path) -> None:
    if page != "first-mission":  # the fixture has followed it
        follow(page, folder)
    assert [file for file in PROMISED.get(page, ()) if not (folder / file).exists()] == []


def test_every_page_with_commands_to_run_is_followed() -> None:
    pages = {block.page.stem for block in SHELL if block.runs and block.page in GUIDE}
    assert pages == set(RUN)


@pytest.mark.ros
def test_the_example_driver_drives(tmp_path: Path) -> None:
    """my_driver.py publishes odometry, and travels a leg once it is told to."""
    rclpy = pytest.importorskip("rclpy")
    messages = pytest.importorskip("auv_lse_msgs.msg")
    (block,) = [block for block in FILES if block.title == "my_driver.py"]
    scope: dict = {"__name__": "my_driver"}
    exec(compile(block.text, block.title, "exec"), scope)
    rclpy.init(domain_id=91)
    try:
        node, heard = scope["MyDriver"](), []
        node.create_subscription(scope["Odometry"], "odometry", heard.append, 10)
        node.legs.append(messages.Waypoint(end_north_m=3.0, end_east_m=0.0, depth_m=4.0, speed_mps=1.5))
        end = time.monotonic() + 10.0
        while not heard and time.monotonic() < end:
            node.tick()
            rclpy.spin_once(node, timeout_sec=0.1)
        assert heard[0].pose.pose.position.y == 0.0, "it waits until the mission runs"
        node.obey(messages.MissionState(action=messages.MissionState.TRAVEL))
        while (node.legs or heard[-1].pose.pose.position.z > -4.0) and time.monotonic() < end:
            node.tick()
            rclpy.spin_once(node, timeout_sec=0.1)
        position = heard[-1].pose.pose.position
        assert (node.legs, position.x, position.z) == ([], 0.0, -4.0)
        assert position.y > 1.0
        node.destroy_node()
    finally:
        rclpy.shutdown()
