"""The one posterior against the dense solve: data, planned locations, after forgetting and extending again."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from textbook import dense

from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_gp import CachedPoints, Centers, GpConfig, IllConditionedError, LevelSet, Posterior
from auv_lse_gp.inference.cached_points import CachedMoments
from auv_lse_gp.inference.point_posteriors import PointPool, join_by_path


def config(kernel="matern52"):
    return GpConfig(kernel=kernel, mean="plane", mean_slope_north=0.01, length_scale_2_m=50.0, rotation_deg=20.0)


def locations(rng, count):
    return rng.uniform(0.0, 400.0, (count, 2))


def centers(rng, count):
    """Soundings of a made-up lake, of different noise."""
    at = locations(rng, count)
    depths = 15.0 + 6.0 * np.sin(at[:, 0] / 60.0) * np.cos(at[:, 1] / 45.0)
    return Centers(at, depths, rng.uniform(0.1, 0.5, count))


def agrees(posterior, planned_m, queries_m, kept=None, moments=None):
    """Asserts that all that the posterior says about locations is what the dense solve gives."""
    mean, given_data, given_both = dense(
        posterior.kernel, posterior.prior_mean, posterior.centers, planned_m, posterior.noise_var_m2, queries_m
    )
    tiny = 1e-11 * posterior.kernel.signal_variance_m2  # a variance is a difference of numbers up to the signal's
    assert len(posterior) == len(posterior.centers) + len(planned_m)
    columns = [posterior.at(queries_m)] + ([kept.current()] if kept else [])
    for c in columns:
        assert_allclose(c.mean_m, mean, rtol=1e-9)
        assert_allclose(c.data_var_m2, np.diag(given_data), rtol=1e-9, atol=tiny)
        assert_allclose(c.planned_var_m2, np.diag(given_both), rtol=1e-9, atol=tiny)
        assert_allclose(posterior.covariance(c, c), given_both, rtol=1e-9, atol=tiny)
        assert_allclose(posterior.covariance(c, columns[0]), given_both, rtol=1e-9, atol=tiny)
    noisy = given_both + posterior.noise_var_m2 * np.eye(len(queries_m))
    assert_allclose(np.tril(posterior.measured_covariance(columns[0])), np.tril(noisy), rtol=1e-9, atol=tiny)
    half = len(queries_m) // 2
    batched = posterior.measured_covariances(columns[0].slice(0, 2 * half), 2)
    assert_allclose(batched[0], noisy[:half, :half], rtol=1e-9, atol=tiny)
    assert_allclose(batched[1], noisy[half : 2 * half, half : 2 * half], rtol=1e-9, atol=tiny)
    predicted = [posterior.moments(queries_m)]
    if moments:
        kept_mean, kept_variance, of_positions = moments.update()
        predicted.append((kept_mean, kept_variance + of_positions))
    for got_mean, got_variance in predicted:
        assert_allclose(got_mean, mean, rtol=1e-9)
        assert_allclose(got_variance, np.diag(given_both), rtol=1e-9, atol=tiny)
    assert_allclose(posterior.mean_m(queries_m), mean, rtol=1e-9)
    one_mean, one_variance = posterior.moments(queries_m[:1])  # a single location takes another way
    assert_allclose([one_mean[0], one_variance[0]], [mean[0], given_both[0, 0]], rtol=1e-9, atol=tiny)


@pytest.mark.usefixtures("numba_or_numpy")
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("planned", [0, 1, 15])
@pytest.mark.parametrize("kernel", KERNELS)
def test_agrees_with_the_dense_solve(kernel, planned, seed):
    rng = np.random.default_rng(seed)
    posterior, queries = Posterior(config(kernel)), locations(rng, 21)
    for count in (0, 1, 90, 60):  # more than a block of the factor
        posterior.extend(centers(rng, count))
        at = locations(rng, planned)
        agrees(posterior.with_planned(at), at, queries)
    agrees(posterior, queries[:0], queries)


@pytest.mark.usefixtures("numba_or_numpy")
@pytest.mark.parametrize("seed", range(4))
def test_random_sequences_of_changes_agree_with_the_dense_solve(seed):
    """A random walk of changes; columns and moments that are kept follow it, asked for now and then."""
    rng = np.random.default_rng(seed)
    posterior, queries = Posterior(config(KERNELS[seed % len(KERNELS)])), locations(rng, 16)
    kept, moments = CachedPoints(posterior, queries), CachedMoments(posterior, queries, int(rng.integers(0, 9)))
    for step in range(30):
        change = rng.integers(0, 5)
        if change == 0:
            at = locations(rng, int(rng.integers(0, 7)))
            planned = posterior.with_planned(at)
            agrees(planned, at, queries, CachedPoints(planned, queries), CachedMoments(planned, queries))
        elif change == 1:
            posterior.extend(centers(rng, int(rng.integers(0, 40))))
        elif change == 2:
            mark = int(rng.integers(0, len(posterior) + 1))
            posterior.truncate(mark)
        else:  # some centers are moved, measured anew or added, as merging and other vehicles do
            held = posterior.centers
            at, depths, noise = held.locations_m.copy(), held.depths_m.copy(), held.noise_std_m.copy()
            if len(held):
                number = int(rng.integers(0, len(held)))
                depths[number] += 0.5
                if change == 3:
                    at[number] += 1.0
            posterior.follow(Centers(at, depths, noise).joined(centers(rng, int(rng.integers(0, 5)))))
        if step % 3 == 0:
            agrees(posterior, queries[:0], queries, kept, moments)


def test_one_datum_and_one_planned_location_worked_by_hand():
    # k = 16, noise 9, residual 5: mean 12 + 16/25 * 5, variance 16 - 256/25 = 5.76; a second measurement of noise 9
    # at the same location: 1 / (1/5.76 + 1/9).
    posterior = Posterior(GpConfig(mean_depth_m=12.0, signal_std_m=4.0, noise_std_m=3.0))
    at = np.array([[10.0, 20.0]])
    posterior.extend(Centers(at, np.array([17.0]), np.array([3.0])))
    posterior = posterior.with_planned(at)
    columns = posterior.at(at)
    assert columns.mean_m[0] == pytest.approx(15.2)
    assert columns.data_var_m2[0] == pytest.approx(5.76)
    assert columns.planned_var_m2[0] == pytest.approx(5.76 * 9.0 / (5.76 + 9.0))


def test_without_data_it_is_the_prior():
    posterior = Posterior(GpConfig())
    columns = posterior.at(np.array([[1.0, 2.0]]))
    assert (columns.mean_m[0], columns.data_var_m2[0], columns.planned_var_m2[0]) == (15.0, 64.0, 64.0)
    assert posterior.covariance(columns, columns).tolist() == [[64.0]]
    assert posterior.moments(np.zeros((0, 2)))[0].shape == (0,)
    kept = CachedPoints(posterior, np.zeros((2, 2)))
    assert kept.current().mean_m.tolist() == [15.0, 15.0]


def test_follow_recomputes_only_changed_rows():
    rng = np.random.default_rng(2)
    every, posterior = centers(rng, 90), Posterior(GpConfig())

    def first(count, moved=False):
        at, noise = every.locations_m[:count].copy(), every.noise_std_m[:count].copy()
        if moved:
            at[-1] += 1.5
            noise[-1] *= 0.7
        return Centers(at, every.depths_m[:count].copy(), noise)

    for data, kept in [
        (first(30), 0),
        (first(50, moved=True), 30),
        (first(60), 49),
        (first(60), 60),
        (first(40), 40),
        (first(90), 40),
        (Centers(every.locations_m, every.depths_m + 1.0, every.noise_std_m), 90),  # depths alone cost no factor
    ]:
        before = posterior.rows
        assert posterior.follow(data) == kept
        assert np.array_equal(posterior.rows[:kept], before[:kept])
        agrees(posterior, np.zeros((0, 2)), every.locations_m[:10] + 3.0)


def test_follow_copies_its_arrays():
    rng = np.random.default_rng(6)
    data, posterior = centers(rng, 20), Posterior(GpConfig())
    posterior.follow(data)
    data.locations_m[5] += 10.0  # the caller's arrays are the caller's
    assert posterior.follow(data) == 5


def test_a_blank_posterior_is_independent():
    rng = np.random.default_rng(7)
    posterior, queries = Posterior(config()), locations(rng, 12)
    posterior.extend(centers(rng, 140))
    posterior = posterior.with_planned(queries[:2])
    before = posterior.moments(queries)
    other = posterior.blank()
    assert len(other) == 0
    other.extend(centers(rng, 145))
    agrees(other, queries[:0], queries)
    other.truncate(100)
    other = other.with_planned(queries[3:5])
    assert np.array_equal(posterior.moments(queries), before)
    agrees(posterior, queries[:2], queries)


def test_planning_does_not_change_the_posterior():
    rng = np.random.default_rng(9)
    posterior, queries, at = Posterior(config()), locations(rng, 12), locations(rng, 15)
    posterior.extend(centers(rng, 140))
    before = posterior.moments(queries)
    planned = posterior.with_planned(at[:10])
    agrees(planned, at[:10], queries)
    agrees(planned.with_planned(at[10:]), at, queries)
    assert len(posterior.with_planned(at[:0])) == len(posterior) == 140
    assert np.array_equal(posterior.moments(queries), before)
    posterior.extend(centers(rng, 3))
    agrees(planned, at[:10], queries)  # a snapshot


def test_data_after_planned_locations_are_rejected():
    rng = np.random.default_rng(8)
    posterior = Posterior(GpConfig())
    posterior = posterior.with_planned(locations(rng, 3))
    with pytest.raises(ValueError, match=r"extend: this posterior has 3 planned locations. Extend the"):
        posterior.extend(centers(rng, 2))


def test_ill_conditioned_centers_leave_the_unchanged_ones():
    rng = np.random.default_rng(4)
    posterior, data = Posterior(GpConfig()), centers(rng, 10)
    posterior.extend(data)
    twice = data.slice(0, 1).joined(data.slice(0, 1))
    twice = Centers(
        twice.locations_m + 5.0, twice.depths_m, np.zeros(2)
    )  # two measurements at one location, without noise
    with pytest.raises(IllConditionedError, match="12 centers is not positive definite"):
        posterior.extend(twice)
    agrees(posterior, data.locations_m[:0], data.locations_m)
    with pytest.raises(IllConditionedError):
        posterior.follow(data.slice(0, 7).joined(twice))
    assert len(posterior) == 7
    agrees(posterior, data.locations_m[:0], data.locations_m)
    assert posterior.follow(data) == 7


def test_locations_of_another_shape_are_rejected():
    posterior = Posterior(GpConfig())
    for ask in (posterior.moments, posterior.mean_m, lambda p: CachedPoints(posterior, p)):
        with pytest.raises(ValueError, match=r"locations_m must be .* of shape \(P, 2\), not \(2,\)"):
            ask(np.zeros(2))


def test_points_are_selected_and_joined():
    rng = np.random.default_rng(5)
    posterior = Posterior(GpConfig())
    posterior.extend(centers(rng, 30))
    posterior = posterior.with_planned(locations(rng, 4))
    first, second = locations(rng, 6), locations(rng, 9)  # three paths of 2 + 3 locations
    parts = [np.concatenate([first[2 * i : 2 * i + 2], second[3 * i : 3 * i + 3]]) for i in range(3)]
    wanted = posterior.at(np.concatenate(parts))
    joined = join_by_path(posterior.at(first), posterior.at(second), 3)
    pool = PointPool(len(posterior))
    pool.add(posterior.at(locations(rng, 4090)))
    begin = pool.add(wanted)  # it grows
    for got in (joined, pool.take(begin + np.arange(15)), joined.take(np.arange(15))):
        for name in ("scaled", "white", "mean_m", "data_var_m2", "planned_var_m2"):
            assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-9, atol=1e-10)
    assert np.array_equal(joined.slice(3, 5).mean_m, joined.mean_m[3:5])


def test_theorem_1_holds_for_random_fields():
    """Benefit 0 for no planned location, never negative, monotone in the planned set; over many random fields."""
    rng = np.random.default_rng(11)
    broken = checked = 0
    for trial in range(1000):
        gp = GpConfig(
            kernel=KERNELS[trial % len(KERNELS)],
            signal_std_m=float(10 ** rng.uniform(-0.3, 1.2)),
            length_scale_m=float(rng.uniform(20, 200)),
            noise_std_m=float(10 ** rng.uniform(-1.3, 0.3)),
            mean_depth_m=float(rng.normal(15, 3)),
        )
        level_set = LevelSet(cost_false_safe=float(rng.uniform(1, 20)), cost_false_unsafe=float(rng.uniform(1, 20)))
        approximate = LevelSet(
            cost_false_safe=level_set.cost_false_safe,
            cost_false_unsafe=level_set.cost_false_unsafe,
            method="exponential_quadratic",
        )
        scale = level_set.cost_false_safe + level_set.cost_false_unsafe
        posterior = Posterior(gp)
        data = Centers(rng.uniform(0, 300, (12, 2)), rng.normal(15, 4, 12), np.full(12, gp.noise_std_m))
        posterior.extend(data)
        queries = np.concatenate([rng.uniform(0, 300, (6, 2)), data.locations_m[:2]])
        planned, benefits = rng.uniform(0, 300, (8, 2)), []
        for begin, end in itertools.pairwise((0, 0, 1, 4, 8)):
            posterior = posterior.with_planned(planned[begin:end])
            columns = posterior.at(queries)
            before, after = columns.data_var_m2, columns.planned_var_m2
            args = (columns.mean_m, np.sqrt(np.maximum(before - after, 0.0)), np.sqrt(after))
            benefits.append(level_set.benefit(*args))
            broken += int(np.sum(approximate.benefit(*args) < -1e-9 * scale))
            checked += len(queries)
        assert np.all(benefits[0] <= 1e-13 * scale)
        assert np.all(np.array(benefits) >= 0.0)
        # Variances are differences: their rounding, 1e-13 of the signal's, moves the benefit by as much.
        assert np.all(np.diff(benefits, axis=0) >= -1e-11 * scale)
    assert broken > 0.02 * checked  # the paper's approximation breaks it


def test_averaged_centers_are_the_means_of_their_groups():
    centers = Centers(
        np.array([[0.0, 0.0], [10.0, 0.0], [4.0, 2.0], [30.0, 0.0]]),
        np.array([10.0, 12.0, 14.0, 20.0]),
        np.array([0.3, 0.4, 0.4, 0.5]),
        np.array([[1.0], [3.0], [5.0], [7.0]]),
    )
    found = centers.averaged(np.array([[2, 0], [1, 0], [2, 0], [0, 0]]))
    assert found.locations_m.tolist() == [[2.0, 1.0], [10.0, 0.0], [30.0, 0.0]]
    assert found.depths_m.tolist() == [12.0, 12.0, 20.0]
    assert found.noise_std_m.tolist() == [0.25, 0.4, 0.5]  # sqrt(.3^2 + .4^2) / 2
    assert found.position_effect_m.tolist() == [[3.0], [3.0], [7.0]]
