"""Whether a vehicle follows the isobath: the distance of lanes and the shape of the area, by hand."""

import math

import pytest
from planner_helpers import area, settings

from auv_lse_planner.methods.coverage import MAX_LANES_APART, follows_isobath, lanes_apart_m, share_of_hull

#: 400 m x 500 m without a bay of 200 m x 300 m: 140,000 m2.
BAY = {"polygon_m": [0.0, 0.0, 400.0, 0.0, 400.0, 100.0, 200.0, 100.0, 200.0, 400.0, 400.0, 400.0, 400.0, 500.0, 0.0,
                     500.0]}  # fmt: skip


def test_distance_of_lanes_and_share_of_the_hull_by_hand():
    bay = area(BAY["polygon_m"]).grid(20.0)
    # 20 legs of a quarter circle of 15 m: 140,000 m2 / (20 * 23.562 m)
    assert lanes_apart_m(settings(steps=20), bay) == pytest.approx(297.09, abs=0.01)
    assert share_of_hull(bay) == pytest.approx(0.7)
    assert share_of_hull(area().grid(20.0)) == pytest.approx(1.0)
    turned = area((0.0, 0.0, 300.0, 300.0, 0.0, 600.0, -300.0, 300.0)).grid(20.0)
    assert share_of_hull(turned) > 0.9  # cells have steps along an oblique border


@pytest.mark.parametrize("scale_m", [40.0, 85.0, 120.0])
def test_it_follows_where_lanes_lie_too_far_apart_among_shores(scale_m):
    steps = math.floor(140_000.0 / (MAX_LANES_APART * scale_m * 7.5 * math.pi))
    gp = {"length_scale_m": scale_m}
    assert follows_isobath(settings(steps=steps, gp=gp, area=BAY))
    assert not follows_isobath(settings(steps=steps + 1, gp=gp, area=BAY))
    assert not follows_isobath(settings(steps=steps, gp=gp))


@pytest.mark.parametrize("method", ["fixed_tour", "lawnmower", "plain", "augmented"])
def test_only_a_tour_that_is_optimized_again_follows(method):
    assert not follows_isobath(settings({"method": method}, steps=5, area=BAY))


def test_a_team_covers_what_it_can():
    assert follows_isobath(settings(steps=5, area=BAY))
    assert not follows_isobath(settings(vehicles=2, steps=5, area=BAY))


def test_a_vehicle_that_knows_its_shore_lowers_the_risk():
    assert not follows_isobath(settings(steps=5, area={**BAY, "shore": {"bay": [400.0, 100.0, 200.0, 100.0]}}))


def test_a_mission_in_stages_mows():
    wide = {"polygon_m": [10.0 * x for x in BAY["polygon_m"]]}
    assert follows_isobath(settings(steps=200, area=wide))
    assert not follows_isobath(settings(steps=201, area=wide))
