"""Covariances, triangular solves and spacing compiled with numba: see `kernels.py`, `factor.py`, `store.py`."""

import math

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]  # has no types
from numba import njit, types
from numba.extending import intrinsic

_LOG2E = math.log2(math.e)
_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 in two parts, so that x - n ln 2 has no rounding error
_LN2_LOW = 1.90821492927058770002e-10
_MAGIC = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer in the low bits
_SQRT5 = math.sqrt(5.0)


@intrinsic
def _bits(typingctx, value):  # type: ignore[no-untyped-def]  # numba's interface
    """The 64 bits of a double as an integer."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic
def _double(typingctx, value):  # type: ignore[no-untyped-def]  # numba's interface
    """The double with these 64 bits."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@intrinsic
def _wide_vectors(typingctx):  # type: ignore[no-untyped-def]  # numba's interface
    """Lets the calling function use 512-bit vectors if the processor has them: 25 % faster."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        # llvmlite rejects this attribute by name, so add it to the underlying set.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), codegen


@njit(inline="always", fastmath={"contract"})
def _exp(x):  # type: ignore[no-untyped-def]  # numba's types
    """exp(x) for x <= 0, and 0 below -700, within 1.5 units in the last place; has no branch, so loops vectorize."""
    y = max(x, -700.0)
    t = y * _LOG2E + _MAGIC
    n = t - _MAGIC
    r = (y - n * _LN2_HIGH) - n * _LN2_LOW  # |r| <= ln 2 / 2; Taylor to r^13 leaves 4e-18
    p = 1.6059043836821613e-10
    p = p * r + 2.08767569878681e-09
    p = p * r + 2.505210838544172e-08
    p = p * r + 2.755731922398589e-07
    p = p * r + 2.7557319223985893e-06
    p = p * r + 2.48015873015873e-05
    p = p * r + 1.984126984126984e-04
    p = p * r + 1.388888888888889e-03
    p = p * r + 8.333333333333333e-03
    p = p * r + 4.1666666666666664e-02
    p = p * r + 1.6666666666666666e-01
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    scale = _double((_bits(t) << np.int64(52)) + np.int64(4607182418800017408))  # 2^n
    return p * scale if x > -700.0 else 0.0


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _matern52(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _wide_vectors()
    for j in range(len(bx)):
        t = _SQRT5 * math.sqrt((bx[j] - x) * (bx[j] - x) + (by[j] - y) * (by[j] - y))
        out[j] = variance * ((1.0 + t + t * t * (1.0 / 3.0)) * _exp(-t))


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _squared_exponential(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _wide_vectors()
    for j in range(len(bx)):
        square = (bx[j] - x) * (bx[j] - x) + (by[j] - y) * (by[j] - y)
        out[j] = variance * _exp(-0.5 * square)


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _wendland_c2(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _wide_vectors()
    for j in range(len(bx)):
        r = math.sqrt((bx[j] - x) * (bx[j] - x) + (by[j] - y) * (by[j] - y))
        q = max(1.0 - r, 0.0)
        q = q * q
        out[j] = variance * (q * q * (4.0 * r + 1.0))


@njit("void(i8, f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True)
def covariance_row(index, variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    """Covariance of scaled locations (bx, by) with one location (x, y); `index` as in `config.KERNELS`."""
    if index == 0:
        _matern52(variance, bx, by, x, y, out)
    elif index == 1:
        _squared_exponential(variance, bx, by, x, y, out)
    else:
        _wendland_c2(variance, bx, by, x, y, out)


@njit("void(i8, f8, f8[:, :], f8[:, :], f8[:, ::1])", cache=True)
def covariance(index, variance, a, b, out):  # type: ignore[no-untyped-def]  # numba's types
    """Covariance (A, B) of scaled locations a (A, 2) and b (B, 2), into `out`."""
    bx, by = b[:, 0].copy(), b[:, 1].copy()
    for i in range(len(a)):
        covariance_row(index, variance, bx, by, a[i, 0], a[i, 1], out[i])


@njit("void(i8, f8, f8[:, :], f8[:, ::1])", cache=True)
def upper_covariance(index, variance, a, out):  # type: ignore[no-untyped-def]  # numba's types
    """Covariance (A, A) among scaled locations (A, 2), into the upper triangle of `out`; the rest is unchanged."""
    ax, ay = a[:, 0].copy(), a[:, 1].copy()
    for i in range(len(a)):
        covariance_row(index, variance, ax[i:], ay[i:], ax[i], ay[i], out[i, i:])


@njit("void(i8, f8, f8[:, :], f8[:, ::1], f8[:, :], f8[:, ::1])", cache=True, fastmath={"contract"})
def subtract_weighted(index, variance, a, weights, b, out):  # type: ignore[no-untyped-def]  # numba's types
    """out (m, B) -= weights (A, m)^T k(a, b), in blocks of columns that fit in the cache."""
    size = 512
    values = np.empty(size)
    bx, by = b[:, 0].copy(), b[:, 1].copy()
    for begin in range(0, len(b), size):
        end = min(begin + size, len(b))
        part = values[: end - begin]
        for j in range(len(a)):
            covariance_row(index, variance, bx[begin:end], by[begin:end], a[j, 0], a[j, 1], part)
            for i in range(weights.shape[1]):
                weight = weights[j, i]
                row = out[i, begin:end]
                for c in range(end - begin):
                    row[c] -= weight * part[c]


@njit("void(f8[:, ::1], f8[::1], f8[::1], f8[::1])", cache=True, fastmath={"contract"})
def add_whitened(whitened, residuals, mean, variance):  # type: ignore[no-untyped-def]  # numba's types
    """mean (P,) += residuals^T w and variance (P,) -= sum of w^2 over its rows, for w (n, P), in one pass."""
    for i in range(whitened.shape[0]):
        weight = residuals[i]
        row = whitened[i]
        for j in range(whitened.shape[1]):
            mean[j] += weight * row[j]
            variance[j] -= row[j] * row[j]


@njit("f8[::1](f8[:, ::1], i8, i8, f8[::1])", cache=True, fastmath={"reassoc", "contract"})
def forward(lower, begin, size, right):  # type: ignore[no-untyped-def]  # numba's types
    """Solves L x = right for rows begin to size - 1 in one pass over L; `right[:begin]` already holds x there."""
    x = right.copy()
    for i in range(begin, size):
        total = 0.0
        row = lower[i]
        for j in range(i):
            total += row[j] * x[j]
        x[i] = (x[i] - total) / row[i]
    return x


# variance * rho'(r) / r at the locations (bx, by), into `out`: see `kernels.SLOPES`.


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _matern52_slope(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _wide_vectors()
    for j in range(len(bx)):
        t = _SQRT5 * math.sqrt((bx[j] - x) * (bx[j] - x) + (by[j] - y) * (by[j] - y))
        out[j] = -5.0 / 3.0 * variance * ((1.0 + t) * _exp(-t))


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _squared_exponential_slope(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _squared_exponential(-variance, bx, by, x, y, out)  # rho' = -r rho


@njit("void(f8, f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract"})
def _wendland_c2_slope(variance, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    _wide_vectors()
    for j in range(len(bx)):
        r = math.sqrt((bx[j] - x) * (bx[j] - x) + (by[j] - y) * (by[j] - y))
        q = max(1.0 - r, 0.0)
        out[j] = -20.0 * variance * (q * q * q)


@njit("void(f8[::1], f8[::1], f8[::1], f8[::1], f8, f8, f8[::1])", cache=True, fastmath={"contract", "reassoc"})
def _weighted_apart(weights, slopes, bx, by, x, y, out):  # type: ignore[no-untyped-def]  # numba's types
    """out (2,) = sum of weight * slope * ((x, y) - (bx, by))."""
    _wide_vectors()
    along, across = 0.0, 0.0
    for j in range(len(bx)):
        weight = weights[j] * slopes[j]
        along += weight * (x - bx[j])
        across += weight * (y - by[j])
    out[0] = along
    out[1] = across


@njit("void(i8, f8, f8[:, :], f8[:, ::1], f8[:, :], f8[:, ::1])", cache=True)
def gradient_sums(index, variance, a, weights, b, out):  # type: ignore[no-untyped-def]  # numba's types
    """`kernels.Kernel.gradient_sums_numpy` of scaled locations a (A, 2) and b (B, 2), into `out` (A, 2)."""
    bx, by = b[:, 0].copy(), b[:, 1].copy()
    slopes, last = np.empty(len(b)), len(weights) - 1
    for i in range(len(a)):
        x, y = a[i, 0], a[i, 1]
        if index == 0:
            _matern52_slope(variance, bx, by, x, y, slopes)
        elif index == 1:
            _squared_exponential_slope(variance, bx, by, x, y, slopes)
        else:
            _wendland_c2_slope(variance, bx, by, x, y, slopes)
        _weighted_apart(weights[min(i, last)], slopes, bx, by, x, y, out[i])


@njit("void(f8[:, ::1], i8, f8, f8[:, :], i8, i8[::1])", cache=True)
def take_spaced(kept, size, spacing, locations, max_new, near):  # type: ignore[no-untyped-def]  # numba's types
    """`store.take_spaced_numpy` compiled; same arguments."""
    full = size + max_new
    for i in range(len(locations)):
        x, y = locations[i, 0], locations[i, 1]
        nearest, best = -1, math.inf
        for j in range(size):
            dx, dy = kept[j, 0] - x, kept[j, 1] - y
            square = dx * dx + dy * dy
            if square < best:
                nearest, best = j, square
        near[i] = nearest if math.sqrt(best) < spacing else -1
        if near[i] < 0 and size < full:
            kept[size, 0], kept[size, 1] = x, y
            near[i] = size
            size += 1
