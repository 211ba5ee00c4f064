"""The section `sim` of a mission file: the simulated water, vehicles and instruments."""

from __future__ import annotations

from dataclasses import field, replace

from auv_lse_common.mission_file.parameters import configuration, parameter
from auv_lse_common.mission_file.sections.world import (
    AltimeterConfig,
    AutopilotConfig,
    BathymetryConfig,
    ChannelConfig,
    ChartConfig,
    CompassConfig,
    CurrentConfig,
    DvlConfig,
    DynamicsConfig,
    GpsConfig,
    GyroConfig,
    LakeConfig,
    PressureConfig,
    RangingConfig,
)


@configuration
class NavigationConfig:
    """Navigation: the estimate of position and heading."""

    ideal: bool = parameter(False, help="true: odometry is the truth, whatever the instruments measure")


@configuration
class SimConfig:
    """The simulator. `ideal: true` makes a part perfect; here it makes all parts perfect."""

    tick_s: float = parameter(1.0, low=0.01, high=10.0, unit="s", help="time step of the engine")
    lockstep: bool = parameter(
        True, help="each tick waits for every vehicle's decision: repeatable, and as fast as the machine allows"
    )
    real_time_factor: float = parameter(
        0.0,
        low=0.0,
        high=1000.0,
        help="without lockstep, speed of simulated time relative to the clock; 0: real time",
    )
    apart: bool = parameter(
        False,
        help="true: the vehicles are in other ROS domains and reach the simulator only through emulated modems and"
        " autopilots. Needs lockstep: false, modem.kind: micromodem and link.kind: mavlink",
    )
    shutdown_at_end: bool = parameter(
        False, help="true: sim_node exits when the mission is over, and the launch file then ends the other nodes"
    )
    ideal: bool = parameter(
        False, help="true: perfect vehicles, instruments and water; the acoustic channel is not changed"
    )
    bathymetry: BathymetryConfig = field(default_factory=BathymetryConfig)
    lake: LakeConfig = field(default_factory=LakeConfig)
    chart: ChartConfig = field(default_factory=ChartConfig)
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    current: CurrentConfig = field(default_factory=CurrentConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)
    gyro: GyroConfig = field(default_factory=GyroConfig)
    compass: CompassConfig = field(default_factory=CompassConfig)
    dvl: DvlConfig = field(default_factory=DvlConfig)
    altimeter: AltimeterConfig = field(default_factory=AltimeterConfig)
    pressure: PressureConfig = field(default_factory=PressureConfig)
    autopilot: AutopilotConfig = field(default_factory=AutopilotConfig)
    gps: GpsConfig = field(default_factory=GpsConfig)
    ranging: RangingConfig = field(default_factory=RangingConfig)
    channel: ChannelConfig = field(default_factory=ChannelConfig)

    def in_area(self, polygon_m: tuple[float, ...]) -> SimConfig:
        """The simulator with a lake that fits an area (north, east, north, east, ... of its corners)."""
        return replace(self, lake=self.lake.in_area(polygon_m[::2], polygon_m[1::2]))

    def __post_init__(self) -> None:
        """Rejects separate vehicles in lockstep.

        Raises:
            ValueError: naming both parameters.
        """
        if self.apart and self.lockstep:
            raise ValueError("apart: true needs lockstep: false, because lockstep sends its ticks on ROS topics")
