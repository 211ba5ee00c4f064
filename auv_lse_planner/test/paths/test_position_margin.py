"""The margin for an uncertain place: values worked by hand. `test_tour.py` checks the gradient."""

import numpy as np
import pytest
from planner_helpers import world

from auv_lse_planner.paths.position_margin import DEVIATIONS, PositionMargin


def test_only_the_uncertainty_towards_the_border_counts():
    """The area's border lies 20 m south and west of the origin, and `area.margin_m` is 10 m."""
    _, _, space, _ = world()
    margin = PositionMargin(np.diag([400.0, 81.0]))
    south, west = np.array([[5.0, 200.0]]), np.array([[200.0, 5.0]])
    assert DEVIATIONS == 2.5
    # 25 m from the southern border: 2.5 x 20 m are asked, so 25 m are missing, and 6 m more if room is to be left.
    # The raster's distances err by up to twice its spacing of 2 m, on the safe side: by at most 4 m in 25 m.
    assert margin.shortfall_m2(space, south)[0] == pytest.approx(25.0**2, rel=0.15)
    assert margin.shortfall_m2(space, south, 6.0)[0] == pytest.approx(31.0**2, rel=0.15)
    assert margin.shortfall_m2(space, west)[0] == 0.0, "9 m are not more than area.margin_m"
    assert margin.shortfall_m2(space, np.array([[-9.0, 200.0]]))[0] == pytest.approx(39.0**2, rel=0.1)
    assert margin.shortfall_m2(space, np.array([[40.0, 200.0]]))[0] == 0.0


def test_a_margin_is_wider_where_one_deviation_exceeds_the_areas_margin():
    _, _, space, _ = world()
    assert not PositionMargin().is_wider(space)
    assert not PositionMargin(np.diag([100.0, 100.0])).is_wider(space)
    assert PositionMargin(np.diag([1.0, 100.1])).is_wider(space)
    correlated = np.array([[60.0, 50.0], [50.0, 60.0]])  # 110 m^2 along the diagonal
    assert PositionMargin(correlated).is_wider(space)
