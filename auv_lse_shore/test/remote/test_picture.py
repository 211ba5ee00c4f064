"""What is shown about a vehicle is never younger than it is, and where it should be follows its plan."""

from __future__ import annotations

from typing import Any

import pytest

from auv_lse_run.remote.mission_link import Newest
from auv_lse_shore.remote.picture import VehicleView, expected_position

PATH = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]


def view(asked_s: float, trouble: str = "", **state: Any) -> VehicleView:
    answer = {"running": True, "state": state}
    return VehicleView("auv1", answer, asked_s, trouble, "one")


def running(age_s: float = 0.5) -> dict[str, Any]:
    position = {"north_m": 0.0, "east_m": 0.0, "depth_m": 5.0, "speed_mps": 1.0, "age_s": age_s}
    return {"mission": {"state": "RUNNING", "age_s": age_s}, "position": position, "path": {"north_east_m": PATH}}


def test_an_age_counts_from_the_question_and_an_unknown_one_stays_unknown() -> None:
    assert view(100.0, **running(0.5)).age_s("mission", 103.0) == 3.5
    newest = Newest()
    newest.take("latched", 5.0)
    assert newest.age_s(6.0) is None
    newest.take("new", 7.0)
    assert newest.age_s(9.0) == 2.0


@pytest.mark.parametrize(
    ("distance_m", "position"), [(0.0, (1.0, 0.0)), (4.0, (5.0, 0.0)), (12.0, (10.0, 3.0)), (99.0, (10.0, 10.0))]
)
def test_a_vehicle_under_water_is_expected_along_its_path(distance_m: float, position: tuple[float, float]) -> None:
    assert expected_position((1.0, 0.0), PATH, distance_m) == pytest.approx(position)


def test_a_position_is_marked_as_expected_only_while_the_vehicle_is_away() -> None:
    assert view(100.0, **running(0.0)).position(104.0) == (0.0, 0.0, False)
    assert view(100.0, "out of reach", **running(0.0)).position(104.0) == (4.0, 0.0, True)
    assert VehicleView("auv1").position(0.0) is None


def test_a_silent_vehicle_is_an_alarm_at_the_surface_and_not_under_water() -> None:
    at_surface = running()
    at_surface["mission"]["state"] = "HOLDING"
    at_surface["position"]["depth_m"] = 0.2
    assert view(0.0, "out of reach", **running()).alarms(99.0) == []
    assert view(0.0, "out of reach", **at_surface).alarms(99.0) == ["silent at the surface: out of reach"]
    assert view(0.0, "out of reach", **at_surface).alarms(9.0) == []
    assert VehicleView("auv1", trouble="out of reach").alarms(99.0) == ["out of reach"]


def test_another_laptop_that_took_over_is_an_alarm() -> None:
    found = view(0.0, **running())
    found.answer = {**found.answer, "controller": {"laptop": "two", "name": "bob@boat", "at": "noon"}}
    assert found.alarms(1.0) == ["bob@boat has commanded it since noon"]
