"""Vehicles' tracks: errors, lengths, distances."""

from dataclasses import replace

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_record.run_data import VehicleRun
from auv_lse_shore.judge.tracks import least_separation, navigation_error, time_outside, true_positions


def test_true_positions_are_interpolated_at_the_stamps(synthetic_run):
    vehicle = synthetic_run(steps=2, drift_mps=0.5).vehicles[0]
    moved = true_positions(vehicle)
    assert np.allclose(moved.north_m, vehicle.soundings.north_m - 0.5 * vehicle.soundings.stamp_s)
    assert np.array_equal(moved.rows[:, [0, 3]], vehicle.soundings.rows[:, [0, 3]])
    assert np.allclose(navigation_error(vehicle), 0.5 * vehicle.odometry[:, 0])


def test_least_separation_after_the_start(synthetic_run):
    run = synthetic_run(steps=10)
    a = VehicleRun(vehicle=1, truth=[[0.0, 0.0, 0.0, 0.0], [100.0, 0.0, 100.0, 0.0]])
    b = VehicleRun(vehicle=2, truth=[[0.0, 0.0, 0.0, 0.0], [100.0, 30.0, 100.0, 0.0]])
    assert least_separation([a, b]) == pytest.approx(18.0)  # 0.3 m/s apart, from 60 s on
    assert least_separation([a]) is None
    assert least_separation(run.vehicles) > 50.0


def test_separation_of_vehicles_whose_clocks_show_the_date() -> None:
    times = 1.7e9 + np.arange(0.0, 200.0, 10.0)
    tracks = [np.column_stack([times, np.zeros(20), np.full(20, east), np.zeros(20)]) for east in (0.0, 30.0)]
    vehicles = [VehicleRun(vehicle=number, truth=truth) for number, truth in enumerate(tracks, 1)]
    assert least_separation(vehicles) == pytest.approx(30.0)


def test_time_outside_the_area_and_the_largest_excursion() -> None:
    square = AreaConfig(polygon_m=(0.0, 0.0, 100.0, 0.0, 100.0, 100.0, 0.0, 100.0), margin_m=10.0)
    clipped = replace(square, no_go={"unreachable_1": (40.0, 40.0, 60.0, 40.0, 60.0, 60.0, 40.0, 60.0)})
    north = [50.0, 95.0, 104.0, 107.0, 95.0]  # in ground left out as unreachable, in the margin, then outside
    vehicle = VehicleRun(vehicle=1, truth=[[10.0 * i, n, 50.0, 0.0] for i, n in enumerate(north)])
    seconds, farthest = time_outside(vehicle, clipped)
    assert seconds == pytest.approx(20.0)
    assert farthest == pytest.approx(7.0, abs=2.0 * square.raster_m)
    assert time_outside(VehicleRun(vehicle=2), square) == (0.0, 0.0)
