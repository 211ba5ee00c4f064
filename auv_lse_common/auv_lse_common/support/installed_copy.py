"""Identifies the copy of the software that runs: version, kind of installation, folder, commit of a checkout.

Several copies may be installed: wheels of pip, a colcon workspace, a checkout. Python imports the first that it finds.
"""

import importlib.metadata
import importlib.util
import os
import platform
import re
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

#: The environment variable with which the starter of nodes names its copy. A node of another copy refuses to run.
COPY_VARIABLE = "AUV_LSE_COPY"
#: Record of the copies that wrote a run folder, a line for each start.
SOFTWARE_FILE = Path("logs") / "software.txt"
#: Time (s) for git to describe a checkout.
_GIT_S = 5.0


class InstalledCopy(NamedTuple):
    """An installed copy of a package.

    Attributes:
        version: "0.2.0"; "?" if unknown.
        kind: "checkout", "colcon" or "pip".
        folder: The checkout, the install prefix of colcon, or Python's folder of packages.
    """

    version: str
    kind: str
    folder: Path


def copy_of(package: str) -> InstalledCopy | None:
    """The copy of a package that Python imports here; None if there is none."""
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


def own_copy() -> str:
    """This process's copy in words: "0.2.0, checkout: /opt/auv_lse"."""
    copy = copy_of("auv_lse_common")
    return "unknown" if copy is None else f"{copy.version}, {copy.kind}: {copy.folder}"


def refuse_mixture() -> None:
    """Checks that this node's copy is that of the process that starts the mission's or the vehicle's nodes.

    Raises:
        ValueError: naming both.
    """
    wanted, own = os.environ.get(COPY_VARIABLE), own_copy()
    if wanted and wanted != own:
        raise ValueError(
            f"the nodes were started by auv_lse {wanted}, but this node is of another copy: {own}. Remove one of them "
            "from PYTHONPATH, or source one workspace only"
        )


def mixed_versions(packages: Iterable[str]) -> str:
    """Why the installed packages cannot work together; "" if all have one version.

    Args:
        packages: Names of packages; those that are not installed are ignored.
    """
    copies = {package: copy for package in packages if (copy := copy_of(package)) is not None}
    if len({copy.version for copy in copies.values()}) <= 1:
        return ""
    named = "; ".join(f"{package} {copy.version} in {copy.folder}" for package, copy in copies.items())
    return f"packages of several versions are installed: {named}. Install one version of all"


def note_software(folder: Path) -> None:
    """Adds this process's copy to a run folder's record; a disk that is full must not stop a vehicle."""
    copy = copy_of("auv_lse_common")
    commit = commit_of(copy.folder) if copy is not None and copy.kind == "checkout" else ""
    at = f" at commit {commit}" if commit else ""
    line = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} auv_lse {own_copy()}{at}, Python {platform.python_version()}\n"
    with suppress(OSError):
        (folder / SOFTWARE_FILE).parent.mkdir(parents=True, exist_ok=True)
        with (folder / SOFTWARE_FILE).open("a") as file:
            file.write(line)


def _version_in(package_xml: Path) -> str:
    match = re.search(r"<version>(.*?)</version>", package_xml.read_text())
    return match[1] if match else "?"
