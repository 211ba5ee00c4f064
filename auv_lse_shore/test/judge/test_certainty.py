"""What is claimed of an isobath: found, likely, or guessed."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import resample
from auv_lse_gp.map import certainty
from auv_lse_gp.map.certainty import FLAT, FOUND, GUESSED, LIKELY, NOT_VISITED, POSITIONS_UNCERTAIN
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_shore.judge import isobath

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 300.0, 0.0, 300.0, 600.0, 0.0, 600.0)))


def classified(soundings, position_std_m=0.0, area=AREA, **gp):
    """The pieces of the isobath of a map of (north, east, depth) soundings (n, 3)."""
    config = GpConfig(**{"length_scale_m": 60.0, "noise_std_m": 0.2, **gp})
    depth_map = DepthMap(config, LevelSet(level_m=15.0), area)
    stamps = np.arange(float(len(soundings)))[:, None]
    depth_map.add_soundings(np.hstack([stamps, soundings]))
    locations = np.column_stack([soundings[:, :2], np.full(len(soundings), position_std_m)])
    shore_known = bool(area.config.shore)
    lines, field = depth_map.isobath().lines, depth_map.field()
    return certainty.classify(lines, field, config.signal_std_m, locations, shore_known=shore_known)


def slope(east_from, east_to, per_m=0.1):
    """Soundings every 12 m on a plane that is 15 m deep at north = 150, on lanes along north every 30 m."""
    north, east = np.meshgrid(np.arange(10.0, 300.0, 12.0), np.arange(east_from, east_to, 30.0))
    return np.column_stack([north.ravel(), east.ravel(), 15.0 + per_m * (north.ravel() - 150.0)])


def test_where_the_ground_was_measured_the_line_is_found():
    pieces = classified(slope(0.0, 601.0), std_soundings=0.0)
    assert {p.kind for p in pieces} == {FOUND}
    assert certainty.length_of(pieces, FOUND) == pytest.approx(600.0, rel=0.03)
    # At a sounding the depth is known to 0.2 m, so the line to 2 m on a slope of 0.1; between soundings less well.
    assert 1.5 < min(p.std_m.min() for p in pieces) < 3.0 < max(p.std_m.max() for p in pieces)
    assert all(p.reason == "" for p in pieces)


def test_ground_smoother_than_the_prior_narrows_the_line_and_does_not_find_more_of_it():
    """The standard deviation shrinks; the share of the prior that the soundings removed stays.

    Up to 30 m more are likely: at the survey's end the prior's standard deviation passes that class's limit sooner.
    """
    ground = slope(400.0, 601.0)
    by_prior, told = (classified(ground, std_soundings=worth) for worth in (0.0, 100.0))
    assert min(p.std_m.min() for p in told) < 0.9 * min(p.std_m.min() for p in by_prior)
    guessed = [certainty.length_of(pieces, GUESSED) for pieces in (by_prior, told)]
    assert guessed[0] - 30.0 < guessed[1] < 1.05 * guessed[0]


def test_nothing_is_claimed_where_nobody_measured():
    """The prior's own mean is the level: without data the map's contour is the prior's, and runs everywhere."""
    pieces = classified(slope(400.0, 601.0))
    in_the_west = [p for p in pieces if p.line[:, 1].min() < 300.0]
    assert in_the_west, "the mean crosses the level there, too"
    assert all(p.line[:, 1].min() > 330.0 for p in pieces if p.kind != GUESSED)
    assert {p.reason for p in in_the_west} == {NOT_VISITED}
    # A plane is smooth, so the line is also found before the first lane, less far than lanes are apart (30 m), and
    # 7.5 m beyond the border.
    assert 200.0 <= isobath.length_m(certainty.lines_of(pieces, FOUND)) < 237.5


def test_a_line_that_soundings_only_lead_to_is_less_sure_than_one_between_them():
    """Lanes 4 m from the line and farther, on its deep side alone: the ground may level out before the line."""
    plane = slope(0.0, 601.0, per_m=0.17)
    deep, shallow = plane[plane[:, 0] > 150.0], plane[plane[:, 0] < 125.0]
    both = np.concatenate([deep, shallow])
    one_side, both_sides = (classified(each, std_soundings=0.0, noise_std_m=0.4) for each in (deep, both))
    assert {(p.kind, p.reason) for p in one_side} == {(LIKELY, NOT_VISITED)}
    assert {p.kind for p in both_sides} == {FOUND}


