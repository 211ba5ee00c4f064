"""Parameters of the vehicle's motion, the water it moves in, and its instruments (sections under `sim`)."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.params import parameter

_IDEAL = "true: this part is perfect, whatever the other parameters say"


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicsConfig:
    """How the vehicle follows its legs."""

    ideal: bool = parameter(False, help=_IDEAL + ": exactly on the leg, at its speed")
    turn_rate_max_dps: float = parameter(
        9.0, above=0.0, high=90.0, unit="deg/s", help="largest yaw rate of the vehicle"
    )
    yaw_time_s: float = parameter(0.7, above=0.0, high=10.0, unit="s", help="time constant of the yaw rate")
    speed_time_s: float = parameter(3.0, above=0.0, high=60.0, unit="s", help="time constant of the speed")
    speed_spread: float = parameter(
        0.02, low=0.0, high=0.3, help="standard deviation of a vehicle's true speed about the commanded one, relative"
    )
    lookahead_m: float = parameter(7.0, above=0.0, high=100.0, unit="m", help="line-of-sight guidance: how far ahead")
    heading_gain: float = parameter(0.6, above=0.0, high=5.0, unit="1/s", help="yaw rate commanded per heading error")
    climb_mps: float = parameter(0.3, above=0.0, high=2.0, unit="m/s", help="vertical speed")
    depth_wobble_m: float = parameter(0.05, low=0.0, high=1.0, unit="m", help="standard deviation of depth keeping")
    depth_wobble_time_s: float = parameter(10.0, above=0.0, unit="s", help="correlation time of depth keeping")


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentConfig:
    """The water's motion over ground, the same everywhere: a mean, a tide, and a slow random part."""

    ideal: bool = parameter(False, help=_IDEAL + ": still water")
    north_mps: float = parameter(0.0, low=-3.0, high=3.0, unit="m/s", help="mean current, north")
    east_mps: float = parameter(0.0, low=-3.0, high=3.0, unit="m/s", help="mean current, east")
    tide_mps: float = parameter(0.0, low=0.0, high=3.0, unit="m/s", help="amplitude of the tidal current")
    tide_heading_deg: float = parameter(0.0, low=-360.0, high=360.0, unit="deg", help="where the flood sets to")
    tide_period_s: float = parameter(44_714.0, above=0.0, unit="s", help="period of the tide (M2: 12.42 h)")
    tide_phase_deg: float = parameter(0.0, low=-360.0, high=360.0, unit="deg", help="phase at the mission's start")
    random_mps: float = parameter(0.02, low=0.0, high=1.0, unit="m/s", help="standard deviation of the random part")
    random_time_s: float = parameter(300.0, above=0.0, unit="s", help="its correlation time")


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroConfig:
    """Vertical gyro."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_deg_rth: float = parameter(0.15, low=0.0, unit="deg/sqrt(h)", help="angle random walk")
    bias_deg_h: float = parameter(5.0, low=0.0, unit="deg/h", help="standard deviation of the bias from run to run")
    bias_walk_deg_h_rth: float = parameter(1.0, low=0.0, unit="deg/h/sqrt(h)", help="random walk of the bias")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassConfig:
    """Heading reference (magnetic compass or AHRS), misalignment to the DVL included."""

    ideal: bool = parameter(False, help=_IDEAL)
    bias_deg: float = parameter(1.0, low=0.0, unit="deg", help="standard deviation of the heading bias from run to run")
    bias_walk_deg_rth: float = parameter(0.3, low=0.0, unit="deg/sqrt(h)", help="random walk of the heading bias")
    noise_deg: float = parameter(0.5, low=0.0, unit="deg", help="standard deviation of one reading")
    interval_s: float = parameter(1.0, above=0.0, unit="s", help="time between readings")


@dataclass(frozen=True, slots=True, kw_only=True)
class DvlConfig:
    """Doppler velocity log in bottom track; altitude comes from the same pings."""

    ideal: bool = parameter(False, help=_IDEAL + ": exact velocities, never a ping lost")
    rate_hz: float = parameter(10.0, low=1.0, high=20.0, unit="Hz", help="pings per second; also the filter's rate")
    scale: float = parameter(0.003, low=0.0, high=0.1, help="standard deviation of the scale error from run to run")
    noise_mps: float = parameter(0.01, low=0.0, unit="m/s", help="standard deviation of one velocity, each axis")
    outlier_share: float = parameter(0.001, low=0.0, high=0.5, help="share of pings whose velocity is wrong")
    outlier_mps: float = parameter(0.5, low=0.0, unit="m/s", help="standard deviation of a wrong velocity's error")
    dropouts_per_h: float = parameter(30.0, low=0.0, unit="1/h", help="short gaps without pings")
    dropout_min_s: float = parameter(0.5, low=0.0, unit="s", help="shortest of them")
    dropout_max_s: float = parameter(2.0, low=0.0, unit="s", help="longest of them")
    lock_losses_per_h: float = parameter(2.0, low=0.0, unit="1/h", help="losses of the bottom")
    lock_loss_min_s: float = parameter(5.0, low=0.0, unit="s", help="shortest of them")
    lock_loss_max_s: float = parameter(20.0, low=0.0, unit="s", help="longest of them")
    min_altitude_m: float = parameter(0.3, low=0.0, unit="m", help="nearer to the bottom there is no ping")
    max_altitude_m: float = parameter(60.0, above=0.0, unit="m", help="farther from the bottom there is no ping")

    def __post_init__(self) -> None:
        """Refuses intervals out of order."""
        for name in ("dropout", "lock_loss"):
            low, high = getattr(self, f"{name}_min_s"), getattr(self, f"{name}_max_s")
            if low > high:
                raise ValueError(f"dvl: {name}_min_s {low:g} > {name}_max_s {high:g}")
        if self.max_altitude_m <= self.min_altitude_m:
            raise ValueError(
                f"dvl: max_altitude_m {self.max_altitude_m:g} <= min_altitude_m {self.min_altitude_m:g}: never a ping; "
                "expected a farthest distance to the bottom beyond the nearest"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class AltimeterConfig:
    """Altitude of a ping, and how pings become soundings."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(0.012, low=0.0, unit="m", help="standard deviation of one altitude")
    outlier_share: float = parameter(0.002, low=0.0, high=0.5, help="share of pings with a wrong altitude")
    outlier_m: float = parameter(4.0, low=0.0, unit="m", help="mean size of a wrong altitude's error (fish, multipath)")
    sounding_every_s: float = parameter(
        1.0, low=0.0, unit="s", help="one sounding: the median of the pings in this time; 0: every ping is a sounding"
    )
    least_pings: int = parameter(3, low=1, help="fewer pings than this in that time give no sounding")


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureConfig:
    """The vehicle's own depth from pressure."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(0.01, low=0.0, unit="m", help="standard deviation of one reading")
    bias_m: float = parameter(0.03, low=0.0, unit="m", help="standard deviation of the offset from run to run")


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsConfig:
    """Position fixes, which exist at the surface only."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(1.0, low=0.0, unit="m", help="standard deviation of a fix, each axis")
    interval_s: float = parameter(1.0, above=0.0, unit="s", help="time between fixes")
    antenna_m: float = parameter(0.3, low=0.0, unit="m", help="fixes come when the vehicle is shallower than this")
    surface_every_s: float = parameter(
        0.0, low=0.0, unit="s", help="time under way, and after each surfacing, to the next climb for fixes; 0: never"
    )
    surface_s: float = parameter(30.0, above=0.0, unit="s", help="how long it then stays shallower than antenna_m")
