"""How ArduSub and ArduRover move a vehicle to a target: trajectories in the autopilot's own estimate.

ArduSub flies the straight line in space to the target and turns to the target's heading at once. Each target message
restarts that trajectory from rest, also one with the same values. The trajectory begins at the stopping point, where
the position controller would bring the vehicle to rest:

    position(t)    = position0 + speed0 (1 - exp(-k t)) / k + direction s(t)
    velocity(t) = speed0 exp(-k t) + direction s'(t)

`speed0` is the velocity at the message, `k` the gain of the position controller, and s(t) an S-curve from the stopping
point to the target. Its jerk rises to `JERK` within `EASE_S` (a raised cosine), its acceleration to `ACCELERATION`.
The constants are fitted to the speeds measured with ArduSub 4.5.0-dev (facts.toml), which they reproduce within
0.02 m/s: a target that is repeated every 0.2 s moves the vehicle at 0.02 m/s.

ArduRover steers to the target with a limited rate of turn, keeps its speed when a target is repeated, and holds there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from auv_lse_common.support.arrays import Array

#: Gain of the position controller (1/s).
GAIN = 0.62
#: Largest jerk (m/s^3) and acceleration (m/s^2) of the S-curve, and the time (s) in which the jerk rises.
JERK, ACCELERATION, EASE_S = 0.39, 0.354, 0.152
#: Speed that the vehicle reaches as a share of the commanded speed.
SPEED_SHARE = 0.87
#: Rate (m/s) of ascent in SURFACE, and with motors that are off; and the time constant (s) with which they set in.
ASCENT_MPS, BUOYANCY_MPS, ASCENT_TIME_S = 1.3, 0.1, 0.3
#: Rate of turn on the spot (rad/s).
YAW_RADPS = math.radians(60.0)
#: A vehicle that is farther (m) than this from its trajectory begins the next one where it is.
LAG_M = 1.0
#: A vehicle within this distance (m) of its target has arrived.
ARRIVED_M = 0.3
#: The boat holds within this distance (m) of its target, and changes its speed by this much (m/s^2).
HOLD_RADIUS_M, BOAT_MPS2 = 2.0, 1.0
#: Rate of turn per radian off its course (1/s), its limit (rad/s), and the speed in a sharp turn (m/s).
COURSE_GAIN, TURN_RADPS, CREEP_MPS = 2.0, 1.0, 0.2
#: With motors that are off its speed falls by this share of its square (1/m). It is computed in steps of this (s).
DRAG_PM, STEP_S = 0.245, 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A position, a heading and a velocity in the autopilot's estimate.

    Attributes:
        position_m: North, east, depth (m), shape (3,).
        heading_rad: Clockwise from north.
        velocity_mps: North, east, down (m/s), shape (3,).
    """

    position_m: Array
    heading_rad: float
    velocity_mps: Array

    @classmethod
    def at_rest(cls, heading_rad: float, north_m: float, east_m: float, depth_m: float = 0.0) -> Pose:
        """A vehicle that does not move."""
        return cls(position_m=np.array([north_m, east_m, depth_m]), heading_rad=heading_rad, velocity_mps=np.zeros(3))


@lru_cache(maxsize=1)
def _half_ramp() -> tuple[Array, Array, Array]:
    """Time (s), speed (m/s) and distance (m) of the first half of an acceleration, whatever speed it leads to."""
    step_s = 0.002
    t = np.arange(0.0, 12.0, step_s)
    jerk = JERK * np.where(t < EASE_S, 0.5 * (1.0 - np.cos(np.pi * t / EASE_S)), 1.0)
    acceleration = np.minimum(np.concatenate([[0.0], np.cumsum(jerk)[:-1]]) * step_s, ACCELERATION)
    speed = np.concatenate([[0.0], np.cumsum(acceleration)[:-1]]) * step_s
    return t, speed, np.concatenate([[0.0], np.cumsum(speed)[:-1]]) * step_s