def test_soundings_beyond_the_line_count_up_to_20_m_from_it():
    """Lanes 4 m from the line and farther on its deep side, and one on the other: at 21 m it is as if there were none.

    At a distance of 4 m and s / g = 2 m, the slope may be half of the mean's.
    """
    along = np.arange(0.0, 601.0, 12.0)

    def lane(north_m):
        return np.column_stack([np.full(51, north_m), along, np.full(51, 15.0 + 0.17 * (north_m - 150.0))])

    deep = [lane(north_m) for north_m in (154.0, 184.0, 214.0)]
    near, far = (
        classified(np.concatenate([*deep, lane(150.0 - m)]), std_soundings=0.0, noise_std_m=0.4) for m in (19.0, 21.0)
    )
    near_m, far_m = (float(np.median(np.concatenate([p.std_m for p in pieces]))) for pieces in (near, far))
    assert 1.4 < far_m / near_m < 3.0


def test_a_line_beyond_the_border_is_less_sure_by_half_its_distance():
    """The last cells' centers are at north 157.5 m, and the line is 7.5 m beyond."""
    area = OperatingArea(AreaConfig(polygon_m=(156.0, 0.0, 300.0, 0.0, 300.0, 600.0, 156.0, 600.0)))
    whole, beyond = (classified(slope(0.0, 601.0), area=each, std_soundings=0.0) for each in (AREA, area))
    assert {p.kind for p in beyond} == {FOUND}
    std_m, more_m = (float(np.median(np.concatenate([p.std_m for p in pieces]))) for pieces in (whole, beyond))
    # the depth's standard deviation is that of the last cells, a few per cent off that at the line
    assert more_m == pytest.approx(np.hypot(std_m, 3.75), rel=0.05)


def test_a_bank_beyond_the_last_cells_stays_found_as_more_is_measured():
    """A bank of 0.5 m per m, 15 m deep 4 m beyond the border: a better map must not lose its line."""
    along = np.arange(10.0, 600.0, 12.0)
    lanes = [
        np.column_stack([np.full(len(along), n), along, 17.0 + 0.5 * np.full(len(along), n)]) for n in (8.0, 20, 32)
    ]
    truth = np.column_stack([np.full(101, -4.0), np.linspace(0.0, 600.0, 101)])
    shares = []
    for number in (2, 3):
        found = certainty.lines_of(classified(np.concatenate(lanes[:number])), FOUND)
        shares.append(isobath.compare(found, [truth]).found)
    assert shares[0] > 0.95
    assert shares[1] >= shares[0]


def test_a_steep_prior_finds_nothing_by_itself():
    one = np.array([[10.0, 10.0, 1.0]])
    plane = {"mean": "plane", "mean_depth_m": 0.0, "mean_slope_north": 0.1, "signal_std_m": 0.9}
    pieces = classified(one, **plane)  # 0.9 m on a slope of 0.1: within 9 m to either side, says the chart
    assert certainty.length_of(pieces, GUESSED) == pytest.approx(600.0, rel=0.05)
    assert {p.kind for p in pieces} == {GUESSED}


def test_a_known_shore_finds_the_isobath_beside_sounded_ground():
    """Soundings 70 m from the shore show how deep the lake is; where the bank crosses the level follows from both."""
    shore = AreaConfig(polygon_m=AREA.config.polygon_m, shore={"south": (-3.0, -200.0, -3.0, 800.0)}, shore_depth_m=5.0)
    along = np.arange(10.0, 600.0, 12.0)
    track = np.column_stack([np.full(len(along), 67.0), along, np.full(len(along), 30.0)])
    with_shore = classified(track, area=OperatingArea(shore))
    bank = [p for p in with_shore if p.line[:, 0].max() < 60.0]
    assert certainty.length_of(bank, FOUND) > 500.0
    # s = 1 - exp(-d / 25 m) = (15 - 5) / (g - 5) at the isobath. Open ground g there is less deep than the track, but
    # deeper than 23 m: d is 13 to 20 m, and less certain than half of that by the bank's width.
    d = np.median(np.concatenate([p.line[:, 0] for p in bank])) + 3.0
    assert 13.0 < d < 20.0
    assert min(p.std_m.min() for p in bank) > 0.4 * d
    assert not [p for p in classified(track) if p.line[:, 0].max() < 60.0 and p.kind == FOUND]
    on_the_isobath = np.column_stack([np.full(len(along), 10.0), along, np.full(len(along), 15.0)])
    both = np.concatenate([track, on_the_isobath])
    sounded = [p for p in classified(both, area=OperatingArea(shore)) if p.line[:, 0].max() < 60.0]
    assert max(p.std_m[AREA.contains(p.line)].max() for p in sounded if p.kind == FOUND) < 3.0
    # A track on flat ground may lie elsewhere, the shore does not. Soundings on the bank move the line with them.
    moved = [p for p in classified(track, 15.0, OperatingArea(shore)) if p.line[:, 0].max() < 60.0]
    assert certainty.length_of(moved, FOUND) > 500.0
    assert {p.kind for p in classified(both, 15.0, OperatingArea(shore)) if p.line[:, 0].max() < 60.0} == {LIKELY}


