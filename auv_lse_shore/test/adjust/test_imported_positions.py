"""How accurate the positions of an imported survey are."""

from __future__ import annotations

import numpy as np
import pytest
from adjust.survey_logs import START_S
from verb_main import verb_main

from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_record.run_reader import read_run
from auv_lse_shore.export.export import export
from auv_lse_shore.export.survey import Survey
from auv_lse_shore.judge.team_map import team_map
from auv_lse_shore.positions.adjustment import adjust

main = verb_main("import")


def test_the_error_of_gps_lasts_for_minutes_and_is_not_averaged_away(tmp_path):
    """Half an hour has a few fixes with independent errors, not one each minute."""
    path, times = tmp_path / "half_hour.csv", START_S + 3.0 * np.arange(601)
    depths = 9.0 + np.arange(601) % 7
    rows = [f"{t:.0f},{46.5 + 2e-5 * (k % 40):.7f},{6.6 + 1e-5 * k:.7f},{depths[k]}" for k, t in enumerate(times)]
    path.write_text("\n".join(["unix_time,lat,lon,depth", *rows]) + "\n")
    assert main([str(path), "--position-std", "1.5", "--out", str(tmp_path / "run")]) == 0
    (vehicle,) = team_map(read_run(tmp_path / "run")).run.vehicles
    assert np.diff([fix.stamp_s for fix in vehicle.fixes]).min() >= 300.0
    assert np.median(vehicle.position_std_at(vehicle.soundings.stamp_s)) > 0.6 * 1.5


def test_errors_of_gps_that_last_ten_minutes_are_within_the_stated_deviation(tmp_path):
    """Lanes and cross lanes over a known bottom. A fix each minute and hardly any drift gave 6.5."""
    along = np.arange(0.0, 301.0, 3.0)
    lanes = [(along[:: 1 - 2 * (k % 2)], np.full(len(along), k * 300.0 / 7.0)) for k in range(8)]
    true_m = np.concatenate([np.column_stack(pair) for lane in (lanes, [p[::-1] for p in lanes]) for pair in lane])
    times, normalized = START_S + 2.0 * np.arange(len(true_m)), []
    for seed in range(2):
        rng, kept = np.random.default_rng(seed), np.exp(-2.0 / 600.0)
        waves, phases = rng.uniform(0.01, 0.05, (6, 2)), rng.uniform(0.0, 6.0, 6)
        depths = 12.0 + 1.3 * np.sin(true_m @ waves.T + phases).sum(axis=1) + 0.05 * rng.standard_normal(len(times))
        errors = [1.5 * rng.standard_normal(2)]
        for _ in times[1:]:
            errors.append(kept * errors[-1] + 1.5 * np.sqrt(1.0 - kept**2) * rng.standard_normal(2))
        lat, lon = geodetic_from_local(*(true_m + errors).T, 46.5, 6.6)
        table, folder = tmp_path / f"gps{seed}.csv", tmp_path / f"run{seed}"
        np.savetxt(table, np.column_stack([times, lat, lon, depths]), "%.8f", ",", header="unix_time,lat,lon,depth")
        assert main([str(table), "--origin", "46.5", "6.6", "--out", str(folder)]) == 0
        (vehicle,) = adjust([read_run(folder)]).runs[0].vehicles
        rows = np.round((vehicle.soundings.stamp_s - START_S) / 2.0).astype(int)
        off_m = vehicle.soundings.points_m[:, :2] - true_m[rows]
        normalized.append(((off_m / vehicle.position_std_at(vehicle.soundings.stamp_s)) ** 2).mean())
    assert np.mean(normalized) < 4.0


def test_only_adjust_moves_positions_of_gps_to_where_crossings_agree(tmp_path):
    """Half a metre of tide between two passes over a slope is no error of GPS: what is exported stays where it was."""
    north_m = np.tile(np.concatenate([np.arange(0.0, 300.0, 3.0), np.arange(300.0, 0.0, -3.0)]), 2)
    times = START_S + 2.0 * np.arange(len(north_m)) + 7200.0 * (np.arange(len(north_m)) >= len(north_m) // 2)
    depths = 5.0 + 0.05 * north_m + np.where(times > START_S + 3600.0, 0.5, 0.0)
    lat, lon = geodetic_from_local(north_m, np.zeros(len(north_m)), 46.5, 6.6)
    table, folder = tmp_path / "tide.csv", tmp_path / "run"
    np.savetxt(table, np.column_stack([times, lat, lon, depths]), "%.8f", ",", header="unix_time,lat,lon,depth")
    assert main([str(table), "--origin", "46.5", "6.6", "--out", str(folder)]) == 0
    recorded = read_run(folder)
    (vehicle,) = team_map(recorded).run.vehicles
    np.testing.assert_allclose(vehicle.soundings.locations_m, recorded.vehicles[0].soundings.locations_m, atol=1e-6)
    stds_m = vehicle.position_std_at(vehicle.soundings.stamp_s)
    assert 1.0 < stds_m.min() <= stds_m.max() < 2.2  # before the pause of two hours and after it
    assert adjust([recorded], crossings=True).vehicles[0].mean_m > 0.5


@pytest.mark.parametrize("header", ["unix_time,lat,lon,depth", "lat,lon,depth"])
def test_sound_speed_corrects_depths_below_the_transducer_only(tmp_path, header):
    """The transducer's depth was measured with a tape."""
    seconds, table, run = np.arange(60), tmp_path / "boat.csv", tmp_path / "run"
    rows = np.column_stack([START_S + seconds, 46.5 + 1e-5 * seconds, np.full(60, 6.6), 9.0 + 0.1 * seconds])
    np.savetxt(table, rows[:, -header.count(",") - 1 :], "%.8f", ",", header=header, comments="")
    assert main([str(table), "--draught", "0.5", "--out", str(run)]) == 0
    list(export(run, tmp_path / "export", survey=Survey(sound_speed=np.array([[0.0, 1425.0]]))))
    depths = np.loadtxt(tmp_path / "export/soundings.csv", delimiter=",", skiprows=1, usecols=4)
    # 1 mm: the table's decimals, and layers of the profile
    assert depths == pytest.approx(0.5 + 0.95 * rows[:, -1], abs=1e-3)
