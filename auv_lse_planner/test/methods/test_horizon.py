"""The horizon of a mission that ends with a share found."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from planner_helpers import centers, settings

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_planner.methods.horizon import LEAST_LEGS, Horizon
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

STEPS = 60


def horizon(asked: float | None, vehicles: int = 1, steps: int = 160) -> Horizon:
    chosen = settings(None, vehicles, steps)
    return Horizon(chosen, OperatingArea(chosen.area), asked)


def planner(**mission: Any) -> VehiclePlanner:
    chosen = settings({"method": "tour"}, mission={"vehicles": 3, "steps": STEPS, **mission})
    return VehiclePlanner(1, chosen, np.random.default_rng(1))


def fly(own: VehiclePlanner, decisions: int) -> list[tuple[Any, int]]:
    """Decides leg after leg, and takes each to its end; the decisions, each with its horizon."""
    v = own.settings.vehicle
    own.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    given = []
    for i in range(decisions):
        own.set_centers(centers(np.random.default_rng(3), 1 + 6 * i), 15.7 * i)
        given.append((own.decide(15.7 * i), own.until.horizon.end))
        own.odometry(15.7 * (i + 1), *(float(x) for x in given[-1][0].leg.end_state))
    return given


def test_the_first_horizon_is_shorter_for_a_lower_share_and_for_a_larger_team() -> None:
    assert horizon(0.5).end < horizon(0.8).end < horizon(0.9).end < 160
    assert horizon(0.8).end == pytest.approx(3 * horizon(0.8, vehicles=3).end, abs=3)
    assert horizon(0.8, steps=40).end == 40, "no more than the mission has"
    assert horizon(None).end == 160


def test_a_map_that_falls_short_moves_the_horizon_on_once_it_is_near() -> None:
    own = horizon(0.8)
    first = own.end
    late = math.ceil(0.8 * first)
    own.judged(late - 1, 0.3)
    assert own.end == first, "it is far"
    own.judged(late, 0.65)
    assert own.end == first, "the map will have the share"
    own.judged(late, 0.5)
    assert own.end == math.ceil(late * 0.8 / 0.5)
    own.judged(own.end - 1, 0.0)
    assert own.end == 160, "the mission's last step"
    assert not own.is_near(159)


def test_a_decision_always_finds_legs_before_the_horizon() -> None:
    own = horizon(0.8)
    first = own.end
    own.extend(first - 2)
    assert own.end == first
    own.extend(first - 1)
    assert own.end == first - 1 + LEAST_LEGS
    own.extend(159)
    assert own.end == 160


@pytest.mark.parametrize(
    "more",
    [
        {"mission": {"steps": STEPS}},
        {"mission": {"steps": STEPS, "until": {"undiscovered_m": 100.0}}},
        {"mission": {"steps": 250, "until": {"found": 0.5}}},
        {"mission": {"steps": STEPS, "vehicles": 1, "until": {"found": 0.5}}},
        {"mission": {"steps": STEPS, "until": {"found": 0.5}}, "planner": {"method": "augmented"}},
        {"mission": {"steps": STEPS, "until": {"found": 0.5}}, "planner": {"method": "fixed_tour"}},
    ],
    ids=["no quality", "no share", "stages", "a single vehicle", "another method", "a tour that is never changed"],
)
def test_other_missions_are_planned_as_a_whole(more: dict[str, Any]) -> None:
    chosen = settings(more.get("planner", {"method": "tour"}), mission=more["mission"])
    own = VehiclePlanner(1, chosen, np.random.default_rng(1))
    assert own.until.horizon.is_whole
    assert not own.until.horizon.is_near(chosen.mission.steps - 1)


def test_a_tour_ends_at_the_horizon_and_is_planned_anew_when_that_moves() -> None:
    own = planner(until={"found": 0.5})
    first = own.until.horizon.end
    assert 10 < first < STEPS - 10
    for decision, end in fly(own, first):
        path = own.rollout.follow(decision.plan)
        assert path.step + len(path) >= end, "every receiver sees a path to the horizon"
        assert path.step + len(path) < end + 4, "a tour consists of whole segments"
    assert own.until.horizon.end >= first + LEAST_LEGS - 2, "no map was judged, so the horizon moved on"


def test_plans_of_a_horizon_are_rebuilt_by_mates_that_have_another_one() -> None:
    own, mate = planner(until={"found": 0.5}), planner()
    for decision, _ in fly(own, 3):
        heard, sent = (one.rollout.follow(decision.plan) for one in (mate, own))
        np.testing.assert_array_equal(heard.states, sent.states)


def test_a_planner_started_again_keeps_its_horizon() -> None:
    own = planner(until={"found": 0.5})
    fly(own, 2)
    own.until.horizon.end += 7
    again = planner(until={"found": 0.5})
    again.restore(own.snapshot())
    assert again.until.horizon.end == own.until.horizon.end
    again.set_centers(centers(np.random.default_rng(3), 13), 40.0)
    own.set_centers(centers(np.random.default_rng(3), 13), 40.0)
    for one in (own, again):
        one.odometry(31.4, *(float(x) for x in own.decided_leg.end_state))
    continued, undisturbed = again.decide(40.0), own.decide(40.0)
    # a map that is built in one go rounds otherwise than one that has grown, and tours differ with that
    assert continued.bound.expected_end == pytest.approx(undisturbed.bound.expected_end, rel=0.02)
    lengths = {len(own.rollout.follow(decision.plan)) for decision in (continued, undisturbed)}
    assert lengths == {own.until.horizon.end - 2}
