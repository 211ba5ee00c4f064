"""Bayes risk of a level set, before and after planned measurements (paper, section "Search objective").

The depth at a location has a normal distribution. Calling it safe (at least `level_m` deep) when it is not costs c1
(`cost_false_safe`); calling it unsafe when it is safe costs c2 (`cost_false_unsafe`).

The paper approximates the expected risk after planned measurements. The default here is exact: a bivariate normal
probability, by Owen's T function. All functions broadcast their arguments.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erfinv, log_ndtr, ndtr, ndtri, owens_t

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support import compiled
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.compiled.modules import compiled_risk

#: Methods to compute the expected risk: exactly, or as in the paper with an approximate error function.
METHODS = ("exact", "exponential_quadratic")
#: erf(x) ~ 1 - exp(-A x - B x^2) for x >= 0, largest error 2.2e-3 (Tsay and Ke).
ERF_A = 1.0950081470333
ERF_B = 0.75651138383854


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class LevelSet(LevelSetConfig):
    """The isobath to find, the costs of wrong calls, and the resulting risks.

    Attributes:
        method: How the expected risk is computed, one of `METHODS`.
    """

    method: str = "exact"

    @classmethod
    def of(cls, config: LevelSetConfig, method: str = "exact") -> LevelSet:
        """The level set of a mission file's section `level_set`."""
        if isinstance(config, cls):
            return config
        return cls(method=method, **{f.name: getattr(config, f.name) for f in dataclasses.fields(LevelSetConfig)})

    def p_safe(self, mean_m: ArrayLike, std_m: ArrayLike) -> Array:
        """Probability that the depth is at least the level."""
        return p_safe(mean_m, std_m, self.level_m)

    def risk(self, mean_m: ArrayLike, std_m: ArrayLike) -> Array:
        """`bayes_risk` for this level and these costs."""
        return bayes_risk(mean_m, std_m, self.level_m, self.cost_false_safe, self.cost_false_unsafe)

    def safe(self, mean_m: ArrayLike, std_m: ArrayLike) -> Mask:
        """`bayes_estimate` for this level and these costs."""
        return bayes_estimate(mean_m, std_m, self.level_m, self.cost_false_safe, self.cost_false_unsafe)

    def expected_risk(self, mean_m: ArrayLike, std_of_mean_m: ArrayLike, std_after_m: ArrayLike) -> Array:
        """`expected_bayes_risk` for this level, these costs and this method."""
        return expected_bayes_risk(
            mean_m, std_of_mean_m, std_after_m, self.level_m, self.cost_false_safe, self.cost_false_unsafe, self.method
        )

    def risk_sums(self, mean_m: Array, variance_m2: Array, left_m2: Array) -> Array:
        """Sums (J,) over cells of the exact expected risk, for each row of remaining variances.

        Args:
            mean_m: Mean of the depth given the present data (M,).
            variance_m2: Variance given the present data (M,).
            left_m2: Remaining variances (J, M), at most `variance_m2`; fastest if they decrease from row to row.
        """
        return self._risk_sums(mean_m, variance_m2, left_m2, False)[0]

    def risk_sums_and_slopes(self, mean_m: Array, variance_m2: Array, left_m2: Array) -> tuple[Array, Array]:
        """`risk_sums`, and the derivatives (J, M) by the remaining variances (`expected_bayes_risk_slope`)."""
        return self._risk_sums(mean_m, variance_m2, left_m2, True)

    def _risk_sums(self, mean: Array, variance: Array, left: Array, with_slopes: bool) -> tuple[Array, Array]:
        c1, c2 = self.cost_false_safe, self.cost_false_unsafe
        if not compiled.USE_NUMBA:
            return self.risk_sums_numpy(mean, variance, left)
        sums, slopes = np.empty(len(left)), np.empty(left.shape if with_slopes else (0, 0))
        z = 0.0 if c1 == c2 else float(ndtri(c2 / (c1 + c2)))
        mean, variance, left = (np.ascontiguousarray(x, dtype=float) for x in (mean, variance, left))
        compiled_risk().risk_sums(mean, variance, left, self.level_m, c1, c2, z, sums, slopes)
        return sums, slopes

    def risk_sums_numpy(self, mean_m: Array, variance_m2: Array, left_m2: Array) -> tuple[Array, Array]:
        """`risk_sums_and_slopes` in SciPy: the reference for the compiled version."""
        std_of_mean, std_after = np.sqrt(np.maximum(variance_m2 - left_m2, 0.0)), np.sqrt(left_m2)
        costs = self.cost_false_safe, self.cost_false_unsafe
        risks = expected_bayes_risk_numpy(mean_m, std_of_mean, std_after, self.level_m, *costs)
        return risks.sum(axis=1), self.expected_risk_slope(mean_m, std_of_mean, std_after)

    def expected_risk_slope(self, mean_m: ArrayLike, std_of_mean_m: ArrayLike, std_after_m: ArrayLike) -> Array:
        """`expected_bayes_risk_slope` for this level and these costs."""
        return expected_bayes_risk_slope(
            mean_m, std_of_mean_m, std_after_m, self.level_m, self.cost_false_safe, self.cost_false_unsafe
        )

    def benefit(self, mean_m: ArrayLike, std_of_mean_m: ArrayLike, std_after_m: ArrayLike) -> Array:
        """`benefit_of_search` for this level, these costs and this method."""
        return benefit_of_search(
            mean_m, std_of_mean_m, std_after_m, self.level_m, self.cost_false_safe, self.cost_false_unsafe, self.method
        )


