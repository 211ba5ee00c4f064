"""Positions of a simulated team without fixes: the default priors describe what the navigation filter leaves."""

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.positions.adjustment import adjust
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of


def test_ranges_alone_reduce_the_errors_of_a_team_whose_filters_estimate_their_compasses():
    """With the compass's own harmonics as a prior (1 deg), and a log that hardly wanders, they grew by a third."""
    without_fixes = {"planner.method": "plain", "positions.correct": True, "packet.navigation": True}
    cheap = {"mission.steps": 60, "planner.iterations": 30, "gp.map_resolution_m": 20.0}
    settings = Settings.load(None, {"mission.seed": 3, **without_fixes, **cheap})
    run = Fleet(settings, ground_of(settings)).run()
    assert not any(vehicle.fixes for vehicle in run.vehicles)
    before, after, normalized = [], [], []
    for recorded, moved in zip(run.vehicles, adjust([run]).runs[0].vehicles, strict=True):
        stamps_s, (at_s, *true) = recorded.soundings.stamp_s, recorded.truth[:, :3].T
        true_m = np.column_stack([np.interp(stamps_s, at_s, values) for values in true])
        error_m = moved.soundings.points_m[:, :2] - true_m
        before.append((recorded.soundings.points_m[:, :2] - true_m) ** 2)
        after.append(error_m**2)
        normalized.append((error_m / moved.position_std_at(stamps_s)) ** 2)
    assert np.sqrt(np.concatenate(after).mean() / np.concatenate(before).mean()) < 0.65
    assert np.concatenate(normalized).mean() < 2.0
