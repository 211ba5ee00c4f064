"""Routes: compiled and plain code agree, budgets hold, ways lead around land."""

import itertools

import numpy as np
import pytest
from planner_helpers import world

from auv_lse_common.support.compiled import plain
from auv_lse_planner.search import routing
from auv_lse_planner.search.routing import Ground, free_area_m2, lloyd, route_m, ruin_and_recreate

SQUARE = (0.0, 0.0, 400.0, 0.0, 400.0, 400.0, 0.0, 400.0)
U_SHAPE = (0.0, 0.0, 400.0, 0.0, 400.0, 400.0, 0.0, 400.0, 0.0, 240.0, 300.0, 240.0, 300.0, 160.0, 0.0, 160.0)


def ground_of(polygon):
    return Ground(world(polygon)[2])


def test_nodes_are_spread_evenly():
    nodes = ground_of(SQUARE).nodes_cm(16)
    off = np.hypot(*np.moveaxis(nodes[:, None] - nodes[None], 2, 0)) + 1e9 * np.eye(16)
    assert off.min() > 0.6 * 10000  # 16 nodes on 400 m x 400 m: 100 m apart
    assert len(nodes) == 16


def test_compiled_equals_plain():
    ground = ground_of(SQUARE)
    nodes = lloyd(ground.locations_cm[::9], 9, 3)
    assert np.array_equal(nodes, plain(lloyd)(ground.locations_cm[::9], 9, 3))
    distance, _ = ground.distances_cm(np.concatenate([nodes, [[1000, 1000]]]))
    near = np.argsort(distance[:-1, :-1], axis=1, kind="stable")
    penalty = np.full(9, 60000)
    one = ruin_and_recreate(distance, near, penalty, 60000, 40, 10000)
    fast, routing.insert_best = routing.insert_best, plain(routing.insert_best)
    try:
        other = plain(ruin_and_recreate)(distance, near, penalty, 60000, 40, 10000)
    finally:
        routing.insert_best = fast
    assert np.array_equal(one, other)


def test_a_route_visits_each_node_once_within_its_budget():
    ground = ground_of(SQUARE)
    line = route_m(ground, np.array([20.0, 20.0]), np.ones(len(ground.locations_cm)), 2200.0, 24)
    assert np.hypot(*np.diff(line, axis=0).T).sum() <= 2200.1
    assert len(np.unique(line[1:], axis=0)) == len(line) - 1 == 24
    assert line[0] == pytest.approx([20.0, 20.0])
    again = route_m(ground_of(SQUARE), np.array([20.0, 20.0]), np.ones(len(ground.locations_cm)), 2200.0, 24)
    assert np.array_equal(line, again)


def test_a_small_budget_goes_to_the_important_ground():
    ground = ground_of(SQUARE)
    weights = np.where(ground.locations_cm[:, 1] > 20000, 1.0, 0.01)  # the eastern half
    line = route_m(ground, np.array([200.0, 200.0]), weights, 700.0, 16)
    assert (line[1:, 1] > 200.0).mean() > 0.7


def test_ways_lead_around_land():
    ground = ground_of(U_SHAPE)
    ends = np.array([[2000, 8000], [2000, 32000], [35000, 20000]])
    distance, bends = ground.distances_cm(ends)
    assert distance[0, 1] > 65000  # 240 m apart, behind a pier of 300 m
    assert distance[0, 1] == distance[1, 0]
    assert bends[0, 1][:, 0].max() > 30000
    assert bends[0, 1][0] == pytest.approx(ends[0], abs=2500)  # in order
    line = route_m(ground, np.array([20.0, 80.0]), np.ones(len(ground.locations_cm)), 1500.0, 12)
    space = world(U_SHAPE)[2]
    dense = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(line)])
    assert min(space.clearance_m(*location) for location in dense) > -3.0


@pytest.mark.parametrize("start_m", [(-90.0, 200.0), (490.0, 200.0), (200.0, -90.0), (200.0, 490.0), (4e3, -9e3)])
def test_a_route_from_outside_enters_the_area(start_m):
    ground = ground_of(SQUARE)
    start_cm = np.rint(100.0 * np.array(start_m)).astype(np.int64)
    distance, _ = ground.distances_cm(np.array([start_cm, [20000, 20000], [10000, 30000]]))
    assert distance[0, 1] >= np.hypot(*(start_cm - 20000)) - 1
    assert distance[1, 2] == pytest.approx(14142, abs=1)
    line = route_m(ground, np.array(start_m), np.ones(len(ground.locations_cm)), 9e3 + 4e3, 12)
    assert line[0] == pytest.approx(start_m, abs=0.01)
    assert len(line) > 1
    assert ((line[1:] > 0.0) & (line[1:] < 400.0)).all()


def test_the_graph_of_ways_has_indices_that_every_supported_scipy_reads():
    """SciPy 1.11's dijkstra raises with others: ends of links with 64 bits stopped every planner near land."""
    graph = ground_of(U_SHAPE)._ways_graph()
    assert (graph.indices.dtype, graph.indptr.dtype) == (np.int32, np.int32)


def test_without_free_ground_there_is_no_area():
    assert free_area_m2(world((0.0, 0.0, 15.0, 0.0, 15.0, 15.0, 0.0, 15.0))[2]) == 0.0
    assert free_area_m2(world(SQUARE)[2]) == pytest.approx(160000.0, rel=0.02)
