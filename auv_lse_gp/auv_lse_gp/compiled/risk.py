"""The exact expected Bayes risk compiled with numba: one ufunc, no temporaries. Formulas: see `risk.py`."""

import math

import numpy as np
from numba import njit, vectorize

_SQRT_HALF = math.sqrt(0.5)
_INV_TWO_PI = 0.5 / math.pi

# Owen's T(h, a) = 1 / (2 pi) Int_0^a exp(-h^2 (1 + x^2) / 2) / (1 + x^2) dx. The integrand is even in x and bounded in
# the complex plane away from its poles at +-i, uniformly in h. A Gauss-Legendre rule of 2 m nodes on [-a, a], of which
# m are evaluated, therefore has an error of (1 + sqrt 2)^(-4 m) for a = 1: 1e-17 for m = 11. For a = 0.35, m = 6 is
# enough.
_nodes, _weights = np.polynomial.legendre.leggauss(24)
_NODES_LONG, _WEIGHTS_LONG = _nodes[12:] ** 2, _weights[12:]
_nodes, _weights = np.polynomial.legendre.leggauss(12)
_NODES_SHORT, _WEIGHTS_SHORT = _nodes[6:] ** 2, _weights[6:]


@njit("f8(f8)", cache=True, inline="always")
def _upper(x):  # type: ignore[no-untyped-def]  # numba's types
    """Upper tail of the standard normal."""
    return 0.5 * math.erfc(x * _SQRT_HALF)


@njit("f8(f8, f8)", cache=True)
def _owens_t_core(h, a):  # type: ignore[no-untyped-def]  # numba's types
    """T(h, a) for h >= 0 and 0 <= a <= 1."""
    if h > 12.0:
        return 0.0  # T(h, a) < Q(h) / 2 < 1e-32
    half = -0.5 * h * h
    total = 0.0
    square = a * a
    if a < 0.35:
        for i in range(6):
            q = 1.0 + square * _NODES_SHORT[i]
            total += _WEIGHTS_SHORT[i] * math.exp(half * q) / q
    else:
        for i in range(12):
            q = 1.0 + square * _NODES_LONG[i]
            total += _WEIGHTS_LONG[i] * math.exp(half * q) / q
    return a * _INV_TWO_PI * total


@njit("f8(f8, f8)", cache=True)
def owens_t(h, a):  # type: ignore[no-untyped-def]  # numba's types
    """Owen's T function, absolute error about 1e-16."""
    if math.isnan(h) or math.isnan(a):
        return math.nan
    h = abs(h)
    slope = abs(a)
    if slope <= 1.0:
        value = _owens_t_core(h, slope)
    elif math.isinf(slope):
        value = 0.5 * _upper(h)
    else:
        q, qa = _upper(h), _upper(slope * h)
        value = 0.5 * (q + qa) - q * qa - _owens_t_core(slope * h, 1.0 / slope)
    return value if a >= 0.0 else -value


@njit("f8(f8, f8, f8, f8, f8, f8, f8)", cache=True)
def _expected_risk(mean, of_mean, after, level, c1, c2, z):  # type: ignore[no-untyped-def]  # numba's types
    gap = level - mean
    std = math.sqrt(of_mean * of_mean + after * after)
    if math.isnan(gap) or math.isnan(std):
        return math.nan
    if std == 0.0:
        return 0.0
    h = gap / std
    risk = min(c1 * _upper(-h), c2 * _upper(h))
    if of_mean == 0.0:
        return risk
    if after == 0.0:
        return 0.0
    if c1 == c2:
        value = 2.0 * c1 * owens_t(h, after / of_mean)
    else:
        k = (gap - after * z) / of_mean
        h_minus, k_minus = h < 0.0, k < 0.0
        a_h = math.inf
        a_k = math.inf
        if gap == 0.0:
            if k == 0.0:
                a_h = after / of_mean
            elif k_minus:
                a_h = -math.inf
        else:
            a_h = (after - z * std * (std / gap)) / of_mean
        if k == 0.0:
            if gap == 0.0:
                a_k = 0.0
            elif h_minus:
                a_k = -math.inf
        else:
            a_k = z / k
        beta = 0.5 if h_minus != k_minus else 0.0
        value = 0.5 * (c2 - c1) * (_upper(-k) - _upper(-h))
        value += (c1 + c2) * (owens_t(h, a_h) + owens_t(k, a_k) + beta)
    return min(max(value, 0.0), risk)


@vectorize(["f8(f8, f8, f8, f8, f8, f8, f8)"], cache=True)
def expected_risk(mean, of_mean, after, level, c1, c2, z):  # type: ignore[no-untyped-def]  # numba's types
    """`risk.expected_bayes_risk_numpy` with z = Phi^-1(c2 / (c1 + c2)), 0 for equal costs."""
    return _expected_risk(mean, of_mean, after, level, c1, c2, z)


