"""Each package.xml names exactly what the package's modules and launch files import."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement

from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = tuple(
    f"auv_lse_{name}" for name in ("common", "run", "gp", "planner", "comms", "mavlink", "record", "sim", "shore")
)

#: Rosdep keys of imports that are no ROS packages. The key of a ROS package is its own name.
KEYS = {
    "contourpy": "python3-matplotlib",  # has no key of its own; Ubuntu's python3-matplotlib depends on it
    "jinja2": "python3-jinja2",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pymavlink": "python3-pymavlink-pip",
    "pyproj": "python3-pyproj",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "shapely": "python3-shapely",
    "tornado": "python3-tornado",
    "yaml": "python3-yaml",
}
#: Imports without a rosdep key, or with one that calls pip, which Ubuntu 24.04 refuses: named in a comment "pip: ...".
#: Loaded by their names at run time, not imported: the messages of the topics.
LOADED = {
    "auv_lse_common": {topic.kind.split("/")[0] for topic in (*VEHICLE_TOPICS.values(), *MISSION_TOPICS.values())},
}
FROM_PIP = {"dask", "distributed", "mcap", "pyarrow", "rosbags"}
#: Imports that the package does without: named in a comment "optional: ...".
OPTIONAL = {"auv_lse_mavlink", "h5py", "llvmlite", "numba", "pyogrio", "rasterio"}


def imports_of(package: str) -> set[str]:
    """Top-level names that the package's modules and launch files import, the standard library aside."""
    found: set[str] = set()
    for path in (*(ROOT / package / package).rglob("*.py"), *(ROOT / package / "launch").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {package}


def commented(text: str, word: str) -> set[str]:
    """The names in a comment "word: a, b; ..."."""
    match = re.search(rf"<!--[^>]*\b{word}: ([\w, ]+)", text)
    return set(re.findall(r"\w+", match[1])) if match else set()


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_names_what_is_imported_and_nothing_else(package: str) -> None:
    text = (ROOT / package / "package.xml").read_text()
    tree = ElementTree.fromstring(text)
    declared = [element.text for tag in ("depend", "exec_depend") for element in tree.iter(tag)]
    assert len(declared) == len(set(declared)), "named twice"
    imported = imports_of(package)
    assert set(declared) == {KEYS.get(name, name) for name in imported - FROM_PIP - OPTIONAL} | LOADED.get(
        package, set()
    )
    assert commented(text, "pip") == imported & FROM_PIP
    assert commented(text, "optional") == imported & OPTIONAL


def test_the_message_package_names_the_packages_of_its_fields() -> None:
    text = "".join(path.read_text() for path in (ROOT / "auv_lse_msgs" / "msg").glob("*.msg"))
    used = set(re.findall(r"^(\w+)/\w+", text, re.MULTILINE))
    tree = ElementTree.parse(ROOT / "auv_lse_msgs" / "package.xml")
    assert {element.text for element in tree.iter("depend")} == used


ALL = (*PACKAGES, "auv_lse_msgs")
#: Names on PyPI of imports that have another name there.
ON_PYPI = {"serial": "pyserial", "yaml": "pyyaml"}


def known_keys() -> dict[str, set[str]]:
    """The stored rosdep keys by heading: apt, ros, pip."""
    text = re.sub(r"^#.*\n", "", (ROOT / "config" / "rosdep_keys.txt").read_text(), flags=re.MULTILINE)
    _, *parts = re.split(r"^\[(\w+)\]$", text, flags=re.MULTILINE)
    return {heading: set(names.split()) for heading, names in zip(parts[::2], parts[1::2], strict=True)}


def test_every_dependency_has_a_rosdep_key_on_jazzy_and_lyrical() -> None:
    known, from_pip = known_keys(), []
    for package in ALL:
        tree = ElementTree.parse(ROOT / package / "package.xml").getroot()
        used = {element.text for element in tree if element.tag.endswith("depend")} - set(ALL)
        assert used <= set().union(*known.values()), package
        from_pip += [package] if used & known["pip"] else []
    assert from_pip == ["auv_lse_mavlink"], "all others are ready for a binary release"


def test_all_packages_have_one_version_a_changelog_and_a_website() -> None:
    (version,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    (released,) = re.findall(r'^date-released: "(.*)"$', (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    newest = re.search(r"^## (\S+) \((.*)\)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest.groups() == (version, released)
    assert f'LABEL version="{version}"' in (ROOT / "Dockerfile").read_text()
    for package in ALL:
        tree = ElementTree.parse(ROOT / package / "package.xml").getroot()
        assert tree.findtext("version") == version, package
        assert tree.findtext("url"), package
        lines = (ROOT / package / "CHANGELOG.rst").read_text().splitlines()
        assert lines[:3] == ["^" * len(lines[1]), f"Changelog for package {package}", "^" * len(lines[1])]
        assert lines[4] == f"{version} ({released})", package
        assert lines[5] == "-" * len(lines[4]), "what bloom reads: catkin's format"
        if package in PACKAGES:
            assert f'"{package}", "{version}"' in (ROOT / package / "setup.py").read_text()


def setup_of(package: str, command: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """What setup.py passes to setuptools for a command."""
    path, given = ROOT / package / "setup.py", {}
    monkeypatch.chdir(path.parent)
    monkeypatch.setattr(sys, "argv", ["setup.py", command])
    monkeypatch.setattr("setuptools.setup", lambda **options: given.update(options))
    exec(compile(path.read_text(), str(path), "exec"), {"__file__": str(path)})
    return given


@pytest.mark.parametrize("package", PACKAGES)
def test_pip_gets_dependencies_types_and_no_commands(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    library = setup_of(package, "bdist_wheel", monkeypatch)
    required = {re.match(r"[\w-]+", requirement)[0] for requirement in library["install_requires"]}
    ros = known_keys()["ros"] | {"auv_lse_msgs", "rclpy"}
    imported = {ON_PYPI.get(name, name) for name in imports_of(package) - OPTIONAL - ros}
    assert required == imported
    optional = {ON_PYPI.get(name, name) for name in imports_of(package) & OPTIONAL}
    assert {re.match(r"[\w-]+", name)[0] for name in library["extras_require"].get("optional", [])} == optional
    assert not library["entry_points"].get("console_scripts") or package == "auv_lse_run"
    assert "py.typed" in library["package_data"][package]
    assert (ROOT / package / package / "py.typed").is_file()
    siblings = [requirement for requirement in library["install_requires"] if requirement.startswith("auv_lse_")]
    assert all("file://" in requirement for requirement in siblings), "they are on no index"
    monkeypatch.setenv("AUV_LSE_WHEELS", "1")
    wheels = setup_of(package, "bdist_wheel", monkeypatch)["install_requires"]
    assert not any("file:" in requirement for requirement in wheels), "a wheel is installed elsewhere"
    colcon = setup_of(package, "install", monkeypatch)
    assert colcon["install_requires"] == []
    with_nodes = bool(colcon.get("entry_points", {}).get("console_scripts"))
    assert with_nodes == (package not in ("auv_lse_common", "auv_lse_shore"))


def test_pip_takes_versions_that_suit_the_oldest_numpy_and_those_of_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pip does not know what pyarrow needs: 26 is installed beside NumPy 1.26, and its import fails."""
    lines = (ROOT / "config" / "constraints.txt").read_text().splitlines()
    tested = dict(line.split("==") for line in lines if re.match(r"[\w.-]+==", line))
    for package in PACKAGES:
        for text in setup_of(package, "bdist_wheel", monkeypatch)["install_requires"]:
            requirement = Requirement(text)
            assert requirement.url or tested[requirement.name] in requirement.specifier, f"{package}: {text}"
            if requirement.name == "numpy":
                assert "1.26.4" in requirement.specifier
            if requirement.name == "pyarrow":
                assert "26.0.1" not in requirement.specifier
