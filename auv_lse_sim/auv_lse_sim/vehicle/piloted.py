"""A vehicle that follows the trajectory of an autopilot of its own, instead of the planner's legs.

The autopilot steers by the estimated state: the vehicle's velocity over ground is the trajectory's, plus `GAIN` times
the estimate's distance from it. Errors of heading and DVL turn into errors of the true position. The speed through the
water is limited, so a strong current carries the vehicle off.
"""

import math
from typing import Any, Protocol

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_sim.vehicle.motion_model import sense
from auv_lse_sim.vehicle.navigation import DVL_SCALE, EAST, HEADING, NORTH, SURGE, SWAY, wrap
from auv_lse_sim.vehicle.records import Draws, Model

#: Position control (1/s), heading control (1/s), and speed through the water (m/s) at full thrust.
GAIN, YAW_GAIN, FULL_MPS = 0.62, 4.0, 2.0
#: Rates of turn (rad/s) and of depth (m/s) at full thrust.
FULL_RADPS, FULL_DIVE_MPS = 1.5, 1.5
#: Where the velocity over ground, or in the vehicle's axes, changes by more than this (m/s^2), the filter expects it.
CHANGING_MPS2 = 0.05


class Pilot(Protocol):
    """An autopilot with a trajectory of its own."""

    @property
    def step(self) -> int:
        """Number of the present target, from 0; -1 before the first."""

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle is at that target."""

    def poses(self, stamps_s: Array) -> Array:
        """The trajectory at times (n,): north, east, depth (m), heading (rad), velocity north, east (m/s), (n, 6)."""


@compiled
def advance_piloted(model: Model, poses: Array, draws: Draws, in_reach: bool, out: Any) -> None:
    """All sub-steps of a tick.

    Args:
        model: The vehicle's state, filters and parameters; state and filters are changed in place.
        poses: The trajectory at the end of each sub-step, shape (n, 6), as `Pilot.poses`.
        draws: Random numbers and currents of the tick's sub-steps.
        in_reach: Whether the bottom is within the DVL's reach.
        out: Records `RESULT` (n,), one of each sub-step, changed in place.
    """
    m, dt = model.state, model.params.dt
    for i in range(len(poses)):
        before = poses[i - 1] if i > 0 else poses[i]
        changed = math.hypot(poses[i, 4] - before[4], poses[i, 5] - before[5])
        _move(model, poses[i], draws.currents[i, 0], draws.currents[i, 1])
        if changed > CHANGING_MPS2 * dt or abs(m.yaw_rate) * math.hypot(m.surge, m.sway) > CHANGING_MPS2:
            m.under_way = 0.0
        _turn(model.estimate.x, m.yaw_rate * dt)
        _turn(model.raw.x, m.yaw_rate * dt)
        _keep_depth(model, poses[i, 2], draws.normals[i].wobble)
        sense(model, draws, in_reach, out, i)


@compiled
def _move(model: Model, pose: Array, current_north: float, current_east: float) -> None:
    """One sub-step in the plane."""
    m, x, dt = model.state, model.estimate.x, model.params.dt
    # velocity over ground as the autopilot wants it at the end of the sub-step, in its estimate
    north = pose[4] + GAIN * (pose[0] - x[NORTH] - pose[4] * dt)
    east = pose[5] + GAIN * (pose[1] - x[EAST] - pose[5] * dt)
    if model.params.ideal_navigation > 0.0 and model.params.ideal_motion > 0.0:
        north, east = (pose[0] - m.north) / dt, (pose[1] - m.east) / dt
    error = wrap(m.heading - x[HEADING])
    share = (1.0 + x[DVL_SCALE]) / (1.0 + m.dvl_scale)
    c, s = share * math.cos(error), share * math.sin(error)
    through_north, through_east = c * north - s * east - current_north, s * north + c * east - current_east
    speed = math.hypot(through_north, through_east)
    if speed > FULL_MPS:
        through_north, through_east = through_north * FULL_MPS / speed, through_east * FULL_MPS / speed
    ground_north, ground_east = through_north + current_north, through_east + current_east
    rate = YAW_GAIN * wrap(pose[3] - x[HEADING])
    if model.params.ideal_navigation > 0.0 and model.params.ideal_motion > 0.0:
        rate = wrap(pose[3] - m.heading) / dt
    m.yaw_rate = min(max(rate, -FULL_RADPS), FULL_RADPS)
    m.north += ground_north * dt
    m.east += ground_east * dt
    m.heading = wrap(m.heading + m.yaw_rate * dt)
    c, s = math.cos(m.heading), math.sin(m.heading)
    m.surge, m.sway = c * ground_north + s * ground_east, -s * ground_north + c * ground_east
    m.speed = c * through_north + s * through_east
    m.travelled += math.hypot(ground_north, ground_east) * dt


@compiled
def _turn(x: Array, turned: float) -> None:
    """Turns a filter's velocity back by as much as the vehicle has turned (rad): it turns without changing course."""
    c, s = math.cos(turned), math.sin(turned)
    surge, sway = x[SURGE], x[SWAY]
    x[SURGE], x[SWAY] = c * surge + s * sway, -s * surge + c * sway


@compiled
def _keep_depth(model: Model, wanted: float, normal: float) -> None:
    """One sub-step of depth keeping."""
    m, params = model.state, model.params
    keel = m.depth - (m.wobble if m.depth > 0.0 else 0.0)
    decay = math.exp(-params.dt / params.wobble_time)
    m.wobble = decay * m.wobble + math.sqrt(1.0 - decay * decay) * params.wobble * normal
    step = FULL_DIVE_MPS * params.dt
    keel += min(max(wanted - keel, -step), step)
    m.depth = max(keel + m.wobble, 0.0) if keel > 0.0 else 0.0
