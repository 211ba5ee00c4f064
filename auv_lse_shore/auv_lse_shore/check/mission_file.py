"""The text of a mission file: every key that is unknown, of a wrong type, or out of range, and not only the first."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.parameter_file import nest, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, problems
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections
from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.check.findings import Findings


def check_file(path: Path, findings: Findings) -> Settings | None:
    """The mission in a file, with what is wrong in it; None if it cannot be made.

    Raises:
        ParameterError: if the file is not there, or no ROS 2 parameter file.
    """
    patterns = read_parameter_file(path)
    for pattern, values in patterns.items():
        for name, content in nest(values).items():
            where = f"{path}: {pattern}: {name}"
            if name in SECTIONS:
                for text in problems(SECTIONS[name], content, where):
                    findings.error(text)
                continue
            try:
                check_sections({name: content}, f"{path}: {pattern}", ignore=("use_sim_time",))
            except ParameterError as error:
                findings.error(str(error))
    if findings.count("error"):
        return None
    try:
        return Settings.from_patterns(patterns, str(path))
    except ParameterError as error:  # a pattern, or parameters that contradict each other
        findings.error(str(error))
        return None
