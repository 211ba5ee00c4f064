import dataclasses

import pytest

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings, check_planner


def test_parameters_of_the_file_override_those_of_the_method():
    paper = PlannerConfig(method="augmented").complete()
    assert (paper.family_name, paper.credit, paper.horizon, paper.augmented) == ("path", "whole", 3, True)
    assert (paper.naive_paths, paper.incumbent) == ((0xF0,), True)
    plain = PlannerConfig(method="plain").complete()
    assert (plain.family_name, plain.credit, plain.horizon, plain.augmented) == ("path", "whole", 10, False)
    assert (plain.naive_paths, plain.incumbent) == ((), False)
    changed = PlannerConfig(method="augmented", horizon=5, incumbent=False, naive_paths=(0xF4, 0xF5)).complete()
    assert (changed.horizon, changed.incumbent, changed.naive_paths) == (5, False, (0xF4, 0xF5))
    assert PlannerConfig(method="plain", augmented=True).complete().naive_paths == (0xF0,)
    assert PlannerConfig(method="plain", naive_paths=(0xF4,)).complete().naive_paths == ()


@pytest.mark.parametrize("method", METHODS)
def test_complete_resolves_every_parameter_of_the_method(method):
    complete = PlannerConfig(method=method).complete()
    missing = {f.name for f in dataclasses.fields(complete) if getattr(complete, f.name) is None}
    assert not missing
    assert complete.complete() == complete


def test_values_of_a_method_are_valid_parameters():
    for method, entry in METHODS.items():
        assert from_mapping(PlannerConfig, {"method": method, **entry.parameters}, "methods.py").method == method


def test_default_method_bounds_the_map_reward_and_paper_methods_the_path_reward():
    assert PlannerConfig().method == "tour"
    assert {m for m in METHODS if PlannerConfig(method=m).family.bound_of == "map"} == {"tour", "fixed_tour"}


@pytest.mark.parametrize(
    ("planner", "message"),
    [
        ({"method": "bset"}, "planner.method must be one of .*, not 'bset'"),
        ({"iteratons": 5}, "did you mean 'iterations'"),
        ({"horizon": 0}, "planner.horizon must be .*, not 0"),
        ({"naive_paths": [0x10]}, r"planner.naive_paths\[0\] must be .*, not 16"),
    ],
)
def test_invalid_parameters_are_named(planner, message):
    with pytest.raises(ParameterError, match=message):
        PlannerSettings.from_parameters({"area": {}, "planner": planner}, "file.yaml")


def test_default_depth_follows_from_the_vehicles_number():
    depths = [PlannerSettings.from_parameters({"area": {}}, "f", k).vehicle.depth_m for k in (1, 2, 3, 4)]
    assert depths == [3.0, 4.0, 5.0, 3.0]
    given = {"area": {}, "vehicle": {"depth_m": 7.0, "speed_mps": 1.0}}
    assert PlannerSettings.from_parameters(given, "f", 2).vehicle.depth_m == 7.0


def test_configuration_round_trip():
    from auv_lse_common.mission_file.parameters import to_mapping

    config = PlannerConfig(method="plain", horizon=7, naive_paths=(0xF4,))
    assert from_mapping(PlannerConfig, to_mapping(config), "again") == config


@pytest.mark.parametrize(("method", "most"), [("augmented", 8000), ("tour", 4000), ("lawnmower", 8000)])
def test_mission_too_long_to_evaluate_is_rejected(method: str, most: int) -> None:
    """Before, the first decision ended in a MemoryError."""
    message = rf"mission.steps: 65535 steps are too many for planner.method '{method}'.* GB. Use at most {most} steps"
    with pytest.raises(ParameterError, match=message):
        check_planner(MissionConfig(steps=65535), PlannerConfig(method=method), "m.yaml")
    check_planner(MissionConfig(steps=most), PlannerConfig(method=method), "m.yaml")


def test_method_with_a_short_horizon_allows_any_length() -> None:
    check_planner(MissionConfig(steps=65535), PlannerConfig(method="plain"), "m.yaml")


def test_a_line_of_more_legs_than_are_planned_is_rejected() -> None:
    check_planner(MissionConfig(steps=200), PlannerConfig(method="line"), "m.yaml")
    with pytest.raises(ParameterError, match=r"mission\.steps is 201, but .* at most 200 legs"):
        check_planner(MissionConfig(steps=201), PlannerConfig(method="line"), "m.yaml")
