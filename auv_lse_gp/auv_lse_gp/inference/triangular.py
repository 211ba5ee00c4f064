"""Small triangular systems: LAPACK itself, because SciPy's checks cost more than the solution of 20 unknowns."""

import numpy as np
from scipy.linalg import LinAlgError, lapack

from auv_lse_common.support.arrays import Array


def cholesky(matrix: Array) -> Array:
    """Lower factor L (n, n) of a symmetric matrix; only the lower triangle is read.

    Raises:
        LinAlgError: if it is not positive definite in double precision, or has a NaN.
    """
    lower, info = lapack.dpotrf(matrix, lower=1, clean=1)
    if info or not lower[-1, -1] > 0.0:  # LAPACK may take NaN for positive, and it ends in the last pivot
        raise LinAlgError(f"the leading {info or len(lower)} rows are not positive definite")
    return np.asarray(lower)


def solve_lower(lower: Array, right: Array, *, transposed: bool = False) -> Array:
    """L^-1 right or, transposed, L^-T right, for right (n,) or (n, P), n > 0; only the lower triangle is read.

    Raises:
        LinAlgError: if L has a zero on its diagonal.
    """
    if lower.flags.f_contiguous:
        solved, info = lapack.dtrtrs(lower, right, lower=1, trans=transposed)
    else:  # L^T is then in the order of LAPACK, or its copy is
        solved, info = lapack.dtrtrs(lower.T, right, lower=0, trans=not transposed)
    if info:
        raise LinAlgError(f"row {info} of the factor has a zero on the diagonal")
    return np.asarray(solved)


def solve_positive(matrix: Array, right: Array) -> Array:
    """A^-1 right for a symmetric positive definite matrix A (n, n), by its lower triangle.

    Raises:
        LinAlgError: if it is not positive definite in double precision, or if a number is not finite.
    """
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        raise LinAlgError("a number of the system is not finite")
    _, solved, info = lapack.dposv(matrix, right, lower=1)
    if info:
        raise LinAlgError(f"the leading {info} rows are not positive definite")
    return np.asarray(solved)
