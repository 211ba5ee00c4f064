"""Vehicles' tracks: errors, lengths, distances."""

import numpy as np
import pytest

from auv_lse_record.run_data import VehicleRun
from auv_lse_shore.judge.tracks import least_separation, navigation_error, true_positions


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
