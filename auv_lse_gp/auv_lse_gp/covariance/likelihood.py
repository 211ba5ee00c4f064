"""Fits the Gaussian process' parameters to soundings by maximum marginal likelihood.

The covariance is K = s^2 (R + g I): the signal has the standard deviation s, the noise sqrt(g) s. The mean H b is
linear in its parameters. For given correlations, the best b and s have closed forms (Rasmussen and Williams 2006,
sections 2.7 and 5.4.1). The search varies the logarithms of the length scales and of g, and a rotation. Its gradient is

    d log p / d x = 1/2 [ a^T dA a / s^2 - tr(A^-1 dA) ],   A = R + g I,  a = A^-1 (z - H b).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, lapack
from scipy.optimize import minimize

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.covariance.kernels import CORRELATIONS, SLOPES, SUPPORT_RATIO

#: Search range of noise variance / signal variance.
LOWEST_RATIO, HIGHEST_RATIO = 1e-6, 1e2

#: Largest length scale of the search, and that beyond which it describes a trend; both in extents of the soundings.
MAX_EXTENTS, TREND_EXTENTS = 20.0, 0.5

#: Maximum number of soundings whose correlations are all computed; more are divided into blocks.
BLOCK = 250

#: The data determine a parameter if the standard error of its logarithm is less than this (a factor 1.65).
DETERMINED = 0.5


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """The best parameters found.

    Attributes:
        standard_errors: Standard errors by field of `config`; for signal, lengths and noise, those of the logarithm.
        warnings: Texts about parameters that the data do not determine.
        restarts: Log marginal likelihood found from each start.
    """

    config: GpConfig
    log_likelihood: float
    standard_errors: dict[str, float]
    warnings: list[str]
    soundings: int
    evaluations: int
    restarts: list[float]


class _Block:
    """Soundings whose correlations are all computed.

    Attributes:
        depths: Their depths less a known mean (n,).
        basis: The mean's basis functions at them (n, number of its parameters).
    """

    def __init__(self, offset: Array, depths: Array, basis: Array, kernel: str, two_axes: bool) -> None:
        self.depths, self.basis = depths, basis
        self._kernel, self._two_axes, self._ratio = kernel, two_axes, SUPPORT_RATIO.get(kernel, 1.0)
        self._north = offset[:, None, 0] - offset[None, :, 0]
        self._east = offset[:, None, 1] - offset[None, :, 1]
        self._square = self._north**2 + self._east**2

    def nearest_m(self) -> Array:
        """Distance of each sounding from its nearest neighbour (m, (n,))."""
        apart = self._square + np.diag(np.full(len(self._square), np.inf))
        nearest: Array = np.sqrt(apart.min(axis=1))
        return nearest

    def correlation(self, x: Array) -> tuple[Array, list[Array]]:
        """R, and its derivatives with respect to all elements of x but the last."""
        if not self._two_axes:
            length = math.exp(x[0]) * self._ratio
            square = self._square / length**2
            r = np.sqrt(square)
            return CORRELATIONS[self._kernel](r), [-SLOPES[self._kernel](r) * square]
        one, two = math.exp(x[0]) * self._ratio, math.exp(x[1]) * self._ratio
        cos, sin = math.cos(x[2]), math.sin(x[2])
        u = (cos * self._north + sin * self._east) / one
        v = (cos * self._east - sin * self._north) / two
        r = np.sqrt(u * u + v * v)
        slope = -SLOPES[self._kernel](r)  # d rho / d log length is this times the axis' part of r^2
        return CORRELATIONS[self._kernel](r), [slope * u * u, slope * v * v, slope * u * v * (one / two - two / one)]


@dataclasses.dataclass(frozen=True, slots=True)
class _Solved:
    """A block at some parameters, with its covariance K and the residuals e of its depths.

    Attributes:
        lower: Cholesky factor of K.
        weights: K^-1 e.
        square: e^T K^-1 e.
        correlation: R.
        derivatives: Those of R.
    """

    lower: Array
    weights: Array
    square: float
    correlation: Array
    derivatives: list[Array]

    def slopes(self, by: Sequence[Array], variance: float = 1.0) -> list[float]:
        """1/2 [ a^T dK a / variance - tr(K^-1 dK) ] for each derivative dK of `by`."""
        inverse = _inverse(self.lower)
        squares = [float(self.weights @ derivative @ self.weights) / variance for derivative in by]
        traces = [float(np.einsum("ij,ij->", inverse, derivative)) for derivative in by]
        return [0.5 * (square - trace) for square, trace in zip(squares, traces, strict=True)]


class MarginalLikelihood:
    """The likelihood of soundings under one kernel, as a function of its parameters.

    Search variables x: log length, [log length across, rotation (rad)], log g. The work grows with the cube of the
    number of soundings, so many are divided into blocks of neighbours, whose likelihoods are multiplied as if they were
    independent (Caragea and Smith 2007).
    """

    def __init__(
        self,
        locations_m: Array,
        depths_m: Array,
        kernel: str,
        mean: str = "constant",
        two_axes: bool = False,
        mean_depth_m: float | None = None,
        max_extents: float = MAX_EXTENTS,
    ) -> None:
        """Prepares the likelihood of soundings; arguments as in `fit`, `two_axes` for two length scales and a rotation.

        Raises:
            ValueError: for fewer than 10 soundings, soundings at one location, or depths that the mean explains
                exactly.
        """
        if mean not in ("constant", "plane"):
            raise ValueError(f"mean: {mean!r} cannot be fitted; use constant or plane")
        if mean_depth_m is not None and mean != "constant":
            raise ValueError(f"mean_depth_m: {mean_depth_m!r} m needs a constant mean")
        if len(locations_m) < 10:
            raise ValueError(f"soundings: {len(locations_m)} are too few to fit; give at least 10")
        self.kernel = kernel
        self.two_axes = two_axes
        self.evaluations = 0
        self._max_extents = max_extents
        self._center = locations_m.mean(axis=0)
        offset = locations_m - self._center
        self.extent_m = float(np.ptp(locations_m, axis=0).max())
        if not self.extent_m > 0.0:
            raise ValueError("soundings: all are at one location; give soundings over an area")
        ones = np.ones((len(offset), 1))
        if mean_depth_m is not None:
            basis, self._fixed = np.zeros((len(offset), 0)), mean_depth_m
        else:
            basis, self._fixed = (ones if mean == "constant" else np.hstack([ones, offset])), 0.0
        depths = depths_m - self._fixed
        if not np.ptp(depths_m) > 0.0:
            raise ValueError(f"soundings: all have the depth {float(depths_m[0])!r} m, so no variance can be fitted")
        if mean == "plane":
            off = depths - basis @ np.linalg.lstsq(basis, depths, rcond=None)[0]
            if float(np.abs(off).max()) <= 1e-9 * float(np.ptp(depths_m)):  # what rounding leaves
                raise ValueError(
                    "soundings: all depths lie on one plane, so no variance about it can be fitted. Use mean constant"
                )
        self._count = len(depths)
        parts = _neighbourhoods(offset, np.arange(self._count))
        self._blocks = [_Block(offset[part], depths[part], basis[part], kernel, two_axes) for part in parts]
        self.spacing_m = float(np.median(np.concatenate([block.nearest_m() for block in self._blocks])))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of the search variables."""
        longest_m = self._max_extents * self.extent_m
        length = (math.log(min(max(1e-3 * self.extent_m, 0.2 * self.spacing_m), longest_m)), math.log(longest_m))
        rotation = (-2.0 * math.pi, 2.0 * math.pi)
        ratio = (math.log(LOWEST_RATIO), math.log(HIGHEST_RATIO))
        return [length, length, rotation, ratio] if self.two_axes else [length, ratio]

    def _solve(self, x: Array, signal2: float, noise2: float) -> tuple[list[_Solved], Array, Array]:
        """All blocks at signal2 R + noise2 I, the mean's best parameters b, and their information H^T K^-1 H."""
        found = []
        parameters = self._blocks[0].basis.shape[1]
        moment, information = np.zeros(parameters), np.zeros((parameters, parameters))
        for block in self._blocks:
            correlation, derivatives = block.correlation(x)
            matrix = signal2 * correlation
            matrix[np.diag_indices(len(matrix))] += noise2
            lower = cholesky(matrix, lower=True, check_finite=False)
            both = cho_solve((lower, True), np.column_stack([block.depths, block.basis]), check_finite=False)
            moment += block.basis.T @ both[:, 0]
            information += block.basis.T @ both[:, 1:]
            found.append((block, lower, both, correlation, derivatives))
        mean = np.asarray(np.linalg.solve(information, moment), dtype=np.float64)
        solved = []
        for block, lower, both, correlation, derivatives in found:
            weights = both[:, 0] - both[:, 1:] @ mean
            square = float((block.depths - block.basis @ mean) @ weights)
            solved.append(_Solved(lower, weights, square, correlation, derivatives))
        return solved, mean, information

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Minus the log marginal likelihood at x with the best mean and signal, and its gradient."""
        self.evaluations += 1
        ratio = math.exp(x[-1])
        try:
            solved, _, _ = self._solve(x, 1.0, ratio)
        except LinAlgError:
            return math.inf, np.zeros_like(x)
        variance = sum(block.square for block in solved) / self._count
        value = -0.5 * self._count * (math.log(2.0 * math.pi * variance) + 1.0)
        value -= sum(float(np.sum(np.log(np.diag(block.lower)))) for block in solved)
        gradient = np.zeros_like(x)
        for block in solved:
            gradient += block.slopes([*block.derivatives, ratio * np.eye(len(block.weights))], variance)
        return -value, -gradient

    def best_signal(self, x: Array) -> tuple[float, Array]:
        """Best standard deviation of the signal (m) and best parameters of the mean at x."""
        solved, mean, _ = self._solve(x, 1.0, math.exp(x[-1]))
        return math.sqrt(sum(block.square for block in solved) / self._count), mean

    def full_gradient(self, y: Array) -> Array:
        """Gradient of the log likelihood in y: log signal, then the search variables with log noise for log g."""
        signal2, noise2 = math.exp(2.0 * y[0]), math.exp(2.0 * y[-1])
        gradient = np.zeros_like(y)
        for block in self._solve(np.append(y[1:-1], 0.0), signal2, noise2)[0]:
            signal = [signal2 * by for by in (2.0 * block.correlation, *block.derivatives)]
            gradient += block.slopes([*signal, 2.0 * noise2 * np.eye(len(block.weights))])
        return gradient

    def mean_parameters(self, y: Array) -> tuple[float, Array, Array]:
        """Mean depth at north = east = 0, its slopes (2,), and the standard errors of these three (3,)."""
        x = np.append(y[1:-1], 0.0)
        _, mean, information = self._solve(x, math.exp(2.0 * y[0]), math.exp(2.0 * y[-1]))
        slopes, errors = np.zeros(2), np.zeros(3)
        if not len(mean):
            return self._fixed, slopes, errors
        to_origin = np.eye(len(mean))
        if len(mean) == 3:
            slopes = mean[1:]
            to_origin[0, 1:] = -self._center
        covariance = to_origin @ np.linalg.solve(information, to_origin.T)
        errors[: len(mean)] = np.sqrt(np.diag(covariance))
        return float(to_origin[0] @ mean), slopes, errors


def _neighbourhoods(locations_m: Array, numbers: Ints) -> list[Ints]:
    """Divides the soundings `numbers` into groups of neighbours, each of at most `BLOCK`."""
    if len(numbers) <= BLOCK:
        return [numbers]
    axis = int(np.argmax(np.ptp(locations_m[numbers], axis=0)))
    along = numbers[np.argsort(locations_m[numbers, axis], kind="stable")]
    middle = len(along) // 2
    return [*_neighbourhoods(locations_m, along[:middle]), *_neighbourhoods(locations_m, along[middle:])]


def _inverse(lower: Array) -> Array:
    """(L L^T)^-1."""
    inverse, _ = lapack.dpotri(lower, lower=1)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def fit(
    locations_m: Array,
    depths_m: Array,
    *,
    kernel: str = "matern52",
    mean: str = "constant",
    two_axes: bool = False,
    mean_depth_m: float | None = None,
    max_extents: float = MAX_EXTENTS,
    restarts: int = 5,
) -> Fit:
    """Fits the parameters by maximum marginal likelihood.

    Args:
        locations_m: North, east (m) of the soundings (n, 2); the time grows with n.
        depths_m: Their depths (n,).
        kernel: One of `KERNELS`.
        mean: "constant" or "plane".
        two_axes: Whether to fit two length scales and a rotation.
        mean_depth_m: A known constant mean; by default it is fitted.
        max_extents: Largest length scale, in extents of the soundings.
        restarts: Number of starts: length scales from the soundings' spacing to their extent.

    Raises:
        ValueError: if the soundings cannot be used, or no start leads to a likelihood.
    """
    target = MarginalLikelihood(locations_m, depths_m, kernel, mean, two_axes, mean_depth_m, max_extents)
    best_x, best, found = _search(target, restarts)
    signal, _ = target.best_signal(best_x)
    y = np.concatenate([[math.log(signal)], best_x[:-1], [math.log(signal) + 0.5 * best_x[-1]]])
    names = ["signal_std_m", "length_scale_m", *(["length_scale_2_m", "rotation_deg"] if two_axes else [])]
    names.append("noise_std_m")
    errors, warnings = _uncertainty(target, y, names)
    depth0, slopes, mean_errors = target.mean_parameters(y)
    values = dict(zip(names, np.exp(y), strict=True))
    if two_axes:
        values["rotation_deg"] = math.degrees(math.remainder(y[3], math.pi))  # an axis has no direction
        errors["rotation_deg"] = math.degrees(errors["rotation_deg"])
    if mean_depth_m is None:
        errors["mean_depth_m"] = float(mean_errors[0])
    if mean == "plane":
        errors["mean_slope_north"], errors["mean_slope_east"] = float(mean_errors[1]), float(mean_errors[2])
    try:
        config = GpConfig(
            kernel=kernel,
            mean=mean,
            mean_depth_m=depth0,
            mean_slope_north=float(slopes[0]),
            mean_slope_east=float(slopes[1]),
            **{name: float(value) for name, value in values.items()},  # type: ignore[arg-type]  # all are floats
        )
    except ParameterError as error:
        if mean == "constant":
            raise
        raise ValueError(
            f"soundings: {error}: their plane is too steep, or the origin too far from them. Fit a constant mean"
        ) from error
    warnings += _bounds_hit(best_x, target.bounds, two_axes) + _length_warnings(target, config, errors, y)
    counts = {"soundings": len(depths_m), "evaluations": target.evaluations}
    return Fit(config=config, log_likelihood=best, standard_errors=errors, warnings=warnings, restarts=found, **counts)


def _search(target: MarginalLikelihood, restarts: int) -> tuple[Array, float, list[float]]:
    """The best search variables, their log likelihood, and the log likelihood found from each start."""
    best_x, best, found = None, math.inf, []
    for start in _starts(target, restarts):
        result = minimize(target, start, jac=True, method="L-BFGS-B", bounds=target.bounds,
                          options={"ftol": 1e-12, "gtol": 1e-5, "maxiter": 200})  # fmt: skip
        found.append(-float(result.fun))
        if result.fun < best:
            best_x, best = np.array(result.x), float(result.fun)
    if best_x is None:
        raise ValueError("soundings: the covariance is singular from every start; give locations farther apart")
    return best_x, -best, found


def _length_warnings(target: MarginalLikelihood, config: GpConfig, errors: dict[str, float], y: Array) -> list[str]:
    """Warnings about length scales that the spacing and extent of the soundings cannot support."""
    warnings, length_m = [], config.length_scale_m
    if length_m < 1.5 * target.spacing_m:
        warnings.append(
            f"length_scale_m: {length_m:.3g} m is under 1.5 times the spacing of the soundings "
            f"({target.spacing_m:.3g} m): measure closer together to distinguish it from noise"
        )
    if length_m > TREND_EXTENTS * target.extent_m:
        warnings.append(
            f"length_scale_m: {length_m:.3g} m is over half of the surveyed extent "
            f"({target.extent_m:.3g} m): a trend rather than a correlation; try --mean plane"
        )
    if target.two_axes and abs(y[1] - y[2]) < 2.0 * math.hypot(errors["length_scale_m"], errors["length_scale_2_m"]):
        warnings.append("length_scale_2_m: equal to length_scale_m within its error; one length scale is enough")
    return warnings


def _starts(target: MarginalLikelihood, count: int) -> list[Array]:
    """Starts (x) with length scales spread over their range."""
    bounds = target.bounds
    low, high = math.log(2.0 * target.spacing_m + 1e-3 * target.extent_m), math.log(target.extent_m)
    starts = []
    for i in range(max(1, count)):
        share, ratio = ((i * 0.6180339887) + 0.5) % 1.0, (1e-2, 1e-4, 1e-1)[i % 3]
        length, angle = low + share * (high - low), (0.3, 1.1, -0.6)[i % 3]
        x = [length, length - 0.3, angle, math.log(ratio)] if target.two_axes else [length, math.log(ratio)]
        starts.append(np.array([min(max(v, a), b) for v, (a, b) in zip(x, bounds, strict=True)]))
    return starts


def _uncertainty(target: MarginalLikelihood, y: Array, names: list[str]) -> tuple[dict[str, float], list[str]]:
    """Standard errors from the curvature of the likelihood at its maximum, and warnings about large ones."""
    step = 1e-4
    hessian = np.array(
        [
            (target.full_gradient(y + step * e) - target.full_gradient(y - step * e)) / (2.0 * step)
            for e in np.eye(len(y))
        ]
    )
    values, vectors = np.linalg.eigh(-0.5 * (hessian + hessian.T))
    flat = values <= 1e-6 * max(float(values.max()), 1.0)
    spread = np.where(flat, np.inf, 1.0 / np.where(flat, 1.0, values))
    with np.errstate(invalid="ignore"):
        variance = np.nansum(np.where(vectors**2 < 1e-12, 0.0, vectors**2) * spread, axis=1)
    errors = {name: float(math.sqrt(v)) for name, v in zip(names, variance, strict=True)}
    warnings = []
    for name, error in errors.items():
        limit = math.radians(20.0) if name == "rotation_deg" else DETERMINED
        if error > limit:
            much = (
                f"+-{math.degrees(error):.0f} degrees" if name == "rotation_deg" else f"a factor {math.exp(error):.2g}"
            )
            much = much if error < 20.0 else "any value fits"
            warnings.append(f"{name}: the data hardly determine it ({much})")
    return errors, warnings


def _bounds_hit(x: Array, bounds: list[tuple[float, float]], two_axes: bool) -> list[str]:
    names = ["length_scale_m", "length_scale_2_m", "rotation_deg", "noise_std_m"] if two_axes else [
        "length_scale_m", "noise_std_m"]  # fmt: skip
    return [
        f"{name}: the search ended at the {'lower' if value <= low + 1e-6 else 'upper'} end of its range: "
        "the data do not bound it there"
        for name, value, (low, high) in zip(names, x, bounds, strict=True)
        if name != "rotation_deg" and (value <= low + 1e-6 or value >= high - 1e-6)
    ]
