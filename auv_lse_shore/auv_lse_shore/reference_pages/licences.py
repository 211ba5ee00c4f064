"""Licences of the pinned packages, as the installed packages state them."""

from __future__ import annotations

import importlib.metadata
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from auv_lse_common.support.project_folder import project_folder
from auv_lse_shore.reference_pages.blocks import wrapped


def pins() -> Iterator[tuple[str, str]]:
    """Name and version of every pinned package."""
    for line in (project_folder() / "config" / "constraints.txt").read_text().splitlines():
        if match := re.fullmatch(r"([\w.-]+)==([\w.]+)", line.strip()):
            yield match[1], match[2]


def licence_of(name: str) -> str:
    """The licence of an installed package, from its metadata, or from the package.xml of a ROS package.

    Raises:
        PackageNotFoundError: if it is not installed.
    """
    metadata = importlib.metadata.metadata(name)
    expression = metadata.get("License-Expression")
    if expression:
        return str(expression)
    package_xml = Path(sys.prefix) / "share" / name.removeprefix("ros-").replace("-", "_") / "package.xml"
    if name.startswith("ros-") and package_xml.is_file():
        stated = re.findall(r"<license[^>]*>([^<]+)</license>", package_xml.read_text())
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


#: What metadata call one licence.
_SAME = {
    "Apache Software License": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "MIT License": "MIT",
    "BSD": "BSD License",
    "3-Clause BSD License": "BSD-3-Clause",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}


def licences() -> str:
    """The pinned packages by licence.

    Raises:
        PackageNotFoundError: if a pinned package is not installed.
    """
    by_licence = defaultdict(list)
    for name, _ in pins():
        licence = licence_of(name)
        by_licence[_SAME.get(licence, licence)].append(name)
    lines = []
    for licence, names in sorted(by_licence.items(), key=lambda item: (-len(item[1]), item[0])):
        lines.append(f"**{licence}:** {', '.join(names)}")
    return "\n\n".join(wrapped(line) for line in lines)

