"""The planning method follows from the goal, the team and the area."""

from __future__ import annotations

import dataclasses

import pytest

from auv_lse_common.mission_file.goals import coverage, with_method
from auv_lse_common.mission_file.operating_area import free_m2
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.settings import Settings

#: The default area is 600 m x 700 m; this one has a quarter of its size.
QUARTER = [0.0, 0.0, 300.0, 0.0, 300.0, 350.0, 0.0, 350.0]


def methods(settings: Settings) -> set[str]:
    return {own.planner.method for own in (settings.common, *settings.vehicles)}


def test_coverage() -> None:
    team = MissionConfig(vehicles=3, steps=100)
    # 3 x 100 x 23.56 m x 85 m / 420000 m2
    assert coverage(420_000.0, team, MotionConfig(), GpConfig()) == pytest.approx(1.4305, abs=1e-4)


def test_size_of_an_area_without_its_no_go_areas() -> None:
    assert free_m2(AreaConfig()) == 420_000.0
    island = AreaConfig(no_go={"island": (100.0, 100.0, 200.0, 100.0, 200.0, 300.0, 100.0, 300.0)})
    assert free_m2(island) == pytest.approx(400_000.0, rel=0.005)


@pytest.mark.parametrize(
    ("values", "method"),
    [
        ({}, "tour"),
        ({"mission.goal": "chart", "mission.vehicles": 1}, "tour"),
        ({"mission.goal": "line", "mission.vehicles": 1}, "line"),  # coverage .48
        ({"mission.goal": "line"}, "line"),  # 1.43
        ({"mission.goal": "line", "mission.steps": 200, "area.polygon_m": QUARTER}, "line"),  # 11.4
        ({"mission.goal": "line", "planner.method": "plain"}, "plain"),
        ({"mission.goal": "line", "auv2.planner.own_share": 2.0, "auv2.gp.length_scale_m": 20.0}, "line"),
        ({"mission.goal": "line", "mission.steps": 201}, "tour"),  # more legs than `line` plans; coverage 2.87
        ({"mission.goal": "line", "mission.vehicles": 8, "mission.steps": 25}, "tour"),  # a large team; coverage .95
        ({"mission.goal": "line", "mission.vehicles": 5, "mission.steps": 16}, "line"),  # a large team; coverage .38
        ({"mission.goal": "line", "mission.vehicles": 8, "mission.steps": 56}, "line"),  # 7 legs for each vehicle
    ],
)
def test_the_method_follows_from_goal_team_and_area(values: dict[str, object], method: str) -> None:
    settings = Settings.load(None, values)
    assert methods(settings) == {method}
    assert settings.planner_settings(1).planner.method == method
    again = Settings.from_patterns(settings.to_patterns(), "again")
    assert again == dataclasses.replace(settings, where="again")


def test_the_method_follows_a_mission_that_changes_unless_it_was_given() -> None:
    settings = Settings.load(None, {"mission.goal": "line", "mission.steps": 201})
    assert methods(settings.with_overrides({"mission.steps": 100})) == {"line"}
    flown = Settings.from_patterns(settings.to_patterns(), "mission.yaml")  # a vehicle's file names the method
    assert methods(flown.with_overrides({"mission.steps": 100})) == {"tour"}
    given = Settings.load(None, {"mission.goal": "line", "planner.method": "line"})
    assert methods(given.with_overrides({"area.polygon_m": QUARTER})) == {"line"}


def test_unusable_values_are_left_to_their_sections() -> None:
    for name, value in (("area", {"polygon_m": [1.0]}), ("mission", 3), ("gp", {"length_scale_m": "wide"})):
        given = {"mission": {"goal": "line"}, name: value}
        assert with_method(given)[name] == value
    with pytest.raises(ParameterError, match="length_scale_m must be a number"):
        Settings.load(None, {"mission.goal": "line", "gp.length_scale_m": "wide"})


def test_a_line_of_more_legs_than_are_planned_is_rejected_where_the_team_covers_less() -> None:
    wide = [0.0, 0.0, 3000.0, 0.0, 3000.0, 3000.0, 0.0, 3000.0]
    with pytest.raises(ParameterError, match="at most 200 legs"):
        Settings.load(None, {"mission.goal": "line", "mission.steps": 201, "area.polygon_m": wide})
