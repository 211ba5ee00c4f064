from pathlib import Path

import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_sim.engine.parameter_file import parameter_file


def test_the_file_with_the_mission_is_found_among_others(tmp_path: Path) -> None:
    own, mission = tmp_path / "own.yaml", tmp_path / "mission.yaml"
    own.write_text("/**:\n  ros__parameters:\n    use_sim_time: true\n")
    mission.write_text("/**:\n  ros__parameters:\n    mission: {steps: 4}\n")
    arguments = ["sim_node", "--ros-args", "--params-file", str(own), "--params-file", str(mission)]
    assert parameter_file(arguments) == mission
    with pytest.raises(ParameterError, match=f"given: {own}"):
        parameter_file(arguments[:4])
    with pytest.raises(ParameterError, match=r"\(given: none\)"):
        parameter_file(["sim_node"])
