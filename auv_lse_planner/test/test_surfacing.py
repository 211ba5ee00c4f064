"""When a vehicle surfaces, and that its plan waits for it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from auv_lse_planner.config import VehicleConfig
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.surfacing import Surfacings

LEG_M = 15.0 * math.pi / 2.0
VEHICLE = VehicleConfig()


def path(places_m: NDArray[np.float64], step: int) -> PlannedPath:
    """A path through these places from a step on; only its states count here."""
    states = np.column_stack([np.zeros(len(places_m)), places_m])[step:]
    legs = len(states) - 1
    return PlannedPath(step, states, np.zeros(legs, dtype=np.int64), legs, np.zeros((legs, 1, 2)))


def decided(surfacings: Surfacings, places_m: NDArray[np.float64]) -> list[int]:
    """Steps at whose legs' ends a vehicle surfaces that travels through these places."""
    return [step + 1 for step in range(len(places_m) - 1) if surfacings.due(path(places_m, step))]


def out_and_back(steps: int, turn: int) -> NDArray[np.float64]:
    far = np.minimum(np.arange(steps + 1), 2 * turn - np.arange(steps + 1))
    return np.column_stack([np.abs(far) * 20.0, np.zeros(steps + 1)])


def test_a_surfacing_takes_whole_legs() -> None:
    assert Surfacings(VEHICLE, 1, 100, LEG_M).legs == 4  # 60 s at 1.5 m/s are 90 m, 3.8 legs of 23.56 m


@pytest.mark.parametrize(("turn", "expected"), [(45, 45), (25, 30), (90, 60)])
def test_it_surfaces_where_it_is_farthest_in_the_middle_of_the_mission(turn: int, expected: int) -> None:
    surfacings = Surfacings(VEHICLE, 1, 100, LEG_M)
    assert decided(surfacings, out_and_back(100, turn)) == [expected]
    assert surfacings.done == 1


def test_each_part_of_the_mission_has_its_surfacing() -> None:
    away = np.column_stack([np.arange(101) * 20.0, np.zeros(101)])
    assert decided(Surfacings(VEHICLE, 2, 100, LEG_M), away) == [30, 80]


def test_it_does_not_surface_near_its_start_nor_where_it_would_cost_too_much() -> None:
    near = np.column_stack([50.0 * np.sin(np.arange(101)), 50.0 * np.cos(np.arange(101))])
    surfacings = Surfacings(VEHICLE, 1, 100, LEG_M)
    assert decided(surfacings, near) == []
    assert surfacings.done == 1, "given up, so that it is not looked for for ever"
    assert Surfacings(VEHICLE, 1, 60, LEG_M).wanted == 0, "4 of 60 legs are more than 6 %"
    assert Surfacings(VEHICLE, 0, 100, LEG_M).wanted == 0
    deep = dataclasses.replace(VEHICLE, surfacing_s=200.0)
    assert Surfacings(deep, 1, 100, LEG_M).wanted == 0


def test_after_a_restart_it_does_not_surface_again() -> None:
    places = out_and_back(100, 45)
    first, second = (Surfacings(VEHICLE, 1, 100, LEG_M) for _ in range(2))
    assert decided(first, places[:46]) == [45]
    second.restore(first.snapshot())
    assert decided(second, places) == []
