"""Judgements of a map during a mission: when they are made, in which slices, and of which map."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_gp.inference.tiled_posterior import TiledPosterior
from auv_lse_gp.inference.work import PART, Job
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map import quality as quality_module
from auv_lse_gp.map import quality_watch
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.quality import QualityJudge
from auv_lse_gp.map.quality_watch import CLOSE_PERIOD_S, PERIOD_S, QualityWatch

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 300.0, 0.0, 300.0)))
CONFIG, LEVELS = GpConfig(map_resolution_m=5.0), LevelSetConfig(level_m=15.0)
EASY, HARD = UntilConfig(undiscovered_m=1e5), UntilConfig(undiscovered_m=0.1)


def rows(east_to_m: float, after_s: float = 0.0) -> list[tuple[float, float, float, float]]:
    """Soundings on a plane that is 15 m deep at north = 100, in the west up to `east_to_m`."""
    north, east = np.meshgrid(np.arange(10.0, 200.0, 15.0), np.arange(10.0, east_to_m, 30.0))
    at = zip(north.ravel().tolist(), east.ravel().tolist(), strict=True)
    return [(after_s + 0.01 * i, n, e, 15.0 + 0.1 * (n - 100.0)) for i, (n, e) in enumerate(at)]


def made(asked: UntilConfig) -> MapIntake:
    """An intake with a map of the west, whose mission began at 0 s."""
    intake = MapIntake(DepthMap(CONFIG, LEVELS, AREA), None, QualityWatch(CONFIG, LEVELS, AREA, asked))
    intake.add_soundings(rows(160.0))
    intake.step(0.0)
    assert intake.judge(0.0, True) is None
    return intake


def judged(intake: MapIntake, now_s: float) -> Quality:
    """The quality, after all slices."""
    while (quality := intake.judge(now_s, True)) is None:
        assert intake.watch is not None
        assert intake.watch.is_judging, f"nothing is judged at {now_s} s"
    return quality


def is_judged(intake: MapIntake, now_s: float) -> bool:
    intake.judge(now_s, True)
    assert intake.watch is not None
    return intake.watch.is_judging


def test_a_map_is_judged_in_intervals_that_are_shorter_close_to_the_quality() -> None:
    intake = made(EASY)
    assert not is_judged(intake, PERIOD_S - 1.0)
    assert is_judged(intake, PERIOD_S)
    first = judged(intake, PERIOD_S + 1.0)
    assert (first.stamp_s, first.revision) == (PERIOD_S + 1.0, intake.map.revision)
    assert not is_judged(intake, PERIOD_S + CLOSE_PERIOD_S), "the map has not changed"
    intake.add_soundings(rows(200.0, 100.0))
    intake.step(101.0)
    assert not is_judged(intake, PERIOD_S + CLOSE_PERIOD_S - 1.0)
    assert is_judged(intake, PERIOD_S + CLOSE_PERIOD_S)
    far = made(HARD)
    judged(far, PERIOD_S)
    far.add_soundings(rows(200.0, 100.0))
    far.step(101.0)
    assert not is_judged(far, 2.0 * PERIOD_S - 1.0)
    assert is_judged(far, 2.0 * PERIOD_S)


def test_the_map_stands_still_while_the_mission_may_end_on_a_judgement() -> None:
    """Every other judgement leaves the mission as it is."""
    intake = made(EASY)
    assert is_judged(intake, PERIOD_S)
    before = intake.map.revision
    intake.add_soundings(rows(200.0, 76.0))
    intake.step(76.0)
    assert intake.map.revision > before, "the first judgement cannot end the mission"
    assert judged(intake, 77.0).revision == before, "of the map at its beginning"
    assert is_judged(intake, 110.0)
    before = intake.map.revision
    intake.add_soundings(rows(250.0, 110.0))
    assert not intake.step(111.0)
    intake.add_soundings(rows(300.0, 112.0))
    assert not intake.step(112.0)
    assert judged(intake, 113.0).revision == intake.map.revision == before
    assert intake.step(114.0)
    everything = DepthMap(CONFIG, LEVELS, AREA)
    for row in (rows(160.0), rows(200.0, 76.0), rows(250.0, 110.0) + rows(300.0, 112.0)):
        everything.add_soundings(row)
    assert np.array_equal(intake.map.centers.depths_m, everything.centers.depths_m), "nothing is lost"


def test_slices_give_the_quality_that_one_go_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    intake, calls = made(EASY), []
    advance = Job.advance
    monkeypatch.setattr(Job, "advance", lambda job, most: calls.append(most) or advance(job, most))
    found = judged(intake, PERIOD_S)
    assert len(calls) > 3
    expected = QualityJudge(CONFIG, LEVELS, AREA).judge(intake.map.centers)
    assert (found.found_share, found.undiscovered_m) == (expected.found_share, expected.undiscovered_m)


@pytest.mark.parametrize("count", [300, 1300])
def test_no_part_of_a_judgement_is_long_and_tiles_give_the_quality_of_the_whole(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Operations count, not seconds: a part is a small share of a second on any computer of today."""
    monkeypatch.setattr(quality_module, "MAX_DENSE", 1000)
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 500.0, 0.0, 500.0, 800.0, 0.0, 800.0)))
    rng = np.random.default_rng(1)
    depth_map = DepthMap(GpConfig(map_resolution_m=10.0, min_spacing_m=0.0), LEVELS, area)
    at = rng.uniform((0.0, 0.0), (500.0, 800.0), (count, 2))
    depth = 15.0 + 6.0 * np.sin(at[:, 0] / 90.0) + rng.normal(0.0, 0.2, count)
    depth_map.add_soundings(np.column_stack([np.arange(float(count)), at, depth]))
    judge = QualityJudge(depth_map.gp.config, LEVELS, area)
    parts: list[float] = []
    searched: list[object] = []  # tiles whose data were searched in this part
    data_of = TiledPosterior.data_of
    monkeypatch.setattr(TiledPosterior, "data_of", lambda tiled, tile: searched.append(tile) or data_of(tiled, tile))
    work = judge.judge_in_parts(depth_map.centers)
    while True:
        searched.clear()
        try:
            parts.append(next(work))
            assert len(searched) <= 1
        except StopIteration as stop:
            found = stop.value
            break
    assert max(parts) <= 2.5 * PART
    monkeypatch.setattr(quality_module, "MAX_DENSE", 10 * count)
    dense = QualityJudge(depth_map.gp.config, LEVELS, area).judge(depth_map.centers)
    assert found.found_share == pytest.approx(dense.found_share, rel=0.01)
    assert found.deviation_m == pytest.approx(dense.deviation_m, rel=0.02)
    again = Job(judge.judge_in_parts(depth_map.centers))
    again.advance(1e15)
    assert again.operations <= sum(parts)
    assert (again.operations < sum(parts)) == (count > 1000), "tiles without changes are kept"


