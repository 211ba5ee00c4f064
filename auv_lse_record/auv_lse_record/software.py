"""The origin of a recording: the mission file, and the version of the software."""

import functools
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import parameter_text, read_parameter_file


@functools.cache
def version() -> str:
    """Version of the running code: its commit ("-dirty": with changes), or the package's version."""
    here = Path(__file__).resolve().parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        found = ""
    return found or metadata.version("auv_lse_record")


def other_versions(rows: Iterable[Mapping[str, Any]]) -> str:
    """Versions, as text, of results (`version`) that are not those of the running code; "" if all are."""
    return ", ".join(sorted({str(row.get("version") or "unknown") for row in rows} - {version()}))


def mission_text(arguments: Sequence[str], parameters: Mapping[str, Any]) -> str:
    """Text of a node's mission file.

    Args:
        arguments: The node's command line: the first --params-file with a section `mission` is the mission file.
        parameters: The node's parameters, used without such a file.

    Raises:
        ParameterError: if a file cannot be read.
    """
    for argument, path in pairwise(arguments):
        if argument == "--params-file" and any("mission" in p for p in read_parameter_file(path).values()):
            return Path(path).read_text()
    return parameter_text({"/**": parameters})
