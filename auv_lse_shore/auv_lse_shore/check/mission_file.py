"""Checks the text of a mission file: all unknown keys, wrong types and values out of range."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.parameter_file import nest, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, problems
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections
from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.check.findings import Findings


def check_file(path: Path, findings: Findings) -> Settings | None:
    """Reads and checks a mission file; adds errors to `findings` and then returns None.

    Raises:
        ParameterError: if the file is missing, or not a ROS 2 parameter file.
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
