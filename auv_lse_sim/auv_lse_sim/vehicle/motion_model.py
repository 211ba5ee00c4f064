"""A vehicle's motion along a leg in sub-steps, with its instruments and its filter in the loop.

Ideal vehicles run on rails: they are exactly where the leg says. Others are steered:

    path following   the place `s` along the leg moves on with the vehicle: s' = V cos(course - path) + k_s * ahead
    line of sight    course wanted = path - atan(off / lookahead), heading wanted = that minus the crab angle
    yaw rate wanted  curvature * s' + gain * (heading wanted - heading), limited to the vehicle's largest
    vehicle          rate' = (wanted - rate) / yaw_time, speed' = (wanted - speed) / speed_time,
                     place' = speed (cos h, sin h) + current

A vehicle that surfaces stops where it is, climbs, stays up for fixes, dives, and goes on along its leg; the current
carries it meanwhile.

(Fossen 2011, section 10.3: line-of-sight path following with a moving path reference; off = cross-track distance,
positive to starboard.) Steering knows only the estimated state; the equations move the true one.

Once a fix has come under way the filter runs twice, by the same instruments: with the fixes, which is what the vehicle
steers by, and without any (the raw place). Until then both are the same, and one is reckoned.

Written for numba like `navigation.py`: scalars and flat arrays; all random numbers are drawn beforehand.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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

Array = NDArray[np.float64]

# -- a leg as a flat array
LEG_HEADING, LEG_NORTH, LEG_EAST, LEG_TURN, LEG_RADIUS, LEG_STRAIGHT = range(6)

# -- the vehicle's true state and what it keeps, as a flat array
(
    T_NORTH,
    T_EAST,
    T_HEADING,
    T_RATE,  # rad/s
    T_SPEED,  # through the water, m/s
    T_DEPTH,  # m
    T_SURGE,  # over ground, body frame, m/s
    T_SWAY,
    ALONG,  # m along the leg
    MODE,
    WOBBLE,  # depth keeping error, m
    DROPOUT,  # seconds left without pings
    LOCK_LOSS,  # seconds left without bottom lock
    COMPASS_AGE,  # seconds since the last compass reading
    GPS_AGE,
    B_GYRO,  # true biases
    B_COMPASS,
    B_SCALE,
    SURFACE_AGE,  # seconds since the last surfacing ended
    TRAVELLED,  # m over ground
    UNDER_WAY,  # seconds since it set out, or since it stopped or went on
    REFUSED,  # DVL pings that the filter refused in a row
    REFUSED_RAW,  # the same of the filter without fixes
    H_SIN,  # true harmonics of the compass
    H_COS,
    SURFACING,  # one of NOT_SURFACING, TO_SURFACE, TO_DEPTH
    UP,  # seconds spent at the surface in this surfacing
    DIVED,  # 1 once it has been below the depth of fixes under way: from then on a fix is one under way
    PARTED,  # 1 once the raw place differs from the filter's
    G_NORTH,  # error of the last GPS reading, m
    G_EAST,
    LAST_NORTH,  # that reading, m
    LAST_EAST,
    AT_NORTH,  # the filter's place when it had taken it, m
    AT_EAST,
    RAW_NORTH,  # the raw place then, m
    RAW_EAST,
    FIX_INFORMATION,  # of the mean of this surfacing's readings minus the raw place: inverse variance, 1/m^2 ...
    FIX_NORTH,  # ... and weighted sums
    FIX_EAST,
    FIX_STEP,  # sub-step, from 1, in which a fix was complete; 0: in none
) = range(41)
MEMORY = 41

# -- surfacing
NOT_SURFACING, TO_SURFACE, TO_DEPTH = 0.0, 1.0, 2.0

#: Under way for less than this many time constants of its speed, a vehicle's velocity changes fast.
SETTING_OUT = 5.0
#: Variance per second of the velocity while it does (m^2/s^3).
SETTING_OUT_RATE = 0.3**2
#: After this many refused DVL pings in a row the filter counts as wrong, and takes the next one.
PATIENCE = 8.0

# -- modes
WAITING, ON_RAILS, STEERED = 0.0, 1.0, 2.0

# -- parameters as a flat array
(
    P_DT,
    P_SPEED,  # true speed through the water when commanded
    P_RATE_MAX,
    P_YAW_TIME,
    P_SPEED_TIME,
    P_LOOKAHEAD,
    P_GAIN,
    P_IDEAL_MOTION,
    P_IDEAL_NAVIGATION,
    P_DEPTH,
    P_CLIMB,
    P_WOBBLE,
    P_WOBBLE_TIME,
    P_GYRO_NOISE,  # rad/sqrt(s)
    P_GYRO_WALK,  # rad/s/sqrt(s)
    P_COMPASS_NOISE,
    P_COMPASS_WALK,
    P_COMPASS_INTERVAL,
    P_DVL_NOISE,
    P_DVL_OUTLIER_SHARE,
    P_DVL_OUTLIER,
    P_DROPOUT_RATE,  # 1/s
    P_DROPOUT_MIN,
    P_DROPOUT_MAX,
    P_LOSS_RATE,
    P_LOSS_MIN,
    P_LOSS_MAX,
    P_GPS_NOISE,
    P_GPS_INTERVAL,
    P_GPS_DEPTH,
    P_SURFACE_EVERY,
    P_SURFACE_TIME,
    P_GYRO_IDEAL,
    P_COMPASS_IDEAL,
    P_DVL_IDEAL,
    P_GPS_IDEAL,
    P_GPS_TIME,  # correlation time of its error
) = range(37)
PARAMETERS = 37

# -- columns of the chance drawn for a sub-step
NORMALS = 11
(
    N_GYRO,
    N_COMPASS,
    N_DVL_SURGE,
    N_DVL_SWAY,
    N_GPS_NORTH,
    N_GPS_EAST,
    N_WOBBLE,
    N_GYRO_WALK,
    N_COMPASS_WALK,
    N_OUT_A,
    N_OUT_B,
) = range(NORMALS)
UNIFORMS = 5
U_DROPOUT, U_DROPOUT_LENGTH, U_LOSS, U_LOSS_LENGTH, U_OUTLIER = range(UNIFORMS)

# -- columns of what a sub-step leaves
OUT = 14
(
    O_NORTH,
    O_EAST,
    O_HEADING,
    O_DEPTH,
    O_EST_NORTH,
    O_EST_EAST,
    O_EST_HEADING,
    O_EST_SPEED,
    O_PING,  # 1 if the DVL is able to ping
    O_TRAVELLED,
    O_ALONG,
    O_RAW_NORTH,
    O_RAW_EAST,
    O_RAW_HEADING,
) = range(OUT)


@compiled
def on_leg(leg: Array, along: float) -> tuple[float, float, float, float]:
    """Heading (rad), north, east (m) and curvature (1/m, clockwise) `along` metres along a leg; then straight on."""
    size = abs(leg[LEG_TURN])
    side = 1.0 if leg[LEG_TURN] >= 0.0 else -1.0
    radius = leg[LEG_RADIUS]
    arc = min(max(along, 0.0), radius * size)
    rest = along - arc
    angle = arc / radius
    ahead = radius * math.sin(angle) + rest * math.cos(angle)
    starboard = side * (radius * (1.0 - math.cos(angle)) + rest * math.sin(angle))
    c, s = math.cos(leg[LEG_HEADING]), math.sin(leg[LEG_HEADING])
    curvature = side / radius if 0.0 <= along < radius * size else 0.0
    return (
        wrap(leg[LEG_HEADING] + side * angle),
        leg[LEG_NORTH] + c * ahead - s * starboard,
        leg[LEG_EAST] + s * ahead + c * starboard,
        curvature,
    )


@compiled
def leg_length(leg: Array) -> float:
    """Length (m) of a leg."""
    length: float = abs(leg[LEG_TURN]) * leg[LEG_RADIUS] + leg[LEG_STRAIGHT]
    return length


@compiled
def _rails(m: Array, leg: Array, params: Array, current_north: float, current_east: float) -> None:
    """One sub-step of an ideal vehicle: on the leg, the current compensated by crabbing."""
    dt, speed = params[P_DT], params[P_SPEED]
    path, _, _, _ = on_leg(leg, m[ALONG])
    with_it = current_north * math.cos(path) + current_east * math.sin(path)
    across = -current_north * math.sin(path) + current_east * math.cos(path)
    over_ground = with_it + math.sqrt(max(speed * speed - across * across, 0.0))
    over_ground = max(over_ground, 0.0)
    before = m[T_HEADING]
    m[ALONG] += over_ground * dt
    heading, north, east, _ = on_leg(leg, m[ALONG])
    m[T_NORTH], m[T_EAST], m[T_HEADING] = north, east, heading
    m[T_RATE] = wrap(heading - before) / dt
    m[T_SPEED], m[T_SURGE], m[T_SWAY] = speed, over_ground, 0.0
    m[TRAVELLED] += over_ground * dt


@compiled
def _steer(m: Array, x: Array, leg: Array, params: Array, current_north: float, current_east: float) -> None:
    """One sub-step of a vehicle that is steered by its estimated state `x`."""
    dt = params[P_DT]
    path, north, east, curvature = on_leg(leg, m[ALONG])
    c, s = math.cos(path), math.sin(path)
    dn, de = x[NORTH] - north, x[EAST] - east
    ahead, off = c * dn + s * de, -s * dn + c * de
    over_ground = math.hypot(x[SURGE], x[SWAY])
    crab = math.atan2(x[SWAY], x[SURGE]) if x[SURGE] > 0.3 else 0.0
    course = x[HEADING] + crab
    along_rate = max(over_ground * math.cos(wrap(course - path)) + 0.5 * ahead, 0.0)
    wanted = wrap(path - math.atan(off / params[P_LOOKAHEAD]) - crab - x[HEADING])
    rate = curvature * along_rate + params[P_GAIN] * wanted
    rate = min(max(rate, -params[P_RATE_MAX]), params[P_RATE_MAX])
    if params[P_IDEAL_MOTION] > 0.0:
        m[T_RATE], m[T_SPEED] = rate, params[P_SPEED]
    else:
        m[T_RATE] += (rate - m[T_RATE]) * (1.0 - math.exp(-dt / params[P_YAW_TIME]))
        m[T_SPEED] += (params[P_SPEED] - m[T_SPEED]) * (1.0 - math.exp(-dt / params[P_SPEED_TIME]))
    m[ALONG] += along_rate * dt
    _float(m, current_north, current_east, dt)


@compiled
def _float(m: Array, current_north: float, current_east: float, dt: float) -> None:
    """Moves the true vehicle by its speed through the water, its yaw rate and the current."""
    middle = m[T_HEADING] + 0.5 * m[T_RATE] * dt
    vn = m[T_SPEED] * math.cos(middle) + current_north
    ve = m[T_SPEED] * math.sin(middle) + current_east
    m[T_NORTH] += vn * dt
    m[T_EAST] += ve * dt
    m[T_HEADING] = wrap(m[T_HEADING] + m[T_RATE] * dt)
    c, s = math.cos(m[T_HEADING]), math.sin(m[T_HEADING])
    m[T_SURGE] = m[T_SPEED] + c * current_north + s * current_east
    m[T_SWAY] = -s * current_north + c * current_east
    m[TRAVELLED] += math.hypot(vn, ve) * dt


@compiled
def _hold(m: Array, params: Array, current_north: float, current_east: float) -> None:
    """One sub-step of a vehicle that has stopped; one on rails stays where it is."""
    if m[MODE] == ON_RAILS:
        m[T_RATE], m[T_SPEED], m[T_SURGE], m[T_SWAY] = 0.0, 0.0, 0.0, 0.0
        return
    dt = params[P_DT]
    if params[P_IDEAL_MOTION] > 0.0:
        m[T_RATE], m[T_SPEED] = 0.0, 0.0
    else:
        m[T_RATE] *= math.exp(-dt / params[P_YAW_TIME])
        m[T_SPEED] *= math.exp(-dt / params[P_SPEED_TIME])
    _float(m, current_north, current_east, dt)


@compiled
def _surface(m: Array, keel: float, params: Array) -> float:
    """The depth (m) wanted by a vehicle under way: its own, or none while it surfaces.

    Args:
        m: Its memory.
        keel: Its depth without the error of depth keeping (m).
        params: Parameters.
    """
    dt = params[P_DT]
    if m[SURFACING] == NOT_SURFACING and params[P_SURFACE_EVERY] > 0.0:
        m[SURFACE_AGE] += dt
        if m[SURFACE_AGE] >= params[P_SURFACE_EVERY]:
            m[SURFACING] = TO_SURFACE
            m[UNDER_WAY] = 0.0
    if m[SURFACING] == TO_SURFACE:
        if m[T_DEPTH] <= params[P_GPS_DEPTH]:
            m[UP] += dt
        if m[UP] >= params[P_SURFACE_TIME] - 1e-9:
            m[SURFACING] = TO_DEPTH
    if m[SURFACING] == TO_DEPTH and keel >= params[P_DEPTH]:
        m[SURFACING], m[SURFACE_AGE], m[UP], m[UNDER_WAY] = NOT_SURFACING, 0.0, 0.0, 0.0
    return 0.0 if m[SURFACING] == TO_SURFACE else params[P_DEPTH]


@compiled
def _keep_depth(m: Array, params: Array, normal: float) -> None:
    """One sub-step of depth keeping: the vehicle dives when it moves, and surfaces when it is due."""
    dt = params[P_DT]
    keel = m[T_DEPTH] - (m[WOBBLE] if m[T_DEPTH] > 0.0 else 0.0)
    wanted = _surface(m, keel, params) if m[MODE] != WAITING else 0.0
    decay = math.exp(-dt / params[P_WOBBLE_TIME])
    m[WOBBLE] = decay * m[WOBBLE] + math.sqrt(1.0 - decay * decay) * params[P_WOBBLE] * normal
    step = params[P_CLIMB] * dt
    at_once = params[P_IDEAL_MOTION] > 0.0 and m[SURFACING] == NOT_SURFACING
    keel = wanted if at_once else keel + min(max(wanted - keel, -step), step)
    m[T_DEPTH] = max(keel + m[WOBBLE], 0.0) if keel > 0.0 else 0.0


@compiled
def _velocity(x: Array, p: Array, surge: float, sway: float, variance: float, refused: float) -> float:
    """The filter takes a DVL velocity. Returns how many it has refused in a row, `refused` before this one."""
    gate = GATE
    if refused >= PATIENCE:
        # Outliers do not come in rows: the velocity has changed as the filter did not expect.
        gate = 1e9
        p[SURGE, SURGE] += 1.0
        p[SWAY, SWAY] += 1.0
    return 0.0 if update_dvl(x, p, surge, sway, variance, gate) == 2 else refused + 1.0


@compiled
def _fix(m: Array, x: Array, p: Array, xr: Array, pr: Array, params: Array, normals: Array) -> None:
    """The filter takes a GPS reading.

    Its error is a first-order Gauss-Markov process: e = f e_before + white, f = exp(-age / time). So it is whitened:
    (z - f (z_before + way since then)) / (1 - f) measures the place with variance noise^2 (1 + f) / (1 - f), and errors
    of these are independent.
    """
    ideal = params[P_GPS_IDEAL] > 0.0
    f = 0.0 if ideal or params[P_GPS_TIME] == 0.0 else math.exp(-m[GPS_AGE] / params[P_GPS_TIME])
    noise = 0.0 if ideal else params[P_GPS_NOISE]
    white = noise * math.sqrt(1.0 - f * f)
    m[G_NORTH] = f * m[G_NORTH] + white * normals[N_GPS_NORTH]
    m[G_EAST] = f * m[G_EAST] + white * normals[N_GPS_EAST]
    north, east = m[T_NORTH] + m[G_NORTH], m[T_EAST] + m[G_EAST]
    variance = (1e-4 if ideal else noise * noise) * (1.0 + f) / (1.0 - f)
    if m[DIVED] > 0.0:
        if m[PARTED] == 0.0:
            m[PARTED] = 1.0
            xr[:] = x
            pr[:] = p
        first = m[FIX_INFORMATION] == 0.0
        g = 0.0 if first else f
        weight = 1.0 / (1e-4 if ideal else noise * noise) if first else 1.0 / variance
        off_north = (north - xr[NORTH] - g * (m[LAST_NORTH] - m[RAW_NORTH])) / (1.0 - g)
        off_east = (east - xr[EAST] - g * (m[LAST_EAST] - m[RAW_EAST])) / (1.0 - g)
        m[FIX_INFORMATION] += weight
        m[FIX_NORTH] += weight * off_north
        m[FIX_EAST] += weight * off_east
        m[RAW_NORTH], m[RAW_EAST] = xr[NORTH], xr[EAST]
    white_north = (north - f * (m[LAST_NORTH] + x[NORTH] - m[AT_NORTH])) / (1.0 - f)
    white_east = (east - f * (m[LAST_EAST] + x[EAST] - m[AT_EAST])) / (1.0 - f)
    update_gps(x, p, white_north, white_east, variance)
    m[LAST_NORTH], m[LAST_EAST], m[AT_NORTH], m[AT_EAST] = north, east, x[NORTH], x[EAST]
    m[GPS_AGE] = 0.0


@compiled
def _navigate(
    m: Array,
    x: Array,
    p: Array,
    xr: Array,
    pr: Array,
    params: Array,
    q: Array,
    normals: Array,
    uniforms: Array,
    ping: bool,
) -> bool:
    """One sub-step of the instruments and the filter. Returns whether the DVL pings."""
    dt = params[P_DT]
    parted = m[PARTED] > 0.0
    gyro = m[T_RATE]
    if params[P_GYRO_IDEAL] == 0.0:
        m[B_GYRO] += params[P_GYRO_WALK] * math.sqrt(dt) * normals[N_GYRO_WALK]
        gyro += m[B_GYRO] + params[P_GYRO_NOISE] / math.sqrt(dt) * normals[N_GYRO]
    predict(x, p, gyro, dt, q)
    if parted:
        predict(xr, pr, gyro, dt, q)
    if m[MODE] != WAITING:
        m[UNDER_WAY] += dt
        if m[UNDER_WAY] < SETTING_OUT * params[P_SPEED_TIME]:
            p[SURGE, SURGE] += SETTING_OUT_RATE * dt
            p[SWAY, SWAY] += SETTING_OUT_RATE * dt
            pr[SURGE, SURGE] += SETTING_OUT_RATE * dt
            pr[SWAY, SWAY] += SETTING_OUT_RATE * dt
    m[COMPASS_AGE] += dt
    if params[P_COMPASS_IDEAL] == 0.0:
        m[B_COMPASS] += params[P_COMPASS_WALK] * math.sqrt(dt) * normals[N_COMPASS_WALK]
    if m[COMPASS_AGE] >= params[P_COMPASS_INTERVAL] - 1e-9:
        m[COMPASS_AGE] = 0.0
        noise = params[P_COMPASS_NOISE]
        reading = m[T_HEADING]
        if params[P_COMPASS_IDEAL] == 0.0:
            reading += m[B_COMPASS] + noise * normals[N_COMPASS]
            reading += m[H_SIN] * math.sin(m[T_HEADING]) + m[H_COS] * math.cos(m[T_HEADING])
        # An ideal compass is trusted to 0.01 deg, an ideal DVL to 0.1 mm/s, ideal GPS to 1 cm.
        variance = noise * noise if params[P_COMPASS_IDEAL] == 0.0 else 3e-8
        update_compass(x, p, reading, variance, GATE)
        if parted:
            update_compass(xr, pr, reading, variance, GATE)
    if params[P_DVL_IDEAL] > 0.0:
        ping = True
        update_dvl(x, p, m[T_SURGE], m[T_SWAY], 1e-8, 1e9)
        if parted:
            update_dvl(xr, pr, m[T_SURGE], m[T_SWAY], 1e-8, 1e9)
    elif ping:
        noise = params[P_DVL_NOISE]
        surge = (1.0 + m[B_SCALE]) * m[T_SURGE] + noise * normals[N_DVL_SURGE]
        sway = (1.0 + m[B_SCALE]) * m[T_SWAY] + noise * normals[N_DVL_SWAY]
        if uniforms[U_OUTLIER] < params[P_DVL_OUTLIER_SHARE]:
            surge += params[P_DVL_OUTLIER] * normals[N_OUT_A]
            sway += params[P_DVL_OUTLIER] * normals[N_OUT_B]
        m[REFUSED] = _velocity(x, p, surge, sway, noise * noise, m[REFUSED])
        if parted:
            m[REFUSED_RAW] = _velocity(xr, pr, surge, sway, noise * noise, m[REFUSED_RAW])
    m[GPS_AGE] += dt
    if m[MODE] != WAITING and m[T_DEPTH] > params[P_GPS_DEPTH]:
        m[DIVED] = 1.0
    if m[T_DEPTH] <= params[P_GPS_DEPTH] and m[GPS_AGE] >= params[P_GPS_INTERVAL] - 1e-9:
        _fix(m, x, p, xr, pr, params, normals)
    return ping


@compiled
def _pings(m: Array, params: Array, uniforms: Array) -> bool:
    """One sub-step of the DVL's gaps: whether it pings."""
    if params[P_DVL_IDEAL] > 0.0:
        return True
    dt = params[P_DT]
    m[DROPOUT] -= dt
    m[LOCK_LOSS] -= dt
    if m[DROPOUT] <= 0.0 and uniforms[U_DROPOUT] < params[P_DROPOUT_RATE] * dt:
        m[DROPOUT] = params[P_DROPOUT_MIN] + uniforms[U_DROPOUT_LENGTH] * (
            params[P_DROPOUT_MAX] - params[P_DROPOUT_MIN]
        )
    if m[LOCK_LOSS] <= 0.0 and uniforms[U_LOSS] < params[P_LOSS_RATE] * dt:
        m[LOCK_LOSS] = params[P_LOSS_MIN] + uniforms[U_LOSS_LENGTH] * (params[P_LOSS_MAX] - params[P_LOSS_MIN])
    able: bool = m[DROPOUT] <= 0.0 and m[LOCK_LOSS] <= 0.0
    return able