def test_a_map_that_cannot_be_factorized_is_judged_later(monkeypatch: pytest.MonkeyPatch) -> None:
    intake = made(EASY)
    from auv_lse_gp.inference.factor import IllConditionedError

    def fails(*_: Any) -> Any:
        raise IllConditionedError("two centers at one location")
        yield 0.0

    with monkeypatch.context() as patch:
        patch.setattr(QualityJudge, "judge_in_parts", fails)
        assert intake.judge(PERIOD_S, True) is None
    assert intake.watch is not None
    assert not intake.watch.is_judging
    assert judged(intake, 2.0 * PERIOD_S).revision == intake.map.revision


def test_a_watch_started_again_knows_the_last_quality_and_repeats_a_judgement() -> None:
    journal: list[Any] = []

    def write(*record: Any) -> None:
        journal.append(json.loads(json.dumps(record)))

    intake = MapIntake(DepthMap(CONFIG, LEVELS, AREA), None, QualityWatch(CONFIG, LEVELS, AREA, EASY))
    intake.add_soundings(rows(160.0))
    intake.step_in_journal(0.0, write)
    intake.judge(0.0, True, write)
    while intake.judge(PERIOD_S, True, write) is None:
        pass
    intake.add_soundings(rows(200.0, 80.0))
    intake.step_in_journal(80.0, write)
    intake.judge(PERIOD_S + CLOSE_PERIOD_S, True, write)
    intake.add_soundings(rows(250.0, 106.0))
    assert not intake.step_in_journal(106.0, write), "the map stands still"
    again = MapIntake(DepthMap(CONFIG, LEVELS, AREA), None, QualityWatch(CONFIG, LEVELS, AREA, EASY))
    again.restore(journal)
    assert again.watch is not None
    assert intake.watch is not None
    assert again.watch.quality == intake.watch.quality
    assert np.array_equal(again.map.centers.locations_m, intake.map.centers.locations_m)
    assert judged(again, 107.0).revision == again.map.revision
    assert intake.judge(106.0, False) is None, "the mission is on hold"
    assert intake.step_in_journal(106.0, write), "what waited"
    again.restore(journal[-1:])
    assert np.array_equal(again.map.centers.locations_m, intake.map.centers.locations_m)


def test_nobody_asks_so_nothing_is_judged() -> None:
    assert QualityWatch.of(CONFIG, LEVELS, AREA, UntilConfig()) is None
    assert quality_watch.slices(1.0) == 20
    assert quality_watch.slices(0.05) == 1
