"""Banks near a known shore: relative depths against the model in depths, and what they change."""

import dataclasses

import numpy as np
import shapely
from numpy.testing import assert_allclose, assert_array_equal

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_gp import GpConfig, Kernel, LevelSet, OnlineGp
from auv_lse_gp.inference.banks import BANK_M, WIDTH_STD, Banks, width_factor
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.undiscovered import coarse_grid, undiscovered

SHORE_M, LEVEL_M = 6.0, 15.0
AREA = AreaConfig(
    polygon_m=(5.0, 0.0, 5.0, 200.0, 205.0, 200.0, 205.0, 0.0),
    shore={"south": (0.0, -200.0, 0.0, 400.0)},
    shore_depth_m=SHORE_M,
)
OPEN = dataclasses.replace(AREA, shore={})
CONFIG = GpConfig(std_soundings=0.0)
BANKS = Banks.of(AREA, LEVEL_M)
AT = np.random.default_rng(3).uniform(2.0, 200.0, (60, 2))


def track(north_m=60.0, depth_m=30.0, n=15):
    """Soundings (n, 3) of deep ground along the shore."""
    return np.column_stack([np.full(n, north_m), np.linspace(0.0, 200.0, n), np.full(n, depth_m)])


def centers():
    rng = np.random.default_rng(1)
    locations = rng.uniform(5.0, 200.0, (25, 2))
    return Centers(locations, rng.uniform(8.0, 30.0, 25), np.full(25, 0.3), rng.normal(0.0, 0.5, (25, 2)))


def dense(data, at):
    """Mean and variance of the depth for the covariance s(p) s(q) k(p, q) and the mean h + s (m - h)."""

    def s(locations):
        return np.maximum(1.0 - np.exp(-locations[:, 0] / BANK_M), 0.05)

    def mean(locations):
        return SHORE_M + s(locations) * (CONFIG.mean_depth_m - SHORE_M)

    def covariance(a, b):
        return np.outer(s(a), s(b)) * Kernel(CONFIG)(a, b)

    x, effect = data.locations_m, data.position_effect_m
    gram = covariance(x, x) + np.diag(data.noise_std_m**2)
    weights = np.linalg.solve(gram, covariance(x, at))
    variance = np.diag(covariance(at, at)) - np.einsum("np,np->p", covariance(x, at), weights)
    return mean(at) + weights.T @ (data.depths_m - mean(x)), variance + ((effect.T @ weights) ** 2).sum(axis=0)


def test_relative_depths_agree_with_the_model_in_depths():
    data = centers()
    posterior = Posterior(CONFIG, banks=BANKS)
    posterior.extend(data)
    relative, variance = posterior.moments(AT)
    mean, expected = dense(data, AT)
    assert_allclose(BANKS.depths(AT, relative), mean, rtol=1e-9)
    assert_allclose(BANKS.factor(AT) * np.sqrt(variance), np.sqrt(expected), rtol=1e-9)
    assert_array_equal(BANKS.depths(AT, relative) >= LEVEL_M, relative >= LEVEL_M)
    again = Posterior(CONFIG, banks=BANKS)
    again.follow(data.slice(0, 10))
    again.follow(data)
    for found, first in zip(again.moments(AT), (relative, variance), strict=True):
        assert_allclose(found, first, rtol=1e-9)


def test_slopes_are_those_of_the_depth():
    posterior = Posterior(CONFIG, banks=BANKS)
    posterior.extend(centers())

    def depth(locations):
        return BANKS.depths(locations, posterior.mean_m(locations))

    steps = 0.1 * np.eye(2)
    at = AT[AT[:, 0] > 10.0]  # vehicles keep their distance
    differences = [(depth(at + step) - depth(at - step)) / 0.2 for step in steps]
    # The prior mean's slope is a difference over 1 m: off by about (.5 / 10)^2.
    assert_allclose(posterior.slopes(at), np.stack(differences, axis=1), rtol=5e-3, atol=5e-4)


def test_the_factor_rests_on_the_distance_to_the_nearest_piece_of_shore():
    rng = np.random.default_rng(2)
    lines = [np.array([[0.0, 0.0], [0.0, 90.0], [70.0, 120.0]]), np.array([[200.0, 10.0], [150.0, 12.0]])]
    lines.append(np.column_stack([np.linspace(100.0, 300.0, 30), 200.0 + rng.uniform(-20.0, 20.0, 30)]))  # jagged
    at = rng.uniform(-60.0, 320.0, (5000, 2))
    shore = shapely.union_all([shapely.LineString(line) for line in lines])
    distance = shapely.distance(shapely.points(at), shore)
    expected = np.maximum(1.0 - np.exp(-distance / BANK_M), 0.05)
    assert_allclose(Banks(lines, 0.0, LEVEL_M).factor(at), expected)


