"""The operating area: containment, clearance that is never too large, and refusals."""

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping, to_mapping
from auv_lse_gp import AreaConfig, OperatingArea

#: An L-shaped area of 200 m x 300 m with a triangular island.
L_SHAPE = (0.0, 0.0, 200.0, 0.0, 200.0, 100.0, 100.0, 100.0, 100.0, 300.0, 0.0, 300.0)
ISLAND = (30.0, 150.0, 70.0, 150.0, 50.0, 200.0)


def distance_to_border(positions, polygons):
    """Exact distance of each position to the nearest edge."""
    best = np.full(len(positions), np.inf)
    for polygon in polygons:
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            t = np.clip(((positions - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
            best = np.minimum(best, np.hypot(*(positions - a - t[:, None] * (b - a)).T))
    return best


@pytest.mark.parametrize("raster_m", [1.0, 2.0, 5.0])
def test_clearance_is_conservative_and_accurate(raster_m):
    area = OperatingArea(AreaConfig(polygon_m=L_SHAPE, no_go={"island": ISLAND}, raster_m=raster_m))
    positions = np.random.default_rng(0).uniform([-40, -40], [240, 340], (20_000, 2))
    inside = area.contains(positions)
    true = distance_to_border(positions, [area.polygon, *area.no_go.values()]) * np.where(inside, 1.0, -1.0)
    clearance = area.clearance_m(positions)
    assert np.all(clearance <= true + 1e-9)
    within = np.all((positions >= 0.0) & (positions <= [200.0, 300.0]), axis=1)
    assert np.all(true[within] - clearance[within] < 2.0 * raster_m)
    assert not np.any(clearance[~inside] > 0.0)


def test_contains_worked_by_hand():
    area = OperatingArea(AreaConfig(polygon_m=L_SHAPE, no_go={"island": ISLAND}))
    positions = [[50, 50], [150, 50], [150, 150], [50, 250], [50, 170], [-1, 50], [50, 301], [35, 151], [31, 190]]
    assert area.contains(positions).tolist() == [True, True, False, True, False, False, False, False, True]
    assert area.contains([[50.0, 170.0]]).tolist() == [False]
    reverse = np.array(L_SHAPE).reshape(-1, 2)[::-1].ravel()
    other = OperatingArea(AreaConfig(polygon_m=tuple(reverse), no_go={"island": ISLAND}))
    assert other.contains(positions).tolist() == area.contains(positions).tolist()


def test_grid_covers_the_area():
    area = OperatingArea(AreaConfig(polygon_m=L_SHAPE, no_go={"island": ISLAND}))
    grid = area.grid(4.0)
    assert grid.inside.shape == (len(grid.north_m), len(grid.east_m)) == (50, 75)
    assert grid.north_m[:2].tolist() == [2.0, 6.0]
    assert grid.locations_m.shape == (grid.inside.sum(), 2)
    assert np.all(area.contains(grid.locations_m))
    assert grid.inside.sum() * 16.0 == pytest.approx(200 * 100 + 100 * 200 - 0.5 * 40 * 50, rel=0.02)  # whole cells
    filled = grid.fill(np.arange(len(grid.locations_m), dtype=float))
    assert np.array_equal(filled[grid.inside], np.arange(len(grid.locations_m)))
    assert np.all(np.isnan(filled[~grid.inside]))
    with pytest.raises(ValueError, match=r"resolution_m must be a finite number > 0, not 0\.0"):
        area.grid(0.0)
    with pytest.raises(ValueError, match=r"no center of a 3\.0 m cell lies in the area"):
        OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 3.0, 0.0, 0.0, 1.0), raster_m=0.5)).grid(3.0)
    with pytest.raises(ValueError, match=r"gp: a cell of 301\.0 m is larger than the area of 200 m x 300 m\. Choose"):
        area.grid(301.0, "gp")


def test_raster_represents_a_thin_wall():
    wall = (0.0, 50.0, 100.0, 50.0, 100.0, 50.2, 0.0, 50.2)
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 100.0, 0.0, 100.0, 100.0, 0.0, 100.0), no_go={"wall": wall},
                                    raster_m=4.0))  # fmt: skip
    across = np.column_stack([np.full(1000, 37.3), np.linspace(49.0, 51.2, 1000)])
    assert np.all(area.clearance_m(across) < 1.3)


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        ((0.0, 0.0, 1.0, 1.0), r"area\.polygon_m has 4 numbers; give north, east of at least 3 corners"),
        ((0.0, 0.0, 1.0, 1.0, 2.0, 0.0, 1.0), "has 7 numbers"),
        ((0.0, 0.0, 1.0, math.nan, 2.0, 0.0), r"AreaConfig\.polygon_m\[3\] must be a number in m, not nan"),
        (
            (0.0, 0.0, 10.0, 10.0, 10.0, 0.0, 0.0, 10.0),
            r"itself: the edge from corner 1 \(0, 0\) to corner 2 .* meets the edge from corner 3 .* to corner 4",
        ),
        ((0.0, 0.0, 10.0, 0.0, 20.0, 0.0), r"crosses itself|has no area"),
        ((0.0, 0.0, 0.0, 0.0, 10.0, 5.0), r"corner 1 \(0\.0, 0\.0\) is given twice in a row"),
        ((0.0, 0.0, 10.0, 0.0, 5.0, 0.0, 5.0, 5.0), r"crosses itself"),
        ((0.0, 0.0, 1e7, 0.0, 1e7, 1e7), "must be finite and within 1000 km"),
    ],
)
def test_invalid_polygons_are_named(polygon, message):
    with pytest.raises(ParameterError, match=message):
        AreaConfig(polygon_m=polygon)
    with pytest.raises(ParameterError, match=r"area\.no_go\.reef\b"):
        AreaConfig(no_go={"reef": polygon})


