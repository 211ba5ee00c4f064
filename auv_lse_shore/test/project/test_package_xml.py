"""Each package.xml names exactly what the package's modules and launch files import."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = tuple(f"auv_lse_{name}" for name in ("common", "gp", "planner", "comms", "record", "sim", "shore"))

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
#: Loaded by their names at run time, not imported: the messages of the topics, and rosbag2's MCAP storage.
LOADED = {
    "auv_lse_common": {topic.kind.split("/")[0] for topic in (*VEHICLE_TOPICS.values(), *MISSION_TOPICS.values())},
    "auv_lse_record": {"rosbag2_storage_mcap"},
}
FROM_PIP = {"dask", "distributed", "mcap", "pyarrow", "rosbags"}
#: Imports that the package does without: named in a comment "optional: ...".
OPTIONAL = {"foxglove", "llvmlite", "numba", "rasterio"}


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
