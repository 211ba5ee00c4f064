"""A vehicle's motion along a leg in sub-steps, with its instruments and its filter in the loop.

Ideal vehicles run on rails: they are exactly on the leg. Others are steered:

    path following   the position `s` along the leg moves on with the vehicle: s' = V cos(course - path) + k_s * ahead
    line of sight    course wanted = path - atan(off / lookahead), heading wanted = that minus the crab angle
    yaw rate wanted  curvature * s' + gain * (heading wanted - heading), limited to the vehicle's largest
    vehicle          rate' = (wanted - rate) / yaw_time, speed' = (wanted - speed) / speed_time,
                     position' = speed (cos h, sin h) + current

A vehicle that surfaces stops, climbs, stays up for fixes, dives, and continues along its leg. The current carries it
meanwhile.

(Fossen 2011, section 10.3: line-of-sight path following with a moving path reference; off = cross-track distance,
positive to starboard.) Steering uses only the estimated state; the equations move the true one.

After the first fix under way the filter runs twice with the same instruments: with the fixes, for steering, and without
them (the dead-reckoned position). Before it both are the same, and only one is computed.

Written for numba like `navigation.py`: scalars and the records of `records.py`; all random numbers are drawn
beforehand.
"""

import math
from typing import Any

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_sim.vehicle.navigation import (
    DVL_SCALE,
    EAST,
    GATE,
    HEADING,
    NORTH,
    SURGE,
    SWAY,
    predict,
    update_compass,
    update_dvl,
    update_gps,
    wrap,
)
from auv_lse_sim.vehicle.records import Draws, Filter, Model

# -- surfacing
NOT_SURFACING, TO_SURFACE, TO_DEPTH = 0.0, 1.0, 2.0

#: A vehicle's velocity changes fast for this many time constants of its speed after it sets out.
SETTING_OUT = 5.0
#: Variance per second of the velocity while it does (m^2/s^3).
SETTING_OUT_RATE = 0.3**2
#: After this many rejected DVL pings in a row the filter accepts the next one: its velocity must be wrong.
PATIENCE = 8.0
#: Variance (m^2) of a GPS reading in the filter at least, also of one without an error.
LEAST_GPS_VARIANCE = 1e-4

# -- modes
WAITING, ON_RAILS, STEERED, PILOTED = 0.0, 1.0, 2.0, 3.0


@compiled
def on_leg(leg: Any, along: float) -> tuple[float, float, float, float]:
    """Heading (rad), north, east (m) and curvature (1/m, clockwise) `along` metres along a leg; then straight on."""
    size = abs(leg.turn)
    side = 1.0 if leg.turn >= 0.0 else -1.0
    radius = leg.radius
    arc = min(max(along, 0.0), radius * size)
    rest = along - arc
    angle = arc / radius
    ahead = radius * math.sin(angle) + rest * math.cos(angle)
    starboard = side * (radius * (1.0 - math.cos(angle)) + rest * math.sin(angle))
    c, s = math.cos(leg.heading), math.sin(leg.heading)
    curvature = side / radius if 0.0 <= along < radius * size else 0.0
    return (
        wrap(leg.heading + side * angle),
        leg.north + c * ahead - s * starboard,
        leg.east + s * ahead + c * starboard,
        curvature,
    )


@compiled
def leg_length(leg: Any) -> float:
    """Length (m) of a leg."""
    length: float = abs(leg.turn) * leg.radius + leg.straight
    return length


@compiled
def _follow_exactly(m: Any, leg: Any, params: Any, current_north: float, current_east: float) -> None:
    """One sub-step of an ideal vehicle: on the leg, the current compensated by crabbing."""
    dt, speed = params.dt, params.speed
    path, _, _, _ = on_leg(leg, m.along)
    with_it = current_north * math.cos(path) + current_east * math.sin(path)
    across = -current_north * math.sin(path) + current_east * math.cos(path)
    over_ground = with_it + math.sqrt(max(speed * speed - across * across, 0.0))
    over_ground = max(over_ground, 0.0)
    before = m.heading
    m.along += over_ground * dt
    heading, north, east, _ = on_leg(leg, m.along)
    m.north, m.east, m.heading = north, east, heading
    m.yaw_rate = wrap(heading - before) / dt
    m.speed, m.surge, m.sway = speed, over_ground, 0.0
    m.travelled += over_ground * dt