def test_other_invalid_arguments():
    with pytest.raises(ParameterError, match=r"origin_lon_deg are 17\.0, None, so one is missing"):
        AreaConfig(origin_lat_deg=17.0)
    with pytest.raises(ParameterError, match=r"area\.raster_m: 0\.1 m needs .*larger raster_m, at least 1\.2 m"):
        OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 5000.0, 0.0, 5000.0, 5000.0), raster_m=0.1))
    with pytest.raises(ParameterError, match="no_go covers the whole polygon"):
        OperatingArea(
            AreaConfig(polygon_m=(0.0, 0.0, 9.0, 0.0, 9.0, 9.0), no_go={"all": (-9.0, -9.0, 50.0, -9.0, 9.0, 50.0)})
        )


def test_closed_ring_survives_the_mapping_round_trip():
    config = AreaConfig(
        polygon_m=(*L_SHAPE, 0.0, 0.0), no_go={"island": ISLAND}, origin_lat_deg=1.0, origin_lon_deg=2.0
    )
    assert len(OperatingArea(config).polygon) == 6
    assert from_mapping(AreaConfig, to_mapping(config), "test") == config


def test_random_simple_polygons_are_accepted():
    rng = np.random.default_rng(3)
    for _ in range(100):  # stars are simple
        angle = np.sort(rng.uniform(0, 2 * np.pi, 12))
        if np.diff(angle, append=angle[0] + 2 * np.pi).max() > 3.0:
            continue
        radius = rng.uniform(50, 200, 12)
        AreaConfig(polygon_m=tuple(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).ravel()))


@pytest.mark.parametrize("seed", range(8))
def test_raster_distance_equals_the_minimum_over_all_edges(seed):
    """The blocks that look at a few edges only, and the rows that an edge spans, against all edges at all nodes."""
    from auv_lse_common.mission_file.operating_area import (
        _border_distance_2,
        _edge_distance_2,
        _in_polygon,
        _raster_in_polygon,
    )

    rng = np.random.default_rng(seed)
    corners_ = int(rng.integers(3, 40))
    angle, radius = np.sort(rng.uniform(0, 2 * np.pi, corners_)), rng.uniform(50, 300, corners_)
    outer = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    inner = 0.2 * outer + rng.uniform(-50, 50, 2)
    north, east = np.arange(-310, 311, rng.uniform(2, 7)), np.arange(-305, 330, rng.uniform(2, 7))
    n, e = (a.ravel() for a in np.meshgrid(north, east, indexing="ij"))
    expected = np.full(n.shape, np.inf)
    for polygon in (outer, inner):
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            expected = np.minimum(expected, _edge_distance_2(n - a[0], e - a[1], *(b - a)))
    assert np.allclose(_border_distance_2((outer, inner), north, east).ravel(), expected, atol=1e-8)
    inside = _in_polygon(outer, np.column_stack([n, e]))
    assert np.array_equal(_raster_in_polygon(outer, north, east).ravel(), inside)


@pytest.mark.parametrize(
    ("area", "match"),
    [
        (
            {"shore": {"west": (0.0, 0.0)}},
            r"area\.shore\.west has 2 numbers; give finite north, east of at least 2",
        ),
        ({"shore": {"west": (0.0, 0.0, 1.0, math.nan)}}, "give finite north, east"),
        ({"shore_depth_m": math.inf}, r"AreaConfig\.shore_depth_m must be a number from -100 to 12,000 m, not inf"),
        ({"shore": {"west": (0.0, 1.0) * 2001}}, r"have 2,0\d\d corners together"),
    ],
)
def test_an_unusable_shore_is_refused(area, match):
    with pytest.raises(ParameterError, match=match):
        AreaConfig(**area)


def test_too_many_cells_name_the_size_that_is_possible():
    side_m = 20_000.0
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, side_m, 0.0, side_m, side_m, 0.0, side_m), raster_m=20.0))
    with pytest.raises(ParameterError, match=r"cell_m: cells of 5\.0 m .* Choose at least 20 m, or a smaller area"):
        area.grid(5.0, "cell_m")
    assert area.finest_cell_m == 20.0
    assert area.grid(area.finest_cell_m).inside.size <= 1_000_000


def test_cells_of_a_given_size_are_smaller_in_a_narrow_area_and_larger_in_a_vast_one():
    pool = OperatingArea(AreaConfig(polygon_m=(20.0, 18.0, 40.0, 18.0, 40.0, 28.0, 20.0, 28.0), raster_m=0.5))
    assert 2.0 <= pool.cell_m(30.0) <= 2.5  # half the distance of its middle from the border
    assert pool.cell_m(1.0) == 1.0
    assert 20 <= pool.grid(pool.cell_m(30.0)).inside.sum() <= 60
    reach = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 2000.0, 2000.0, 2000.0, 2030.0, 0.0, 30.0)))  # of a river
    assert len(reach.grid(reach.cell_m(57.0)).locations_m) > 100
    usual = OperatingArea(AreaConfig())
    assert [usual.cell_m(size_m) for size_m in (5.0, 10.0, 30.0)] == [5.0, 10.0, 30.0]
    vast = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 20e3, 0.0, 20e3, 20e3, 0.0, 20e3), raster_m=20.0))
    assert vast.cell_m(10.0) == vast.finest_cell_m
