"""The section `sim` of a mission file: the simulated water, vehicles and instruments."""

from __future__ import annotations

from dataclasses import dataclass, field

from auv_lse_common.mission_file.parameters import parameter
from auv_lse_common.mission_file.sections.world import (
    AltimeterConfig,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationConfig:
    """The estimate of place and heading."""

    ideal: bool = parameter(False, help="true: odometry is the truth, whatever the instruments are")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimConfig:
    """Section `sim`. Each part has `ideal: true` to make it perfect; `ideal: true` here makes all of them perfect."""

    tick_s: float = parameter(1.0, above=0.0, high=10.0, unit="s", help="the engine's time step")
    lockstep: bool = parameter(True, help="time waits for every planner that owes a decision: repeatable, and fast")
    real_time_factor: float = parameter(
        0.0,
        low=0.0,
        high=1000.0,
        help="speed of simulated time against the clock, without lockstep; 0: as the clock. In lockstep time goes as "
        "fast as it can",
    )
    apart: bool = parameter(
        False,
        help="true: the vehicles share no ROS domain with the simulator, only emulated modems and autopilots; it waits "
        "for none of their nodes. Needs lockstep: false, modem.kind: micromodem and link.kind: mavlink",
    )
    shutdown_at_end: bool = parameter(
        False, help="true: sim_node ends when the mission has (the launch file then ends the other nodes)"
    )
    ideal: bool = parameter(False, help="true: perfect vehicles, instruments and water; the channel is not touched")
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
    gps: GpsConfig = field(default_factory=GpsConfig)
    ranging: RangingConfig = field(default_factory=RangingConfig)
    channel: ChannelConfig = field(default_factory=ChannelConfig)

    def __post_init__(self) -> None:
        """Refuses vehicles apart in lockstep.

        Raises:
            ValueError: naming both parameters.
        """
        if self.apart and self.lockstep:
            raise ValueError("apart = true with lockstep = true: expected lockstep: false; ticks go over ROS topics")
