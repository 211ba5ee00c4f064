"""When a vehicle surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.vehicle.surfacing import Surfacings

LEG_M = 15.0 * math.pi / 2.0
VEHICLE = VehicleConfig()


def path(locations_m: Array, step: int) -> PlannedPath:
    """A path through these locations from a step on; only its states count here."""
    states = np.column_stack([np.zeros(len(locations_m)), locations_m])[step:]
    legs = len(states) - 1
    return PlannedPath(step, states, np.zeros(legs, dtype=np.int64), legs, np.zeros((legs, 1, 2)))


def decided(surfacings: Surfacings, locations_m: Array) -> list[int]:
    """Steps at whose legs' ends a vehicle surfaces that travels through these locations."""
    return [step + 1 for step in range(len(locations_m) - 1) if considers(surfacings, path(locations_m, step))]


def considers(surfacings: Surfacings, ahead: PlannedPath) -> bool:
    """Whether a surfacing is considered, which is then recorded."""
    considered = surfacings.is_considered(ahead)
    if considered:
        surfacings.record(ahead.step + 1)
    return considered


def out_and_back(steps: int, turn: int) -> Array:
    """A way out and back, farthest from the start at step `turn`, and no farther again."""
    far = np.minimum(np.arange(steps + 1), 2 * turn - np.arange(steps + 1))
    return np.column_stack([np.abs(far) * 20.0, np.zeros(steps + 1)])


def surfacings(vehicle: int = 1, most: int = 1) -> Surfacings:
    """Those of a vehicle in a mission of 100 steps."""
    return Surfacings(vehicle, VEHICLE, most, 100, LEG_M)


def test_surfacing_takes_whole_legs() -> None:
    assert surfacings().legs == 4  # 60 s at 1.5 m/s are 90 m, 3.8 legs of 23.56 m


@pytest.mark.parametrize(("vehicle", "turn", "expected"), [(1, 45, 45), (1, 25, 30), (1, 90, 90), (3, 45, 50)])
def test_surfacing_is_considered_where_the_path_turns_back(vehicle: int, turn: int, expected: int) -> None:
    own = surfacings(vehicle)
    assert decided(own, out_and_back(100, turn))[:1] == [expected]
    assert own.done == 1
    before = own.snapshot()
    own.is_considered(path(out_and_back(100, turn), 99))
    assert own.snapshot() == before, "to consider one changes nothing"


def test_surfacing_is_not_considered_near_the_missions_end() -> None:
    assert decided(surfacings(), out_and_back(100, 98)) == [], "the 4 legs that it takes are not left"
    assert decided(surfacings(), out_and_back(100, 96)) == [], "the mission would end there, without the fix"
    assert decided(surfacings(), out_and_back(100, 95)) == [95], "a leg is left, before which the fix comes"
    assert decided(surfacings(most=0), out_and_back(100, 45)) == []


def test_next_surfacing_waits_for_the_interval() -> None:
    there_and_back = np.column_stack([200.0 + 60.0 * np.sin(np.arange(101) * math.pi / 8.0), np.zeros(101)])
    assert decided(surfacings(most=3), there_and_back) == [36, 68], "not at 52, and at 100 it is over"


def test_restart_does_not_repeat_a_surfacing() -> None:
    locations = out_and_back(100, 45)
    first, second = surfacings(), surfacings()
    assert decided(first, locations[:51]) == [45]
    second.restore(first.snapshot())
    assert decided(second, locations) == []
