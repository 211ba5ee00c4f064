"""Motion primitives (paper, section 4): an action is an arc of |a| at the turning radius, then a straight.

A state is an array (3,): heading (rad, clockwise from north), north (m), east (m). The paper's misprints
(docs/design/paper.md) are corrected: dx is to starboard, dy ahead, heading 0 is north, and the new location is the old
one plus the rotated step.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.compiled import compiled
from auv_lse_common.vocabulary.leg import Leg, leg_point

#: Largest spacing (m) of the locations at which a leg's clearance is checked.
TRACK_SPACING_M = 1.0


@compiled
def advance(heading: float, north: float, east: float, turn: float, ahead: float, starboard: float):
    """The state after a step given in the body's frame: heading wrapped to [-pi, pi), north, east."""
    c = math.cos(heading)
    s = math.sin(heading)
    new = heading + turn
    if new >= math.pi:
        new -= 2.0 * math.pi
    elif new < -math.pi:
        new += 2.0 * math.pi
    return new, north + c * ahead - s * starboard, east + s * ahead + c * starboard


@compiled
def roll_states(state, actions, turns, steps):
    """States (L + 1, 3) along actions (L,) from a state (3,)."""
    states = np.empty((actions.shape[0] + 1, 3))
    heading, north, east = state[0], state[1], state[2]
    states[0, 0], states[0, 1], states[0, 2] = heading, north, east
    for i in range(actions.shape[0]):
        a = actions[i]
        heading, north, east = advance(heading, north, east, turns[a], steps[a, 0], steps[a, 1])
        states[i + 1, 0], states[i + 1, 1], states[i + 1, 2] = heading, north, east
    return states


@compiled
def roll_many(states, actions, turns, steps):
    """States (B, L + 1, 3) along actions (B, L) from states (B, 3)."""
    rolled = np.empty((actions.shape[0], actions.shape[1] + 1, 3))
    for b in range(actions.shape[0]):
        rolled[b] = roll_states(states[b], actions[b], turns, steps)
    return rolled


