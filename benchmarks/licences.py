"""Prints config/licences.txt: every pinned package with its licence, as the installed packages state it.

python -m benchmarks.licences > config/licences.txt
"""

import importlib.metadata
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.command import end_with, parser_of

_ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = _ROOT / "config" / "constraints.txt"
_HEAD = """\
# Every package that scripts/setup installs, with its version and the licence that its metadata state.
# Made by: python -m benchmarks.licences > config/licences.txt
"""


def pins() -> Iterator[tuple[str, str]]:
    """Name and version of every pinned package."""
    for line in CONSTRAINTS.read_text().splitlines():
        if match := re.fullmatch(r"([\w.-]+)==([\w.]+)", line.strip()):
            yield match[1], match[2]


def licence_of(name: str) -> str:
    """The licence of an installed package, from its metadata, or from the package.xml of a ROS package."""
    metadata: Any = importlib.metadata.metadata(name)  # a mapping, which its protocol does not say
    expression = metadata.get("License-Expression")
    if expression:
        return str(expression)
    of_ros = Path(sys.prefix) / "share" / name.removeprefix("ros-").replace("-", "_") / "package.xml"
    if name.startswith("ros-") and of_ros.is_file():
        stated = re.findall(r"<license[^>]*>([^<]+)</license>", of_ros.read_text())
        if stated:
            return ", ".join(stated)
    named = [c.split("::")[-1].strip() for c in metadata.get_all("Classifier", []) if c.startswith("License ::")]
    words = (metadata.get("License") or "").strip().splitlines()
    return ", ".join(named) or (words[0][:60] if words and not words[0].startswith("%") else "") or _in_file(name)


def _in_file(name: str) -> str:
    """The first line of the licence file that comes with a package."""
    for file in importlib.metadata.files(name) or ():
        if re.search(r"(?i)licen[cs]e|copying", file.name) and file.suffix not in (".py", ".pyc"):
            lines = [line.strip() for line in Path(str(file.locate())).read_text(errors="replace").splitlines()]
            return next((line[:60] for line in lines if line), "")
    return "not stated"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the page."""
    parser_of("benchmarks.licences", __doc__).parse_args(arguments)
    print(_HEAD, end="")
    for name, version in pins():
        print(f"{name}=={version}  {licence_of(name)}")
    return 0


if __name__ == "__main__":
    end_with(main)
