"""The coarse chart that a team may have before its mission."""

import numpy as np
import pytest
from sim_helpers import TINY

from auv_lse_common.mission_file.sections.world import ChartConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_sim.ground.chart import coarse_chart, with_chart
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_source import ground_of

EXTENT = Extent(north_min_m=-400.0, north_max_m=400.0, east_min_m=-400.0, east_max_m=400.0)


class Slope:
    """20 m deep at north 0, 1 m deeper every 20 m north; land west of -300 m."""

    def depth_m(self, north_m, east_m):
        return np.where(np.asarray(east_m) < -300.0, np.nan, 20.0 + np.asarray(north_m) / 20.0)


def settings(**overrides):
    return Settings.from_patterns({"/**": {"mission": {"seed": 8200, "vehicles": 2}}}, "test", overrides)


def test_a_chart_without_errors_is_the_smoothed_truth():
    config = ChartConfig(smoothing_m=50.0, error_m=0.0)
    north, east, depth = coarse_chart(Slope(), EXTENT, config, np.random.default_rng(1))
    inner = np.abs(north) < 200.0  # a slope stays what it is under symmetric weights that meet no edge
    known = east > -100.0
    assert depth[np.ix_(inner, known)] == pytest.approx(np.repeat(20.0 + north[inner, None] / 20.0, known.sum(), 1))
    assert np.diff(north) == pytest.approx(25.0), "half of the smoothing"


def test_the_errors_have_the_size_and_the_length_asked_for():
    config = ChartConfig(smoothing_m=20.0, error_m=2.0, error_length_m=20.0)
    errors = []
    for seed in range(4):
        north, _, depth = coarse_chart(Slope(), EXTENT, config, np.random.default_rng(seed))
        errors.append((depth - 20.0 - north[:, None] / 20.0)[6:-6, 14:])
    errors = np.stack(errors)
    # about 1,000 independent locations: 2 % of the standard deviation, so 10 % is far off
    assert errors.std() == pytest.approx(2.0, rel=0.1)
    # white noise under Gaussian weights of s: correlation exp(-d^2 / 4 s^2); nodes are 10 m apart
    far = (errors[:, 4:] * errors[:, :-4]).mean() / errors.var()
    assert far == pytest.approx(np.exp(-1.0), abs=0.1)


def test_a_mission_starts_from_its_chart(tmp_path):
    asked = settings(**{"sim.chart.smoothing_m": 75.0})
    charted = with_chart(asked, tmp_path)
    assert charted.common.gp.mean == charted.vehicles[1].gp.mean == "survey"
    locations = np.stack(np.meshgrid(np.arange(0.0, 600.0, 20.0), np.arange(0.0, 500.0, 20.0)), axis=-1).reshape(-1, 2)
    truth = ground_of(asked).depth_m(locations[:, 0], locations[:, 1])
    off = truth - prior_mean(charted.common.gp)(locations)
    assert np.nanstd(off) < 0.75 * np.nanstd(truth), "it knows something"
    assert np.nanstd(off) > 2.0, "and not all"
    again = tmp_path / "again"
    again.mkdir()
    np.testing.assert_array_equal(
        prior_mean(with_chart(asked, again).common.gp)(locations), prior_mean(charted.common.gp)(locations)
    )


def test_vehicles_and_judge_start_from_the_same_chart():
    small = {**TINY, "mission.steps": 3, "planner.method": "plain"}
    flat = simulate_and_evaluate(settings(**small).to_patterns(), "flat").summary
    charted = simulate_and_evaluate(
        settings(**small, **{"sim.chart.smoothing_m": 75.0}).to_patterns(), "charted"
    ).summary
    assert charted.risk_before < 0.9 * flat.risk_before
    assert charted.steps == flat.steps == 3


def test_a_mission_that_asks_for_no_chart_is_left_alone(tmp_path):
    asked = settings()
    assert with_chart(asked, tmp_path) is asked
    assert not list(tmp_path.iterdir())


def test_a_chart_of_nothing_is_refused():
    nowhere = Extent(north_min_m=-10.0, north_max_m=10.0, east_min_m=-900.0, east_max_m=-800.0)
    with pytest.raises(GroundError, match="no ground is known"):
        coarse_chart(Slope(), nowhere, ChartConfig(smoothing_m=50.0), np.random.default_rng(1))
