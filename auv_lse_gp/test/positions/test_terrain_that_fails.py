"""Terrain whose information cannot be factorized leaves the solution of the other measurements."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import cho_factor

from auv_lse_gp.positions import gauss_newton

SIZE = 3
KNOWN = np.diag([4.0, 5.0, 6.0])


def search():
    return SimpleNamespace(
        precision=np.ones(SIZE),
        cost=lambda theta, loss: float(theta @ theta),
        normal=lambda theta, loss: (-theta, KNOWN),
        converged=lambda step, share: False,
    )


@pytest.mark.parametrize("broken", [-1e6 * np.eye(SIZE), np.full((SIZE, SIZE), np.nan)], ids=["indefinite", "nan"])
@pytest.mark.parametrize("good_steps", [0, 2])
def test_the_last_information_that_could_be_factorized_is_returned(broken, good_steps):
    given = iter([np.eye(SIZE)] * good_steps + [broken] * 9)
    terrain = SimpleNamespace(cost=lambda theta: 0.0, gradient=lambda theta, precision: (np.zeros(SIZE), next(given)))
    start = np.array([1.0, 2.0, 3.0])
    theta, information = gauss_newton._with_terrain(search(), terrain, start, None, KNOWN, 5)
    cho_factor(information, lower=True)
    assert information == pytest.approx(KNOWN + (np.eye(SIZE) if good_steps else 0.0))
    assert (np.abs(theta) < np.abs(start)).all() == (good_steps > 0)
