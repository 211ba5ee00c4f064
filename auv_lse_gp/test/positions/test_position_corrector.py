"""Soundings moved to where they were taken: the map made again, and what it knows of the positions that are left."""

from __future__ import annotations

import numpy as np
import pytest
from positions_helpers import AREA, GP, Ground, played, sail, surface

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig, positions_of
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.inference.cached_points import CachedMoments, CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_gp.positions.sounding_log import SoundingLog

CONFIG = PositionsConfig(correct=True)


def uncertain(rng: np.random.Generator, modes: int = 3) -> Centers:
    positions = rng.uniform(0.0, 200.0, (25, 2))
    effect = 0.5 * rng.standard_normal((25, modes))
    return Centers(positions, rng.normal(15.0, 5.0, 25), np.full(25, 0.3), effect)


# ---------------------------------------------------------------- the floor of the variance


def test_position_variance_agrees_with_the_textbook():
    """D Sigma D' with D = -k S^-1 H, here with H Sigma H' = E E'."""
    rng = np.random.default_rng(0)
    centers = uncertain(rng)
    posterior = Posterior(GP)
    posterior.follow(centers)
    at = rng.uniform(0.0, 200.0, (7, 2))
    covariance = posterior.kernel(centers.locations_m, centers.locations_m) + np.diag(centers.noise_std_m**2)
    d = posterior.kernel(at, centers.locations_m) @ np.linalg.solve(covariance, centers.position_effect_m)
    expected = (d**2).sum(axis=1)
    known = Posterior(GP)
    known.follow(Centers(centers.locations_m, centers.depths_m, centers.noise_std_m))
    mean, variance = known.moments(at)
    assert posterior.position_variance(posterior.kernel.scale(at)) == pytest.approx(expected, rel=1e-9)
    assert posterior.moments(at)[0] == pytest.approx(mean)
    assert posterior.moments(at)[1] == pytest.approx(variance + expected, rel=1e-9)
    assert posterior.at(at).data_var_m2 == pytest.approx(variance + expected, rel=1e-9)
    assert CachedPoints(posterior, at).current().data_var_m2 == pytest.approx(variance + expected, rel=1e-9)


@pytest.mark.parametrize("provisional", [0, 9])
def test_cached_moments_follow_the_position_variance(provisional: int) -> None:
    rng = np.random.default_rng(3)
    first, more = uncertain(rng), uncertain(rng)
    posterior, at = Posterior(GP), rng.uniform(0.0, 200.0, (7, 2))
    kept = CachedMoments(posterior, at, provisional)
    told_anew = Centers(first.locations_m, first.depths_m, first.noise_std_m, 2.0 * first.position_effect_m)
    for centers in (first, first.joined(more), told_anew, more):  # from nothing, more of them, other effects, others
        posterior.follow(centers)
        for _ in range(2):  # the second time nothing is new
            mean, variance, of_positions = kept.update()
            assert np.array([mean, variance + of_positions]) == pytest.approx(np.array(posterior.moments(at)), rel=1e-9)
            assert of_positions == pytest.approx(posterior.position_variance(posterior.kernel.scale(at)), rel=1e-9)


def test_planned_measurements_keep_the_position_variance():
    rng = np.random.default_rng(1)
    posterior = Posterior(GP)
    posterior.follow(uncertain(rng))
    at = rng.uniform(0.0, 200.0, (5, 2))
    floor = posterior.position_variance(posterior.kernel.scale(at))
    posterior = posterior.with_planned(np.repeat(at, 50, axis=0))
    for columns in (posterior.at(at), CachedPoints(posterior, at).current()):
        assert np.all(columns.planned_var_m2 >= floor)
        assert columns.planned_var_m2 == pytest.approx(floor, abs=0.3**2 / 49.0)
        assert np.all(columns.planned_var_m2 <= columns.data_var_m2)


def test_slope_of_the_mean_agrees_with_finite_differences():
    rng = np.random.default_rng(2)
    posterior = Posterior(GpConfig(mean="plane", mean_slope_north=0.1, mean_slope_east=-0.05))
    posterior.follow(uncertain(rng))
    at = rng.uniform(0.0, 200.0, (6, 2))
    slopes = posterior.slopes(at)
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = 1e-3
        assert slopes[:, axis] == pytest.approx(
            (posterior.mean_m(at + step) - posterior.mean_m(at - step)) / 2e-3, abs=1e-5
        )