@dataclass(frozen=True, slots=True)
class SCurve:
    """Distance over time from rest to rest.

    Attributes:
        speed_mps: Largest speed.
        ramp_s: Duration of the acceleration, and of the deceleration.
    """

    length_m: float
    speed_mps: float
    ramp_s: float

    @classmethod
    def over(cls, length_m: float, speed_mps: float) -> SCurve:
        """An S-curve of a length at a speed, or slower if it is too short for that."""
        t, speed, _ = _half_ramp()
        peaks = 2.0 * speed
        longest = np.interp(length_m, peaks * 2.0 * t, peaks)  # speed whose two ramps take the whole length
        peak = min(speed_mps, float(longest))
        return cls(length_m, peak, 2.0 * float(np.interp(0.5 * peak, speed, t)))

    @property
    def duration_s(self) -> float:
        """Time until it ends."""
        cruise_m = max(self.length_m - self.speed_mps * self.ramp_s, 0.0)
        return 2.0 * self.ramp_s + (cruise_m / self.speed_mps if self.speed_mps > 0.0 else 0.0)

    def at(self, passed_s: float) -> tuple[float, float]:
        """Distance (m) and speed (m/s) after a time."""
        left_s = self.duration_s - passed_s
        if left_s <= 0.0:
            return self.length_m, 0.0
        if left_s < self.ramp_s and left_s < passed_s:
            distance_m, speed_mps = self._ramp(left_s)
            return self.length_m - distance_m, speed_mps
        return self._ramp(max(passed_s, 0.0))

    def _ramp(self, passed_s: float) -> tuple[float, float]:
        t, speed, distance = _half_ramp()
        if passed_s <= 0.5 * self.ramp_s:
            return float(np.interp(passed_s, t, distance)), float(np.interp(passed_s, t, speed))
        rest_s = self.ramp_s - passed_s
        if rest_s <= 0.0:
            return self.speed_mps * (0.5 * self.ramp_s - rest_s), self.speed_mps
        mirrored_m, mirrored_mps = float(np.interp(rest_s, t, distance)), float(np.interp(rest_s, t, speed))
        return self.speed_mps * (0.5 * self.ramp_s - rest_s) + mirrored_m, self.speed_mps - mirrored_mps


