"""Down-weights samples that contradict the map and each other.

A sample may lie within the gate of an uncertain map and still contradict the samples around it. Each packet, and then
each sample, is compared with its prediction from the map and all the others. While any of them exceeds the gate, the
one with the largest residual gets more noise, as much as explains its residuals. So of packets that contradict each
other, those with less support lose their weight.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from auv_lse_common.support.arrays import Array, Ints

#: Least number of samples that are compared with each other, if there are as many.
BLOCK = 128


def blocks_of(packets: Ints) -> list[NDArray[np.intp]]:
    """Indices of samples that are compared with each other: whole packets, given the packet of each sample (n,)."""
    ends = [*(np.flatnonzero(np.diff(packets)) + 1).tolist(), len(packets)]
    found, begin = [], 0
    for end in ends:
        if end > begin and (end - begin >= BLOCK or end == len(packets)):
            found.append(np.arange(begin, end))
            begin = end
    return found


def noise_of_samples(
    covariance_m2: Array, residuals_m: Array, noise_std_m: float, sigmas: float, packets: Ints
) -> Array:
    """Noise standard deviations (n,) that make the samples consistent; at least `noise_std_m`.

    Args:
        covariance_m2: Covariance (n, n) of the depths at the samples, given the map.
        residuals_m: Samples minus their predictions by the map (n,).
        noise_std_m: Standard deviation of the noise of a sample that contradicts nothing.
        sigmas: Largest residual, in standard deviations of its prediction from the map and the other samples.
        packets: Number of each sample's packet (n,).
    """
    noise_m2 = np.full(len(residuals_m), noise_std_m**2)
    groups = [np.flatnonzero(packets == number) for number in np.unique(packets)]
    singles = [np.array([i]) for i in range(len(residuals_m))]
    for units in (groups if len(groups) > 1 else [], singles):
        for _ in units:
            factor = cho_factor(covariance_m2 + np.diag(noise_m2), lower=True)
            precision = cho_solve(factor, np.eye(len(residuals_m)))
            errors, stds = _residuals(precision, precision @ residuals_m, units)
            off = np.where(noise_m2 == noise_std_m**2, np.abs(errors) / stds, 0.0)  # not those already down-weighted
            worst = int(np.argmax(off))
            if off[worst] <= sigmas:
                break
            unit = next(unit for unit in units if worst in unit)
            # one error among many small ones must not lower the noise; a little more marks it as down-weighted
            noise_m2[unit] = max(np.mean(errors[unit] ** 2), 1.000001 * noise_std_m**2)
    return np.asarray(np.sqrt(noise_m2))


def _residuals(precision: Array, weighted: Array, units: Sequence[NDArray[np.intp]]) -> tuple[Array, Array]:
    """Errors and standard deviations (n,) of predictions of each unit from all others (RW2006, section 5.4.2)."""
    variances = 1.0 / np.diag(precision)
    errors = weighted * variances
    for unit in (unit for unit in units if len(unit) > 1):
        covariance = np.linalg.solve(precision[np.ix_(unit, unit)], np.eye(len(unit)))
        errors[unit], variances[unit] = covariance @ weighted[unit], np.diag(covariance)
    return errors, np.sqrt(variances)
