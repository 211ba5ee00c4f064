"""The Dockerfile, as far as it can be tried without Docker: copies, packages, the build, and the labels for BlueOS."""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[3]
VEHICLE = tuple(f"auv_lse_{name}" for name in ("msgs", "common", "run", "gp", "planner", "comms", "mavlink", "record"))
#: Rosdep keys that pip installs, with their names there.
PIP = {"python3-pymavlink-pip": "pymavlink"}


def instructions() -> list[tuple[str, str]]:
    """The instructions of the Dockerfile with their texts, continued lines joined."""
    lines = [line for line in (ROOT / "Dockerfile").read_text().splitlines() if not line.startswith("#")]
    joined = "\n".join(lines).replace("\\\n", " ")
    return [(word, text.strip()) for word, _, text in (line.partition(" ") for line in joined.splitlines() if line)]


def copies() -> list[tuple[str, str]]:
    """Source and target of everything that is copied from the project."""
    found = []
    for word, text in instructions():
        if word == "COPY" and not text.startswith("--from"):
            *sources, target = text.split()
            found += [(source, target) for source in sources]
    return found


def test_everything_copied_exists_and_is_not_ignored() -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    kept = [line[1:] for line in lines if line.startswith("!")]
    assert "*" in lines
    assert sorted(kept) == sorted(source for source, _ in copies()), "and nothing else is sent to the builder"
    for source in kept:
        assert (ROOT / source).exists(), source
        assert not any(fnmatch.fnmatch(source, line) for line in lines if line[:1] not in "!#*"), source
    assert {source for source, _ in copies() if source.startswith("auv_lse_")} == set(VEHICLE)


def test_the_image_installs_what_the_packages_need_and_no_more() -> None:
    wanted, from_pip = set[str](), set[str]()
    for package in VEHICLE:
        path = ROOT / package / "package.xml"
        tree = ElementTree.parse(path).getroot()
        from_pip |= {
            name for names in re.findall("<!-- pip: ([^;]*?)[ ;]*-->", path.read_text()) for name in names.split(", ")
        }
        wanted |= {element.text or "" for element in tree if element.tag in ("depend", "exec_depend")}
    wanted -= set(VEHICLE)
    apt = {key if key.startswith("python3-") else f"ros-jazzy-{key.replace('_', '-')}" for key in wanted - set(PIP)}
    (install,) = [text for word, text in instructions() if word == "RUN" and "apt-get install" in text]
    assert set(re.findall(r"\s((?:python3|ros)-\S+)", install)) == apt | {"python3-pip"}
    (pip,) = [text for word, text in instructions() if word == "RUN" and "pip install" in text]
    from_pip |= {PIP[key] for key in wanted & set(PIP)}
    assert from_pip == {"mcap", "pymavlink", "rosbags"}
    *_, constraints_and_names = pip.partition("--constraint ")
    assert set(constraints_and_names.split()[1:]) == from_pip
    constraints = (ROOT / "config" / "constraints.txt").read_text()
    assert all(re.search(rf"^{name}==", constraints, re.MULTILINE) for name in from_pip)


def test_blueos_reads_the_labels() -> None:
    labels = {}
    for word, text in instructions():
        if word == "LABEL":
            name, _, value = text.partition("=")
            (labels[name],) = shlex.split(value)
    assert set(labels) >= {"version", "permissions", "authors", "company", "type", "tags", "readme", "links"}
    (version,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert labels["version"] == version
    variables = json.loads(labels["permissions"])["Env"]
    assert variables == ["AUV_LSE_VEHICLE=", "AUV_LSE_MISSION=/data/vehicle.yaml"], "to be edited in BlueOS"
    host = json.loads(labels["permissions"])["HostConfig"]
    assert host["NetworkMode"] == "host", "the autopilot's endpoint is there"
    assert any(bind.endswith(":/data") for bind in host["Binds"])
    assert "Privileged" not in host
    for name in ("authors", "company", "tags", "links"):
        json.loads(labels[name])
    words = dict(instructions())
    assert words["USER"] == "ubuntu", "not root"
    assert "CMD" not in words, "no vehicle is guessed"
    assert "AUV_LSE_VEHICLE= AUV_LSE_MISSION=/data/vehicle.yaml" in [
        text for word, text in instructions() if word == "ENV"
    ]
    entry = json.loads(words["ENTRYPOINT"])
    assert "exec auv_lse vehicle --wait" in entry[2], "takes SIGTERM itself, and does not move by itself"


@pytest.mark.ros
@pytest.mark.skipif("AUV_LSE_SLOW" not in os.environ, reason="builds all packages of a vehicle; AUV_LSE_SLOW=1 runs it")
def test_the_build_stage_and_the_entry_point_run_here(tmp_path: Path) -> None:
    for source, target in copies():
        position = tmp_path / "build" / target
        if source.startswith("auv_lse_"):
            shutil.copytree(ROOT / source, position, ignore=shutil.ignore_patterns("test", "__pycache__", "*.egg-info"))
    (build,) = [text for word, text in instructions() if word == "RUN" and "colcon build" in text]
    install = tmp_path / "install"
    command = build.partition("&&")[2].replace("/opt/auv_lse/install", str(install))
    prefix = Path(sys.prefix)
    environment = {name: text for name, text in os.environ.items() if name not in ("PYTHONPATH", "COLCON_PREFIX_PATH")}
    environment |= {"AMENT_PREFIX_PATH": str(prefix), "CMAKE_PREFIX_PATH": str(prefix)}
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path / "build", env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    (tmp_path / "data").mkdir()
    (entry,) = [json.loads(text)[2] for word, text in instructions() if word == "ENTRYPOINT"]
    entry = entry.replace("source /opt/ros/jazzy/setup.bash &&", "").replace("/opt/auv_lse/install", str(install))
    entry = entry.replace("/data", str(tmp_path / "data"))
    file = tmp_path / "data" / "vehicle.yaml"
    file.write_text("/**: {ros__parameters: {mission: {vehicles: 2}}}\n")
    variables = {"AUV_LSE_ROOT": str(tmp_path), "AUV_LSE_VEHICLE": "", "AUV_LSE_MISSION": str(file)}
    started = subprocess.run(
        ["bash", "-c", entry, "vehicle"],
        cwd=tmp_path / "data", env=environment | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert started.returncode == 2
    assert "has 2 vehicles, and none is named" in started.stderr, "it does not start as auv1"
