"""The mission file of the simulator."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError


def parameter_file(arguments: Sequence[str]) -> Path:
    """The mission file among the --params-file arguments: the simulator needs the parameters of every vehicle.

    Raises:
        ParameterError: if there is no such file.
    """
    given = [Path(b) for a, b in pairwise(arguments) if a == "--params-file"]
    for path in given:
        if "mission" in read_parameter_file(path).get("/**", {}):
            return path
    raise ParameterError(
        "sim_node needs --params-file with a mission file that has a 'mission' section under '/**', as any run's "
        f"mission.yaml has (given: {', '.join(map(str, given)) or 'none'})"
    )