@compiled
def advance(
    m: Array,
    x: Array,
    p: Array,
    xr: Array,
    pr: Array,
    leg: Array,
    params: Array,
    q: Array,
    normals: Array,
    uniforms: Array,
    currents: Array,
    in_reach: bool,
    limit: float,
    out: Array,
    first: int,
    last: int,
) -> int:
    """Sub-steps `first` to `last` of a tick, or until the leg is done.

    Args:
        m: The vehicle's memory (MEMORY,), changed in place.
        x: Filter state (10,), changed in place.
        p: Filter covariance (10, 10), changed in place.
        xr: State (10,) of the filter that takes no fix under way, changed in place; used once the two differ.
        pr: Its covariance (10, 10), likewise.
        leg: Its present leg (6,); not used while waiting.
        params: Parameters (PARAMETERS,).
        q: The filter's process noise (5,).
        normals: Standard normals (n, NORMALS).
        uniforms: Uniforms in [0, 1) (n, UNIFORMS).
        currents: Current north, east (n, 2), m/s.
        in_reach: Whether the bottom is within the DVL's reach.
        limit: Metres along the leg at which to stop.
        out: Results of each sub-step (n, OUT), changed in place.
        first: First sub-step.
        last: One after the last.

    Returns:
        Number of the next sub-step.
    """
    for i in range(first, last):
        if m[SURFACING] != NOT_SURFACING:
            _hold(m, params, currents[i, 0], currents[i, 1])
        elif m[MODE] == ON_RAILS:
            _rails(m, leg, params, currents[i, 0], currents[i, 1])
        elif m[MODE] == STEERED:
            _steer(m, x, leg, params, currents[i, 0], currents[i, 1])
        else:  # held at the surface until it sets out
            m[T_RATE], m[T_SPEED], m[T_SURGE], m[T_SWAY] = 0.0, 0.0, 0.0, 0.0
        _keep_depth(m, params, normals[i, N_WOBBLE])
        ping = _pings(m, params, uniforms[i]) and in_reach
        if params[P_IDEAL_NAVIGATION] > 0.0:
            x[NORTH], x[EAST], x[HEADING] = m[T_NORTH], m[T_EAST], m[T_HEADING]
            x[SURGE], x[SWAY] = m[T_SURGE], m[T_SWAY]
        else:
            ping = _navigate(m, x, p, xr, pr, params, q, normals[i], uniforms[i], ping)
            if m[FIX_INFORMATION] > 0.0 and m[FIX_STEP] == 0.0 and m[T_DEPTH] > params[P_GPS_DEPTH]:
                m[FIX_STEP] = i + 1.0
        row = out[i]
        row[O_NORTH], row[O_EAST], row[O_HEADING], row[O_DEPTH] = m[T_NORTH], m[T_EAST], m[T_HEADING], m[T_DEPTH]
        row[O_EST_NORTH], row[O_EST_EAST], row[O_EST_HEADING] = x[NORTH], x[EAST], x[HEADING]
        row[O_EST_SPEED] = math.hypot(x[SURGE], x[SWAY]) / (1.0 + x[DVL_SCALE])
        row[O_PING] = 1.0 if ping else 0.0
        row[O_TRAVELLED], row[O_ALONG] = m[TRAVELLED], m[ALONG]
        raw = xr if m[PARTED] > 0.0 else x
        row[O_RAW_NORTH], row[O_RAW_EAST], row[O_RAW_HEADING] = raw[NORTH], raw[EAST], raw[HEADING]
        if m[MODE] != WAITING and m[ALONG] >= limit - 1e-9:
            return i + 1
    return last