class MotionTable:
    """Step, sampled track and turning loop of every action.

    Attributes:
        turns_rad: Heading change of each action, shape (A,).
        steps_m: Step of each action in the body's frame (ahead, starboard), shape (A, 2).
        straights_m: Length of each action's straight, shape (A,).
        lengths_m: Arc plus straight of each action, shape (A,).
        tracks_m: Track of each action in the body's frame (ahead, starboard), shape (A, T, 2), at equal arc lengths of
            at most `TRACK_SPACING_M`.
        checked_m: The locations of each action that must be free, shape (A, C, 2), at most `spacing_m` apart: its
            track and, with `motion.straight_legs`, the straight line back from the leg's end to its start.
        loops_m: Tightest loop to port and to starboard: center ahead, center starboard, radius, shape (2, 3). Repeating
            `loop_actions` keeps the vehicle inside this circle.
        loop_actions: The actions of the loops, shape (2,).
        straight_on: Index of the action with the smallest turn.
    """

    def __init__(self, config: MotionConfig) -> None:
        self.config = config
        radius = config.turn_radius_m
        theta = math.radians(config.theta_max_deg)
        turns = np.radians(np.asarray(config.actions_deg, dtype=float))
        size = np.abs(turns)
        # docs/design/paper.md: d = r (theta_max - |a|) is the default reading; the paper prints '+'.
        self.straights_m: Array = radius * (theta - size if config.straight == "constant" else theta + size)
        self.turns_rad: Array = turns
        self.radius_m = radius
        self.lengths_m: Array = radius * size + self.straights_m
        # Paper, section 4: Delta_x = sign(a) [r - r cos|a| + d sin|a|], Delta_y = r sin|a| + d cos|a|
        starboard = np.sign(turns) * (radius - radius * np.cos(size) + self.straights_m * np.sin(size))
        ahead = radius * np.sin(size) + self.straights_m * np.cos(size)
        self.steps_m: Array = np.stack([ahead, starboard], axis=1)
        count = math.ceil(float(self.lengths_m.max()) / TRACK_SPACING_M) + 1
        fractions = np.linspace(0.0, 1.0, count)
        self.tracks_m: Array = np.stack([self.points(a, fractions * self.lengths_m[a]) for a in range(turns.size)])
        self.spacing_m = float(self.lengths_m.max()) / (count - 1)
        self.checked_m: Array = self.tracks_m
        if config.straight_legs:
            back = np.linspace(1.0, 0.0, count)[None, :, None] * self.steps_m[:, None, :]
            self.checked_m = np.ascontiguousarray(np.concatenate([self.tracks_m, back], axis=1))
        self.straight_on = int(np.argmin(size))
        self.loops_m, self.loop_actions = self._loops()

    @property
    def actions(self) -> int:
        """Number of actions."""
        return int(self.turns_rad.size)

    @property
    def leg_length_m(self) -> float:
        """Length of the straight-on leg; with `motion.straight` 'constant', of every leg."""
        return self.config.leg_length_m

    def points(self, action: int, along_m: Array) -> Array:
        """Points (P, 2), ahead and starboard of the start, at distances (P,) along an action's leg."""
        turn = float(self.turns_rad[action])
        return np.array([leg_point(turn, self.radius_m, float(s))[1:] for s in along_m]).reshape(-1, 2)

    def samples(self, action: int, count: int) -> Array:
        """`count` measurement locations along an action's leg, shape (count, 2), in the frame of `points`.

        They are evenly spaced, the last one at the leg's end.
        """
        fractions = np.arange(1, count + 1) / count
        locations = self.points(action, fractions * self.lengths_m[action])
        locations[-1] = self.steps_m[action]
        return locations

    def line(self, states: Array, actions: Ints, points: int) -> Array:
        """The way along legs as a line (1 + L * points, 2): north, east, with `points` to a leg after the first one.

        Args:
            states: States (L + 1, 3) before and after each of the actions (L,).
        """
        samples = np.stack([self.samples(action, points) for action in range(self.actions)])
        ahead, starboard = np.moveaxis(samples[actions], 2, 0)
        heading, north, east = (states[:-1, i, None] for i in range(3))
        c, s = np.cos(heading), np.sin(heading)
        way = np.stack([north + c * ahead - s * starboard, east + s * ahead + c * starboard], axis=2)
        return np.concatenate([states[:1, 1:], way.reshape(-1, 2)])

    def _loops(self) -> tuple[Array, Ints]:
        """Tightest closed loop to each side: a repeated turn circles the fixed point of its rigid displacement."""
        best: dict[int, tuple[float, Array, int]] = {}
        for action, turn in enumerate(self.turns_rad):
            if turn == 0.0:
                continue
            c, s = math.cos(turn), math.sin(turn)
            rotation = np.array([[c, -s], [s, c]])  # ahead, starboard: a turn is clockwise
            center = np.linalg.solve(np.eye(2) - rotation, self.steps_m[action])
            reach = float(np.linalg.norm(self.tracks_m[action] - center, axis=1).max())
            side = 1 if turn > 0.0 else 0
            if side not in best or reach < best[side][0]:
                best[side] = (reach, center, action)
        for side in (0, 1):  # an action set may turn to one side only
            best.setdefault(side, best.get(1 - side, (math.inf, np.zeros(2), 0)))
        loops = np.array([[*best[side][1], best[side][0]] for side in (0, 1)])
        return loops, np.array([best[0][2], best[1][2]])

    def leg(self, step: int, state: Array, action: int) -> Leg:
        """The leg of an action from a state (3,) at mission step `step`."""
        return Leg(
            step=step,
            heading_rad=float(state[0]),
            north_m=float(state[1]),
            east_m=float(state[2]),
            action_rad=float(self.turns_rad[action]),
            radius_m=self.radius_m,
            straight_m=float(self.straights_m[action]),
        )

    def end_state(self, state: Array, action: int) -> Array:
        """The state after one action, with the same scalar arithmetic as `roll`."""
        return np.array(advance(state[0], state[1], state[2], self.turns_rad[action], *self.steps_m[action]))

    def roll(self, state: Array, actions: NDArray[np.integer] | list[int] | tuple[int, ...]) -> Array:
        """States along a sequence of actions, shape (len(actions) + 1, 3), the first one `state`."""
        return np.asarray(
            roll_states(
                np.asarray(state, dtype=float), np.asarray(actions, dtype=np.int64), self.turns_rad, self.steps_m
            )
        )