@compiled
def _steer(m: Any, x: Array, leg: Any, params: Any, current_north: float, current_east: float) -> None:
    """One sub-step of a vehicle that is steered by its estimated state `x`."""
    dt = params.dt
    path, north, east, curvature = on_leg(leg, m.along)
    c, s = math.cos(path), math.sin(path)
    dn, de = x[NORTH] - north, x[EAST] - east
    ahead, off = c * dn + s * de, -s * dn + c * de
    over_ground = math.hypot(x[SURGE], x[SWAY])
    crab = math.atan2(x[SWAY], x[SURGE]) if x[SURGE] > 0.3 else 0.0
    course = x[HEADING] + crab
    along_rate = max(over_ground * math.cos(wrap(course - path)) + 0.5 * ahead, 0.0)
    wanted = wrap(path - math.atan(off / params.lookahead) - crab - x[HEADING])
    rate = curvature * along_rate + params.gain * wanted
    rate = min(max(rate, -params.yaw_rate_max), params.yaw_rate_max)
    if params.ideal_motion > 0.0:
        m.yaw_rate, m.speed = rate, params.speed
    else:
        m.yaw_rate += (rate - m.yaw_rate) * (1.0 - math.exp(-dt / params.yaw_time))
        m.speed += (params.speed - m.speed) * (1.0 - math.exp(-dt / params.speed_time))
    m.along += along_rate * dt
    _drift(m, current_north, current_east, dt)


@compiled
def _drift(m: Any, current_north: float, current_east: float, dt: float) -> None:
    """Moves the true vehicle by its speed through the water, its yaw rate and the current."""
    middle = m.heading + 0.5 * m.yaw_rate * dt
    vn = m.speed * math.cos(middle) + current_north
    ve = m.speed * math.sin(middle) + current_east
    m.north += vn * dt
    m.east += ve * dt
    m.heading = wrap(m.heading + m.yaw_rate * dt)
    c, s = math.cos(m.heading), math.sin(m.heading)
    m.surge = m.speed + c * current_north + s * current_east
    m.sway = -s * current_north + c * current_east
    m.travelled += math.hypot(vn, ve) * dt


@compiled
def _hold(m: Any, params: Any, current_north: float, current_east: float) -> None:
    """One sub-step of a vehicle that has stopped; one on rails stays where it is."""
    if m.mode == ON_RAILS:
        m.yaw_rate, m.speed, m.surge, m.sway = 0.0, 0.0, 0.0, 0.0
        return
    dt = params.dt
    if params.ideal_motion > 0.0:
        m.yaw_rate, m.speed = 0.0, 0.0
    else:
        m.yaw_rate *= math.exp(-dt / params.yaw_time)
        m.speed *= math.exp(-dt / params.speed_time)
    _drift(m, current_north, current_east, dt)


@compiled
def _advance_surfacing(m: Any, keel: float, params: Any) -> float:
    """Advances the surfacing cycle of a vehicle under way by one sub-step, in `m`.

    Returns the target depth (m): the travel depth, or 0 while the vehicle surfaces.

    Args:
        m: State of the vehicle; changed.
        keel: Its depth without the error of depth keeping (m).
    """
    dt = params.dt
    if m.surfacing == NOT_SURFACING and params.surface_every > 0.0:
        m.surface_age += dt
        if m.surface_age >= params.surface_every:
            m.surfacing = TO_SURFACE
            m.under_way = 0.0
    if m.surfacing == TO_SURFACE:
        if m.depth <= params.gps_depth:
            m.time_up += dt
        if m.time_up >= params.surface_time - 1e-9:
            m.surfacing = TO_DEPTH
    if m.surfacing == TO_DEPTH and keel >= params.depth:
        m.surfacing, m.surface_age, m.time_up, m.under_way = NOT_SURFACING, 0.0, 0.0, 0.0
    return 0.0 if m.surfacing == TO_SURFACE else params.depth


