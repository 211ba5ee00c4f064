"""Packets with times far from this vehicle's own: a wrong clock of a mate or of this vehicle, or a modem's driver."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from positions_helpers import Heard, Sailed, messages, sail, smoother_of

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, MateNavigation
from auv_lse_gp.positions.smoother import CLOCKS_APART_S, PositionSmoother

CONFIG = PositionsConfig()


@pytest.fixture(scope="module")
def team() -> list[Sailed]:
    rng = np.random.default_rng(3)
    return [sail(rng, CONFIG, 60) for _ in range(2)]


@pytest.fixture
def heard(team: list[Sailed]) -> list[Heard]:
    return messages(np.random.default_rng(1), team, 0)


@pytest.mark.parametrize("sent_s", [1e300, 1e9, 4000.0, -4000.0, -1e9, -1e300])
def test_time_of_sending_far_from_that_of_reception_is_ignored_with_its_range(
    team: list[Sailed], heard: list[Heard], sent_s: float
) -> None:
    wrong = dataclasses.replace(heard[4][0], sent_s=sent_s)
    smoother = smoother_of(CONFIG, team, 0, [*heard[:4], (wrong, heard[4][1]), *heard[5:]])
    without = smoother_of(CONFIG, team, 0, heard)
    assert smoother.tracks[2].end_s == without.tracks[2].end_s
    assert len(smoother.ranges) == len(without.ranges) - 1
    assert smoother.refused == 0
    assert np.isfinite(smoother.smooth().theta).all()


@pytest.mark.parametrize("stamp_s", [1e300, 1e9, 4000.0, -1e9, -1e300])
@pytest.mark.parametrize("knows_sending", [True, False])
def test_packet_received_outside_this_vehicles_own_time_is_refused(
    team: list[Sailed], heard: list[Heard], stamp_s: float, knows_sending: bool
) -> None:
    wrong = dataclasses.replace(heard[4][0], stamp_s=stamp_s, sent_s=stamp_s if knows_sending else math.nan)
    smoother = smoother_of(CONFIG, team, 0, [*heard[:4], (wrong, heard[4][1]), *heard[5:]])
    assert smoother.refused == 1
    assert smoother.tracks[2].end_s == heard[-1][0].sent_s
    assert np.isfinite(smoother.smooth().theta).all()


@pytest.mark.parametrize("back_s", [CLOCKS_APART_S + 5.0, 3600.0])
@pytest.mark.parametrize("knows_sending", [True, False])
def test_mates_are_followed_after_this_vehicles_clock_was_set_back(back_s: float, knows_sending: bool) -> None:
    smoother = PositionSmoother(1, CONFIG)
    for t in range(400):
        stamp_s = 5000.0 + t - back_s * (t >= 200)
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp_s, heading_rad=0.0, north_m=float(t), east_m=0.0, depth_m=3.0)
        )
        if t % 20 == 10:
            sent_s = stamp_s - 1.0 if knows_sending else math.nan
            smoother.add_navigation(
                MateNavigation(stamp_s=stamp_s, source=2, sent_s=sent_s, raw_north_m=float(t), raw_east_m=50.0)
            )
    assert smoother.refused == 1, "the first position after the step might have come late"
    assert smoother.tracks[2].end_s == pytest.approx(smoother.tracks[1].end_s, abs=20.0)


def own_track(stamps_s: list[float]) -> PositionSmoother:
    smoother = PositionSmoother(1, CONFIG)
    for t, stamp_s in enumerate(stamps_s):
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp_s, heading_rad=0.0, north_m=float(t), east_m=0.0, depth_m=3.0)
        )
    return smoother


@pytest.mark.parametrize("wrong_s", [1e9, 1e300, 4000.0, -4000.0])
def test_single_position_with_a_wrong_stamp_is_refused(wrong_s: float) -> None:
    smoother = own_track([*map(float, range(50)), wrong_s, *map(float, range(51, 100))])
    assert smoother.refused == 1
    assert (smoother.clock.set_back_s, smoother.tracks[1].end_s) == (0.0, 99.0)


@pytest.mark.parametrize("by_s", [4000.0, 1e9, -4000.0])
def test_track_goes_on_when_the_clock_is_set(by_s: float) -> None:
    smoother = own_track([float(t) + by_s * (t >= 50) for t in range(100)])
    assert smoother.refused == 1
    assert smoother.clock.set_back_s == pytest.approx(-by_s, abs=2.0)
    assert smoother.tracks[1].end_s == pytest.approx(99.0, abs=2.0)


def test_gap_without_positions_is_time_that_passed() -> None:
    smoother = own_track([float(t) + 1500.0 * (t >= 50) for t in range(100)])
    assert (smoother.refused, smoother.tracks[1].end_s) == (0, 1599.0)


@pytest.mark.parametrize("north_m", [1e300, -1e9, math.inf, math.nan])
def test_impossible_dead_reckoned_positions_are_refused(team: list[Sailed], north_m: float) -> None:
    smoother = smoother_of(CONFIG, team, 0, [])
    end_s = smoother.tracks[1].end_s
    smoother.add_dead_reckoning(
        DeadReckoning(stamp_s=end_s + 1.0, heading_rad=0.0, north_m=north_m, east_m=0.0, depth_m=3.0)
    )
    assert (smoother.refused, smoother.tracks[1].end_s) == (1, end_s)
