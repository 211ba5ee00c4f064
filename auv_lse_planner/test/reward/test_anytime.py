"""The anytime reward: against dense solves and finite differences, telescoping, mates in time order."""

import dataclasses

import numpy as np
import pytest
from planner_helpers import area, centers, dense_posterior, expected_risk

from auv_lse_common.mission_file.sections.gp import KERNELS, GpConfig
from auv_lse_common.support import compiled
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward import anytime
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting

UNEQUAL = LevelSet(cost_false_safe=3.0, cost_false_unsafe=10.0)


class Case:
    """A reward with all that it was made from."""

    def __init__(self, seed=1, data=60, planned=0, mates=(), legs=20, step=30, steps=50, weight=1.5, **options):
        rng = np.random.default_rng(seed)
        self.config = GpConfig(kernel=options.get("kernel", "matern52"))
        self.level = options.get("level", LevelSet())
        self.known = centers(rng, data)
        self.planned_m = rng.uniform(0, 400, (planned, 2))
        self.posterior = Posterior(self.config)
        self.posterior.follow(self.known)
        self.posterior = self.posterior.with_planned(self.planned_m)
        self.locations_m = area().grid(40.0).locations_m
        self.coarse_m = area().grid(60.0).locations_m
        self.mates = [(np.sort(rng.uniform(0, latest, count)), rng.uniform(0, 400, (count, 2)))
                      for count, latest in mates]  # fmt: skip
        self.kept = CachedPoints(self.posterior, self.locations_m)
        self.time = Weighting(legs, step, steps, weight)
        coarse = CachedPoints(self.posterior, self.coarse_m)
        self.inflation = options.get("inflation", 1.0)
        self.reward = AnytimeReward(self.kept, self.level, self.mates, self.time, coarse, self.inflation)
        self.path_m = rng.uniform([0, 0], [360, 460], (legs, options.get("each", 1), 2))

    def dense(self, path_m, at_m, checkpoints, mates, inflation=1.0):
        """Risk after each checkpoint, by a dense solve for each; standard deviations are `inflation` times as large."""
        risks = []
        for legs in [-1, *checkpoints]:  # -1: before the first
            measured = [self.planned_m, path_m[: max(legs, 0)].reshape(-1, 2)]
            for ahead, m in mates:
                measured.append(m[: len(m) if legs == self.time.legs else int(np.sum(ahead <= legs))])
            mean, before, after = dense_posterior(self.config, self.known, np.concatenate(measured), at_m)
            risks.append(expected_risk(self.level, mean, inflation**2 * before, inflation**2 * after).sum())
        return np.array(risks)

    def drop(self, locations_m):
        """Drop of the map's risk by measurements at locations, without any order, by dense solves."""
        risks = []
        for measured in (self.planned_m, np.concatenate([self.planned_m, locations_m])):
            mean, before, after = dense_posterior(self.config, self.known, measured, self.locations_m)
            risks.append(expected_risk(self.level, mean, before, after).sum())
        return risks[0] - risks[1]


CASES = {
    "no data": {"data": 0},
    "data": {},
    "unequal costs": {"level": UNEQUAL},
    "mates": {"mates": ((9, 18.0), (7, 30.0))},
    "planned locations": {"planned": 8, "mates": ((5, 10.0),)},
    "locations along legs": {"each": 3, "legs": 7, "mates": ((6, 7.0),)},
    "inflation": {"inflation": 2.5, "level": UNEQUAL, "mates": ((9, 18.0),)},
    "only the end counts": {"weight": 0.0},
    "only the end counts, with mates": {"weight": 0.0, "planned": 8, "mates": ((9, 18.0), (7, 30.0))},
}