def p_safe(mean_m: ArrayLike, std_m: ArrayLike, level_m: ArrayLike) -> Array:
    """Probability P(f >= l) that the depth is at least the level; arguments as in `bayes_risk`."""
    mean, std, level = _arrays(("mean_m", mean_m), ("std_m", std_m), ("level_m", level_m))
    _not_negative(std_m=std)
    return np.asarray(ndtr(-_standardized(level - mean, std)))


def bayes_risk(
    mean_m: ArrayLike, std_m: ArrayLike, level_m: ArrayLike, cost_false_safe: ArrayLike, cost_false_unsafe: ArrayLike
) -> Array:
    """Bayes risk r = min(c1 P(f < l), c2 P(f >= l)) of the best call at a location.

    Args:
        mean_m: Mean of the depth (m).
        std_m: Standard deviation of the depth (m); 0 where it is known.
        level_m: Level l (m).
        cost_false_safe: Cost c1 > 0 of calling an unsafe location safe.
        cost_false_unsafe: Cost c2 > 0 of calling a safe location unsafe.

    Returns:
        The risk, of the broadcast shape.

    Raises:
        ValueError: for a cost that is not positive, or a negative standard deviation.
    """
    mean, std, level = _arrays(("mean_m", mean_m), ("std_m", std_m), ("level_m", level_m))
    c1, c2 = _costs(cost_false_safe, cost_false_unsafe)
    _not_negative(std_m=std)
    h = _standardized(level - mean, std)
    return np.asarray(np.minimum(c1 * ndtr(h), c2 * ndtr(-h)))


def bayes_estimate(
    mean_m: ArrayLike, std_m: ArrayLike, level_m: ArrayLike, cost_false_safe: ArrayLike, cost_false_unsafe: ArrayLike
) -> Mask:
    """The call with the lowest risk (true: safe); a tie is safe. Arguments as in `bayes_risk`."""
    mean, std, level = _arrays(("mean_m", mean_m), ("std_m", std_m), ("level_m", level_m))
    c1, c2 = _costs(cost_false_safe, cost_false_unsafe)
    _not_negative(std_m=std)
    h = _standardized(level - mean, std)
    return np.asarray(c1 * ndtr(h) <= c2 * ndtr(-h))