def test_common_position_error_changes_depths_by_the_slope():
    """Soundings on a plane, all shifted north by an unknown 2 m (std): the depth is then unknown by 2 m times slope."""
    positions = np.stack(np.meshgrid(np.arange(0.0, 200.0, 10.0), np.arange(0.0, 200.0, 10.0)), axis=-1).reshape(-1, 2)
    depths = 15.0 + 0.1 * (positions[:, 0] - 100.0)
    posterior = Posterior(GP)
    effect = np.full((len(positions), 1), 0.1 * 2.0)
    posterior.follow(Centers(positions, depths, np.full(len(positions), 0.3), effect))
    middle = np.array([[95.0, 105.0]])
    assert posterior.slopes(middle)[0] == pytest.approx([0.1, 0.0], abs=0.002)
    assert posterior.position_variance(posterior.kernel.scale(middle))[0] == pytest.approx(0.2**2, rel=0.02)


def test_centers_join_with_and_without_position_effects():
    rng = np.random.default_rng(3)
    some = uncertain(rng, 2)
    plain = Centers(some.locations_m, some.depths_m, some.noise_std_m)
    assert plain.joined(plain).position_effect_m is None
    joined = plain.joined(some)
    assert joined.position_effect_m is not None
    assert joined.position_effect_m[:25].tolist() == np.zeros((25, 2)).tolist()
    assert np.array_equal(joined.slice(25, 50).position_effect_m, some.position_effect_m)


# ---------------------------------------------------------------- the log


def test_log_keeps_uncorrectable_positions():
    log, nan = SoundingLog(), float("nan")
    first = Soundings.from_rows([[1.0, 1.0, 2.0, 9.0, nan, nan], [nan, 3.0, 4.0, 8.0, 30.0, 40.0]])
    assert log.add(2, first, None).tolist() == [[1.0, 2.0], [30.0, 40.0]]
    assert len(log.segments()) == 0
    for _ in range(200):
        log.add(1, Soundings.from_rows(np.ones((3, 6))), None)
    assert len(log) == 602
    assert log.depths_m[:2].tolist() == [9.0, 8.0]


def test_fix_moves_earlier_soundings_and_the_map():
    rng = np.random.default_rng(33)
    ground = Ground(rng, GP)
    config = PositionsConfig(correct=True, heading_std_deg=4.0)  # ten metres of error, where a fix is off by one
    team = [sail(rng, config, 30, box_m=350.0) for _ in range(2)]
    surface(rng, team[0], 400)
    intake = played(team, ground, config)
    corrector, own = intake.corrector, team[0]
    assert corrector is not None
    assert corrector.rebuilds >= 1
    assert len(corrector.log) > 700
    mine = corrector.log.vehicles == 1
    at = corrector.log.stamps_s[mine].astype(int)
    before = np.sqrt(((own.raw[at] - own.true[at]) ** 2).sum(axis=1).mean())
    after = np.sqrt(((corrector.log.mapped_m[mine] - own.true[at]) ** 2).sum(axis=1).mean())
    assert after < 0.5 * before
    cells = intake.map.grid.locations_m
    near = np.array([np.min(((own.true - cell) ** 2).sum(axis=1)) < 15.0**2 for cell in cells])
    raw_map = DepthMap(GP, LevelSet(), AREA)
    raw_map.add_soundings(np.column_stack([own.times, own.raw, ground.depth_m(own.true)]))
    truth = ground.depth_m(cells[near])
    error = intake.map.gp.predict(cells[near])[0] - truth
    raw_error = raw_map.gp.predict(cells[near])[0] - truth
    assert np.sqrt((error**2).mean()) < 0.7 * np.sqrt((raw_error**2).mean())
    inside = intake.map.grid.inside
    std = intake.map.field().std_m[inside][near]
    assert np.mean((error / std) ** 2) < 1.5
    assert intake.map.field().prior_std_m[inside] == pytest.approx(intake.map.gp.predict(cells)[1])


def test_rebuilt_map_equals_a_map_of_the_corrected_soundings():
    rng = np.random.default_rng(32)
    ground = Ground(rng, GP)
    team = [sail(rng, CONFIG, 12, box_m=300.0)]
    surface(rng, team[0], 200)
    intake = played(team, ground, PositionsConfig(correct=True, moved_m=0.0))
    corrector = intake.corrector
    assert corrector is not None
    corrector.correct(rebuild=True)
    fresh = DepthMap(GP, LevelSet(), AREA)
    fresh.add_soundings(np.column_stack([corrector.log.stamps_s, corrector.log.mapped_m, corrector.log.depths_m]))
    assert np.array_equal(intake.map.centers.locations_m, fresh.centers.locations_m)
    assert np.array_equal(intake.map.centers.depths_m, fresh.centers.depths_m)
    effect = intake.map.centers.position_effect_m
    assert effect is not None
    assert len(effect) == len(fresh.centers)
    assert np.array_equal(effect, effect.astype(np.float32))


