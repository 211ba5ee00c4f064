"""The risk functions: against references of high precision, by hand, by brute force, and Theorem 1."""

import csv
import functools
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, stats

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support import compiled
from auv_lse_gp import (
    LevelSet,
    bayes_estimate,
    bayes_risk,
    benefit_of_search,
    expected_bayes_risk,
    p_safe,
)
from auv_lse_gp.level_set.bayes_risk import METHODS, expected_bayes_risk_numpy, expected_bayes_risk_slope

#: Made by make_expected_bayes_risk.py: integrals of the definition in arbitrary precision.
REFERENCE = Path(__file__).with_name("expected_bayes_risk.csv")
# mean, s_mu, s_q, level, c1, c2, expected risk: high-precision integration (mpmath), and what can be worked by hand.
CASES = [
    (23.29306651769643, 0.607842656719804, 2.508615207863491, 15.0, 10.0, 10.0, 0.0065708933119593104484),
    (3.0706742908715725, 7.30922164512763, 0.008870137748900307, 2.905607575445469, 18.321853545968807,
     0.33845143550106455, 0.0004024366870104567489),
    (15.0, 1.0, 1.0, 15.0, 10.0, 10.0, 2.5),  # 2 c T(0, 1) = 20 / 8
    (15.0, 0.0, 2.0, 15.0, 10.0, 4.0, 2.0),  # nothing learned, at the level: min(c1, c2) / 2
    (15.0, 3.0, 0.0, 15.0, 10.0, 4.0, 0.0),  # all will be known
    (14.0, 0.0, 0.0, 15.0, 10.0, 4.0, 0.0),  # all is known
]  # fmt: skip


@pytest.mark.usefixtures("numba_or_numpy")
def test_expected_risk_of_known_cases():
    for *args, wanted in CASES:
        assert expected_bayes_risk(*args) == pytest.approx(wanted, abs=1e-15 * (args[4] + args[5]))


@pytest.mark.usefixtures("numba_or_numpy")
def test_expected_risk_of_the_reference_table():
    table = np.genfromtxt(REFERENCE, delimiter=",", names=True)
    names = ["mean_m", "std_of_mean_m", "std_after_m", "level_m", "cost_false_safe", "cost_false_unsafe"]
    value = expected_bayes_risk(**{name: table[name] for name in names})
    scale = table["cost_false_safe"] + table["cost_false_unsafe"]
    error = np.abs(value - table["expected_bayes_risk"]) / scale
    assert len(table) >= 100
    assert error.max() < 1e-13
    # The approximation: erf is off by 2.2e-3 at most, each of the two integrals by half of it times its mass and cost.
    rough = expected_bayes_risk(**{name: table[name] for name in names}, method="exponential_quadratic")
    assert 1e-5 < (np.abs(rough - table["expected_bayes_risk"]) / scale).max() < 1.1e-3


def test_reference_table_equals_its_scripts_output():
    import make_expected_bayes_risk as script

    with REFERENCE.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(script.COLUMNS)
    assert [row[:-1] for row in rows] == [[repr(value) for value in case] for case in script.cases()]
    with script.mp.workdps(script.DIGITS):
        for number in (0, 1, 2, 3):  # the rest takes minutes
            assert rows[number][-1] == script.as_text(script.expected_risk(script.cases()[number]))


def weighted_risk(m, mean, of_mean, after, c1, c2):
    """The integrand of the paper's expected risk: the risk if the mean turns out to be m, times its density."""
    return stats.norm.pdf(m, mean, of_mean) * bayes_risk(m, after, 15.0, c1, c2)


def test_expected_risk_against_quadrature():
    rng = np.random.default_rng(7)
    for _ in range(40):
        mean, of_mean, after = rng.normal(15, 3), rng.uniform(0.2, 4), rng.uniform(0.2, 4)
        c1, c2 = rng.uniform(1, 20, 2)
        star = 15.0 - after * stats.norm.ppf(c2 / (c1 + c2))
        integrand = functools.partial(weighted_risk, mean=mean, of_mean=of_mean, after=after, c1=c1, c2=c2)
        ends = (min(star, mean) - 9 * of_mean, star, max(star, mean) + 9 * of_mean)
        parts = [integrate.quad(integrand, a, b, epsabs=1e-12)[0] for a, b in itertools.pairwise(ends)]
        assert expected_bayes_risk(mean, of_mean, after, 15.0, c1, c2) == pytest.approx(sum(parts), abs=1e-9)