def expected_bayes_risk(
    mean_m: ArrayLike,
    std_of_mean_m: ArrayLike,
    std_after_m: ArrayLike,
    level_m: ArrayLike,
    cost_false_safe: ArrayLike,
    cost_false_unsafe: ArrayLike,
    method: str = "exact",
) -> Array:
    """Expected Bayes risk E of a location after planned measurements; level and costs as in `bayes_risk`.

    After the measurements, the mean has the distribution N(mean_m, std_of_mean_m^2), and the depth the standard
    deviation std_after_m.

    Args:
        mean_m: Mean of the depth given the present data (m).
        std_of_mean_m: Standard deviation s_mu of the mean after the planned measurements (m).
        std_after_m: Standard deviation s_q of the depth after the planned measurements (m).
        method: "exact" (Owen's T) or "exponential_quadratic" (the paper's approximation with one term).

    Returns:
        The expected risk, of the broadcast shape; if exact, at most the current risk.

    Raises:
        ValueError: for an unknown method, a cost that is not positive or a negative standard deviation.
    """
    mean, of_mean, after, level = _arrays(
        ("mean_m", mean_m), ("std_of_mean_m", std_of_mean_m), ("std_after_m", std_after_m), ("level_m", level_m)
    )
    c1, c2 = _costs(cost_false_safe, cost_false_unsafe)
    _not_negative(std_of_mean_m=of_mean, std_after_m=after)
    if method == "exact":
        if compiled.USE_NUMBA:
            if c1.ndim == c2.ndim == 0 and c1 == c2:  # the planner's case, for a hundred locations at a time
                quantile = np.zeros(())
            else:
                quantile = np.where(c1 == c2, 0.0, ndtri(c2 / (c1 + c2)))
            return np.asarray(compiled_risk().expected_risk(mean, of_mean, after, level, c1, c2, quantile))
        return expected_bayes_risk_numpy(mean, of_mean, after, level, c1, c2)
    if method == "exponential_quadratic":
        return _exponential_quadratic(mean, of_mean, after, level, c1, c2)
    raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")


def benefit_of_search(
    mean_m: ArrayLike,
    std_of_mean_m: ArrayLike,
    std_after_m: ArrayLike,
    level_m: ArrayLike,
    cost_false_safe: ArrayLike,
    cost_false_unsafe: ArrayLike,
    method: str = "exact",
) -> Array:
    """Expected benefit of search: present risk minus `expected_bayes_risk` (same arguments).

    With the exact method it is 0 if nothing is planned, never negative, and grows with the planned set (paper, theorem
    1).
    """
    mean, of_mean, after = _arrays(("mean_m", mean_m), ("std_of_mean_m", std_of_mean_m), ("std_after_m", std_after_m))
    expected = expected_bayes_risk(mean, of_mean, after, level_m, cost_false_safe, cost_false_unsafe, method)
    current = bayes_risk(mean, np.sqrt(of_mean**2 + after**2), level_m, cost_false_safe, cost_false_unsafe)
    # Two functions compute the two terms: with the exact method, negative values are rounding.
    return np.maximum(current - expected, 0.0) if method == "exact" else current - expected


def expected_bayes_risk_slope(
    mean_m: ArrayLike,
    std_of_mean_m: ArrayLike,
    std_after_m: ArrayLike,
    level_m: ArrayLike,
    cost_false_safe: ArrayLike,
    cost_false_unsafe: ArrayLike,
) -> Array:
    """Derivative dE / dv of the exact `expected_bayes_risk` E with respect to v = s_q^2 (same arguments).

    The current variance s^2 = s_mu^2 + s_q^2 is constant. With k = (l - s_q z - m) / s_mu, z = Phi^-1(c2 / (c1 + c2))
    and phi the standard normal density,

        dE / dv = (c1 + c2) / 2 phi(k) / s_mu phi(z) / s_q  >= 0.

    It is unbounded as s_q, or at the level s_mu, approaches 0; where one of them is 0, the result is 0.
    """
    mean, of_mean, after, level = _arrays(
        ("mean_m", mean_m), ("std_of_mean_m", std_of_mean_m), ("std_after_m", std_after_m), ("level_m", level_m)
    )
    c1, c2 = _costs(cost_false_safe, cost_false_unsafe)
    _not_negative(std_of_mean_m=of_mean, std_after_m=after)
    z = np.where(c1 == c2, 0.0, ndtri(c2 / (c1 + c2)))
    live = (of_mean > 0.0) & (after > 0.0)
    s_mu, s_q = np.where(live, of_mean, 1.0), np.where(live, after, 1.0)
    k = (level - s_q * z - mean) / s_mu
    return np.asarray(np.where(live, (c1 + c2) / (4.0 * math.pi) * np.exp(-0.5 * (k * k + z * z)) / (s_mu * s_q), 0.0))