@pytest.mark.parametrize("name", CASES)
def test_value_agrees_with_the_dense_computation(name):
    case = Case(**CASES[name])
    legs, step, steps, weight, _ = dataclasses.astuple(case.time)
    ends = np.unique(np.rint(np.linspace(0, legs, -(-legs // anytime.CHECKPOINT_LEGS) + 1)).astype(int))[1:]
    drops = -np.diff(case.dense(case.path_m, case.locations_m, ends, case.mates, case.inflation))
    expected, begin = 0.0, 0
    for end, drop in zip(ends, drops, strict=True):
        for i in range(begin + 1, end + 1):  # the risk falls evenly between checkpoints
            expected += drop / (end - begin) * (1 + weight * (1 - (step + i) / steps))
        begin = end
    value = case.reward.value(case.path_m)
    assert value.weighted == pytest.approx(expected, rel=1e-8)  # cells of 1e-9 of the largest risk are left out
    uninflated = -np.diff(case.dense(case.path_m, case.locations_m, ends, case.mates))
    assert value.expected_end == pytest.approx(uninflated.sum(), rel=1e-8)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("numba", [False, True])
def test_gradient_agrees_with_finite_differences(name, numba, monkeypatch):
    if numba and not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    monkeypatch.setattr(compiled, "USE_NUMBA", numba)
    case = Case(**CASES[name])
    locations = case.path_m.reshape(-1, 2)
    value, gradient = case.reward.value_and_gradient(locations)
    assert _dense_rough(case) == pytest.approx(value, rel=1e-9)
    rng = np.random.default_rng(0)
    scale = np.abs(gradient).max()
    for _ in range(6):
        aside = rng.normal(size=locations.shape)
        differences = [
            case.reward.value_and_gradient(locations + k * 0.02 * aside)[0]
            - case.reward.value_and_gradient(locations - k * 0.02 * aside)[0]
            for k in (1, 2)
        ]
        slope = (8 * differences[0] - differences[1]) / (12 * 0.02)  # fourth order
        # single precision, with what the covariances' conditions cost
        assert (gradient * aside).sum() == pytest.approx(slope, rel=1e-4, abs=1e-4 * scale)


def _dense_rough(case):
    """What `value_and_gradient` gives, by dense solves."""
    legs, step, steps, weight, _ = dataclasses.astuple(case.time)
    count = min(anytime.GRADIENT_CHECKPOINTS, -(-legs // anytime.CHECKPOINT_LEGS))
    ends = np.unique(np.rint(np.linspace(0, legs, count + 1)).astype(int))[1:]
    mean, before, after = dense_posterior(case.config, case.known, case.planned_m, case.coarse_m)
    before, after = case.inflation**2 * before, case.inflation**2 * after
    counted = (
        expected_risk_of_each(case.level, mean, before, after) > anytime.GRADIENT_RISK_SHARE * case.level.largest_risk
    )
    every = anytime.GRADIENT_MATES_EVERY
    mates = [(ahead[every // 2 :: every], m[every // 2 :: every]) for ahead, m in case.mates]
    drops = -np.diff(case.dense(case.path_m, case.coarse_m[counted], ends, mates, case.inflation))
    begins = np.concatenate([[0], ends[:-1]])
    weights = 1 + weight * (1 - (step + (begins + 1 + ends) / 2) / steps)  # the mean over legs begin + 1 to end
    return float(weights @ drops) * len(case.locations_m) / len(case.coarse_m)


def expected_risk_of_each(level, mean, before, after):
    after = np.clip(after, 0.0, before)
    return level.expected_risk(mean, np.sqrt(before - after), np.sqrt(after))


@pytest.mark.parametrize("kernel", KERNELS)
def test_gradient_of_every_kernel(kernel):
    case = Case(kernel=kernel, legs=6, mates=((5, 6.0),))
    locations = case.path_m.reshape(-1, 2)
    gradient = case.reward.value_and_gradient(locations)[1]
    aside = np.random.default_rng(0).normal(size=locations.shape)
    values = [case.reward.value_and_gradient(locations + k * 0.01 * aside)[0] for k in (-2, -1, 1, 2)]
    slope = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / 0.12
    assert (gradient * aside).sum() == pytest.approx(slope, rel=1e-4)  # single precision


@pytest.mark.parametrize("name", CASES)
def test_compiled_agrees_with_numpy(name, monkeypatch):
    if not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    results = []
    for numba in (True, False):
        monkeypatch.setattr(compiled, "USE_NUMBA", numba)
        case = Case(**CASES[name])
        value, gradient = case.reward.value_and_gradient(case.path_m.reshape(-1, 2))
        exact = case.reward.value(case.path_m)
        results.append((np.array([value, exact.weighted, exact.expected_end]), gradient))
    # 1e-12 of the variances, through roots of what is left of them
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-8, abs=1e-9)
    largest = np.abs(results[1][1]).max()
    assert results[0][1] == pytest.approx(results[1][1], abs=1e-4 * largest)  # single precision


@pytest.mark.parametrize("mates", [(), ((6, 12.0), (8, 40.0))])
def test_with_weight_0_it_is_the_drop_at_the_end(mates):
    case = Case(weight=0.0, mates=mates)
    value = case.reward.value(case.path_m)
    assert value.weighted == pytest.approx(value.expected_end, rel=1e-12)
    theirs = [m for _, m in case.mates]
    everything = np.concatenate([case.path_m.reshape(-1, 2), *theirs])
    assert value.expected_end == pytest.approx(case.drop(everything), rel=1e-8)


def test_weighing_with_a_share_equals_a_new_reward_with_that_weight():
    case = Case(mates=[(12, 20.0)])
    whole, half, end = (case.reward.weighing(share).value(case.path_m) for share in (1.0, 0.5, 0.0))
    assert whole == case.reward.value(case.path_m)
    assert half.weighted == pytest.approx(0.5 * (whole.weighted + end.weighted), rel=1e-12), "J is linear in the weight"
    assert half.expected_end == end.expected_end == whole.expected_end
    flat = case.path_m.reshape(-1, 2)
    values, gradients = zip(*(case.reward.weighing(s).value_and_gradient(flat) for s in (1.0, 0.5, 0.0)), strict=True)
    assert values[1] == pytest.approx(0.5 * (values[0] + values[2]), rel=1e-12)
    largest = np.abs(gradients[1]).max()  # single precision
    assert gradients[1] == pytest.approx(0.5 * (gradients[0] + gradients[2]), abs=1e-4 * largest)


def test_weighing_with_0_equals_a_new_reward_without_weight():
    case = Case(mates=[(12, 20.0)])
    of_the_end = case.reward.weighing(0.0)
    end = case.reward.value(case.path_m).expected_end
    assert of_the_end.value(case.path_m).weighted == pytest.approx(end, rel=1e-12)
    assert of_the_end.risk_before == case.reward.risk_before


def test_at_the_last_step_every_weight_is_1():
    case = Case(legs=1, step=49)
    value = case.reward.value(case.path_m)
    assert value.weighted == pytest.approx(value.expected_end, rel=1e-12)


def test_it_telescopes_in_expectation():
    """E over the first leg's measurement of (drop so far + end of the rest) is the end of the whole beforehand."""
    case = Case(data=25, legs=5, mates=((4, 5.0),), weight=0.0)
    whole = case.reward.value(case.path_m).expected_end
    first = case.path_m[0]
    at = case.posterior.at(first)
    spread = np.sqrt(at.data_var_m2[0] + case.config.noise_std_m**2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    mates = [(ahead - 1.0, m) for ahead, m in case.mates]
    total = 0.0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        measured = Centers(
            np.concatenate([case.known.locations_m, first]),
            np.append(case.known.depths_m, at.mean_m[0] + spread * node),
            np.append(case.known.noise_std_m, case.config.noise_std_m),
        )
        case.posterior.follow(measured)
        later = AnytimeReward(case.kept, case.level, mates, Weighting(4, 31, 50))
        total += weight * (case.reward.risk_before - later.risk_before + later.value(case.path_m[1:]).expected_end)
    # 60 Gauss-Hermite nodes on integrands with kinks (the call about a location changes): 0.5 %
    assert total == pytest.approx(whole, rel=5e-3)


def test_early_measurements_count_more():
    case = Case(data=0, legs=20, step=0, steps=20)
    there = np.linspace([20.0, 20.0], [360.0, 460.0], 20)[:, None]
    late = np.concatenate([np.repeat(there[:1], 10, axis=0), there[::2]])
    early = np.concatenate([there[::2], np.repeat(there[:1], 10, axis=0)])
    one, two = case.reward.value(early), case.reward.value(late)
    assert one.expected_end == pytest.approx(two.expected_end, rel=1e-9)
    assert one.weighted > 1.1 * two.weighted


def test_earlier_mate_reduces_the_early_gain():
    case = Case(data=0, legs=8, step=0, steps=8)
    soon = AnytimeReward(case.kept, case.level, [(np.full(8, 1.0), case.path_m[:, 0])], case.time)
    late = AnytimeReward(case.kept, case.level, [(np.full(8, 99.0), case.path_m[:, 0])], case.time)
    one, two = soon.value(case.path_m), late.value(case.path_m)
    assert one.expected_end == pytest.approx(two.expected_end, rel=1e-9)
    assert one.weighted > two.weighted


def test_path_without_locations_has_value_0():
    case = Case()
    assert case.reward.value(np.empty((0, 1, 2))) == anytime.Value(0.0, 0.0)
    over = AnytimeReward(case.kept, case.level, [], Weighting(0, 50, 50, 1.5))
    assert over.value(np.empty((0, 1, 2))) == anytime.Value(0.0, 0.0)
    value, gradient = over.value_and_gradient(np.empty((0, 2)))
    assert (value, gradient.shape) == (0.0, (0, 2))


def test_value_without_own_locations_is_that_of_the_mates():
    case = Case(mates=((6, 12.0),))
    alone = case.reward.value(np.empty((0, 1, 2)))
    assert alone.expected_end == pytest.approx(case.drop(case.mates[0][1]), rel=1e-8)
    assert case.reward.value(case.path_m).expected_end > alone.expected_end


def test_gradient_is_0_without_risk():
    case = Case()
    far = CachedPoints(case.posterior, case.locations_m)
    sure = AnytimeReward(far, LevelSet(level_m=12_000.0), [], case.time)
    value, gradient = sure.value_and_gradient(case.path_m.reshape(-1, 2))
    assert value == 0.0
    assert not gradient.any()


def test_a_measured_location_has_a_finite_gradient():
    """Where all is known already, or nothing at all (mean at the level), slopes of the risk have no bound."""
    case = Case(data=0, legs=4)
    on_cells = case.locations_m[[0, 0, 5, 9]]
    value, gradient = case.reward.value_and_gradient(on_cells)
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


def test_wrong_number_of_locations_is_reported():
    case = Case(legs=4)
    with pytest.raises(ValueError, match="locations_m has 5 legs, but only 4 remain"):
        case.reward.value(np.zeros((5, 1, 2)))
    with pytest.raises(ValueError, match="locations_m: 7 locations cannot be divided evenly among 4 legs"):
        case.reward.value_and_gradient(np.zeros((7, 2)))


def test_coarse_value_equals_the_value_with_gradient():
    case = Case(mates=((6, 12.0),))
    locations = case.path_m.reshape(-1, 2)
    assert case.reward.coarse_value(locations) == pytest.approx(case.reward.value_and_gradient(locations)[0], rel=1e-12)


def test_risk_near_sums_the_cells_near_the_path():
    case = Case(data=0)
    everywhere = case.reward.risk_near(case.coarse_m)
    one = case.reward.risk_near(case.coarse_m[:1])
    assert everywhere == pytest.approx(one * len(case.coarse_m))  # no data: every cell has the same risk
    assert case.reward.risk_near(case.coarse_m[:1] + 1000.0) == 0.0
