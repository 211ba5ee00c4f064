"""What a simulated autopilot measures and estimates of its vehicle's state; needs no pymavlink."""

import math
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.world import AutopilotConfig
from auv_lse_common.vocabulary.water import MEAN_LATITUDE_DEG, gauge_pressure_pa
from auv_lse_sim.world import VehicleOutput

#: Standard air pressure (Pa).
AIR_PA = 101325.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The autopilot's estimate of its vehicle's state.

    Attributes:
        heading_rad: Clockwise from north.
        north_m: North of the mission's origin.
        east_m: East of it.
        depth_m: Below the surface, positive down.
        speed_mps: Over ground.
        drift_rad: Direction of travel minus the heading, positive to starboard.
        climb_mps: Rate of ascent.
        yaw_rate_radps: Positive to starboard.
        altitude_m: Height over ground; NaN: no ground seen.
        pressure_pa: Absolute pressure of the water.
        gps_m: North, east of the mission's origin by GPS; None: it has no fix, as under water.
        gps_std_m: Standard deviation of that, each axis.
    """

    heading_rad: float
    north_m: float
    east_m: float
    depth_m: float
    speed_mps: float = 0.0
    drift_rad: float = 0.0
    climb_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    altitude_m: float = math.nan
    pressure_pa: float = AIR_PA
    gps_m: tuple[float, float] | None = None
    gps_std_m: float = 1.0


def autopilot_of(sim: SimConfig) -> AutopilotConfig:
    """The autopilots' imperfections that are in force."""
    if not (sim.ideal or sim.autopilot.ideal):
        return sim.autopilot
    return AutopilotConfig(
        origin_height_m=0.0,
        air_pressure_hpa=AIR_PA / 100.0,
        air_change_hpa_h=0.0,
        barometer_offset_hpa=0.0,
        barometer_drift_hpa_h=0.0,
    )


def measured_pressure_pa(config: AutopilotConfig, passed_s: float, depth_m: float, latitude_deg: float | None) -> float:
    """Pressure (Pa) that a barometer measures at a depth (m), `passed_s` after the start; latitude None: unknown."""
    drift_hpa = (config.air_change_hpa_h + config.barometer_drift_hpa_h) * passed_s / 3600.0
    at_surface_pa = 100.0 * (config.air_pressure_hpa + config.barometer_offset_hpa + drift_hpa)
    latitude_deg = MEAN_LATITUDE_DEG if latitude_deg is None else latitude_deg
    return at_surface_pa + gauge_pressure_pa(depth_m, config.water_density_kgpm3, latitude_deg)


def report_of(output: VehicleOutput, gps_std_m: float, pressure_pa: float) -> Report:
    """The state that a vehicle's autopilot reports after a tick.

    Args:
        gps_std_m: Accuracy of GPS (m).
        pressure_pa: Pressure that its barometer measures (Pa).
    """
    estimate = output.odometry
    return Report(
        heading_rad=estimate.heading_rad,
        north_m=estimate.north_m,
        east_m=estimate.east_m,
        depth_m=output.pressure_depth_m,
        speed_mps=estimate.speed_mps,
        drift_rad=estimate.drift_rad,
        altitude_m=output.altitude_m,
        pressure_pa=pressure_pa,
        gps_m=output.gps_m,
        gps_std_m=gps_std_m,
    )
