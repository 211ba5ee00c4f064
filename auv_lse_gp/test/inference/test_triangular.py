"""Small triangular systems against NumPy, in both memory orders."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from auv_lse_gp.inference.triangular import cholesky, solve_lower, solve_positive


def positive(size: int) -> np.ndarray:
    root = np.random.default_rng(size).normal(size=(size, size))
    return root @ root.T + np.eye(size)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("size", [1, 2, 17])
@pytest.mark.parametrize("columns", [None, 0, 1, 5])
def test_solutions_are_those_of_numpy_and_the_upper_triangle_is_not_read(size, order, columns):
    matrix, shape = positive(size), (size,) if columns is None else (size, columns)
    right = np.random.default_rng(3).normal(size=shape)
    above = np.triu(np.full((size, size), np.nan), 1)
    lower = np.linalg.cholesky(matrix)
    given = np.array(lower + above, order=order)
    np.testing.assert_allclose(cholesky(np.array(matrix + above, order=order)), lower, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(solve_lower(given, right), np.linalg.solve(lower, right), rtol=1e-9, atol=1e-12)
    backward = solve_lower(given, right, transposed=True)
    np.testing.assert_allclose(backward, np.linalg.solve(lower.T, right), rtol=1e-9, atol=1e-12)
    if right.size:
        solved = solve_positive(np.array(matrix + 0.1 * np.triu(matrix, 1), order=order), right)
        np.testing.assert_allclose(solved, np.linalg.solve(matrix, right), rtol=1e-9, atol=1e-12)


def test_a_part_of_a_larger_factor_is_solved_and_its_right_side_is_left_as_it_was():
    lower, right = np.linalg.cholesky(positive(9)), np.random.default_rng(3).normal(size=(4, 3))
    before, part = right.copy(), lower[5:, 5:]
    np.testing.assert_allclose(part @ solve_lower(part, right), right, atol=1e-12)
    np.testing.assert_array_equal(right, before)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_what_has_no_solution_is_refused(bad):
    matrix, singular = positive(4), np.eye(4)
    matrix[2, 2], singular[1, 1] = bad, 0.0
    with pytest.raises(LinAlgError, match="not positive definite"):
        cholesky(matrix)
    with pytest.raises(LinAlgError):
        solve_positive(matrix, np.ones(4))
    with pytest.raises(LinAlgError, match="not finite"):
        solve_positive(np.eye(2), np.array([1.0, np.inf]))
    with pytest.raises(LinAlgError, match="row 2"):
        solve_lower(singular, np.ones(4))