def test_compiled_agrees_with_numpy():
    if not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    rng = np.random.default_rng(1)
    n = 200_000
    mean = 15 + 5 * rng.normal(size=n)
    of_mean, after = 10 ** rng.uniform(-6, 2, n), 10 ** rng.uniform(-6, 2, n)
    of_mean[::97] = 0.0
    after[::89] = 0.0
    mean[::83] = 15.0
    costs = 10 ** rng.uniform(-1, 2, (2, n))
    costs[1, ::3] = costs[0, ::3]
    fast = expected_bayes_risk(mean, of_mean, after, 15.0, *costs)
    slow = expected_bayes_risk_numpy(mean, of_mean, after, 15.0, *costs)
    assert np.max(np.abs(fast - slow) / costs.sum(axis=0)) < 1e-13


@pytest.mark.usefixtures("numba_or_numpy")
def test_slope_worked_by_hand():
    # mean 14, s_mu 2, s_q 1, costs 10: 20 / 2 phi(1/2) / 2 phi(0) / 1
    expected = 5.0 * stats.norm.pdf(0.5) * stats.norm.pdf(0.0)
    assert expected_bayes_risk_slope(14.0, 2.0, 1.0, 15.0, 10.0, 10.0) == pytest.approx(expected, rel=1e-14)
    # costs 10 and 30: z = Phi^-1(3/4), k = (1 - z) / 2
    z = stats.norm.ppf(0.75)
    expected = 20.0 * stats.norm.pdf((1.0 - z) / 2.0) / 2.0 * stats.norm.pdf(z)
    assert expected_bayes_risk_slope(14.0, 2.0, 1.0, 15.0, 10.0, 30.0) == pytest.approx(expected, rel=1e-14)
    assert expected_bayes_risk_slope([14.0, 14.0], [0.0, 2.0], [2.0, 0.0], 15.0, 10.0, 10.0).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("costs", [(10.0, 10.0), (3.0, 12.0), (12.0, 3.0)])
def test_slope_agrees_with_finite_differences(costs):
    rng = np.random.default_rng(5)
    level = LevelSet(cost_false_safe=costs[0], cost_false_unsafe=costs[1])
    mean, total, left = rng.uniform(10, 20, 200), rng.uniform(1, 60, 200), rng.uniform(0.05, 0.95, 200)

    def risk(after):
        return level.expected_risk(mean, np.sqrt(total - after), np.sqrt(after))

    after, step = left * total, 1e-4 * total
    # fourth order, so that 1e-4 of the variance leaves 1e-12, and rounding 1e-15 over 1e-4
    near, far = risk(after + step) - risk(after - step), risk(after + 2 * step) - risk(after - 2 * step)
    slope = level.expected_risk_slope(mean, np.sqrt(total - after), np.sqrt(after))
    assert slope == pytest.approx((8 * near - far) / (12 * step), rel=1e-6, abs=1e-10)


@pytest.mark.parametrize("costs", [(10.0, 10.0), (3.0, 12.0), (12.0, 3.0)])
def test_compiled_risk_sums_agree_with_numpy(costs):
    if not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    rng = np.random.default_rng(6)
    level = LevelSet(cost_false_safe=costs[0], cost_false_unsafe=costs[1])
    mean = np.concatenate([rng.uniform(5, 25, 300), np.full(50, 15.0), 15.0 + rng.normal(0, 1e-3, 50), [15.0, 3.0]])
    total = np.append(rng.uniform(1, 60, len(mean) - 2), [0.0, 0.0])
    # from nothing measured, by steps of every size, to nothing left; some stay as they are, one comes back
    fall = 10.0 ** rng.uniform(-9, 0.5, (14, len(mean))) * (rng.random((14, len(mean))) < 0.8)
    left = total * np.exp(-np.cumsum(fall, axis=0))
    left = np.concatenate([total[None], left, 1e-12 * left[-1:], 0.0 * left[-1:], left[3:4]])
    for row in range(1, len(left) - 1):  # one cell at a time too, so that errors cannot cancel
        several = left[: row + 1]
        expected, slopes = level.risk_sums_numpy(mean, total, several)
        # 0.5 c eps for each of 400 cells, as the exact integral, and the steps' 1e-12
        assert level.risk_sums(mean, total, several) == pytest.approx(expected, rel=1e-11, abs=1e-11)
        sums, found = level.risk_sums_and_slopes(mean, total, several)
        assert sums == pytest.approx(expected, rel=1e-11, abs=1e-11)
        assert found == pytest.approx(slopes, rel=1e-6, abs=1e-9)  # where little is left, of what rounding left
    for p in range(len(mean)):
        one = slice(p, p + 1)
        expected = level.risk_sums_numpy(mean[one], total[one], left[:, one])[0]
        assert level.risk_sums(mean[one], total[one], left[:, one]) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_theorem_1_holds_for_random_numbers():
    rng = np.random.default_rng(2)
    n = 300_000
    mean, total = 15 + 4 * rng.normal(size=n), 10 ** rng.uniform(-2, 1.5, n)
    costs = 10 ** rng.uniform(-1, 2, (2, n))
    share = np.sort(rng.uniform(0, 1, (2, n)), axis=0)  # of the variance, that a smaller and a larger set take away
    smaller, larger = (benefit_of_search(mean, np.sqrt(s) * total, np.sqrt(1 - s) * total, 15.0, *costs) for s in share)
    scale = costs.sum(axis=0)
    assert np.all(smaller >= 0.0)
    assert np.all(larger >= smaller - 1e-14 * scale)
    assert np.all(benefit_of_search(mean, 0.0, total, 15.0, *costs) <= 1e-15 * scale)
    # Before what sticks out is cut off, the exact form itself is as good.
    raw = bayes_risk(mean, total, 15.0, *costs) - expected_bayes_risk_numpy(
        mean, np.sqrt(share[0]) * total, np.sqrt(1 - share[0]) * total, np.full(n, 15.0), *costs
    )
    assert raw.min() > -1e-14 * scale.max()


