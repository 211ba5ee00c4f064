"""The online GP against the textbook, what becomes of soundings, and honesty about bad input."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from textbook import dense

from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_gp import GpConfig, Kernel, OnlineGp, Outcome, SoundingError
from auv_lse_gp.inference.factor import BLOCK, Factor
from auv_lse_gp.map.store import MERGE_WINDOW


def bottom(locations):
    """A made-up lake."""
    return 15.0 + 6.0 * np.sin(locations[:, 0] / 60.0) * np.cos(locations[:, 1] / 45.0) + locations[:, 0] / 100.0


def soundings(n, seed=0, size=400.0):
    rng = np.random.default_rng(seed)
    locations = rng.uniform(0, size, (n, 2))
    return locations, bottom(locations) + rng.normal(0, 0.3, n)


def add_all(gp, locations, depths):
    for (north, east), depth in zip(locations, depths, strict=True):
        gp.add(north, east, depth)


def textbook(gp, queries):
    """Mean and covariance by a dense solve."""
    mean, covariance, _ = dense(gp.kernel, gp.prior_mean, gp.centers, queries[:0], 0.0, queries)
    return mean, covariance


@pytest.mark.usefixtures("numba_or_numpy")
@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("name", KERNELS)
def test_agrees_with_the_textbook(name, merge):
    config = GpConfig(kernel=name, merge=merge, mean="plane", mean_slope_north=0.01, length_scale_2_m=50.0,
                      rotation_deg=20.0)  # fmt: skip
    gp = OnlineGp(config)
    locations, depths = soundings(420)
    queries = np.random.default_rng(1).uniform(-50, 450, (333, 2))
    for (north, east), depth in zip(locations, depths, strict=True):
        gp.add(north, east, depth)
        if len(gp) in (1, 2, 130):
            gp.predict(queries[:3])  # asking in between must change nothing
    assert len(gp) > 2 * BLOCK
    assert gp.counts.kept == len(gp)
    assert gp.counts.kept + gp.counts.merged + gp.counts.too_close == len(locations)
    assert (gp.counts.merged > 0) is merge
    mean, covariance = textbook(gp, queries)
    tiny = 1e-11 * config.signal_std_m**2  # a covariance near 0 is a difference of numbers up to the signal's variance
    got_mean, got_std = gp.predict(queries)
    assert_allclose(got_mean, mean, rtol=1e-9)
    assert_allclose(got_std, np.sqrt(np.diag(covariance)), rtol=1e-9)
    columns = gp.posterior.at(queries)
    assert_allclose(columns.mean_m, mean, rtol=1e-9)
    assert_allclose(gp.posterior.covariance(columns, columns), covariance, rtol=1e-9, atol=tiny)
    centers, lower = gp.centers, gp.posterior.factor.lower
    own = gp.kernel(centers.locations_m, centers.locations_m) + np.diag(centers.noise_std_m**2)
    assert_allclose(lower @ lower.T, own, atol=1e-13 * config.signal_std_m**2)


@pytest.mark.usefixtures("numba_or_numpy")
@pytest.mark.parametrize("name", KERNELS)
def test_agrees_with_the_textbook_when_the_noise_is_small(name):
    gp = OnlineGp(GpConfig(kernel=name, noise_std_m=0.05, min_spacing_m=8.0, merge=False))
    for (north, east), depth in zip(*soundings(300, size=250.0), strict=True):
        gp.add(north, east, depth)
    queries = np.random.default_rng(1).uniform(0, 250, (200, 2))
    mean, covariance = textbook(gp, queries)
    got_mean, got_std = gp.predict(queries)
    assert got_mean == pytest.approx(mean, rel=1e-9)
    assert got_std == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)


def test_without_data_it_is_the_prior():
    gp = OnlineGp(GpConfig(mean_depth_m=12.0, signal_std_m=4.0))
    mean, std = gp.predict(np.zeros((3, 2)))
    assert mean.tolist() == [12.0] * 3
    assert std.tolist() == [4.0] * 3
    assert gp.predict(np.zeros((0, 2)))[0].shape == (0,)


def test_one_datum_worked_by_hand():
    # k = 16, noise 9, residual 5: mean 12 + 16/25 * 5, variance 16 - 256/25.
    gp = OnlineGp(GpConfig(mean_depth_m=12.0, signal_std_m=4.0, noise_std_m=3.0))
    assert gp.add(10.0, 20.0, 17.0) is Outcome.KEPT
    mean, std = gp.predict(np.array([[10.0, 20.0]]))
    assert mean[0] == pytest.approx(15.2)
    assert std[0] == pytest.approx(2.4)


@pytest.mark.parametrize("merge", [False, True])
def test_postponed_factorization_gives_the_same_posterior(merge, monkeypatch):
    later, at_once = OnlineGp(GpConfig(merge=merge)), OnlineGp(GpConfig(merge=merge))
    blocks = []
    append = Factor.append

    def counted(self, cross, own):
        blocks.append(len(own))
        append(self, cross, own)

    monkeypatch.setattr(Factor, "append", counted)
    locations, depths = soundings(300)
    for (north, east), depth in zip(locations, depths, strict=True):
        later.add(north, east, depth)
    assert blocks == []
    centers = later.centers
    assert blocks == []  # where they are needs no factor
    mean, std = later.predict(locations + 3.0)
    assert blocks == [len(later)]
    for (north, east), depth in zip(locations, depths, strict=True):
        at_once.add(north, east, depth)
        assert len(at_once.posterior) == len(at_once)
    assert later.counts == at_once.counts
    assert later.revision == at_once.revision
    for got, wanted in zip(dataclasses.astuple(centers), dataclasses.astuple(at_once.centers), strict=True):
        assert np.array_equal(got, wanted)
    wanted_mean, wanted_std = at_once.predict(locations + 3.0)
    assert mean == pytest.approx(wanted_mean, rel=1e-11)  # the same up to the order of the sums
    assert std == pytest.approx(wanted_std, rel=1e-11)


def test_minimum_spacing_holds_and_dropped_soundings_are_counted():
    gp = OnlineGp(GpConfig(min_spacing_m=10.0, merge=False))
    locations, depths = soundings(600, seed=3, size=120.0)
    outcomes = [gp.add(n, e, d) for (n, e), d in zip(locations, depths, strict=True)]
    kept = gp.centers.locations_m
    distance = np.hypot(*(kept[:, None] - kept[None]).T)
    assert distance[np.triu_indices(len(kept), 1)].min() >= 10.0
    assert outcomes.count(Outcome.KEPT) == len(kept) == gp.counts.kept
    assert outcomes.count(Outcome.TOO_CLOSE) == gp.counts.too_close == 600 - len(kept)
    for location, outcome in zip(locations, outcomes, strict=True):  # nothing was dropped without need
        assert outcome is Outcome.KEPT or np.hypot(*(kept - location).T).min() < 10.0


def test_sounding_at_exactly_the_spacing_is_kept():
    gp = OnlineGp(GpConfig(min_spacing_m=10.0))
    assert gp.add(0.0, 0.0, 10.0) is Outcome.KEPT
    assert gp.add(10.0, 0.0, 10.0) is Outcome.KEPT
    assert gp.add(0.0, math.nextafter(10.0, 0.0), 10.0) is Outcome.MERGED


def test_merging_has_a_smaller_error_than_dropping():
    rng = np.random.default_rng(5)
    error = {}
    queries = rng.uniform(20, 280, (400, 2))
    for merge in (False, True):
        gp = OnlineGp(GpConfig(merge=merge, min_spacing_m=12.0, noise_std_m=0.5))
        noise = np.random.default_rng(6)
        for east in range(0, 301, 25):
            for north in np.arange(0, 300, 1.5):
                gp.add(north, float(east), bottom(np.array([[north, east]]))[0] + noise.normal(0, 0.5))
        mean, std = gp.predict(queries)
        error[merge] = np.sqrt(np.mean((mean - bottom(queries)) ** 2))
        score = (mean - bottom(queries)) / std
        assert np.mean(np.abs(score) < 2.0) > 0.9  # merged or not, it knows how well it knows
    assert error[True] < 0.6 * error[False]


def test_soundings_are_merged_only_into_recent_centers():
    gp = OnlineGp(GpConfig(merge=True, min_spacing_m=5.0))
    for i in range(MERGE_WINDOW + 1):
        assert gp.add(0.0, 10.0 * i, 12.0) is Outcome.KEPT
    assert gp.add(0.0, 1.0, 12.0) is Outcome.TOO_CLOSE
    assert gp.add(0.0, 11.0, 12.0) is Outcome.MERGED


def test_merged_center_is_the_mean_at_the_centroid():
    config = GpConfig(merge=True, min_spacing_m=10.0, noise_std_m=0.3)
    gp = OnlineGp(config)
    assert [gp.add(0, 0, 10.0), gp.add(2, 0, 11.0), gp.add(4, 0, 12.0)][1:] == [Outcome.MERGED] * 2
    centers = gp.centers
    assert centers.locations_m.tolist() == [[2.0, 0.0]]
    assert centers.depths_m.tolist() == [11.0]
    kernel = Kernel(config)
    locations = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
    contrast = np.array([1 / 3, 1 / 3 - 1, 1 / 3])  # mean of the three less the one at the centroid
    wanted = 0.09 / 3 + contrast @ kernel(locations, locations) @ contrast
    assert centers.noise_std_m[0] ** 2 == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("sounding", "message"),
    [
        ((math.nan, 0.0, 10.0), r"north_m=nan.*must be finite"),
        ((0.0, math.inf, 10.0), r"east_m=inf.*must be finite"),
        ((0.0, 0.0, math.nan), r"depth_m=nan.*must be finite"),
        ((0.0, 0.0, -3.0), r"depth_m=-3\.0 is implausible; plausible are 0 to 1000 m"),
        ((0.0, 0.0, 1e4), r"depth_m=10000\.0 is implausible; plausible are 0 to 1000 m"),
        ((2e6, 0.0, 10.0), r"is not within 1000 km of the local origin"),
    ],
)
def test_implausible_soundings_are_rejected(sounding, message):
    gp = OnlineGp(GpConfig())
    with pytest.raises(SoundingError, match=message):
        gp.add(*sounding)
    assert gp.counts.refused == 1
    assert len(gp) == 0


def test_locations_of_another_shape_are_rejected():
    with pytest.raises(ValueError, match=r"locations_m must be .* of shape \(P, 2\), not \(2,\)"):
        OnlineGp(GpConfig()).predict(np.zeros(2))


@pytest.mark.usefixtures("numba_or_numpy")
def test_factor_appends_truncates_and_solves():
    rng = np.random.default_rng(0)
    n = 2 * BLOCK + 37
    root = rng.normal(size=(n, n))
    matrix = root @ root.T + n * np.eye(n)
    factor = Factor(8)
    size = 0
    right = rng.normal(size=(n, 5))
    for step in (1, 1, 60, BLOCK, -BLOCK // 2, -1, 5, n):
        new = min(n, max(0, size + step))
        if new < size:
            factor.truncate(new)
        else:
            factor.append(matrix[size:new, :size], matrix[size:new, size:new])
        size = new
        lower = np.linalg.cholesky(matrix[:size, :size])
        assert_allclose(factor.lower, lower, rtol=1e-9, atol=1e-9)
        wanted = np.linalg.solve(lower, right[:size])
        assert_allclose(factor.solve(right[:size]), wanted, rtol=1e-9, atol=1e-12)
        assert_allclose(factor.inverse @ right[:size], wanted, rtol=1e-9, atol=1e-12)
        assert factor.inverse is factor.inverse
        assert_allclose(factor.solve(right[:size, 0]), wanted[:, 0], rtol=1e-9, atol=1e-12)
        wanted = np.linalg.solve(lower.T, right[:size])
        assert_allclose(factor.solve_transposed(right[:size]), wanted, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match="must be C-ordered float64"):
        factor.solve_in_place(np.asfortranarray(right))


@pytest.mark.parametrize("max_new", [None, 20])
def test_add_all_equals_adding_one_by_one(max_new):
    locations, depths = soundings(200)
    rows = np.column_stack([locations, depths])
    rows[7, 2], rows[9, 0] = -5.0, math.nan  # refused
    one, many = OnlineGp(GpConfig()), OnlineGp(GpConfig())
    wanted, room = [], len(rows) if max_new is None else max_new
    for north, east, depth in rows.tolist():
        try:
            wanted.append(one.add(north, east, depth, grow=room > 0))
        except SoundingError:
            wanted.append(None)
        room -= wanted[-1] is Outcome.KEPT
    got = many.add_all(rows[:120], max_new)
    left = None if max_new is None else max_new - got.count(Outcome.KEPT)
    assert got + many.add_all(rows[120:], left) == wanted
    assert many.counts == one.counts
    assert many.revision == one.revision
    assert "must be finite" in many.last_problem
    for mine, theirs in zip(dataclasses.astuple(many.centers)[:3], dataclasses.astuple(one.centers)[:3], strict=True):
        assert mine == pytest.approx(theirs, rel=1e-12)  # rounding of the sums over merged soundings
