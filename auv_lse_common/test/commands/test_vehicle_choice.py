"""Which vehicle starts: named on the command line, in the environment, or the only one."""

from __future__ import annotations

from pathlib import Path

import pytest

from auv_lse_common.commands.vehicle_choice import FILE_VARIABLE, VEHICLE_VARIABLE, chosen_vehicle
from auv_lse_common.mission_file.parameters import ParameterError


@pytest.fixture
def team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in (FILE_VARIABLE, VEHICLE_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    path = tmp_path / "vehicles.yaml"
    path.write_text("/**: {ros__parameters: {mission: {vehicles: 3}}}\n")
    return path


def test_the_command_line_comes_before_the_environment(team: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VEHICLE_VARIABLE, "auv3")
    monkeypatch.setenv(FILE_VARIABLE, str(team))
    assert chosen_vehicle(None, None) == ("auv3", team)
    assert chosen_vehicle("auv2", Path("other.yaml")) == ("auv2", Path("other.yaml"))


def test_none_of_several_vehicles_is_guessed(team: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FILE_VARIABLE, str(team))
    monkeypatch.setenv(VEHICLE_VARIABLE, "")  # as an image sets it
    with pytest.raises(ParameterError, match=r"vehicles\.yaml has 3 vehicles, and none is named\. .* AUV_LSE_VEHICLE"):
        chosen_vehicle(None, None)


def test_the_only_vehicle_needs_no_name(team: Path) -> None:
    team.write_text("/**: {ros__parameters: {mission: {vehicles: 1}}}\n")
    assert chosen_vehicle(None, team) == ("auv1", team)
    with pytest.raises(ParameterError, match="no mission file is named"):
        chosen_vehicle("auv1", None)
