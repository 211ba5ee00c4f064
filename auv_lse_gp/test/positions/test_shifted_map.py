"""A map whose centers follow corrected positions instead of being rebuilt."""

from __future__ import annotations

import numpy as np
import pytest
from positions_helpers import AREA, GP, STEADY, Ground, played, sail, surface

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.tiled_posterior import SLOPES_MOVED
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map import online
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions import corrected_map


@pytest.mark.parametrize("most_dense", [1000, 30], ids=["dense", "tiled"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_shifted_map_is_close_to_one_rebuilt_at_each_correction(
    monkeypatch: pytest.MonkeyPatch, seed: int, most_dense: int
) -> None:
    """Tolerances: means .1 standard deviations (rms); nine tenths of the standard deviations 8 %; errors 5 %."""
    monkeypatch.setattr(online, "MAX_DENSE", most_dense)
    maps, rebuilds = [], []
    for many in (corrected_map.MANY_CENTERS, -1.0):
        monkeypatch.setattr(corrected_map, "MANY_CENTERS", many)
        rng = np.random.default_rng(seed)
        ground, config = Ground(rng, GP), PositionsConfig(**STEADY, correct=True, heading_std_deg=1.0)
        team = [sail(rng, config, 40, box_m=300.0) for _ in range(2)]
        surface(rng, team[0], 400)
        intake = played(team, ground, config)
        assert intake.corrector is not None
        maps.append(intake.map)
        rebuilds.append(intake.corrector.rebuilds)
    assert rebuilds[0] < 0.5 * rebuilds[1]
    shifted, rebuilt = (depth_map.field() for depth_map in maps)
    inside = maps[0].grid.inside
    apart = (shifted.mean_m - rebuilt.mean_m)[inside] / rebuilt.std_m[inside]
    assert np.sqrt((apart**2).mean()) < 0.1
    ratio = (shifted.std_m / rebuilt.std_m)[inside]
    assert np.quantile(np.abs(ratio - 1.0), 0.9) < 0.08
    known = rebuilt.std_m[inside] < 0.5 * GP.signal_std_m
    truth = ground.depth_m(maps[0].grid.locations_m[known])
    error, usual = (np.sqrt(((f.mean_m[inside][known] - truth) ** 2).mean()) for f in (shifted, rebuilt))
    assert error < 1.05 * usual


@pytest.mark.parametrize("most_dense", [1000, 5], ids=["dense", "tiled"])
def test_shift_moves_centers_and_what_later_soundings_are_compared_with(
    monkeypatch: pytest.MonkeyPatch, most_dense: int
) -> None:
    monkeypatch.setattr(online, "MAX_DENSE", most_dense)
    depth_map = DepthMap(GP, LevelSet(), AREA)
    north = np.arange(-100.0, 100.0, 4.0)
    rows = np.column_stack([north, north, 0.1 * north, 15.0 + 0.05 * north])
    depth_map.add_soundings(rows)
    before, by = depth_map.centers, np.array([30.0, -7.0])
    depth_map.gp.shift(np.tile(by, (len(before), 1)))
    assert depth_map.centers.locations_m == pytest.approx(before.locations_m + by)
    assert np.array_equal(depth_map.centers.depths_m, before.depths_m)
    counts = len(depth_map.gp)
    depth_map.add_soundings(rows[-3:] + np.array([100.0, *by, 0.0]))
    assert len(depth_map.gp) == counts, "they are as close to its last centers as before"
    with pytest.raises(ValueError, match=r"shift: \(1, 2\) is not the shape of the centers"):
        depth_map.gp.shift(by[None])


def test_slopes_stay_while_centers_move_little_and_are_new_after_that(monkeypatch: pytest.MonkeyPatch) -> None:
    """They stay within 15 % of the steepest slope of the present ones."""
    monkeypatch.setattr(online, "MAX_DENSE", 5)
    rng = np.random.default_rng(3)
    depth_map = DepthMap(GP, LevelSet(), AREA)
    gp = depth_map.gp
    length_m = 1.0 / np.abs(gp.kernel.scale(np.array([[1.0, 0.0]]))).max()
    positions = length_m * rng.uniform(0.3, 1.6, (60, 2))  # all of one tile
    depths = 15.0 + 5.0 * np.sin(positions[:, 0] / 60.0)
    depth_map.add_soundings(np.column_stack([np.arange(60.0), positions, depths]))
    first = gp.slopes()
    gp.shift(rng.uniform(-0.4, 0.4, first.shape) * SLOPES_MOVED * length_m)
    present = Posterior(GP)
    present.follow(gp.centers)
    assert gp.slopes() == pytest.approx(first, abs=0.0)
    exact = present.slopes(gp.centers.locations_m)
    assert np.abs(first - exact).max() < 0.15 * np.abs(exact).max()
    gp.shift(np.full(first.shape, 1.5 * SLOPES_MOVED * length_m) * np.linspace(-1.0, 1.0, len(first))[:, None])
    assert np.abs(gp.slopes() - first).max() > 0.0
