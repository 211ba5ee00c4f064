"""Routes of a team before its vehicles have heard of each other."""

import numpy as np
import pytest
from planner_helpers import centers, settings

from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

#: Ground for which one vehicle is too few, concave: two arms.
TWO_ARMS = (0.0, 0.0, 420.0, 0.0, 420.0, 420.0, 0.0, 420.0, 0.0, 260.0, 300.0, 260.0, 300.0, 160.0, 0.0, 160.0)


def planner(vehicle=1, vehicles=3, steps=30, team_routes=True, **sections):
    area = {"polygon_m": list(TWO_ARMS)}
    start = {"start_north_m": 60.0, "start_east_m": 60.0}
    own = settings(
        {"method": "tour", "team_routes": team_routes}, vehicles, steps, **{"area": area, "vehicle": start, **sections}
    )
    return VehiclePlanner(vehicle, own, np.random.default_rng(1))


def test_every_vehicle_computes_the_same_routes_whatever_it_has_measured():
    one, other = planner(1), planner(3)
    other.set_centers(centers(np.random.default_rng(3), 20), 0.0)
    other._take_centers(evaluates=True)
    assert len(one._context.routes.lines_m) == 3
    for a, b in zip(one._context.routes.lines_m, other._context.routes.lines_m, strict=True):
        assert np.array_equal(a, b)


def test_mates_are_assumed_on_their_routes_and_routes_are_expected_to_beat_lanes():
    first = planner(1)
    routes = first._context.routes
    first.team.assume_plans(0.0)
    (_, second), (_, third) = first.team.in_time_order(0.0)
    assert second == pytest.approx(first.rollout.follow(routes.plan(2)).places_m)
    assert third == pytest.approx(first.rollout.follow(routes.plan(3)).places_m)
    paths = [first.rollout.follow(routes.plan(k)).leg_places_m for k in (1, 2, 3)]
    assert routes.expected_end(paths) > routes.lanes_end


def test_the_first_decision_is_at_least_its_route():
    first = planner(1)
    first.odometry(0.0, 0.0, 60.0, 60.0)
    bound = first.decide(0.0).bound
    routes = first._context.routes
    paths = [first.rollout.follow(routes.plan(k)).leg_places_m for k in (1, 2, 3)]
    assert bound.expected_end - bound.budget < routes.expected_end(paths)
    assert bound.budget > 0.0


@pytest.mark.parametrize(
    ("vehicles", "steps", "team_routes", "why"),
    [
        (1, 30, True, "a single vehicle"),
        (3, 300, True, "nodes closer than a turn"),
        (3, 30, False, "the default"),
    ],
)
def test_without_routes_mates_are_assumed_to_mow(vehicles, steps, team_routes, why):
    first = planner(1, vehicles, steps, team_routes)
    assert first._context.routes.lines_m == [], why
    if vehicles > 1:
        start = np.array([0.0, 60.0, 60.0])
        mowing = first.rollout.path(0, start, (), FITTED[1])
        first.team.assume_plans(0.0)
        assert first.team.in_time_order(0.0)[0][1] == pytest.approx(mowing.places_m)


def test_a_vehicle_that_has_started_keeps_its_routes_after_a_restart():
    first = planner(1)
    first.odometry(0.0, 0.0, 60.0, 60.0)
    first.decide(0.0)
    again = planner(1)
    again.restore(first.snapshot())
    kept, rebuilt = first.team.in_time_order(0.0), again.team.in_time_order(0.0)
    for (_, before), (_, after) in zip(kept, rebuilt, strict=True):
        assert np.array_equal(before, after)
