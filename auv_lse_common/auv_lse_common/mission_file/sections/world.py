"""Parameters of the simulated world: ground, water, motion, instruments, channel (the sections under `sim`)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import parameter
from auv_lse_common.vocabulary.extent import Extent

_IDEAL = "true: this part is perfect, whatever the other parameters say"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartConfig:
    """A coarse chart of the ground that the team has before the mission, as the prior mean of its map (`gp.mean`)."""

    smoothing_m: float = parameter(
        0.0, low=0.0, high=10e3, unit="m", help="standard deviation of the weights that smooth the truth; 0: no chart"
    )
    error_m: float = parameter(2.5, low=0.0, high=100.0, unit="m", help="standard deviation of the chart's errors")
    error_length_m: float = parameter(
        75.0, above=0.0, high=10e3, unit="m", help="the same for the weights that smooth its errors"
    )


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
    harmonic_deg: float = parameter(
        1.0,
        low=0.0,
        unit="deg",
        help="the error depends on the heading h, a sin h + b cos h: standard deviation of a and of b from run to run",
    )
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
    noise_m: float = parameter(1.0, low=0.0, unit="m", help="standard deviation of a reading, each axis")
    correlation_s: float = parameter(
        20.0, low=0.0, unit="s", help="correlation time of its error; 0: readings are independent"
    )
    interval_s: float = parameter(1.0, above=0.0, unit="s", help="time between readings")
    antenna_m: float = parameter(0.3, low=0.0, unit="m", help="readings come when the vehicle is shallower than this")
    surface_every_s: float = parameter(
        0.0, low=0.0, unit="s", help="time under way, and after each surfacing, to the next one; 0: only planned ones"
    )
    surface_s: float = parameter(
        30.0,
        above=0.0,
        unit="s",
        help="how long it stays shallower than antenna_m; it stops from the climb to the dive",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RangingConfig:
    """Travel times of packets, as the modems' clocks measure them."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_s: float = parameter(0.5e-3, low=0.0, unit="s", help="standard deviation of one travel time")
    echo_share: float = parameter(0.02, low=0.0, high=1.0, help="share of packets of which an echo is timed")
    echo_s: float = parameter(0.02, low=0.0, unit="s", help="mean time by which an echo is late, exponential")
    clock_offset_s: float = parameter(
        1e-3, low=0.0, unit="s", help="standard deviation of a vehicle's clock at the start"
    )
    clock_drift_ppm: float = parameter(1.0, low=0.0, unit="ppm", help="standard deviation of a clock's rate")
    sound_speed_error: float = parameter(
        0.003, low=0.0, high=0.1, help="standard deviation of the true speed of sound about the channel's, relative"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class BathymetryConfig:
    """Where the ground comes from, and how a file is read."""

    file: str = parameter("", help="CSV of soundings, npz grid, ESRI ASCII grid (.asc), GeoTIFF; '' for the lake")
    resolution_m: float = parameter(5.0, above=0.0, high=500.0, unit="m", help="node spacing soundings are gridded to")
    max_gap_m: float = parameter(
        60.0, above=0.0, unit="m", help="ground farther than this from the nearest sounding is unknown"
    )
    smoothing_m: float = parameter(5.0, low=0.0, unit="m", help="Gaussian smoothing of gridded soundings, 0 for none")
    depth_sign: str = parameter("auto", choices=("auto", "down", "up"), help="direction in which depth values grow")
    water_level_m: float | None = parameter(
        None,
        low=-1000.0,
        high=9000.0,
        unit="m",
        help="elevation of the water surface in the file's datum: depth = water_level_m - elevation; left out: 0; "
        "given, a raster is taken as elevations, and depths are refused",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LakeConfig:
    """The synthetic lake family: a drowned river valley with side valleys (inlets), knolls (islands), roughness."""

    seed: int = parameter(-1, low=-1, help="which lake of the family; -1 takes the mission's seed")
    deepest_m: float = parameter(35.0, above=0.0, high=1000.0, unit="m", help="depth the valley floor tends to")
    terrace_m: float = parameter(
        10.0, low=0.0, unit="m", help="depth the old flood plain inside the window tends to; 0 lets islands emerge"
    )
    level_m: float = parameter(15.0, above=0.0, unit="m", help="depth whose contour the lake is designed for")
    deep_share_low: float = parameter(0.4, above=0.0, high=0.75, help="least share of the window deeper than level_m")
    deep_share_high: float = parameter(0.6, low=0.25, high=0.95, help="largest share of the window deeper than it")
    islands: int = parameter(2, low=0, high=8, help="knolls rising from the valley; at least one closed contour if > 0")
    inlets: int = parameter(4, low=0, high=12, help="side valleys")
    steepness: float = parameter(1.0, above=0.0, high=10.0, help="slopes relative to the default lake's")
    roughness_m: float = parameter(0.7, low=0.0, high=5.0, unit="m", help="standard deviation of the small relief")
    roughness_scale_m: float = parameter(60.0, low=5.0, unit="m", help="length scale of the small relief")
    north_m: float = parameter(250.0, unit="m", help="middle of the window, north")
    east_m: float = parameter(300.0, unit="m", help="middle of the window, east")
    height_m: float = parameter(600.0, low=100.0, unit="m", help="the window's length from south to north")
    width_m: float = parameter(700.0, low=100.0, unit="m", help="the window's length from west to east")
    shore_m: float = parameter(150.0, low=20.0, unit="m", help="width of the banks around the window, up to land")

    def __post_init__(self) -> None:
        """Refuses depths out of order."""
        if not self.terrace_m < self.level_m < self.deepest_m:
            raise ValueError(
                f"lake: terrace_m {self.terrace_m:g}, level_m {self.level_m:g}, deepest_m {self.deepest_m:g}: "
                "expected terrace_m < level_m < deepest_m"
            )
        if self.deep_share_low > self.deep_share_high:
            raise ValueError(f"lake: deep_share_low {self.deep_share_low:g} > deep_share_high {self.deep_share_high:g}")

    @property
    def window(self) -> Extent:
        """The rectangle the lake is designed for."""
        return Extent(
            north_min_m=self.north_m - self.height_m / 2.0,
            north_max_m=self.north_m + self.height_m / 2.0,
            east_min_m=self.east_m - self.width_m / 2.0,
            east_max_m=self.east_m + self.width_m / 2.0,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelConfig:
    """Section `sim.channel`: the water between the modems. Each effect has a value that switches it off (ideal)."""

    ideal: bool = parameter(
        False,
        help="true: every packet is read by all, at the end of its transmission, but for packet_loss and blackouts",
    )
    rate: int = parameter(4, low=0, high=5, help="Micromodem packet rate; 3 to 5 hold a 252-byte packet")
    overhead_s: float = parameter(
        0.45, unit="s", low=0.0, high=10.0, help="preamble and header of a transmission, before its data"
    )
    delay: bool = parameter(True, help="sound takes range / sound_speed_mps; false: it is there at once (ideal)")
    sound_speed_mps: float = parameter(1500.0, unit="m/s", low=1300.0, high=1700.0, help="speed of sound")
    spreading: str = parameter(
        "practical",
        choices=("spherical", "practical", "none"),
        help="spreading loss: 20 log10 R, 15 log10 R (shallow water), or none (ideal)",
    )
    absorption: str = parameter(
        "thorp",
        choices=("thorp", "fresh", "none"),
        help="absorption: Thorp's formula for the sea, its terms without salts for a lake, or none (ideal)",
    )
    frequency_khz: float = parameter(25.0, unit="kHz", low=1.0, high=100.0, help="carrier frequency")
    bandwidth_khz: float = parameter(4.0, unit="kHz", above=0.0, high=100.0, help="bandwidth")
    source_level_db: float = parameter(
        185.0, unit="dB re 1 uPa @ 1 m", low=100.0, high=220.0, help="level of a transmission 1 m from its source"
    )
    noise_level_db: float = parameter(
        70.0, unit="dB re 1 uPa^2/Hz", low=0.0, high=150.0, help="ambient and own noise per hertz at the carrier"
    )
    fading_db: float = parameter(
        4.0,
        unit="dB",
        low=0.0,
        high=30.0,
        help="standard deviation of the level from one reception to the next (multipath); 0: none (ideal)",
    )
    frame_errors: bool = parameter(
        True, help="frames are lost by the curve of the rate; false: any ratio is enough (ideal)"
    )
    half_duplex: bool = parameter(True, help="a vehicle that sends is deaf; false: it hears nevertheless (ideal)")
    interference: bool = parameter(
        True, help="other sound that arrives at the same time counts as noise; false: it does not (ideal)"
    )
    packet_loss: float = parameter(
        0.0, low=0.0, high=1.0, help="chance that a reception is lost whatever its level, on top of the rest"
    )
    land_blocks: bool = parameter(True, help="a link with land in between is cut; false: sound goes through (ideal)")
    blackouts: tuple[float, ...] = parameter(
        (),
        help="scheduled loss of links, four numbers each: vehicle, vehicle (0: any), from (s), until (s); both ways",
    )

    def __post_init__(self) -> None:
        """Checks the blackouts.

        Raises:
            ValueError: naming the entry that is wrong.
        """
        if len(self.blackouts) % 4:
            raise ValueError(f"blackouts has {len(self.blackouts)} numbers; expected four each: a, b, from_s, until_s")
        for a, b, start, end in self.outages:
            if a != int(a) or b != int(b) or min(a, b) < 0 or not start <= end:
                raise ValueError(f"blackouts: {(a, b, start, end)}; expected two vehicle numbers, from_s <= until_s")

    @property
    def in_force(self) -> ChannelConfig:
        """These settings with every effect of the physics made ideal if `ideal`."""
        if not self.ideal:
            return self
        return dataclasses.replace(
            self,
            delay=False,
            spreading="none",
            absorption="none",
            fading_db=0.0,
            frame_errors=False,
            half_duplex=False,
            interference=False,
            land_blocks=False,
        )

    @property
    def outages(self) -> list[tuple[float, float, float, float]]:
        """The scheduled blackouts: vehicle, vehicle, from (s), until (s)."""
        flat = self.blackouts
        return [(flat[i], flat[i + 1], flat[i + 2], flat[i + 3]) for i in range(0, len(flat), 4)]
