"""The parameters of the compiled motion model, from those of a mission file."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_sim.vehicle import motion_model as mm

Array = NDArray[np.float64]

DEG = math.pi / 180.0


def motion_parameters(vehicle: VehicleConfig, sim: SimConfig, speed_mps: float) -> Array:
    """The parameters (mm.PARAMETERS,) of `motion_model.advance`, in SI units and radians.

    Args:
        vehicle: Depth of the vehicle.
        sim: Its dynamics and instruments.
        speed_mps: Its speed through the water.
    """
    d, g, c, v, s = sim.dynamics, sim.gyro, sim.compass, sim.dvl, sim.gps
    hour = 3600.0
    p = np.zeros(mm.PARAMETERS)
    p[mm.P_DT] = 1.0 / v.rate_hz
    p[mm.P_SPEED] = speed_mps
    p[mm.P_RATE_MAX] = d.turn_rate_max_dps * DEG
    p[mm.P_YAW_TIME], p[mm.P_SPEED_TIME] = d.yaw_time_s, d.speed_time_s
    p[mm.P_LOOKAHEAD], p[mm.P_GAIN] = d.lookahead_m, d.heading_gain
    p[mm.P_IDEAL_MOTION] = float(d.ideal or sim.ideal)
    p[mm.P_IDEAL_NAVIGATION] = float(sim.navigation.ideal or sim.ideal)
    p[mm.P_DEPTH], p[mm.P_CLIMB] = vehicle.depth_m, d.climb_mps
    p[mm.P_WOBBLE] = 0.0 if d.ideal or sim.ideal else d.depth_wobble_m
    p[mm.P_WOBBLE_TIME] = d.depth_wobble_time_s
    p[mm.P_GYRO_NOISE] = g.noise_deg_rth * DEG / math.sqrt(hour)
    p[mm.P_GYRO_WALK] = g.bias_walk_deg_h_rth * DEG / hour / math.sqrt(hour)
    p[mm.P_COMPASS_NOISE] = c.noise_deg * DEG
    p[mm.P_COMPASS_WALK] = c.bias_walk_deg_rth * DEG / math.sqrt(hour)
    p[mm.P_COMPASS_INTERVAL] = c.interval_s
    p[mm.P_DVL_NOISE] = v.noise_mps
    p[mm.P_DVL_OUTLIER_SHARE], p[mm.P_DVL_OUTLIER] = v.outlier_share, v.outlier_mps
    p[mm.P_DROPOUT_RATE] = v.dropouts_per_h / hour
    p[mm.P_DROPOUT_MIN], p[mm.P_DROPOUT_MAX] = v.dropout_min_s, v.dropout_max_s
    p[mm.P_LOSS_RATE] = v.lock_losses_per_h / hour
    p[mm.P_LOSS_MIN], p[mm.P_LOSS_MAX] = v.lock_loss_min_s, v.lock_loss_max_s
    p[mm.P_GPS_NOISE], p[mm.P_GPS_INTERVAL], p[mm.P_GPS_DEPTH] = s.noise_m, s.interval_s, s.antenna_m
    p[mm.P_GPS_TIME] = s.correlation_s
    p[mm.P_SURFACE_EVERY], p[mm.P_SURFACE_TIME] = s.surface_every_s, s.surface_s
    p[mm.P_GYRO_IDEAL], p[mm.P_COMPASS_IDEAL] = float(g.ideal or sim.ideal), float(c.ideal or sim.ideal)
    p[mm.P_DVL_IDEAL], p[mm.P_GPS_IDEAL] = float(v.ideal or sim.ideal), float(s.ideal or sim.ideal)
    return p


def process_noise(parameters: Array) -> Array:
    """Variances per second (5,) of the filter's heading, velocity, and biases of gyro, compass and DVL.

    Args:
        parameters: Of `motion_parameters`.
    """
    p = parameters
    gyro = 0.0 if p[mm.P_GYRO_IDEAL] else p[mm.P_GYRO_NOISE] ** 2
    gyro_walk = 0.0 if p[mm.P_GYRO_IDEAL] else p[mm.P_GYRO_WALK] ** 2
    compass_walk = 0.0 if p[mm.P_COMPASS_IDEAL] else p[mm.P_COMPASS_WALK] ** 2
    # Velocity: speed keeping, and the current's change of side in a turn. Place: the sub-step's arc taken for its
    # chord. Heading: the same of the turn.
    return np.array([gyro + 1e-10, 0.02**2, gyro_walk, compass_walk, 1e-6])