@compiled
def _keep_depth(m: Any, params: Any, normal: float) -> None:
    """One sub-step of depth keeping: the vehicle dives when it moves, and surfaces when it is due."""
    dt = params.dt
    keel = m.depth - (m.wobble if m.depth > 0.0 else 0.0)
    wanted = _advance_surfacing(m, keel, params) if m.mode != WAITING else 0.0
    decay = math.exp(-dt / params.wobble_time)
    m.wobble = decay * m.wobble + math.sqrt(1.0 - decay * decay) * params.wobble * normal
    step = params.climb_rate * dt
    at_once = params.ideal_motion > 0.0 and m.surfacing == NOT_SURFACING
    keel = wanted if at_once else keel + min(max(wanted - keel, -step), step)
    m.depth = max(keel + m.wobble, 0.0) if keel > 0.0 else 0.0


@compiled
def _take_velocity(filter: Filter, surge: float, sway: float, variance: float, refused: float) -> float:
    """Updates a filter with a DVL velocity (m/s); returns the number of rejections in a row, `refused` before."""
    gate = GATE
    if refused >= PATIENCE:
        # Outliers are isolated, so the velocity must have changed in a way that the filter does not model.
        gate = 1e9
        filter.p[SURGE, SURGE] += 1.0
        filter.p[SWAY, SWAY] += 1.0
    return 0.0 if update_dvl(filter.x, filter.p, surge, sway, variance, gate) == 2 else refused + 1.0


@compiled
def _take_fix(model: Model, normals: Any) -> None:
    """Updates the filter with a GPS reading.

    Its error is a first-order Gauss-Markov process: e = f e_before + white, f = exp(-age / time). Whitened,
    (z - f (z_before + distance since then)) / (1 - f) measures the position with variance noise^2 (1 + f) / (1 - f),
    and the errors of these measurements are independent.
    """
    m, x, xr, params = model.state, model.estimate.x, model.raw.x, model.params
    ideal = params.gps_ideal > 0.0
    f = 0.0 if ideal or params.gps_time == 0.0 else math.exp(-m.gps_age / params.gps_time)
    noise = 0.0 if ideal else params.gps_noise
    white = noise * math.sqrt(1.0 - f * f)
    m.gps_error_north = f * m.gps_error_north + white * normals.gps_north
    m.gps_error_east = f * m.gps_error_east + white * normals.gps_east
    north, east = m.north + m.gps_error_north, m.east + m.gps_error_east
    reading = max(noise * noise, LEAST_GPS_VARIANCE)
    variance = reading * (1.0 + f) / (1.0 - f)
    if m.mode == PILOTED:  # it may move at the surface without a DVL: then the distance since the last one is uncertain
        p = model.estimate.p
        variance += (f / (1.0 - f) * m.gps_age) ** 2 * (p[SURGE, SURGE] + p[SWAY, SWAY])
    if m.dived > 0.0:
        if m.raw_differs == 0.0:
            m.raw_differs = 1.0
            xr[:] = x
            model.raw.p[:] = model.estimate.p
        first = m.fix_information == 0.0
        g = 0.0 if first else f
        weight = 1.0 / reading if first else 1.0 / variance
        off_north = (north - xr[NORTH] - g * (m.gps_north - m.raw_north_at_gps)) / (1.0 - g)
        off_east = (east - xr[EAST] - g * (m.gps_east - m.raw_east_at_gps)) / (1.0 - g)
        m.fix_information += weight
        m.fix_north += weight * off_north
        m.fix_east += weight * off_east
        m.raw_north_at_gps, m.raw_east_at_gps = xr[NORTH], xr[EAST]
    white_north = (north - f * (m.gps_north + x[NORTH] - m.north_at_gps)) / (1.0 - f)
    white_east = (east - f * (m.gps_east + x[EAST] - m.east_at_gps)) / (1.0 - f)
    update_gps(x, model.estimate.p, white_north, white_east, variance)
    m.gps_north, m.gps_east, m.north_at_gps, m.east_at_gps = north, east, x[NORTH], x[EAST]
    m.gps_age = 0.0


