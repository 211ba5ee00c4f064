"""Which vehicle a start is for, and by which mission file: from the command line, else from the environment."""

import os
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.mission import MissionConfig

#: Environment variables that name vehicle and mission file, as for a container.
VEHICLE_VARIABLE, FILE_VARIABLE = "AUV_LSE_VEHICLE", "AUV_LSE_MISSION"


def chosen_vehicle(name: str | None, file: Path | None) -> tuple[str, Path]:
    """The vehicle's name and the mission file.

    Args:
        name: The vehicle; None: that of the environment, else the only one in the file.
        file: The mission file; None: that of the environment.

    Raises:
        ParameterError: if no file is named, or it has several vehicles and none is named.
    """
    if file is None:
        if not os.environ.get(FILE_VARIABLE):
            raise ParameterError(f"no mission file is named. Name it on the command line, or set {FILE_VARIABLE}")
        file = Path(os.environ[FILE_VARIABLE])
    name = name or os.environ.get(VEHICLE_VARIABLE)
    if not name:
        mission = section(MissionConfig, parameters_for(read_parameter_file(file), "/settings"), "mission", str(file))
        if mission.vehicles != 1:
            raise ParameterError(
                f"{file} has {mission.vehicles} vehicles, and none is named. Name one on the command line, such as "
                f"auv2, or set {VEHICLE_VARIABLE}"
            )
        name = "auv1"
    return name, file