def expected_bayes_risk_numpy(
    mean: ArrayLike, of_mean: ArrayLike, after: ArrayLike, level: ArrayLike, c1: ArrayLike, c2: ArrayLike
) -> Array:
    """The exact expected risk in SciPy: the reference for the compiled version. Arguments are not checked.

    With s^2 = s_mu^2 + s_q^2, z = Phi^-1(c2 / (c1 + c2)), h = (l - m) / s, k = (l - s_q z - m) / s_mu:

        E = (c2 - c1) / 2 [Phi(k) - Phi(h)] + (c1 + c2) [T(h, a_h) + T(k, z / k) + beta],
        a_h = (s_q - z s^2 / (l - m)) / s_mu,   beta = 1/2 if h and k differ in sign (0 counts as +), else 0,

    which for c1 = c2 = c is 2 c T(h, s_q / s_mu).
    """
    mean, of_mean, after, level, c1, c2 = np.broadcast_arrays(
        *(np.asarray(x, float) for x in (mean, of_mean, after, level, c1, c2))
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gap = level - mean
        std = np.sqrt(of_mean**2 + after**2)
        h = _standardized(gap, std)
        risk = np.minimum(c1 * ndtr(h), c2 * ndtr(-h))
        live = (of_mean > 0.0) & (after > 0.0)
        ratio = np.where(live, after / np.where(live, of_mean, 1.0), 0.0)
        equal = 2.0 * c1 * owens_t(h, ratio)
        if np.all(c1 == c2):
            value = equal
        else:
            z = np.where(c1 == c2, 0.0, ndtri(c2 / (c1 + c2)))
            k = np.where(live, (gap - after * z) / np.where(live, of_mean, 1.0), h)
            sign_h, sign_k = np.where(h < 0.0, -1.0, 1.0), np.where(k < 0.0, -1.0, 1.0)
            a_h = np.where(gap == 0.0, sign_k * np.inf, ratio - z * (std / np.where(live, of_mean, 1.0)) / h)
            a_k = np.where(k == 0.0, sign_h * np.inf, z / k)
            both = (gap == 0.0) & (k == 0.0)
            a_h, a_k = np.where(both, ratio, a_h), np.where(both, 0.0, a_k)
            beta = np.where(sign_h != sign_k, 0.5, 0.0)
            value = 0.5 * (c2 - c1) * (ndtr(k) - ndtr(h)) + (c1 + c2) * (owens_t(h, a_h) + owens_t(k, a_k) + beta)
            value = np.where(c1 == c2, equal, value)
    value = np.where(of_mean == 0.0, risk, np.where(after == 0.0, 0.0, value))
    # 0 <= E <= current risk in theory; the rest is rounding. NaN stays NaN.
    return np.asarray(np.clip(value, 0.0, risk))


def _exponential_quadratic(mean: Array, of_mean: Array, after: Array, level: Array, c1: Array, c2: Array) -> Array:
    """The expected risk with erf x ~ 1 - exp(-A x - B x^2): each integral is a Gaussian over an interval."""
    mean, of_mean, after, level, c1, c2 = np.broadcast_arrays(mean, of_mean, after, level, c1, c2)
    live = (of_mean > 0.0) & (after > 0.0)
    s_mu, s_q = np.where(live, of_mean, 1.0), np.where(live, after, 1.0)
    gap = mean - level  # integrate over u = mu - l, normal about `gap`
    star = -math.sqrt(2.0) * s_q * erfinv((c2 - c1) / (c1 + c2))  # u at which the call changes
    slope, square = ERF_A / (math.sqrt(2.0) * s_q), ERF_B / (2.0 * s_q**2)

    def tail(low: Array, high: Array, side: float) -> Array:
        """Integral from low to high of N(u; gap, s_mu^2) exp(-side slope u - square u^2) / 2."""
        spread = 1.0 + 2.0 * square * s_mu**2
        precision = spread / s_mu**2
        center = (gap - side * slope * s_mu**2) / spread
        # The completed square, at most slope^2 / (4 square), written without cancellation of large terms.
        log_scale = (0.5 * (slope * s_mu) ** 2 - square * gap**2 - side * slope * gap) / spread - 0.5 * np.log(spread)
        a, b = (low - center) * np.sqrt(precision), (high - center) * np.sqrt(precision)
        flip = a > 0.0  # both in the upper tail: mirror, to keep the difference's precision
        a, b = np.where(flip, -b, a), np.where(flip, -a, b)
        return np.asarray(0.5 * (np.exp(log_scale + log_ndtr(b)) - np.exp(log_scale + log_ndtr(a))))

    def mass(low: Array, high: Array) -> Array:
        return np.asarray(ndtr((high - gap) / s_mu) - ndtr((low - gap) / s_mu))

    inf = np.full_like(gap, np.inf)
    zero = np.zeros_like(gap)
    below, above = np.minimum(star, 0.0), np.maximum(star, 0.0)
    # u < star costs c2 P(f >= l | u); P is the tail for u < 0 and 1 - tail for u > 0. u > star is the mirror image.
    value = c2 * (tail(-inf, below, -1.0) + np.where(star > 0.0, mass(zero, above) - tail(zero, above, 1.0), 0.0))
    value += c1 * (tail(above, inf, 1.0) + np.where(star < 0.0, mass(below, zero) - tail(below, zero, -1.0), 0.0))
    h = _standardized(-gap, np.sqrt(of_mean**2 + after**2))
    return np.where(of_mean == 0.0, np.minimum(c1 * ndtr(h), c2 * ndtr(-h)), np.where(after == 0.0, 0.0, value))


def _standardized(gap: Array, std: Array) -> Array:
    """gap / std; where std is 0, its limit +-inf (0 / 0 = -inf: a depth exactly at the level is safe)."""
    known = std == 0.0
    if not np.any(known):
        return np.asarray(gap / std)
    limit = np.where(gap > 0.0, np.inf, -np.inf)
    return np.where(known, np.where(np.isnan(gap), np.nan, limit), gap / np.where(known, 1.0, std))


def _arrays(*named: tuple[str, ArrayLike]) -> list[Array]:
    arrays = []
    for name, value in named:
        try:
            arrays.append(np.asarray(value, dtype=float))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} must be numbers (m), not {value!r}") from error
    return arrays


def _costs(cost_false_safe: ArrayLike, cost_false_unsafe: ArrayLike) -> list[Array]:
    costs = _arrays(("cost_false_safe", cost_false_safe), ("cost_false_unsafe", cost_false_unsafe))
    if all(cost.ndim == 0 and 0.0 < cost < math.inf for cost in costs):
        return costs
    for name, cost in zip(("cost_false_safe", "cost_false_unsafe"), costs, strict=True):
        bad = ~((cost > 0.0) & np.isfinite(cost))
        if np.any(bad):
            raise ValueError(f"{name} must be a finite cost > 0, not {_worst(cost, bad)}")
    return costs


def _not_negative(**stds: Any) -> None:
    for name, std in stds.items():
        if np.any(std < 0.0):
            raise ValueError(f"{name} must be a standard deviation >= 0 m, not {_worst(std, std < 0.0)}")


def _worst(values: Array, bad: Any) -> float:
    return float(np.ravel(values)[np.flatnonzero(bad)[0]])
