"""Dead reckoning: an error-state Kalman filter over gyro, compass, DVL and (at the surface) GPS.

State (10), in the local tangent plane and the vehicle's body frame:

    NORTH, EAST (m), HEADING (rad), SURGE, SWAY (m/s, as the DVL sees them), GYRO_BIAS (rad/s), COMPASS_BIAS (rad),
    DVL_SCALE, COMPASS_SIN, COMPASS_COS (rad)

Between measurements the heading changes by the gyro rate minus its bias, and the position by the velocity over ground,
which is the DVL velocity without its scale error. Velocity, biases and scale are random walks:

    heading' = gyro - GYRO_BIAS
    north' = (SURGE cos h - SWAY sin h) / (1 + DVL_SCALE),  east' = (SURGE sin h + SWAY cos h) / (1 + DVL_SCALE)

A compass reads HEADING + COMPASS_BIAS + COMPASS_SIN sin h + COMPASS_COS cos h: iron in the vehicle deflects the
field by an angle that depends on the heading. In turns the gyro makes these two observable, but not the bias.

If the velocity over ground were a state instead, DVL measurements (1 + scale) * velocity would be products of two
states. The filter would then wrongly estimate the scale from them, which only fixes can provide, and be overconfident.

The state is at the same time the nominal state and, by its covariance, the error state: after each scalar
measurement the error's estimate is put into the nominal state and starts from 0 again (Groves 2013, sections 14.2
and 16.2: an inertially aided dead-reckoning filter in closed loop). Scalar measurements with residuals above
`GATE` standard deviations are rejected as DVL outliers.

The functions are written for numba, and run as plain Python where it is not installed; both give the same numbers.
"""

import math

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled

NORTH, EAST, HEADING, SURGE, SWAY, GYRO_BIAS, COMPASS_BIAS, DVL_SCALE, COMPASS_SIN, COMPASS_COS = range(10)
STATES = 10
GATE = 4.0  # standard deviations; a normal error exceeds it once in 16 000

# Columns of the noise parameters handed to the filter (variances; rates per second).
HEADING_RATE, VELOCITY_RATE, GYRO_BIAS_RATE, COMPASS_BIAS_RATE, POSITION_RATE = range(5)