# With s_q = s sin(t), s_mu = s cos(t) and h = (l - m) / s, the slope of the expected risk in the angle t is
#
# dE / dt = (c1 + c2) / (2 pi) exp(-(h^2 - 2 h z sin(t) + z^2) / (2 cos(t)^2)), with its only singularity at t = pi / 2.
# A Gauss-Legendre sum therefore gives the change of the risk over a step in t that is small compared with cos(t): an
# ellipse (2 cos(t) / step) times as large as the step excludes the singularity.
_LONG_STEP, _SHORT_STEP, _TINY_STEP = 0.3, 0.01, 1e-4  # as shares of cos(t): errors below 1e-12 of the risk
_SIX, _SIX_WEIGHTS = np.polynomial.legendre.leggauss(6)
_TWO = math.sqrt(1.0 / 3.0)


@njit("f8(f8, f8, f8, f8, f8)", cache=True, inline="always")
def _angular_slope(sine, cosine, h, z, delta):  # type: ignore[no-untyped-def]  # numba's types
    """exp(...) of dE / dt at the angle with this sine and cosine plus delta (rad, at most 0.3)."""
    d2 = delta * delta
    s = delta * (1.0 - d2 / 6.0 * (1.0 - d2 / 20.0 * (1.0 - d2 / 42.0 * (1.0 - d2 / 72.0 * (1.0 - d2 / 110.0)))))
    c = 1.0 - d2 / 2.0 * (1.0 - d2 / 12.0 * (1.0 - d2 / 30.0 * (1.0 - d2 / 56.0 * (1.0 - d2 / 90.0))))
    sine, cosine = sine * c + cosine * s, cosine * c - sine * s
    return math.exp(-0.5 * (h * h - 2.0 * h * z * sine + z * z) / (cosine * cosine))


@njit("void(f8[::1], f8[::1], f8[:, ::1], f8, f8, f8, f8, f8[::1], f8[:, ::1])", cache=True)
def risk_sums(mean, variance, left, level, c1, c2, z, sums, slopes):  # type: ignore[no-untyped-def]
    """`risk.LevelSet.risk_sums` into `sums` (J,) and, if it has rows, `slopes` (J, M)."""
    scale = (c1 + c2) / (2.0 * math.pi)
    with_slopes = slopes.shape[0] > 0
    sums[:] = 0.0
    for p in range(left.shape[1]):
        if variance[p] <= 0.0:
            for j in range(left.shape[0]):
                if with_slopes:
                    slopes[j, p] = 0.0
            continue
        std = math.sqrt(variance[p])
        h = (level - mean[p]) / std
        risk = 0.0
        known = False  # whether `risk` is that of the angle of `sine` and `cosine`
        sine, cosine, last = 1.0, 0.0, -1.0
        slope = 0.0
        for j in range(left.shape[0]):
            if left[j, p] != last:
                last = left[j, p]
                share = min(max(last / variance[p], 0.0), 1.0)
                new_sine, new_cosine = math.sqrt(share), math.sqrt(1.0 - share)
                back = sine * new_cosine - cosine * new_sine  # sine of the step
                # a lower bound of the integrand's exponent
                exponent = 0.5 * (abs(h) - abs(z)) ** 2 / (new_cosine * new_cosine) if new_cosine > 0.0 else math.inf
                if known and back >= 0.0 and exponent > 40.0:
                    pass  # the risk falls by less than 1e-17 of the costs
                elif h == 0.0 and z == 0.0:
                    risk = scale * math.asin(new_sine)
                elif not known or not 0.0 <= back <= _LONG_STEP * cosine:
                    risk = _expected_risk(mean[p], std * new_cosine, std * new_sine, level, c1, c2, z)
                elif back > 0.0:
                    step = math.asin(back) if back > 1e-3 else back + back * back * back / 6.0
                    half = -0.5 * step
                    if back > _SHORT_STEP * cosine:
                        total = 0.0
                        for i in range(6):
                            total += _SIX_WEIGHTS[i] * _angular_slope(sine, cosine, h, z, half * (1.0 + _SIX[i]))
                        total *= 0.5
                    elif back > _TINY_STEP * cosine:
                        total = 0.5 * (
                            _angular_slope(sine, cosine, h, z, half * (1.0 - _TWO))
                            + _angular_slope(sine, cosine, h, z, half * (1.0 + _TWO))
                        )
                    else:
                        total = _angular_slope(sine, cosine, h, z, half)
                    risk = max(risk - scale * step * total, 0.0)
                known = True
                sine, cosine = new_sine, new_cosine
                slope = 0.0
                if with_slopes and sine > 0.0 and cosine > 0.0:
                    slope = 0.5 * scale * _angular_slope(sine, cosine, h, z, 0.0) / (variance[p] * sine * cosine)
            sums[j] += risk
            if with_slopes:
                slopes[j, p] = slope
