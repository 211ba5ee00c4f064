import math

import numpy as np
import pytest

from auv_lse_common.plan import Plan
from auv_lse_planner.config import MotionConfig
from auv_lse_planner.paths.motion import MotionTable


def test_a_plan_holds_what_a_packet_can():
    plan = Plan(
        step=7,
        heading_rad=0.1,
        north_m=123.456789,
        east_m=-9.87654321,
        actions=(np.int64(3), 5),
        naive_path=0xF0,
    )
    assert plan.north_m == float(np.float32(123.456789))
    assert plan.actions == (3, 5)
    assert type(plan.actions[0]) is int
    again = Plan(
        step=7,
        heading_rad=plan.heading_rad,
        north_m=plan.north_m,
        east_m=plan.east_m,
        actions=(3, 5),
        naive_path=0xF0,
    )
    assert again == plan


@pytest.mark.parametrize("straight", ["constant", "printed"])
def test_legs_follow_the_motion_table(straight):
    table = MotionTable(MotionConfig(straight=straight))
    rng = np.random.default_rng(1)
    for action in range(table.actions):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(-300, 300, 2)])
        leg = table.leg(3, state, action)
        assert leg.step == 3
        assert leg.length_m == pytest.approx(table.lengths_m[action])
        end = table.end_state(state, action)
        assert leg.end_state[1:] == pytest.approx(end[1:], abs=1e-9)
        assert math.cos(leg.end_state[0] - end[0]) == pytest.approx(1.0)
        at = np.linspace(0.0, leg.length_m, 9)
        assert np.array([leg.state_at(s)[1:] for s in at]) == pytest.approx(table.along(state, action, at), abs=1e-9)


def test_progress_is_the_arc_length_of_the_nearest_point():
    table = MotionTable(MotionConfig())
    rng = np.random.default_rng(2)
    for action in range(table.actions):
        leg = table.leg(0, np.array([rng.uniform(-3, 3), 50.0, 60.0]), action)
        for along in np.linspace(0.0, leg.length_m + 20.0, 30):
            at = leg.state_at(along)
            assert leg.progress_m(at[1], at[2]) == pytest.approx(along, abs=1e-6)
            # 2 m to starboard: the same point of the leg is nearest
            n, e = at[1] - 2.0 * math.sin(at[0]), at[2] + 2.0 * math.cos(at[0])
            assert leg.progress_m(n, e) == pytest.approx(along, abs=1e-6)
            assert leg.distance_off_m(n, e) == pytest.approx(2.0, abs=1e-6)
        behind = leg.state_at(0.0)
        n, e = behind[1] - 5.0 * math.cos(behind[0]), behind[2] - 5.0 * math.sin(behind[0])
        assert leg.progress_m(n, e) <= 0.0
        assert leg.distance_off_m(n, e) <= 5.0 + 1e-9