@compiled
def _predict(model: Model, normals: Any) -> None:
    """One sub-step of the gyro and of both filters' prediction."""
    m, params, dt = model.state, model.params, model.params.dt
    gyro = m.yaw_rate
    if params.gyro_ideal == 0.0:
        m.gyro_bias += params.gyro_walk * math.sqrt(dt) * normals.gyro_walk
        gyro += m.gyro_bias + params.gyro_noise / math.sqrt(dt) * normals.gyro
    predict(model.estimate.x, model.estimate.p, gyro, dt, model.noise)
    if m.raw_differs > 0.0:
        predict(model.raw.x, model.raw.p, gyro, dt, model.noise)
    if m.mode != WAITING:
        m.under_way += dt
        if m.under_way < SETTING_OUT * params.speed_time:
            for p in (model.estimate.p, model.raw.p):
                p[SURGE, SURGE] += SETTING_OUT_RATE * dt
                p[SWAY, SWAY] += SETTING_OUT_RATE * dt


@compiled
def _read_compass(model: Model, normals: Any) -> None:
    """One sub-step of the compass."""
    m, params, dt = model.state, model.params, model.params.dt
    m.compass_age += dt
    if params.compass_ideal == 0.0:
        m.compass_bias += params.compass_walk * math.sqrt(dt) * normals.compass_walk
    if m.compass_age < params.compass_interval - 1e-9:
        return
    m.compass_age = 0.0
    noise = params.compass_noise
    reading = m.heading
    if params.compass_ideal == 0.0:
        reading += m.compass_bias + noise * normals.compass
        reading += m.compass_sin * math.sin(m.heading) + m.compass_cos * math.cos(m.heading)
    # An ideal compass is trusted to 0.01 deg, an ideal DVL to 0.1 mm/s, ideal GPS to 1 cm.
    variance = noise * noise if params.compass_ideal == 0.0 else 3e-8
    update_compass(model.estimate.x, model.estimate.p, reading, variance, GATE)
    if m.raw_differs > 0.0:
        update_compass(model.raw.x, model.raw.p, reading, variance, GATE)


@compiled
def _read_dvl(model: Model, normals: Any, uniforms: Any) -> None:
    """One ping of the DVL."""
    m, params = model.state, model.params
    raw_differs = m.raw_differs > 0.0
    if params.dvl_ideal > 0.0:
        update_dvl(model.estimate.x, model.estimate.p, m.surge, m.sway, 1e-8, 1e9)
        if raw_differs:
            update_dvl(model.raw.x, model.raw.p, m.surge, m.sway, 1e-8, 1e9)
        return
    noise = params.dvl_noise
    surge = (1.0 + m.dvl_scale) * m.surge + noise * normals.dvl_surge
    sway = (1.0 + m.dvl_scale) * m.sway + noise * normals.dvl_sway
    if uniforms.outlier < params.dvl_outlier_share:
        surge += params.dvl_outlier * normals.outlier_surge
        sway += params.dvl_outlier * normals.outlier_sway
    m.refused = _take_velocity(model.estimate, surge, sway, noise * noise, m.refused)
    if raw_differs:
        m.refused_raw = _take_velocity(model.raw, surge, sway, noise * noise, m.refused_raw)


@compiled
def _navigate(model: Model, normals: Any, uniforms: Any, ping: bool) -> bool:
    """One sub-step of the instruments and the filters. Returns whether the DVL pings."""
    m, params = model.state, model.params
    ping = ping or params.dvl_ideal > 0.0
    _predict(model, normals)
    _read_compass(model, normals)
    if ping:
        _read_dvl(model, normals, uniforms)
    m.gps_age += params.dt
    if m.mode != WAITING and m.depth > params.gps_depth:
        m.dived = 1.0
    if m.depth <= params.gps_depth and m.gps_age >= params.gps_interval - 1e-9:
        _take_fix(model, normals)
    return ping


