import math

import numpy as np
import pytest
from planner_helpers import track_of

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.support.compiled import plain
from auv_lse_planner.paths.motion import MotionTable, advance, roll_states


@pytest.fixture
def table():
    return MotionTable(MotionConfig())


def test_hand_worked_steps(table):
    # Straight on: r theta_max = 15 pi / 2 ahead. 90 degrees to starboard: a quarter circle, no straight left.
    assert table.leg_length_m == pytest.approx(23.5619449, abs=1e-6)
    assert table.steps_m[5] == pytest.approx([23.5619449, 0.0], abs=1e-6)
    assert table.steps_m[10] == pytest.approx([15.0, 15.0], abs=1e-12)
    assert table.steps_m[0] == pytest.approx([15.0, -15.0], abs=1e-12)
    # 30 degrees: d = 15 (pi/2 - pi/6) = 15.7080; ahead 15 sin 30 + d cos 30, starboard 15 - 15 cos 30 + d sin 30
    assert table.steps_m[9] == pytest.approx([7.5 + 15.70796 * 0.8660254, 15 - 12.990381 + 7.853982], abs=1e-5)
    end = table.end_state(np.array([math.pi / 2, 100.0, 200.0]), 10)  # heading east, turns to the south
    assert end == pytest.approx([-math.pi, 85.0, 215.0]) or end == pytest.approx([math.pi, 85.0, 215.0])


def test_legs_have_equal_length_only_with_constant_straights(table):
    assert np.ptp(table.lengths_m) < 1e-12
    growing = MotionTable(MotionConfig(straight="growing"))
    assert growing.straights_m == pytest.approx(15.0 * (math.pi / 2 + np.abs(growing.turns_rad)))
    assert np.ptp(growing.lengths_m) > 40.0


@pytest.mark.parametrize("straight", ["constant", "growing"])
def test_tracks_lead_to_the_end_state_at_the_configured_spacing(straight):
    table = MotionTable(MotionConfig(straight=straight))
    rng = np.random.default_rng(1)
    for action in range(table.actions):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(-500, 500, 2)])
        track = track_of(table, state, action, 0.7)
        assert track[0] == pytest.approx(state[1:])
        assert track[-1] == pytest.approx(table.end_state(state, action)[1:], abs=1e-9)
        gaps = np.hypot(*np.diff(track, axis=0).T)
        assert gaps.max() <= 0.7 + 1e-9
        assert gaps.sum() == pytest.approx(table.lengths_m[action], rel=2e-3)  # chords are a little shorter than arcs


def test_headings_stay_wrapped_and_steps_have_their_length(table):
    rng = np.random.default_rng(2)
    for _ in range(300):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(-900, 900, 2)])
        action = int(rng.integers(table.actions))
        end = table.end_state(state, action)
        assert -math.pi <= end[0] < math.pi
        off_rad = math.remainder(end[0] - state[0] - table.turns_rad[action], 2.0 * math.pi)
        assert off_rad == pytest.approx(0.0, abs=1e-12)
        assert np.hypot(*(end - state)[1:]) == pytest.approx(np.hypot(*table.steps_m[action]))


def test_compiled_and_plain_steps_are_identical(table):
    rng = np.random.default_rng(3)
    for _ in range(200):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(-900, 900, 2)])
        action = int(rng.integers(table.actions))
        arguments = (*state, table.turns_rad[action], *table.steps_m[action])
        assert advance(*arguments) == plain(advance)(*arguments)
    actions = rng.integers(0, table.actions, 100)
    assert np.array_equal(
        table.roll(state, actions)[-1], roll_states(state, actions, table.turns_rad, table.steps_m)[-1]
    )


def test_loops_are_the_turning_circles(table):
    assert table.loops_m == pytest.approx(np.array([[0.0, -15.0, 15.0], [0.0, 15.0, 15.0]]), abs=1e-9)
    assert list(table.loop_actions) == [0, 10]
    growing = MotionTable(MotionConfig(straight="growing"))
    state = np.array([0.3, 10.0, -20.0])
    for side in (0, 1):
        ahead, starboard, reach = growing.loops_m[side]
        c, s = math.cos(state[0]), math.sin(state[0])
        center = np.array([state[1] + c * ahead - s * starboard, state[2] + s * ahead + c * starboard])
        at = state
        for _ in range(5):
            track = track_of(growing, at, int(growing.loop_actions[side]), 1.0)
            assert np.hypot(*(track - center).T).max() <= reach + 1e-6
            at = growing.end_state(at, int(growing.loop_actions[side]))


@pytest.mark.parametrize("straight", ["constant", "growing"])
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
        c, s = math.cos(state[0]), math.sin(state[0])
        locations = state[1:] + table.points(action, at) @ np.array([[c, s], [-s, c]])
        assert np.array([leg.state_at(along)[1:] for along in at]) == pytest.approx(locations, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"actions_deg": [0.0]}, "has no turn"),
        ({"actions_deg": [90.0]}, r"\[90.0\] is one turn; a vehicle would circle"),
        ({"actions_deg": [0.0, 100.0]}, r"100 deg is larger than theta_max_deg \(90 deg\)"),
        ({"actions_deg": [5.0, 5.0]}, "repeats a heading change"),
        ({"actions_deg": [0.1 * i for i in range(225)]}, "has 225 values; a packet has bytes for at most 224"),
        ({"turn_radius_m": 0.0}, "turn_radius_m must be .*, not 0"),
        ({"straight": "other"}, "constant"),
    ],
)
def test_invalid_parameters_are_named(values, message):
    with pytest.raises(ParameterError, match=message):
        from_mapping(MotionConfig, values, "test: motion")
