"""Positions in missions of hours: a bounded problem, close to the one with all knots and all segments."""

import numpy as np
import pytest
from positions_helpers import STEADY, Ground, messages, sail, smoother_of, surface, terrain_of

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_gp.positions import error_model
from auv_lse_gp.positions.error_model import MAX_KNOTS, TeamErrorModel, VehicleErrorModel
from auv_lse_gp.positions.terrain_matching import Terrain
from auv_lse_gp.positions.track import OwnTrack
from auv_lse_gp.positions.track_segments import (
    MAX_SEGMENT_M,
    MAX_SEGMENTS,
    add_to_tracks,
    segment_track,
    segment_tracks,
)

CONFIG = PositionsConfig(**STEADY)


def _segments(length_m, most=MAX_SEGMENTS):
    along = np.arange(0.0, length_m, 2.0)
    raw = np.column_stack([along, np.zeros_like(along)])
    return segment_track(np.ones(len(along), dtype=np.int64), along, raw, along, most)


def _track(lasts_s):
    track = OwnTrack()
    for time_s in np.arange(0.0, lasts_s + 1.0, 10.0).tolist():
        track.add(time_s, 1.5 * time_s, 0.0)
    return track


@pytest.mark.parametrize("length_m", [11_000.0, 13_000.0, 30_000.0, 80_000.0])
def test_long_track_has_few_short_segments(length_m):
    segments = _segments(length_m)
    assert 0.45 * MAX_SEGMENTS <= len(segments) <= MAX_SEGMENTS + 1
    gaps = np.diff(segments.raw_m[:-1, 0])
    assert gaps.max() - gaps.min() < 5.0


def test_segments_of_a_long_track_stay_as_it_grows():
    before, after = _segments(25_000.0), _segments(25_900.0)
    assert np.array_equal(before.raw_m[:-1], after.raw_m[: len(before) - 1])
    assert before.raw_m[0, 0] <= 0.5 * MAX_SEGMENT_M


@pytest.mark.parametrize("seed", [0, 1])
def test_segments_of_soundings_added_one_after_another_are_those_of_all(seed):
    """Bit by bit, whether or not some come late, at every length of the track."""
    rng, tracks, all_rows = np.random.default_rng(seed), {}, []
    for step in range(12):
        count = int(rng.integers(50, 1500))
        times = 100.0 * step + np.sort(rng.uniform(0.0, 100.0 + 10.0 * seed, count))
        positions = 30.0 * step + np.cumsum(rng.normal(0.0, 2.0, (count, 2)), axis=0)
        rows = np.column_stack([rng.integers(1, 3, count), times, positions, rng.normal(size=count)])
        rows[rng.random(count) < 0.01, 1] = np.nan
        all_rows.append(rows)
        add_to_tracks(tracks, rows[:, 0].astype(np.int64), rows[:, 1:])
        found, every = segment_tracks(tracks), np.concatenate(all_rows)
        expected = segment_track(every[:, 0].astype(np.int64), every[:, 1], every[:, 2:4], every[:, 4])
        for name in ("vehicles", "stamps_s", "raw_m", "depths_m"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))
    assert sum(track.length_m for track in tracks.values()) > MAX_SEGMENTS * MAX_SEGMENT_M


def test_knots_of_a_long_mission_stay_as_it_goes_on():
    limit_s = MAX_KNOTS * CONFIG.knot_s
    for lasted_s in (1.2 * limit_s, 3.9 * limit_s):
        older, newer = (VehicleErrorModel(_track(s), 0, CONFIG) for s in (lasted_s, lasted_s + 30.0))
        assert older.knots <= newer.knots <= MAX_KNOTS
        theta = np.random.default_rng(1).standard_normal(older.block.stop)
        kept = newer.warm_start(theta, older)
        assert sorted(kept[kept != 0.0]) == sorted(theta)


@pytest.mark.parametrize("vehicles", [3, 4, 5, 10, 20])
def test_unknowns_of_a_large_team_are_bounded(vehicles):
    lasted_s = 0.99 * MAX_KNOTS * CONFIG.knot_s
    model = TeamErrorModel(CONFIG, dict.fromkeys(range(1, vehicles + 1), _track(lasted_s)), references={1})
    assert model.vehicles[1].knots == MAX_KNOTS
    assert all((model.vehicles[number].knots == MAX_KNOTS) == (vehicles <= 4) for number in range(2, vehicles + 1))
    assert model.size <= 500


def test_large_team_is_close_to_all_knots(monkeypatch):
    """Tolerance: the errors (root mean square) are at most 1.1 times those with all knots; 1.01 on average."""
    rng = np.random.default_rng(2)
    team = [sail(rng, CONFIG, legs=120, box_m=900.0) for _ in range(12)]
    heard = messages(rng, team, 0, slot_s=20)

    def errors_m():
        correction = smoother_of(CONFIG, team, 0, heard).smooth()
        found = [correction.positions(n, team[n - 1].times, team[n - 1].raw) for n in correction.vehicles]
        errors = [np.sum((a - sailed.true) ** 2, axis=1).mean() for a, sailed in zip(found, team, strict=True)]
        return np.sqrt([errors[0], np.mean(errors[1:])]), correction.model.size

    (own, mates), unknowns = errors_m()
    monkeypatch.setattr(error_model, "MAX_MATE_KNOTS", 1000)
    (own_with_all, mates_with_all), all_unknowns = errors_m()
    assert unknowns < 0.7 * all_unknowns
    assert own <= 1.1 * own_with_all
    assert mates <= 1.1 * mates_with_all


def test_long_mission_is_close_to_all_knots_and_segments(monkeypatch):
    """Tolerance: the error (root mean square) is at most 1.3 times that with all of them."""
    rng, gp = np.random.default_rng(5), GpConfig()
    sailed = sail(rng, CONFIG, legs=640, box_m=900.0)
    for at_s in range(1200, len(sailed.times), 3600):
        surface(rng, sailed, at_s)
    terrain = terrain_of(rng, [sailed], 0, Ground(rng, gp), gp)
    depths = Ground(np.random.default_rng(6), gp).depth_m(sailed.true)
    vehicles = np.ones(len(depths), dtype=np.int64)

    def positions(most):
        segments = segment_track(vehicles, sailed.times, sailed.raw, depths, most)
        full = Terrain(segments, terrain.kernel, terrain.prior_mean, terrain.noise_std_m)
        correction = smoother_of(CONFIG, [sailed], 0, []).smooth(full)
        return correction.positions(1, sailed.times, sailed.raw), len(segments), correction.model.size

    bounded, segments, unknowns = positions(MAX_SEGMENTS)
    monkeypatch.setattr(error_model, "MAX_KNOTS", 1000)
    dense, all_segments, all_unknowns = positions(10_000)
    assert segments < 0.5 * all_segments
    assert unknowns < 0.5 * all_unknowns
    error, all_error = (np.sqrt(((found - sailed.true) ** 2).sum(axis=1).mean()) for found in (bounded, dense))
    assert all_error < 2.0
    assert error < 1.3 * all_error