@compiled
def wrap(angle: float) -> float:
    """An angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@compiled
def predict(x: Array, p: Array, gyro: float, dt: float, q: Array) -> None:
    """Advances state and covariance by `dt`, in place.

    Args:
        x: State (10,).
        p: Covariance (10, 10).
        gyro: Measured yaw rate (rad/s, clockwise).
        dt: Time step (s).
        q: Process noise: variance per second of heading, velocity, gyro bias, compass bias, position (5,).
    """
    turn = (gyro - x[GYRO_BIAS]) * dt
    c, s = math.cos(x[HEADING] + 0.5 * turn), math.sin(x[HEADING] + 0.5 * turn)  # of the step's middle
    scale = 1.0 + x[DVL_SCALE]
    c, s = c / scale, s / scale
    north_rate = x[SURGE] * c - x[SWAY] * s
    east_rate = x[SURGE] * s + x[SWAY] * c
    north_scale, east_scale = -north_rate / scale, -east_rate / scale
    x[NORTH] += north_rate * dt
    x[EAST] += east_rate * dt
    x[HEADING] = wrap(x[HEADING] + turn)
    # P = F P F', F = I + dt * d(rates)/d(state): rows NORTH, EAST and HEADING only, first from the left ...
    for j in range(STATES):
        north = p[NORTH, j] + dt * (
            -east_rate * p[HEADING, j] + c * p[SURGE, j] - s * p[SWAY, j] + north_scale * p[DVL_SCALE, j]
        )
        east = p[EAST, j] + dt * (
            north_rate * p[HEADING, j] + s * p[SURGE, j] + c * p[SWAY, j] + east_scale * p[DVL_SCALE, j]
        )
        p[NORTH, j], p[EAST, j] = north, east
        p[HEADING, j] -= dt * p[GYRO_BIAS, j]
    # ... then from the right.
    for i in range(STATES):
        north = p[i, NORTH] + dt * (
            -east_rate * p[i, HEADING] + c * p[i, SURGE] - s * p[i, SWAY] + north_scale * p[i, DVL_SCALE]
        )
        east = p[i, EAST] + dt * (
            north_rate * p[i, HEADING] + s * p[i, SURGE] + c * p[i, SWAY] + east_scale * p[i, DVL_SCALE]
        )
        p[i, NORTH], p[i, EAST] = north, east
        p[i, HEADING] -= dt * p[i, GYRO_BIAS]
    p[NORTH, NORTH] += q[POSITION_RATE] * dt
    p[EAST, EAST] += q[POSITION_RATE] * dt
    p[HEADING, HEADING] += q[HEADING_RATE] * dt
    p[SURGE, SURGE] += q[VELOCITY_RATE] * dt
    p[SWAY, SWAY] += q[VELOCITY_RATE] * dt
    p[GYRO_BIAS, GYRO_BIAS] += q[GYRO_BIAS_RATE] * dt
    p[COMPASS_BIAS, COMPASS_BIAS] += q[COMPASS_BIAS_RATE] * dt


@compiled
def update(x: Array, p: Array, h: Array, residual: float, variance: float, gate: float) -> float:
    """Updates state and covariance with one scalar measurement, in place.

    Args:
        x: State (10,).
        p: Covariance (10, 10).
        h: Derivative of the measurement with respect to each state (10,).
        residual: Measurement minus its value predicted from the state.
        variance: Variance of the measurement's noise.
        gate: Standard deviations beyond which the measurement is rejected.

    Returns:
        The normalized innovation squared; the measurement was used if it is at most `gate` squared.
    """
    ph = np.zeros(STATES)
    s = variance
    for i in range(STATES):
        total = 0.0
        for j in range(STATES):
            if h[j] != 0.0:
                total += p[i, j] * h[j]
        ph[i] = total
        s += h[i] * total
    nis = residual * residual / s
    if nis > gate * gate:
        return nis
    for i in range(STATES):
        x[i] += ph[i] / s * residual
    for i in range(STATES):
        for j in range(i, STATES):
            value = p[i, j] - ph[i] * ph[j] / s
            p[i, j] = value
            p[j, i] = value
    x[HEADING] = wrap(x[HEADING])
    return nis


@compiled
def update_dvl(x: Array, p: Array, surge: float, sway: float, variance: float, gate: float) -> int:
    """Uses a DVL velocity (m/s, body frame, with the DVL's scale).

    Returns:
        Number of components that were used.
    """
    taken = 0
    h = np.zeros(STATES)
    h[SURGE] = 1.0
    if update(x, p, h, surge - x[SURGE], variance, gate) <= gate * gate:
        taken += 1
    h[SURGE], h[SWAY] = 0.0, 1.0
    if update(x, p, h, sway - x[SWAY], variance, gate) <= gate * gate:
        taken += 1
    return taken


@compiled
def update_compass(x: Array, p: Array, heading: float, variance: float, gate: float) -> float:
    """Uses a compass heading (rad); returns the normalized innovation squared.

    The harmonics use the reading. With the estimated heading the measurement would be a product of states, whose
    linearization seems to distinguish heading from bias (as with DVL_SCALE).
    """
    h = np.zeros(STATES)
    h[HEADING], h[COMPASS_BIAS], h[COMPASS_SIN], h[COMPASS_COS] = 1.0, 1.0, math.sin(heading), math.cos(heading)
    expected = x[HEADING] + x[COMPASS_BIAS] + x[COMPASS_SIN] * h[COMPASS_SIN] + x[COMPASS_COS] * h[COMPASS_COS]
    nis: float = update(x, p, h, wrap(heading - expected), variance, gate)
    return nis


@compiled
def update_gps(x: Array, p: Array, north: float, east: float, variance: float) -> None:
    """Uses a GPS fix (m) without a gate, because after a long dive the state may be far off."""
    h = np.zeros(STATES)
    h[NORTH] = 1.0
    update(x, p, h, north - x[NORTH], variance, 1e9)
    h[NORTH], h[EAST] = 0.0, 1.0
    update(x, p, h, east - x[EAST], variance, 1e9)