def test_approximation_violates_theorem_1():
    rng = np.random.default_rng(3)
    n = 20_000
    mean, total, share = 15 + 4 * rng.normal(size=n), rng.uniform(0.3, 5, n), rng.uniform(0, 0.5, n)
    args = (mean, np.sqrt(share) * total, np.sqrt(1 - share) * total, 15.0, 10.0, 10.0)
    approximate = benefit_of_search(*args, method="exponential_quadratic")
    assert np.mean(approximate < -1e-6) > 0.05
    assert np.all(benefit_of_search(*args) >= 0.0)
    assert np.max(np.abs(approximate - benefit_of_search(*args))) < 0.05


def test_risk_and_estimate_worked_by_hand():
    # Phi(-1) = 0.158655...
    assert bayes_risk(16.0, 1.0, 15.0, 10.0, 10.0) == pytest.approx(1.5865525393145705)
    assert bayes_risk(14.0, 1.0, 15.0, 10.0, 4.0) == pytest.approx(4 * 0.15865525393145705)
    assert bayes_estimate([16.0, 14.0], 1.0, 15.0, 10.0, 10.0).tolist() == [True, False]
    # c1 = 10 c2: called safe only above l + s Phi^-1(10 / 11).
    edge = 15.0 + stats.norm.ppf(10 / 11)
    assert bayes_estimate([edge + 1e-9, edge - 1e-9], 1.0, 15.0, 10.0, 1.0).tolist() == [True, False]
    assert p_safe([15.0, 15.0, 14.9, 16.0], [1.0, 0.0, 0.0, 1.0], 15.0) == pytest.approx([0.5, 1.0, 0.0, 0.841344746])
    assert bayes_risk([15.0, 14.0], 0.0, 15.0, 10.0, 10.0).tolist() == [0.0, 0.0]


@pytest.mark.usefixtures("numba_or_numpy")
def test_broadcasting_and_nan():
    value = expected_bayes_risk(
        np.full((4, 1), 16.0), np.ones(3), 1.0, 15.0, 10.0, np.array([[5.0], [6.0], [7.0], [8.0]])
    )
    assert value.shape == (4, 3)
    assert np.isnan(expected_bayes_risk([np.nan, 16.0], 1.0, 1.0, 15.0, 10.0, 10.0)).tolist() == [True, False]


def test_invalid_arguments_are_named():
    with pytest.raises(ValueError, match=r"cost_false_safe must be a finite cost > 0, not 0\.0"):
        bayes_risk(1.0, 1.0, 1.0, 0.0, 1.0)
    with pytest.raises(ValueError, match=r"std_after_m must be a standard deviation >= 0 m, not -1\.0"):
        expected_bayes_risk(1.0, 1.0, [1.0, -1.0], 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match=r"method must be one of exact, exponential_quadratic, not 'guess'"):
        expected_bayes_risk(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, method="guess")
    with pytest.raises(
        ParameterError, match=r"LevelSet\.cost_false_unsafe must be a number above 0 and at most 1,000,000, not -1"
    ):
        LevelSet(cost_false_unsafe=-1.0)
    with pytest.raises(ParameterError, match=r"LevelSet\.level_m must be .*, not nan"):
        LevelSet(level_m=float("nan"))


@pytest.mark.parametrize("method", METHODS)
def test_level_set_methods_use_its_fields(method):
    level_set = LevelSet(level_m=12.0, cost_false_safe=3.0, cost_false_unsafe=7.0, method=method)
    assert level_set.expected_risk(11.0, 1.0, 2.0) == expected_bayes_risk(11.0, 1.0, 2.0, 12.0, 3.0, 7.0, method)
    assert level_set.benefit(11.0, 1.0, 2.0) == benefit_of_search(11.0, 1.0, 2.0, 12.0, 3.0, 7.0, method)
    assert level_set.risk(11.0, 1.0) == bayes_risk(11.0, 1.0, 12.0, 3.0, 7.0)
    assert bool(level_set.safe(11.0, 1.0)) is False
    assert level_set.p_safe(12.0, 1.0) == 0.5
