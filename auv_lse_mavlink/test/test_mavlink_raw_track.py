"""An autopilot's estimate without its fixes: jumps undone, and told as fixes."""

from __future__ import annotations

import numpy as np
import pytest

from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_mavlink.raw_track import FIX_STD_M, RawTrack


def dive(jump_m: tuple[float, float], gps: bool) -> tuple[RawTrack, list[Fix]]:
    """North with 1.5 m/s for 100 s; at the surface from 40 to 60 s, where the estimate jumps and then creeps 0.5 m."""
    track, fixes = RawTrack(), []
    north, east = 0.0, 0.0
    for t in range(101):
        up = 40 <= t < 60
        speed = 0.0 if up or t == 0 else 1.5
        north += speed if t else 0.0
        if t == 42:
            north, east = north + jump_m[0], east + jump_m[1]
        if 42 < t < 52:
            east += 0.05
        if up and gps:
            track.gps(0.0)
        fix = track.move(float(t), north, east, 0.0 if up or t == 0 else 3.0, speed, 0.0)
        fixes += [] if fix is None else [fix]
    return track, fixes


def test_a_jump_at_the_surface_is_removed_and_reported_as_a_fix() -> None:
    track, (fix,) = dive((-4.0, 6.0), gps=True)
    assert track.jumps == 1
    assert (track.north_m, track.east_m) == pytest.approx((80 * 1.5, 0.0), abs=1.6), "where speed and time lead"
    assert fix.stamp_s == 60.0
    assert (fix.north_m - fix.raw_north_m, fix.east_m - fix.raw_east_m) == pytest.approx((-4.0, 6.45), abs=0.8)
    assert fix.std_m == FIX_STD_M


def test_without_gps_there_is_no_fix_and_without_a_jump_the_raw_position_is_the_estimate() -> None:
    _, fixes = dive((0.0, 0.0), gps=False)
    assert fixes == []
    track = RawTrack()
    for t in range(50):  # at a depth, in a turn
        heading = 0.1 * t
        position = 15.0 * np.sin(heading), 15.0 * (1.0 - np.cos(heading))
        assert track.move(float(t), *position, 3.0, 1.5 * np.cos(heading), 1.5 * np.sin(heading)) is None
        assert (track.north_m, track.east_m) == pytest.approx(position)


def test_a_jump_at_depth_and_a_new_frame_are_undone() -> None:
    track = RawTrack()
    for t in range(20):
        track.move(float(t), 1.5 * t + (30.0 if t >= 10 else 0.0), 0.0, 3.0, 1.5, 0.0)
    assert (track.north_m, track.jumps) == (pytest.approx(28.5), 1)
    track.interrupt()
    track.move(21.0, 500.0, 500.0, 3.0, 1.5, 0.0)
    track.move(22.0, 501.5, 500.0, 3.0, 1.5, 0.0)
    assert (track.north_m, track.east_m) == pytest.approx((30.0, 0.0))


def test_distance_covered_in_a_gap_of_the_link_counts() -> None:
    """20 s without estimates at depth, in which it has turned to the east: the autopilot has reckoned on."""
    track = RawTrack()
    for t in range(10):
        track.move(float(t), 1.5 * t, 0.0, 3.0, 1.5, 0.0)
    track.move(29.0, 13.5, 30.0, 3.0, 0.0, 1.5)
    assert (track.north_m, track.east_m, track.jumps) == (pytest.approx(13.5), pytest.approx(30.0), 0)
    track.move(49.0, 113.5, 60.0, 3.0, 0.0, 1.5)
    assert (track.north_m, track.east_m, track.jumps) == (pytest.approx(13.5), pytest.approx(60.0), 1), "too far"