def test_rejected_sounding_counts_once_despite_rebuilds():
    corrector = PositionCorrector(1, CONFIG, DepthMap(GP, LevelSet(), AREA))
    rows = [[1.0, 0.0, 0.0, 15.0, 0.0, 0.0], [2.0, 9.0, 0.0, np.nan, 9.0, 0.0]]
    corrector.add_soundings(Soundings.from_rows(rows))
    for _ in range(2):
        corrector.corrected_map.rebuild(corrector.log.mapped_m.copy())
    assert (corrector.corrected_map.map.counts.kept, corrector.corrected_map.map.counts.refused) == (1, 1)


def test_without_raw_positions_the_corrector_changes_nothing():
    depth_map, plain = DepthMap(GP, LevelSet(), AREA), DepthMap(GP, LevelSet(), AREA)
    placed, other = MapIntake(depth_map, PositionCorrector(1, CONFIG, depth_map)), MapIntake(plain)
    for t in range(1, 100):
        for intake in (placed, other):
            intake.add_soundings([(float(t), 2.0 * t, 0.5 * t, 15.0 + 0.05 * t)])
            if t % 30 == 0:
                intake.add_samples(float(t), 2, [[-t, 20.0, 14.0], [-t - 20.0, 20.0, 13.0]])
            intake.step(float(t))
    assert np.array_equal(depth_map.centers.locations_m, plain.centers.locations_m)
    assert depth_map.field().std_m == pytest.approx(plain.field().std_m, nan_ok=True)


@pytest.mark.parametrize("wrong_m", [1e300, -1e9, np.inf])
def test_sounding_with_an_impossible_raw_position_stays_at_its_estimated_one(wrong_m: float):
    depth_map = DepthMap(GP, LevelSet(), AREA)
    corrector = PositionCorrector(1, CONFIG, depth_map)
    intake = MapIntake(depth_map, corrector)
    for t in range(1, 100):
        raw_m = wrong_m if t == 20 else 2.0 * t
        heading = {"stamp_s": float(t), "heading_rad": 0.0, "depth_m": 3.0}
        intake.add_dead_reckoning(DeadReckoning(north_m=2.0 * t, east_m=0.0, **heading))
        intake.add_soundings([(float(t), 2.0 * t, 0.0, 15.0 + 0.05 * t, raw_m, 0.0)])
        intake.step(float(t))
    assert corrector.log.mapped_m[19].tolist() == [40.0, 0.0]
    assert np.isfinite(depth_map.field().mean_m).all()
    assert np.isfinite(corrector.smoother.theta).all()


def test_positions_are_corrected_except_with_the_papers_methods():
    assert positions_of({}, "file").correct is True
    assert positions_of({"planner": {"method": "plain"}}, "file").correct is False
    assert positions_of({"planner": {"method": "plain"}, "positions": {"correct": True}}, "file").correct is True
    assert positions_of({"planner": {"method": "plain"}, "positions": {"correct": False}}, "file").correct is False


def test_first_two_modes_are_those_that_a_fix_removes():
    """A fix where the track ends, in the middle of the mean: it moves nothing, and the variance falls by these two."""
    rng = np.random.default_rng(33)
    ground = Ground(rng, GP)
    config = PositionsConfig(correct=True, terrain=False, moved_m=1000.0)
    intake = played([sail(rng, CONFIG, 12, box_m=300.0)], ground, config)
    corrector = intake.corrector
    assert corrector is not None
    corrector.correct()
    assert corrector.correction is not None
    track = corrector.smoother.tracks[1]
    position = corrector.correction.positions(1, np.array([track.end_s]), track.nodes[-1:, 1:3])[0]
    at = intake.map.grid.locations_m[::37]
    before = _position_parts(intake, at)
    north_m, east_m = position.tolist()
    raw_north_m, raw_east_m = track.nodes[-1, 1:3].tolist()
    corrector.add_fix(
        Fix(
            stamp_s=track.end_s,
            north_m=north_m,
            east_m=east_m,
            raw_north_m=raw_north_m,
            raw_east_m=raw_east_m,
            std_m=config.fix_std_m,
        )
    )
    corrector.correct()
    after = _position_parts(intake, at)
    assert before[:, :2].sum() > 0.5 * before.sum()
    assert after.sum(axis=1) == pytest.approx(before[:, 2:].sum(axis=1), rel=0.02, abs=1e-4 * before.max())
    assert after[:, :2].sum() < 0.7 * after.sum()


def _position_parts(intake: MapIntake, locations_m: np.ndarray) -> np.ndarray:
    """What each way in which positions may be wrong adds to the variance of positions (P, 2), (P, ways)."""
    posterior = Posterior(GP)
    posterior.follow(intake.map.centers)
    return (posterior.at(locations_m).white @ posterior.white_position_effect) ** 2
