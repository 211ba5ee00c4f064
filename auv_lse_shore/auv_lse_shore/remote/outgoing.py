"""The files sent to vehicles: the mission file with its areas written into it, and the files that it names."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.parameter_file import parse_parameters, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, nest
from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.packet.key import KeyFileError, read_key
from auv_lse_run.remote.dive_process import MISSION
from auv_lse_shore.areas.area_file import read_area

#: Parameters that name a file which vehicles need.
_FILES = (("packet", "key_file"), ("link", "key_file"), ("gp", "survey_file"))
_HEAD = "# For the vehicles, areas in metres; sent by auv_lse fleet from {name}\n"


def outgoing_files(mission: Path) -> dict[str, bytes]:
    """The files to send, by their names on the vehicles.

    Args:
        mission: The mission file; files that it names are sought from here, else beside it.

    Raises:
        ParameterError: naming what is wrong in it, or a file that is missing.
    """
    patterns = read_parameter_file(mission, read_area)
    Settings.from_patterns(patterns, str(mission))
    files: dict[str, bytes] = {}
    renamed: dict[str, dict[str, Any]] = {}
    for pattern, values in patterns.items():
        nested = nest(values)
        if "sim" in nested:
            raise ParameterError(
                f"{mission} has a section sim, so vehicles would wait for a simulator. Write the vehicles' file: "
                "auv_lse mission --for-vehicles vehicles.yaml"
            )
        renamed[pattern] = _with_files(nested, mission, files)
    text = mission.read_text()
    if renamed != {pattern: nest(values) for pattern, values in parse_parameters(text, str(mission)).items()}:
        body = {pattern: {"ros__parameters": values} for pattern, values in renamed.items()}
        text = _HEAD.format(name=mission.name) + yaml.safe_dump(
            body, sort_keys=False, default_flow_style=None, width=110
        )
    return {**files, MISSION: text.encode()}


def hashes_of(files: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of each file, by name."""
    return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


def _with_files(nested: dict[str, Any], mission: Path, files: dict[str, bytes]) -> dict[str, Any]:
    """Parameters that name files by their names alone; adds the files to `files`."""
    for section, name in _FILES:
        own = nested.get(section)
        if not isinstance(own, dict) or not own.get(name):
            continue
        path = Path(own[name])
        path = path if path.is_file() else mission.parent / path
        try:
            if name == "key_file":
                read_key(path)
            data = path.read_bytes()
        except (OSError, KeyFileError) as error:
            raise ParameterError(f"{mission}: {section}.{name}: {error}") from error
        if files.setdefault(path.name, data) != data or path.name == MISSION:
            raise ParameterError(f"{mission}: {section}.{name}: another file is also called {path.name}. Rename one.")
        nested = {**nested, section: {**own, name: path.name}}
    return nested