@compiled
def _can_ping(m: Any, params: Any, uniforms: Any) -> bool:
    """One sub-step of the DVL's dropouts and lock losses: whether it can ping."""
    if params.dvl_ideal > 0.0:
        return True
    dt = params.dt
    m.dropout -= dt
    m.lock_loss -= dt
    if m.dropout <= 0.0 and uniforms.dropout < params.dropout_rate * dt:
        m.dropout = params.dropout_min + uniforms.dropout_length * (params.dropout_max - params.dropout_min)
    if m.lock_loss <= 0.0 and uniforms.lock_loss < params.lock_loss_rate * dt:
        m.lock_loss = params.lock_loss_min + uniforms.lock_loss_length * (params.lock_loss_max - params.lock_loss_min)
    able: bool = m.dropout <= 0.0 and m.lock_loss <= 0.0
    return able


@compiled
def _write(model: Model, ping: bool, row: Any) -> None:
    """Writes the result of a sub-step to a record `RESULT`."""
    m, x = model.state, model.estimate.x
    raw = model.raw.x if m.raw_differs > 0.0 else x
    row.north, row.east, row.heading, row.depth = m.north, m.east, m.heading, m.depth
    row.est_north, row.est_east, row.est_heading = x[NORTH], x[EAST], x[HEADING]
    row.est_speed = math.hypot(x[SURGE], x[SWAY]) / (1.0 + x[DVL_SCALE])
    row.ping = 1.0 if ping else 0.0
    row.travelled, row.along = m.travelled, m.along
    row.raw_north, row.raw_east, row.raw_heading = raw[NORTH], raw[EAST], raw[HEADING]


@compiled
def sense(model: Model, draws: Draws, in_reach: bool, out: Any, i: int) -> None:
    """Instruments and filters at the end of sub-step `i`; arguments as for `advance`."""
    m, x, params = model.state, model.estimate.x, model.params
    ping = _can_ping(m, params, draws.uniforms[i]) and in_reach
    if params.ideal_navigation > 0.0:
        x[NORTH], x[EAST], x[HEADING] = m.north, m.east, m.heading
        x[SURGE], x[SWAY] = m.surge, m.sway
    else:
        ping = _navigate(model, draws.normals[i], draws.uniforms[i], ping)
        if m.fix_information > 0.0 and m.fix_step == 0.0 and m.depth > params.gps_depth:
            m.fix_step = i + 1.0
    _write(model, ping, out[i])


@compiled
def advance(model: Model, leg: Any, draws: Draws, in_reach: bool, limit: float, out: Any, first: int, last: int) -> int:
    """Sub-steps `first` to `last` of a tick, or until the leg is done.

    Args:
        model: The vehicle's state, filters and parameters; state and filters are changed in place.
        leg: Its present leg, a record `LEG`; not used while waiting.
        draws: Random numbers and currents of the tick's sub-steps.
        in_reach: Whether the bottom is within the DVL's reach.
        limit: Metres along the leg at which to stop.
        out: Records `RESULT` (n,), one of each sub-step, changed in place.
        first: First sub-step.
        last: One after the last.

    Returns:
        Number of the next sub-step.
    """
    m, x, params = model.state, model.estimate.x, model.params
    for i in range(first, last):
        current_north, current_east = draws.currents[i, 0], draws.currents[i, 1]
        if m.surfacing != NOT_SURFACING:
            _hold(m, params, current_north, current_east)
        elif m.mode == ON_RAILS:
            _follow_exactly(m, leg, params, current_north, current_east)
        elif m.mode == STEERED:
            _steer(m, x, leg, params, current_north, current_east)
        else:  # held at the surface until it sets out
            m.yaw_rate, m.speed, m.surge, m.sway = 0.0, 0.0, 0.0, 0.0
        _keep_depth(m, params, draws.normals[i].wobble)
        sense(model, draws, in_reach, out, i)
        if m.mode != WAITING and m.along >= limit - 1e-9:
            return i + 1
    return last
