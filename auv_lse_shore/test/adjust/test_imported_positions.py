"""How accurate the positions of an imported survey are."""

from __future__ import annotations

import numpy as np
from adjust.survey_logs import START_S
from verb_main import verb_main

from auv_lse_record.run_reader import read_run
from auv_lse_shore.judge.team_map import team_map

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
