"""A surfacing: up until GPS has had a fix for long enough, then down to the depth of the leg's end."""

from __future__ import annotations

from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.targets.surfacing import AT_DEPTH_M, FIX_S, LONGEST_S, SURFACED_M, Stage, Surfacing

END = Target(north_m=100.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=1, surface=True)


def test_a_surfacing_descends_after_a_fix_and_ends_at_depth() -> None:
    surfacing = Surfacing(END, 100.0)
    assert surfacing.target.depth_m == 0.0
    surfacing.gps(110.0, True)
    assert not surfacing.proceed(110.0 + FIX_S, SURFACED_M + 0.01), "not at the surface"
    assert not surfacing.proceed(110.0 + FIX_S - 0.01, 0.0), "not for long enough"
    surfacing.gps(110.0 + FIX_S, False)
    surfacing.gps(111.0 + FIX_S, True)
    assert not surfacing.proceed(110.0 + 2.0 * FIX_S, 0.0), "it was lost in between"
    assert surfacing.proceed(111.0 + 2.0 * FIX_S, 0.0)
    assert surfacing.fixed
    assert surfacing.target.depth_m == END.depth_m
    assert not surfacing.proceed(120.0, END.depth_m - AT_DEPTH_M - 0.01), "on its way down"
    assert surfacing.proceed(121.0, END.depth_m - AT_DEPTH_M)
    assert surfacing.stage is Stage.OVER
    assert not surfacing.proceed(122.0, END.depth_m)


def test_without_a_fix_the_surfacing_times_out() -> None:
    surfacing = Surfacing(END, 100.0)
    assert not surfacing.proceed(100.0 + LONGEST_S - 0.01, 0.0)
    assert surfacing.proceed(100.0 + LONGEST_S, 0.0)
    assert not surfacing.fixed
    assert surfacing.stage is Stage.DOWN
