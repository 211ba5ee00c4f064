"""Which copy of the software runs: its version, how it was installed, where it is, and the commit of a checkout.

Several copies may be installed: wheels of pip, a colcon workspace, a checkout. Python imports the first that it finds.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import re
import subprocess
from pathlib import Path
from typing import NamedTuple

#: Time (s) for git to describe a checkout.
_GIT_S = 5.0


class InstalledCopy(NamedTuple):
    """An installed copy of a package.

    Attributes:
        version: "0.2.0"; "?" if nothing says it.
        kind: "checkout", "colcon" or "pip".
        folder: The checkout, the install prefix of colcon, or Python's folder of packages.
    """

    version: str
    kind: str
    folder: Path


def copy_of(package: str) -> InstalledCopy | None:
    """The copy of a package that Python imports here; None if there is none.

    Args:
        package: Name of a package of the stack.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return None
    source = Path(spec.origin).resolve().parents[1]
    if (source / "package.xml").is_file() and (source.parent / "scripts" / "setup").is_file():
        return InstalledCopy(_version_in(source / "package.xml"), "checkout", source.parent)
    site = Path(spec.origin).parents[1]
    prefix = site.parents[2]
    try:
        found = importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        found = None
    if found is None or not found.read_text("INSTALLER"):  # only pip writes that file
        declared = prefix / "share" / package / "package.xml"
        if declared.is_file():
            return InstalledCopy(_version_in(declared), "colcon", prefix)
    return InstalledCopy("?" if found is None else found.version, "pip", site)


def commit_of(checkout: Path) -> str:
    """The commit of a checkout, with "-dirty" if files have changed since; "" without git."""
    command = ("git", "-C", str(checkout), "--no-optional-locks", "describe", "--always", "--dirty", "--exclude=*")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


def _version_in(package_xml: Path) -> str:
    match = re.search(r"<version>(.*?)</version>", package_xml.read_text())
    return match[1] if match else "?"