def test_far_from_all_soundings_there_is_not_even_a_guess():
    line = classified(slope(0.0, 100.0))
    assert {p.kind for p in line} == {FOUND, LIKELY, GUESSED}
    east = max(p.line[:, 1].max() for p in line)
    assert 250.0 < east < 500.0, "the mean crosses the level up to 597 m"
    assert max(p.std_m.max() for p in line) < 2e5


def test_vehicles_unsure_of_their_locations_find_less():
    pieces = classified(slope(0.0, 601.0), position_std_m=15.0)
    assert {(p.kind, p.reason) for p in pieces} == {(LIKELY, POSITIONS_UNCERTAIN)}
    unknown = classified(slope(0.0, 601.0), position_std_m=np.nan)  # a driver that says nothing about it
    assert {p.kind for p in unknown} == {FOUND}


def test_on_flat_ground_a_small_error_moves_the_line_far():
    pieces = classified(slope(0.0, 601.0, per_m=0.004))
    assert FOUND not in {p.kind for p in pieces}
    assert {p.reason for p in pieces} == {FLAT}


def test_pieces_are_the_whole_line_without_gaps():
    pieces = classified(slope(200.0, 400.0))
    kinds = {p.kind for p in pieces}
    assert kinds == {FOUND, LIKELY, GUESSED}
    ends = np.array([p.line[0] for p in pieces] + [p.line[-1] for p in pieces])
    inner = [end for end in ends if 3.0 < end[1] < 597.0]  # the outermost cells' centers are at 2.5 and 597.5
    for end in inner:  # each inner end is that of two pieces
        assert np.count_nonzero(np.all(np.isclose(ends, end), axis=1)) >= 2


def test_a_short_stretch_is_worth_no_more_than_what_is_beside_it():
    east = np.arange(0.0, 105.0, 5.0)
    locations = np.column_stack([np.zeros_like(east), east])
    ranks = np.full(21, 2)
    ranks[5:7] = 0  # 10 m
    ranks[12:18] = 1  # 30 m
    out = certainty._without_short_stretches(ranks, locations)
    assert set(out[:12]) == {2}
    assert set(out[12:18]) == {1}


def test_the_classes_of_certainty_are_calibrated():
    """Lakes drawn from the prior, measured on a few lanes: what is found is within two standard deviations."""
    rng = np.random.default_rng(5)
    config = GpConfig(length_scale_m=60.0, noise_std_m=0.2)
    grid = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 300.0, 0.0, 300.0, 600.0, 0.0, 600.0))).grid(10.0)
    locations = grid.locations_m
    factor = np.linalg.cholesky(Kernel(config)(locations, locations) + 1e-6 * np.eye(len(locations)))
    off = {kind: [] for kind in certainty.CLASSES}
    for _ in range(6):
        depth = 15.0 + factor @ rng.standard_normal(len(locations))
        lanes = np.isin(np.round(locations[:, 1]), np.round(grid.east_m[4::11]))
        soundings = np.column_stack([locations[lanes], depth[lanes] + 0.2 * rng.standard_normal(lanes.sum())])
        truth = isobath.trace(grid.north_m, grid.east_m, grid.fill(depth), 15.0)
        for piece in classified(soundings):
            distance = cKDTree(resample(truth)).query(piece.line)[0]
            off[piece.kind] += distance.tolist()
    # 95 % of the found locations lie within 2 x 10 m and of the likely ones within 2 x 30 m; the distance to the
    # nearest
    # piece of the truth can only be less. Some 200 locations of each class: 0.9 is three standard errors below 0.95.
    assert len(off[FOUND]) > 100
    assert np.mean(np.array(off[FOUND]) <= 20.0) > 0.9
    assert np.mean(np.array(off[LIKELY]) <= 60.0) > 0.9
    assert np.mean(off[FOUND]) < np.mean(off[LIKELY]) < np.mean(off[GUESSED])


def test_the_distance_of_the_line_found_is_that_of_its_errors():
    line = np.array([[0.0, 0.0], [0.0, 100.0]])

    def piece(kind, std_m):
        return certainty.Piece(line=line, kind=kind, reason="", std_m=np.full(2, std_m))

    assert certainty.found_within_m([piece(FOUND, 2.0)]) == pytest.approx(1.96 * 2.0, rel=1e-3)
    # half with 1 m, half with 3 m: P(|N(0, 1)| < d) + P(|N(0, 3)| < d) = 1.9
    assert certainty.found_within_m([piece(FOUND, 1.0), piece(FOUND, 3.0)]) == pytest.approx(4.935, rel=1e-3)
    assert np.isnan(certainty.found_within_m([piece(LIKELY, 2.0)]))


def test_a_line_is_densified_evenly_with_all_its_corners() -> None:
    line = np.array([[0.0, 0.0], [0.0, 12.0], [0.0, 12.0], [3.0, 12.0], [3.0, 22.0]])
    expected = [[0, 0], [0, 4], [0, 8], [0, 12], [3, 12], [3, 17], [3, 22]]
    assert certainty._densified(line).tolist() == expected
