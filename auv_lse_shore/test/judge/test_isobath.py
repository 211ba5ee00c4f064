"""Isobaths: traced, compared, written as GeoJSON."""

import json
import math

import numpy as np
import pytest

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_gp.level_set.lines import resample
from auv_lse_shore.judge import isobath


def line(north_m, east_from, east_to):
    east = np.linspace(east_from, east_to, 50)
    return np.column_stack([np.full_like(east, north_m), east])


def test_a_plane_has_a_straight_isobath():
    north, east = np.arange(0.0, 50.0, 5.0), np.arange(0.0, 80.0, 5.0)
    depth = np.broadcast_to(north[:, None] / 2.0, (10, 16)).copy()  # 15 m at north = 30
    (found,) = isobath.trace(north, east, depth, 15.0)
    assert np.allclose(found[:, 0], 30.0)
    assert isobath.length_m([found]) == pytest.approx(75.0)
    depth[:, 8] = np.nan  # unknown ground: the line stops on both sides of it
    assert isobath.length_m(isobath.trace(north, east, depth, 15.0)) == pytest.approx(75.0 - 10.0)


def test_parallel_lines_are_as_far_apart_as_they_are():
    error = isobath.compare([line(5.0, 0.0, 400.0)], [line(0.0, 0.0, 400.0)])
    assert error.mean_m == pytest.approx(5.0)
    assert error.percentile_95_m == pytest.approx(5.0)
    assert (error.found, error.made_up) == (1.0, 0.0)


def test_missing_and_made_up_pieces_count():
    truth = [line(0.0, 0.0, 100.0), line(1000.0, 0.0, 100.0)]
    error = isobath.compare([line(0.0, 0.0, 100.0)], truth)
    assert error.found == pytest.approx(0.5)
    assert error.made_up == 0.0
    assert error.mean_m == pytest.approx(0.25 * 1000.0, rel=1e-3)  # half of one direction is 1000 m off
    back = isobath.compare(truth, [line(0.0, 0.0, 100.0)])
    assert (back.found, back.made_up) == (1.0, 0.5)


def test_nothing_to_compare_is_not_a_number():
    nothing_found = isobath.compare([], [line(0.0, 0.0, 10.0)])
    assert math.isnan(nothing_found.mean_m)
    assert nothing_found.found == 0.0
    nothing_there = isobath.compare([line(0.0, 0.0, 10.0)], [])
    assert nothing_there.made_up == 1.0
    assert math.isnan(nothing_there.found)


def test_points_stand_for_equal_lengths():
    points = resample([line(0.0, 0.0, 100.0), line(9.0, 0.0, 10.0)], spacing_m=2.0)
    assert len(points) == 55
    assert np.allclose(np.diff(points[:50, 1]), 2.0)
    assert resample([]).shape == (0, 2)


def test_geojson_is_wgs84_where_an_origin_is_known(tmp_path):
    lines = [line(120.0, -50.0, 300.0)]
    isobath.write_geojson(tmp_path / "a.geojson", [({"name": "x"}, lines)], (17.1221, -91.6281))
    feature = json.loads((tmp_path / "a.geojson").read_text())["features"][0]
    lon, lat = np.array(feature["geometry"]["coordinates"][0]).T
    north, east = local_from_geodetic(lat, lon, 17.1221, -91.6281)
    assert np.allclose(np.column_stack([north, east]), lines[0], atol=0.02)  # 7 decimals are 1 cm
    assert "WGS84" in feature["properties"]["coordinates"]


def test_geojson_without_an_origin_says_that_it_is_local(tmp_path):
    isobath.write_geojson(tmp_path / "a.geojson", [({"name": "x"}, [line(120.0, -50.0, 300.0)])], None)
    feature = json.loads((tmp_path / "a.geojson").read_text())["features"][0]
    assert feature["geometry"]["coordinates"][0][0] == [-50.0, 120.0]  # east, north: x before y
    assert "local metres" in feature["properties"]["coordinates"]


def test_an_estimate_near_the_true_isobath_outside_of_the_evaluated_cells_is_not_made_up():
    inside, outside = line(0.0, 0.0, 100.0), line(0.0, 500.0, 600.0)
    estimate = [line(2.0, 0.0, 100.0), line(2.0, 500.0, 600.0)]
    assert isobath.compare(estimate, [inside]).made_up == pytest.approx(0.5, abs=0.05)
    error = isobath.compare(estimate, [inside], [outside])
    assert (error.made_up, error.found) == (0.0, 1.0)
    assert error.estimate_mean_m == pytest.approx(2.0)
    nothing_evaluated = isobath.compare(estimate[1:], [], [outside])
    assert nothing_evaluated.made_up == 0.0
    assert np.isnan(nothing_evaluated.found)


def test_a_line_across_the_antimeridian_is_cut_there():
    """As RFC 7946 asks; maps drew it around the earth."""
    north = np.linspace(0.0, 100.0, 11)
    line_m = np.column_stack([north, 60.0 - 2.0 * np.abs(north - 50.0)])  # east of it from 30 to 70 m north
    (feature,) = isobath.geojson_of([({}, [line_m])], (-17.0, 179.9998121))["features"]  # 20 m west of it
    parts = [np.array(part) for part in feature["geometry"]["coordinates"]]
    assert len(parts) == 3
    assert max(np.ptp(part[:, 0]) for part in parts) < 0.001
    assert [part[k, 0] for part, k in zip(parts, (-1, 0, 0), strict=True)] == [180.0, -180.0, 180.0]
    assert parts[0][-1, 1] == parts[1][0, 1] == pytest.approx(-17.0 + 30.0 / 110_650.0, abs=2e-6)
    assert parts[1][-1, 1] == parts[2][0, 1] == pytest.approx(-17.0 + 70.0 / 110_650.0, abs=2e-6)
    assert sum(map(len, parts)) == len(line_m) + 4
