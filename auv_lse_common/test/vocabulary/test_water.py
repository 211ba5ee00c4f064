"""Depth from pressure against the formula that oceanographers agreed on."""

import math

import pytest

from auv_lse_common.vocabulary.water import depth_of, gauge_pressure_pa, gravity_mps2

#: Sea water of 0 deg C and salinity 35, for which the UNESCO formula holds (kg/m3).
STANDARD_SEA = 1028.1063


def unesco_depth_m(pressure_dbar: float, latitude_deg: float) -> float:
    """Fofonoff and Millard 1983, UNESCO technical papers in marine science 44, algorithm 4."""
    s = math.sin(math.radians(latitude_deg)) ** 2
    gravity = 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * s) * s) + 1.092e-6 * pressure_dbar
    p = pressure_dbar
    return ((((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p) / gravity


def test_the_published_check_value():
    assert unesco_depth_m(10_000.0, 30.0) == pytest.approx(9712.653, abs=1e-3)


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 30.0, 90.0])
@pytest.mark.parametrize(("dbar", "tolerance_m"), [(1.0, 1e-4), (10.0, 1e-3), (100.0, 5e-3), (300.0, 3e-2)])
def test_depth_is_that_of_the_unesco_formula(dbar, tolerance_m, latitude_deg):
    assert depth_of(1e4 * dbar, STANDARD_SEA, latitude_deg) == pytest.approx(
        unesco_depth_m(dbar, latitude_deg), abs=tolerance_m
    )


def test_normal_gravity_at_the_equator_and_the_poles():
    assert [gravity_mps2(a) for a in (0.0, 90.0, -90.0)] == pytest.approx([9.7803253359, 9.8321849379, 9.8321849379])


@pytest.mark.parametrize("depth_m", [-0.2, 0.0, 3.0, 300.0])
def test_pressure_at_a_depth_gives_that_depth_back(depth_m):
    assert depth_of(gauge_pressure_pa(depth_m, 1025.0, 46.5), 1025.0, 46.5) == pytest.approx(depth_m, abs=1e-9)


def test_salt_water_is_denser_and_shallower():
    assert depth_of(150_000.0, 1000.0) - depth_of(150_000.0, 1025.0) == pytest.approx(
        0.373, abs=1e-3
    )  # 2.4 % of 15.3 m
