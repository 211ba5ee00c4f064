"""Conditions and evaluates a posterior in parts (`inference/work.py`)."""

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.work import FUNCTION, Work, rows_per_part

#: Largest number of centers that `extend_in_parts` takes together.
ROWS = 512


def extend_in_parts(posterior: Posterior, centers: Centers) -> Work[None]:
    """As `Posterior.extend`, at most `ROWS` centers at a time; if it raises, those before remain."""
    first = 0
    posterior.factor.reserve(posterior.data_rows + len(centers))
    while first < len(centers):
        before = posterior.data_rows
        new = min(ROWS, len(centers) - first, rows_per_part((FUNCTION + 0.5 * before) * before))
        posterior.extend(centers.slice(first, first + new))
        first += new
        yield new * ((FUNCTION + 0.5 * before) * before + (FUNCTION + new) * new)


def moments_in_parts(posterior: Posterior, locations_m: Array) -> Work[tuple[Array, Array, Array]]:
    """Mean, variance with exact positions, and variance that uncertain positions add, (P,) each.

    The first and the sum of the others are those of `Posterior.moments`.
    """
    mean, variance, position_variance = np.empty((3, len(locations_m)))
    each = len(posterior) * (0.5 * len(posterior) + 2.0 * FUNCTION)
    rows = rows_per_part(each)
    for first in range(0, len(locations_m), rows):
        part = slice(first, min(first + rows, len(locations_m)))
        mean[part], total = posterior.moments(locations_m[part])
        position_variance[part] = posterior.position_variance(posterior.kernel.scale(locations_m[part]))
        variance[part] = np.maximum(total - position_variance[part], 0.0)
        yield each * (part.stop - first)
    return mean, variance, position_variance
