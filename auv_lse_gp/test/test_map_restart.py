"""A map started again from its journal: the same state, without repeating all corrections."""

import dataclasses
import json

import numpy as np
import pytest
from positions_helpers import STEADY, Ground, messages, sail, surface

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_gp import AreaConfig, DepthMap, GpConfig, LevelSet, OperatingArea
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map import online
from auv_lse_gp.positions import position_corrector
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_gp.positions.smoother import PositionSmoother

AREA = OperatingArea(AreaConfig(polygon_m=(-400.0, -400.0, 400.0, -400.0, 400.0, 400.0, -400.0, 400.0), raster_m=20.0))
CONFIG = PositionsConfig(**STEADY, correct=True, heading_std_deg=2.0)


def _intake():
    depth_map = DepthMap(GpConfig(map_resolution_m=20.0), LevelSet(), AREA)
    return MapIntake(depth_map, PositionCorrector(1, CONFIG, depth_map))


def _mission(legs):
    """An intake after a mission, with its journal."""
    rng, gp = np.random.default_rng(4), GpConfig()
    team = [sail(rng, CONFIG, legs) for _ in range(2)]
    surface(rng, team[0], 12 * legs)
    ground, heard = Ground(rng, gp), messages(rng, team, 0)
    intake, journal = _intake(), []

    def write(*record):
        journal.append(json.loads(json.dumps(record)))

    own, depths = team[0], ground.depth_m(team[0].true)
    for i, (time_s, (north, east), heading) in enumerate(zip(own.times, own.raw, own.headings, strict=True)):
        position = DeadReckoning(stamp_s=time_s, heading_rad=heading, north_m=north, east_m=east, depth_m=3.0)
        intake.add_dead_reckoning(position)
        intake.add_soundings([(time_s, north, east, depths[i], north, east)])
        for fix in own.fixes:
            if fix.stamp_s == time_s:
                intake.add_fix(fix)
        for navigation, samples in heard:
            if navigation.sent_s == time_s:
                intake.add_navigation(navigation)
                found = np.column_stack([samples, ground.depth_m(samples)])
                intake.add_samples(time_s, navigation.source, found)
        intake.step_in_journal(float(time_s), write)
    return intake, journal


def _assert_same(one, other):
    assert np.array_equal(one.corrector.correction.theta, other.corrector.correction.theta)
    assert one.corrector.position == other.corrector.position
    assert one.corrector.rebuilds == other.corrector.rebuilds
    assert one.map.revision == other.map.revision
    assert one.map.counts == other.map.counts
    assert one.map.team == other.map.team
    assert np.array_equal(one.corrector.log.mapped_m, other.corrector.log.mapped_m)
    for name in ("locations_m", "depths_m", "noise_std_m", "position_effect_m"):
        assert getattr(one.map.centers, name) == pytest.approx(getattr(other.map.centers, name), abs=1e-5)


@pytest.mark.parametrize("most_dense", [1000, 20], ids=["dense", "tiled"])
def test_map_started_again_continues_from_its_last_checkpoint(monkeypatch, most_dense):
    monkeypatch.setattr(online, "MAX_DENSE", most_dense)
    intake, journal = _mission(legs=54)
    checkpoints = [i for i, record in enumerate(journal) if record[0] == "checkpoint"]
    assert len(checkpoints) > 1
    estimates = []
    smooth = PositionSmoother.smooth

    def counted(self, terrain=None):
        estimates.append(1)
        return smooth(self, terrain)

    monkeypatch.setattr(PositionSmoother, "smooth", counted)
    again = _intake()
    again.restore(journal)
    _assert_same(again, intake)
    ended_s = [record[-1] for record in journal if record[0] == "step"][-1]
    checkpoint_s = journal[checkpoints[-1]][1]["now_s"]
    assert len(estimates) == 1 + (ended_s - checkpoint_s) // CONFIG.interval_s < 0.7 * ended_s // CONFIG.interval_s


def test_a_restart_of_a_map_of_any_size_repeats_a_limited_number_of_corrections(monkeypatch):
    monkeypatch.setattr(online, "MAX_DENSE", 20)
    monkeypatch.setattr(position_corrector, "CENTERS_PER_REPEATED", 1)
    monkeypatch.setattr(position_corrector, "MIN_REPEATED", 3)
    monkeypatch.setattr(position_corrector, "MAX_REPEATED", 6)
    intake, journal = _mission(legs=54)
    assert len(intake.map.gp) > 40, "far more than corrections that a restart may repeat"
    rebuilt_s = np.array([record[1]["now_s"] for record in journal if record[0] == "checkpoint"])
    assert np.diff(rebuilt_s).max() <= 6 * CONFIG.interval_s


def test_long_mission_is_corrected_at_every_second_interval_or_after_a_fix_also_after_a_restart(monkeypatch):
    monkeypatch.setitem(globals(), "CONFIG", dataclasses.replace(CONFIG, knot_s=15.0))
    monkeypatch.setattr(online, "MAX_DENSE", 20)
    corrected_s, correct = [], PositionCorrector.correct

    def noted(self, rebuild=False):
        corrected_s.append(self._corrected_s)
        correct(self, rebuild)

    monkeypatch.setattr(PositionCorrector, "correct", noted)
    intake, journal = _mission(legs=59)
    long_s, fix_s, end_s = 24 * 15.0 + 30.0, 12 * 59.0, 24 * 59.0
    expected = [*np.arange(30.0, long_s + 1.0, 30.0), *np.arange(long_s + 60.0, fix_s, 60.0)]
    expected += np.arange(fix_s + 12.0, end_s + 1.0, 60.0).tolist()
    assert corrected_s == expected
    corrected_s.clear()
    again = _intake()
    again.restore(journal)
    _assert_same(again, intake)
    assert corrected_s == expected[-len(corrected_s) :]
    assert 1 < len(corrected_s) < len(expected)


def test_journal_that_ends_at_a_checkpoint_or_lacks_its_step_is_read(monkeypatch):
    intake, journal = _mission(legs=20)
    last = max(i for i, record in enumerate(journal) if record[0] == "checkpoint")
    for records in (journal[: last + 1], journal[: last - 1] + journal[last : last + 1]):
        again = _intake()
        again.restore(records)
        assert again.corrector.rebuilds == journal[last][1]["rebuilds"]
        assert len(again.map.gp) > 5
        assert np.isfinite(again.map.field().mean_m[AREA.grid(20.0).inside]).all()
    assert intake.corrector.rebuilds >= journal[last][1]["rebuilds"]


@pytest.mark.parametrize("late_s", [0.0, 7.0], ids=["in order", "a late stamp"])
def test_steps_before_the_checkpoint_are_logged_together(monkeypatch, late_s):
    """The log and the map are those of single steps, also where a sounding came late."""
    _, journal = _mission(legs=54)
    for record in journal[20:300:40]:
        record[1]["soundings"][0][0] -= late_s
    steps = []
    step = MapIntake.step

    def counted(self, now_s):
        steps.append(now_s)
        return step(self, now_s)

    monkeypatch.setattr(MapIntake, "step", counted)
    again = _intake()
    again.restore(journal)
    joined = len(steps)
    monkeypatch.setattr(MapIntake, "_can_join", lambda self, waiting: False)
    single = _intake()
    single.restore(journal)
    assert len(steps) - joined == sum(record[0] == "step" for record in journal)
    assert joined < 0.8 * (len(steps) - joined)
    _assert_same(again, single)
    assert again.gate.counts == single.gate.counts
    assert again.gate.counts["late"] == (late_s > 0.0) * 7
    assert again.sounded_s == single.sounded_s