class SubGuidance:
    """ArduSub's: holonomic, and at rest after each message."""

    def __init__(self, pose: Pose) -> None:
        """Starts at rest, with motors that are off."""
        self._begin = pose
        self._begun_s = -math.inf
        self._curve = SCurve(0.0, 0.0, 0.0)
        self._direction = np.zeros(3)
        self._target_rad = pose.heading_rad
        self._rise_mps = 0.0
        self._arrives = True
        self._lag_m = np.zeros(3)  # the estimate minus the trajectory, north, east, down

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle is at its last target, or has a command to stop."""
        return self._arrives

    def at(self, now_s: float) -> Pose:
        """The pose at a time."""
        passed_s = now_s - self._begun_s
        if math.isinf(passed_s):
            return self._begin
        left = math.exp(-GAIN * passed_s)
        distance_m, speed_mps = self._curve.at(passed_s)
        self._arrives = self._curve.length_m - distance_m <= ARRIVED_M
        coast = self._begin.velocity_mps
        position = self._begin.position_m + coast * (1.0 - left) / GAIN + self._direction * distance_m
        velocity = coast * left + self._direction * speed_mps
        if self._rise_mps > 0.0:
            setting_in = 1.0 - math.exp(-passed_s / ASCENT_TIME_S)
            position[2] = self._begin.position_m[2] - self._rise_mps * (passed_s - ASCENT_TIME_S * setting_in)
            velocity[2] = -self._rise_mps * setting_in
        if position[2] <= 0.0:
            position[2], velocity[2] = 0.0, max(velocity[2], 0.0)
        turn = math.remainder(self._target_rad - self._begin.heading_rad, 2.0 * math.pi)
        turned = math.copysign(min(abs(turn), YAW_RADPS * passed_s), turn)
        heading = math.remainder(self._begin.heading_rad + turned, 2.0 * math.pi)
        return Pose(position_m=position, heading_rad=heading, velocity_mps=velocity)

    def correct(self, now_s: float, north_m: float, east_m: float, depth_m: float, heading_rad: float) -> None:
        """Updates the estimate: the next trajectory begins there if the vehicle cannot follow this one."""
        self._lag_m = np.array([north_m, east_m, depth_m]) - self.at(now_s).position_m

    def go(self, now_s: float, position_m: Array, heading_rad: float, speed_mps: float) -> None:
        """Restarts from rest: a straight line to north, east, depth (m), and the heading at once (NaN: the present)."""
        self._restart(now_s)
        here = self._begin
        way = np.maximum(position_m, [-math.inf, -math.inf, 0.0]) - (here.position_m + here.velocity_mps / GAIN)
        length_m = float(np.linalg.norm(way))
        self._direction = way / length_m if length_m > 0.0 else way
        self._curve = SCurve.over(length_m, SPEED_SHARE * speed_mps)
        self._target_rad = here.heading_rad if math.isnan(heading_rad) else heading_rad
        self._arrives = length_m <= ARRIVED_M

    def hold(self, now_s: float) -> None:
        """Brakes to the stopping point."""
        self._restart(now_s)

    def ascend(self, now_s: float) -> None:
        """Comes to the surface where the vehicle is."""
        self._restart(now_s)
        self._rise_mps = ASCENT_MPS

    def drift(self, now_s: float) -> None:
        """Stops the motors: the vehicle is a little lighter than water."""
        self._restart(now_s)
        self._rise_mps = BUOYANCY_MPS

    def _restart(self, now_s: float) -> None:
        here = self.at(now_s)
        if float(np.linalg.norm(self._lag_m)) > LAG_M:
            here = replace(here, position_m=here.position_m + self._lag_m)
        self._begin, self._begun_s, self._lag_m = here, now_s, np.zeros(3)
        self._curve, self._direction = SCurve(0.0, 0.0, 0.0), np.zeros(3)
        self._target_rad, self._rise_mps, self._arrives = self._begin.heading_rad, 0.0, True


class RoverGuidance:
    """ArduRover's with a boat: it steers to its target, and holds there."""

    def __init__(self, pose: Pose) -> None:
        """Starts at rest, with motors that are off."""
        self._pose, self._drifts = pose, True
        self._now_s = -math.inf
        self._target_m: Array | None = None
        self._speed_mps = 0.0  # present
        self._wanted_mps = 0.0

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle is at its last target, or has a command to stop."""
        return self._target_m is None

    def at(self, now_s: float) -> Pose:
        """The pose at a time; it must not be earlier than the last one asked for."""
        if math.isinf(self._now_s):
            self._now_s = now_s
        while now_s - self._now_s > 1e-9:
            step_s = min(STEP_S, now_s - self._now_s)
            self._now_s += step_s
            self._advance(step_s)
        return self._pose

    def correct(self, now_s: float, north_m: float, east_m: float, depth_m: float, heading_rad: float) -> None:
        """Continues from where the vehicle is."""
        pose = self.at(now_s)
        self._pose = Pose(
            position_m=np.array([north_m, east_m, 0.0]), heading_rad=heading_rad, velocity_mps=pose.velocity_mps
        )

    def go(self, now_s: float, position_m: Array, heading_rad: float, speed_mps: float) -> None:
        """Steers to north, east (m); a repeated target changes nothing."""
        self.at(now_s)
        self._drifts = False
        self._target_m, self._wanted_mps = np.array([position_m[0], position_m[1]]), speed_mps

    def hold(self, now_s: float) -> None:
        """Stops."""
        self.at(now_s)
        self._target_m, self._drifts = None, False

    def ascend(self, now_s: float) -> None:
        """Stops: a boat is at the surface."""
        self.hold(now_s)

    def drift(self, now_s: float) -> None:
        """Stops the motors."""
        self.hold(now_s)
        self._drifts = True

    def _advance(self, step_s: float) -> None:
        heading, position = self._pose.heading_rad, self._pose.position_m
        wanted_mps = rate_radps = 0.0
        if self._target_m is not None:
            north_m, east_m = self._target_m - position[:2]
            apart_m = math.hypot(north_m, east_m)
            off_rad = math.remainder(math.atan2(east_m, north_m) - heading, 2.0 * math.pi)
            rate_radps = min(max(COURSE_GAIN * off_rad, -TURN_RADPS), TURN_RADPS)
            # slower in a turn, and in time before the target
            turning_mps = max(self._wanted_mps * math.cos(off_rad), min(CREEP_MPS, self._wanted_mps))
            stopping_mps = math.sqrt(2.0 * BOAT_MPS2 * max(apart_m - 0.5 * HOLD_RADIUS_M, 0.0))
            wanted_mps = min(turning_mps, stopping_mps)
            if apart_m <= HOLD_RADIUS_M:
                self._target_m = None
        change_mps = (DRAG_PM * self._speed_mps**2 if self._drifts else BOAT_MPS2) * step_s
        self._speed_mps += min(max(wanted_mps - self._speed_mps, -change_mps), change_mps)
        heading = math.remainder(heading + rate_radps * step_s, 2.0 * math.pi)
        velocity = self._speed_mps * np.array([math.cos(heading), math.sin(heading), 0.0])
        self._pose = Pose(position_m=position + velocity * step_s, heading_rad=heading, velocity_mps=velocity)


#: Moves one vehicle; times (s) never decrease.
Guidance = SubGuidance | RoverGuidance
