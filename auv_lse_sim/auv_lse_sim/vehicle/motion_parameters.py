"""The compiled motion model as a mission file describes it: parameters, true errors, and the filters' start."""

import math
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_sim.vehicle.motion_model import WAITING
from auv_lse_sim.vehicle.navigation import (
    COMPASS_BIAS,
    COMPASS_COS,
    COMPASS_SIN,
    DVL_SCALE,
    EAST,
    GYRO_BIAS,
    HEADING,
    NORTH,
    STATES,
    SURGE,
    SWAY,
    wrap,
)
from auv_lse_sim.vehicle.records import PARAMETERS, STATE, Filter, Model, new_record

DEG = math.pi / 180.0


def motion_parameters(vehicle: VehicleConfig, sim: SimConfig, speed_mps: float) -> Any:
    """The record `PARAMETERS` of the motion model, in SI units and radians.

    Args:
        vehicle: Depth of the vehicle.
        sim: Its dynamics and instruments.
        speed_mps: Its speed through the water.
    """
    d, g, c, v, s = sim.dynamics, sim.gyro, sim.compass, sim.dvl, sim.gps
    hour = 3600.0
    p = new_record(PARAMETERS)
    p.dt = 1.0 / v.rate_hz
    p.speed = speed_mps
    p.yaw_rate_max = d.turn_rate_max_dps * DEG
    p.yaw_time, p.speed_time = d.yaw_time_s, d.speed_time_s
    p.lookahead, p.gain = d.lookahead_m, d.heading_gain
    p.ideal_motion = float(d.ideal or sim.ideal)
    p.ideal_navigation = float(sim.navigation.ideal or sim.ideal)
    p.depth, p.climb_rate = vehicle.depth_m, d.climb_mps
    p.wobble = 0.0 if d.ideal or sim.ideal else d.depth_wobble_m
    p.wobble_time = d.depth_wobble_time_s
    p.gyro_noise = g.noise_deg_rth * DEG / math.sqrt(hour)
    p.gyro_walk = g.bias_walk_deg_h_rth * DEG / hour / math.sqrt(hour)
    p.compass_noise = c.noise_deg * DEG
    p.compass_walk = c.bias_walk_deg_rth * DEG / math.sqrt(hour)
    p.compass_interval = c.interval_s
    p.dvl_noise = v.noise_mps
    p.dvl_outlier_share, p.dvl_outlier = v.outlier_share, v.outlier_mps
    p.dropout_rate = v.dropouts_per_h / hour
    p.dropout_min, p.dropout_max = v.dropout_min_s, v.dropout_max_s
    p.lock_loss_rate = v.lock_losses_per_h / hour
    p.lock_loss_min, p.lock_loss_max = v.lock_loss_min_s, v.lock_loss_max_s
    p.gps_noise, p.gps_interval, p.gps_depth = s.noise_m, s.interval_s, s.antenna_m
    p.gps_time = s.correlation_s
    p.surface_every, p.surface_time = s.surface_every_s, s.surface_s
    p.gyro_ideal, p.compass_ideal = float(g.ideal or sim.ideal), float(c.ideal or sim.ideal)
    p.dvl_ideal, p.gps_ideal = float(v.ideal or sim.ideal), float(s.ideal or sim.ideal)
    return p


def process_noise(parameters: Any) -> Array:
    """Variances per second (5,) of the filter's heading, velocity, and biases of gyro, compass and DVL.

    Args:
        parameters: Of `motion_parameters`.
    """
    p = parameters
    gyro = 0.0 if p.gyro_ideal else p.gyro_noise**2
    gyro_walk = 0.0 if p.gyro_ideal else p.gyro_walk**2
    compass_walk = 0.0 if p.compass_ideal else p.compass_walk**2
    # Velocity: speed keeping, and the current's change of side in a turn. Position: the sub-step's arc taken for its
    # chord. Heading: the same of the turn.
    return np.array([gyro + 1e-10, 0.02**2, gyro_walk, compass_walk, 1e-6])


def speed_share(sim: SimConfig, draws: Array) -> float:
    """True speed through the water as a share of the commanded one; `draws` as for `initial_model`."""
    spread = 0.0 if sim.dynamics.ideal or sim.ideal else sim.dynamics.speed_spread
    return max(1.0 + spread * float(draws[0]), 0.2)


def initial_model(vehicle: VehicleConfig, sim: SimConfig, rng: np.random.Generator, draws: Array) -> Model:
    """The motion model of a vehicle that waits at its start, with this run's true instrument errors.

    Args:
        vehicle: Its start, depth and speed.
        sim: Its dynamics and instruments.
        rng: Source of the compass harmonics.
        draws: Standard normals (8,): speed, gyro bias, compass bias, DVL scale, unused, GPS north, GPS east, heading.
            Their count does not depend on what is ideal, so that later draws stay the same.
    """
    ideal = sim.ideal
    params = motion_parameters(vehicle, sim, vehicle.speed_mps * speed_share(sim, draws))
    gyro_bias = 0.0 if sim.gyro.ideal or ideal else sim.gyro.bias_deg_h * DEG / 3600.0
    compass_bias = 0.0 if sim.compass.ideal or ideal else sim.compass.bias_deg * DEG
    harmonic = 0.0 if sim.compass.ideal or ideal else sim.compass.harmonic_deg * DEG
    scale = 0.0 if sim.dvl.ideal or ideal else sim.dvl.scale
    gps = 0.01 if sim.gps.ideal or ideal else sim.gps.noise_m

    m, x = new_record(STATE), np.zeros(STATES)
    m.mode = WAITING
    m.north, m.east = vehicle.start_north_m, vehicle.start_east_m
    m.heading = wrap(vehicle.start_heading_rad)
    m.gyro_bias, m.compass_bias, m.dvl_scale = np.array([gyro_bias, compass_bias, scale]) * draws[1:4]
    m.compass_sin, m.compass_cos = harmonic * rng.standard_normal(2)
    m.gps_error_north, m.gps_error_east = gps * draws[5:7]
    heading_std = max(math.hypot(compass_bias, harmonic), 0.2 * DEG)
    x[NORTH], x[EAST] = m.north + m.gps_error_north, m.east + m.gps_error_east
    x[HEADING] = wrap(m.heading + heading_std * draws[7])
    m.gps_north, m.gps_east = m.north_at_gps, m.east_at_gps = x[[NORTH, EAST]]
    std = np.zeros(STATES)
    std[[NORTH, EAST, HEADING, SURGE, SWAY]] = max(gps, 0.01), max(gps, 0.01), heading_std, 0.01, 0.01
    std[[GYRO_BIAS, COMPASS_BIAS, DVL_SCALE, COMPASS_SIN, COMPASS_COS]] = (
        gyro_bias, compass_bias, scale, harmonic, harmonic,
    )  # fmt: skip
    p = np.diag(std * std)
    if params.ideal_navigation:
        x[:3] = m.north, m.east, m.heading
        p[:] = 0.0
    return Model(m, Filter(x, p), Filter(x.copy(), p.copy()), params, process_noise(params))