def test_the_variance_of_a_banks_width_is_that_of_the_depth_it_changes():
    d, depth = 20.0, np.array([18.0])
    at = np.array([[d, 100.0]])
    s = 1.0 - np.exp(-d / BANK_M)
    rise = (depth - SHORE_M) / s  # of open ground
    step = 1e-4
    wider = SHORE_M + (1.0 - np.exp(-d / (BANK_M * np.exp(step)))) * rise
    relative = LEVEL_M + (depth - LEVEL_M) / s
    per_e = (wider - depth) / step / s
    assert_allclose(BANKS.width_variance(at, relative), (WIDTH_STD * per_e) ** 2, rtol=1e-3)
    assert_array_equal(BANKS.width_variance(at, np.array([-20.0])), 0.0)  # shallower than the shore


def test_a_map_is_less_sure_of_a_bank_than_its_prior_unless_it_was_sounded():
    banked = DepthMap(CONFIG, LevelSet(level_m=LEVEL_M), OperatingArea(AREA))
    banked.add_soundings(np.column_stack([np.arange(15.0), track()]))
    north = banked.grid.locations_m[:, 0]
    isobath, deep = np.abs(north - 14.0) < 3.0, np.abs(north - 180.0) < 3.0

    def ratio():
        field, inside = banked.field(), banked.grid.inside
        return field.std_m[inside] / field.prior_std_m[inside]

    factor = width_factor(
        BANKS, banked.grid.locations_m, banked.gp.moments(banked.grid.locations_m)[0], CONFIG.signal_std_m
    )
    assert_allclose(ratio(), np.sqrt(1.0 + factor))
    assert ratio()[isobath].min() > 1.2
    assert ratio()[deep].max() < 1.01
    std = banked.field().std_m[banked.grid.inside][isobath].max()
    banked.add_soundings(np.column_stack([np.arange(15.0, 30.0), track(14.0, 15.0)]))
    assert banked.field().std_m[banked.grid.inside][isobath].max() < 0.3 * std


def test_soundings_far_out_do_not_deepen_the_bank():
    location = np.array([[8.0, 100.0]])
    without, with_banks = OnlineGp(CONFIG), OnlineGp(CONFIG, banks=BANKS)
    for gp in (without, with_banks):
        gp.add_all(track())
    assert without.predict(location)[0][0] > 22.0
    mean, std = with_banks.predict(location)
    assert SHORE_M < mean[0] < LEVEL_M
    assert std[0] < without.predict(location)[1][0]


def test_the_bank_of_unsounded_ground_falls_to_the_shore():
    mean, std = OnlineGp(CONFIG, banks=BANKS).predict(np.array([[0.0, 100.0], [BANK_M, 100.0], [190.0, 100.0]]))
    assert_allclose(mean, [SHORE_M, SHORE_M + 0.632 * 9.0, 15.0], atol=0.5)
    assert_allclose(std, [0.05 * 8.0, 0.632 * 8.0, 8.0], rtol=0.01)


def test_without_a_shore_all_ground_is_open():
    assert Banks.of(OPEN, LEVEL_M) is None
    with_option, before = DepthMap(CONFIG, LevelSet(), OperatingArea(OPEN)), OnlineGp(CONFIG)
    with_option.add_soundings(np.column_stack([np.arange(15.0), track()]))
    before.add_all(track())
    locations = with_option.grid.locations_m
    assert_array_equal(with_option.field().mean_m[with_option.grid.inside], before.predict(locations)[0])


def test_a_map_is_in_depths_and_calls_the_bank_shallow():
    banked, open_map = (DepthMap(CONFIG, LevelSet(level_m=LEVEL_M), OperatingArea(a)) for a in (AREA, OPEN))
    for depth_map in (banked, open_map):
        depth_map.add_soundings(np.column_stack([np.arange(15.0), track()]))
    inside, rim = banked.grid.inside, banked.grid.locations_m[:, 0] < 12.0
    field = banked.field()
    expected = banked.gp.predict(banked.grid.locations_m)
    assert_allclose(field.mean_m[inside], expected[0])
    assert_allclose(field.prior_std_m[inside], expected[1])
    assert_allclose(field.risk[inside], LevelSet(level_m=LEVEL_M).risk(expected[0], field.std_m[inside]))
    assert field.p_safe[inside][rim].mean() < 0.2 < 0.8 < open_map.field().p_safe[inside][rim].mean()
    (line,) = banked.isobath().lines
    assert 10.0 < line[:, 0].min() < line[:, 0].max() < 40.0


def test_samples_are_compared_as_depths():
    gp = OnlineGp(CONFIG, banks=BANKS)
    gp.add_all(track())
    near_shore = np.array([[12.0, 100.0, 11.0], [12.0, 60.0, 60.0]])
    _, fit = gp.add_if_fitting(near_shore, 5.0, 10)
    assert fit.tolist() == [True, False]


def test_the_undiscovered_isobath_knows_the_banks():
    banked = OnlineGp(CONFIG, banks=BANKS)
    banked.add_all(track())
    grid = coarse_grid(OperatingArea(AREA), 5.0)
    missing = [
        undiscovered(CONFIG, banked.centers, LEVEL_M, grid, lambda p: np.zeros(len(p), dtype=bool), banks)
        for banks in (None, BANKS)
    ]
    # Deep ground was sounded: only the banks tell that there is an isobath, 200 m long, between it and the shore.
    assert missing[0].expected_m < 100.0 < missing[1].expected_m
