import numpy as np
import pytest
from planner_helpers import centers, dense_posterior

from auv_lse_gp.config import GpConfig
from auv_lse_gp.factor import IllConditionedError
from auv_lse_gp.online import Centers
from auv_lse_planner.reward.posterior import Posterior


@pytest.mark.parametrize("kernel", ["matern52", "wendland_c2", "squared_exponential"])
def test_columns_agree_with_dense_algebra(kernel):
    rng = np.random.default_rng(1)
    config = GpConfig(kernel=kernel)
    data = centers(rng, 80)
    posterior = Posterior(config)
    posterior.set_centers(data)
    at, planned = rng.uniform(0, 400, (30, 2)), rng.uniform(0, 400, (12, 2))
    posterior.plan(planned)
    columns = posterior.columns(at)
    mean, before, after = dense_posterior(config, data, planned, at)
    assert columns.mean_m == pytest.approx(mean, abs=1e-8)
    assert columns.data_var_m2 == pytest.approx(before, abs=1e-8)
    assert columns.planned_var_m2 == pytest.approx(after, abs=1e-8)
    assert np.diag(posterior.covariance(columns, columns)) == pytest.approx(after, abs=1e-8)
    posterior.forget_planned()
    assert posterior.mean_m(at) == pytest.approx(mean, abs=1e-8)
    assert posterior.columns(at).planned_var_m2 == pytest.approx(before, abs=1e-8)


def test_without_data_it_is_the_prior():
    posterior = Posterior(GpConfig())
    columns = posterior.columns(np.array([[1.0, 2.0]]))
    assert columns.mean_m == pytest.approx([15.0])
    assert columns.data_var_m2 == pytest.approx([64.0])


def test_only_what_changed_is_computed_and_the_result_is_as_if_from_scratch():
    rng = np.random.default_rng(2)
    config = GpConfig()
    every = centers(rng, 90)
    watched = rng.uniform(0, 400, (25, 2))
    posterior = Posterior(config)
    posterior.watch(watched)

    def first(count, moved=False):
        places, noise = every.places_m[:count].copy(), every.noise_std_m[:count].copy()
        if moved:
            places[-1] += 1.5
            noise[-1] *= 0.7
        return Centers(places, every.depths_m[:count].copy(), noise)

    for data, kept in [
        (first(30), 0),
        (first(50, moved=True), 30),
        (first(60), 49),
        (first(60), 60),
        (first(40), 40),
        (first(90), 40),
    ]:
        assert posterior.set_centers(data) == kept
        mean, before, _ = dense_posterior(config, data, np.empty((0, 2)), watched)
        columns = posterior.watched()
        assert columns.mean_m == pytest.approx(mean, abs=1e-8)
        assert columns.data_var_m2 == pytest.approx(before, abs=1e-8)
        posterior.plan(watched[:5] + 3.0)
        _, _, after = dense_posterior(config, data, watched[:5] + 3.0, watched)
        assert posterior.watched().planned_var_m2 == pytest.approx(after, abs=1e-8)
        posterior.forget_planned()
        assert posterior.watched().planned_var_m2 == pytest.approx(before, abs=1e-8)


def test_a_changed_depth_alone_changes_the_mean_but_costs_no_factor():
    rng = np.random.default_rng(3)
    data = centers(rng, 40)
    posterior = Posterior(GpConfig())
    posterior.set_centers(data)
    changed = Centers(data.places_m, data.depths_m + 1.0, data.noise_std_m)
    assert posterior.set_centers(changed) == 40
    mean, _, _ = dense_posterior(GpConfig(), changed, np.empty((0, 2)), data.places_m)
    assert posterior.columns(data.places_m).mean_m == pytest.approx(mean, abs=1e-8)


def test_centres_that_cannot_be_factorized_leave_the_good_ones():
    data = centers(np.random.default_rng(4), 10)
    posterior = Posterior(GpConfig())
    posterior.set_centers(data)
    bad = Centers(
        np.concatenate([data.places_m, data.places_m[:1]]),
        np.concatenate([data.depths_m, [3.0]]),
        np.concatenate([data.noise_std_m, [0.0]]),
    )
    worse = Centers(bad.places_m, bad.depths_m, np.concatenate([[0.0], data.noise_std_m[1:], [0.0]]))
    with pytest.raises(IllConditionedError):
        posterior.set_centers(worse)
    assert len(posterior.centers) == 0
    posterior.set_centers(data)
    assert len(posterior.centers) == 10


def test_asking_for_what_is_not_set_up_is_an_error():
    posterior = Posterior(GpConfig())
    with pytest.raises(ValueError, match="no places are watched"):
        posterior.watched()
    posterior.set_centers(centers(np.random.default_rng(5), 5))
    posterior.plan(np.array([[0.0, 0.0]]))
    with pytest.raises(ValueError, match="places are planned"):
        posterior.mean_m(np.zeros((1, 2)))
