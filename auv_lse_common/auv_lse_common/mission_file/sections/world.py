"""The groups of the section `sim`: ground, water, motion, instruments, acoustic channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from auv_lse_common.mission_file.parameters import configuration, parameter
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.sounding import DEEPEST_M

_IDEAL = "true: this part is perfect, whatever its other parameters"


@configuration
class ChartConfig:
    """A coarse chart of the ground, known before the mission: the prior mean of the map (`gp.mean`)."""

    smoothing_m: float = parameter(
        0.0,
        low=0.0,
        high=10e3,
        unit="m",
        help="standard deviation of the weights that smooth the true ground into the chart; 0: no chart",
    )
    error_m: float = parameter(2.5, low=0.0, high=100.0, unit="m", help="standard deviation of the chart's errors")
    error_length_m: float = parameter(
        75.0, above=0.0, high=10e3, unit="m", help="standard deviation of the weights that smooth its errors"
    )


@configuration
class DynamicsConfig:
    """Motion of the vehicle along its legs."""

    ideal: bool = parameter(False, help=_IDEAL + ": exactly on the leg, at its speed")
    turn_rate_max_dps: float = parameter(9.0, above=0.0, high=90.0, unit="deg/s", help="largest yaw rate")
    yaw_time_s: float = parameter(0.7, above=0.0, high=10.0, unit="s", help="time constant of the yaw rate")
    speed_time_s: float = parameter(3.0, above=0.0, high=60.0, unit="s", help="time constant of the speed")
    speed_spread: float = parameter(
        0.02, low=0.0, high=0.3, help="relative standard deviation of a vehicle's true speed about the commanded one"
    )
    lookahead_m: float = parameter(
        7.0, above=0.0, high=100.0, unit="m", help="look-ahead distance of the line-of-sight guidance"
    )
    heading_gain: float = parameter(
        0.6, above=0.0, high=5.0, unit="1/s", help="commanded yaw rate for each unit of heading error"
    )
    climb_mps: float = parameter(0.3, above=0.0, high=2.0, unit="m/s", help="vertical speed")
    depth_wobble_m: float = parameter(
        0.05, low=0.0, high=1.0, unit="m", help="standard deviation of the depth control error"
    )
    depth_wobble_time_s: float = parameter(
        10.0, above=0.0, high=1e6, unit="s", help="correlation time of the depth control error"
    )


@configuration
class CurrentConfig:
    """Current, the same everywhere: a mean, a tide and a slow random part."""

    ideal: bool = parameter(False, help=_IDEAL + ": still water")
    north_mps: float = parameter(0.0, low=-3.0, high=3.0, unit="m/s", help="mean current, north")
    east_mps: float = parameter(0.0, low=-3.0, high=3.0, unit="m/s", help="mean current, east")
    tide_mps: float = parameter(0.0, low=0.0, high=3.0, unit="m/s", help="amplitude of the tidal current")
    tide_heading_deg: float = parameter(0.0, low=-360.0, high=360.0, unit="deg", help="direction of the flood current")
    tide_period_s: float = parameter(44_714.0, above=0.0, high=1e8, unit="s", help="period of the tide (M2: 12.42 h)")
    tide_phase_deg: float = parameter(0.0, low=-360.0, high=360.0, unit="deg", help="phase at the mission's start")
    random_mps: float = parameter(0.02, low=0.0, high=1.0, unit="m/s", help="standard deviation of the random part")
    random_time_s: float = parameter(300.0, above=0.0, high=1e6, unit="s", help="its correlation time")


@configuration
class GyroConfig:
    """Vertical gyro."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_deg_rth: float = parameter(0.15, low=0.0, high=1e3, unit="deg/sqrt(h)", help="angle random walk")
    bias_deg_h: float = parameter(
        5.0, low=0.0, high=36e3, unit="deg/h", help="standard deviation of the bias from run to run"
    )
    bias_walk_deg_h_rth: float = parameter(
        1.0, low=0.0, high=36e3, unit="deg/h/sqrt(h)", help="random walk of the bias"
    )


@configuration
class CompassConfig:
    """Heading reference (magnetic compass or AHRS), including its misalignment to the DVL."""

    ideal: bool = parameter(False, help=_IDEAL)
    bias_deg: float = parameter(
        1.0, low=0.0, high=180.0, unit="deg", help="standard deviation of the heading bias from run to run"
    )
    bias_walk_deg_rth: float = parameter(
        0.3, low=0.0, high=180.0, unit="deg/sqrt(h)", help="random walk of the heading bias"
    )
    harmonic_deg: float = parameter(
        1.0,
        low=0.0,
        high=180.0,
        unit="deg",
        help="heading-dependent error a sin h + b cos h: standard deviation of a and of b from run to run",
    )
    noise_deg: float = parameter(0.5, low=0.0, high=180.0, unit="deg", help="standard deviation of one reading")
    interval_s: float = parameter(1.0, above=0.0, high=3600.0, unit="s", help="time between readings")


@configuration
class DvlConfig:
    """Doppler velocity log in bottom track; the same pings measure the altitude."""

    ideal: bool = parameter(False, help=_IDEAL + ": exact velocities, no lost pings")
    rate_hz: float = parameter(10.0, low=1.0, high=20.0, unit="Hz", help="ping rate, and rate of the navigation filter")
    scale: float = parameter(
        0.003, low=0.0, high=0.1, help="standard deviation of the relative scale error from run to run"
    )
    noise_mps: float = parameter(
        0.01, low=0.0, high=10.0, unit="m/s", help="standard deviation of one velocity, each axis"
    )
    outlier_share: float = parameter(0.001, low=0.0, high=0.5, help="fraction of pings with a wrong velocity")
    outlier_mps: float = parameter(
        0.5, low=0.0, high=100.0, unit="m/s", help="standard deviation of a wrong velocity's error"
    )
    dropouts_per_h: float = parameter(30.0, low=0.0, high=3600.0, unit="1/h", help="rate of short gaps without pings")
    dropout_min_s: float = parameter(0.5, low=0.0, high=3600.0, unit="s", help="shortest gap")
    dropout_max_s: float = parameter(2.0, low=0.0, high=3600.0, unit="s", help="longest gap")
    lock_losses_per_h: float = parameter(2.0, low=0.0, high=3600.0, unit="1/h", help="rate of bottom lock losses")
    lock_loss_min_s: float = parameter(5.0, low=0.0, high=86400.0, unit="s", help="shortest lock loss")
    lock_loss_max_s: float = parameter(20.0, low=0.0, high=86400.0, unit="s", help="longest lock loss")
    min_altitude_m: float = parameter(0.3, low=0.0, high=1e3, unit="m", help="smallest altitude with bottom lock")
    max_altitude_m: float = parameter(
        60.0, above=0.0, high=DEEPEST_M, unit="m", help="largest altitude with bottom lock"
    )

    def __post_init__(self) -> None:
        """Rejects limits in the wrong order."""
        for name in ("dropout", "lock_loss"):
            low, high = getattr(self, f"{name}_min_s"), getattr(self, f"{name}_max_s")
            if low > high:
                raise ValueError(f"{name}_min_s is {low:g} s, but must not exceed {name}_max_s ({high:g} s)")
        if self.max_altitude_m <= self.min_altitude_m:
            raise ValueError(
                f"max_altitude_m is {self.max_altitude_m:g} m, but must be above min_altitude_m "
                f"({self.min_altitude_m:g} m)"
            )


@configuration
class AltimeterConfig:
    """Altitude measured by a ping, and how pings become soundings."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(0.012, low=0.0, high=100.0, unit="m", help="standard deviation of one altitude")
    outlier_share: float = parameter(0.002, low=0.0, high=0.5, help="fraction of pings with a wrong altitude")
    outlier_m: float = parameter(
        4.0, low=0.0, high=1e3, unit="m", help="mean size of a wrong altitude's error (fish, multipath)"
    )
    sounding_every_s: float = parameter(
        1.0,
        low=0.0,
        high=3600.0,
        unit="s",
        help="one sounding is the median of the pings in this time; 0: every ping is a sounding",
    )
    least_pings: int = parameter(3, low=1, high=1_000, help="least pings for a sounding")


@configuration
class PressureConfig:
    """Depth of the vehicle from pressure."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(0.01, low=0.0, high=10.0, unit="m", help="standard deviation of one reading")
    bias_m: float = parameter(
        0.03, low=0.0, high=10.0, unit="m", help="standard deviation of the offset from run to run"
    )


@configuration
class AutopilotConfig:
    """A simulated autopilot's barometers and its own depth (link.kind: mavlink); soundings of sim_node do not use them.

    By default its origin lies above the water, its pressure is off and drifts, and the air is not standard air.
    """

    ideal: bool = parameter(False, help=_IDEAL)
    firmware: str = parameter(
        "ardupilot",
        choices=("ardupilot", "generic"),
        help="ardupilot: ArduSub, or ArduRover for a vehicle with depth_m 0, modeled on their own simulators; "
        "generic: one that flies the planner's arcs and follows every message",
    )
    origin_height_m: float = parameter(
        2.0, low=-100.0, high=100.0, unit="m", help="height of its origin above the surface"
    )
    air_pressure_hpa: float = parameter(990.0, low=500.0, high=1100.0, unit="hPa", help="air pressure")
    air_change_hpa_h: float = parameter(-1.0, low=-100.0, high=100.0, unit="hPa/h", help="its change")
    barometer_offset_hpa: float = parameter(
        40.0, low=-200.0, high=200.0, unit="hPa", help="offset of the pressure sensor"
    )
    barometer_drift_hpa_h: float = parameter(-1.0, low=-1000.0, high=1000.0, unit="hPa/h", help="its drift")
    water_density_kgpm3: float = parameter(
        1000.0, low=980.0, high=1080.0, unit="kg/m3", help="true density of the water"
    )


@configuration
class GpsConfig:
    """GPS fixes, at the surface only."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_m: float = parameter(1.0, low=0.0, high=1e3, unit="m", help="standard deviation of a reading, each axis")
    correlation_s: float = parameter(
        20.0, low=0.0, high=1e6, unit="s", help="correlation time of the error; 0: readings are independent"
    )
    interval_s: float = parameter(1.0, above=0.0, high=3600.0, unit="s", help="time between readings")
    antenna_m: float = parameter(0.3, low=0.0, high=100.0, unit="m", help="depth above which the antenna receives")
    surface_every_s: float = parameter(
        0.0,
        low=0.0,
        high=1e6,
        unit="s",
        help="time under way between surfacings that are not planned; 0: planned ones only",
    )
    surface_s: float = parameter(
        30.0,
        above=0.0,
        high=86400.0,
        unit="s",
        help="time at the surface; the vehicle stops from the climb to the dive",
    )


@configuration
class RangingConfig:
    """Travel times of packets, measured with the modems' clocks."""

    ideal: bool = parameter(False, help=_IDEAL)
    noise_s: float = parameter(0.5e-3, low=0.0, high=1.0, unit="s", help="standard deviation of one travel time")
    echo_share: float = parameter(
        0.02, low=0.0, high=1.0, help="fraction of packets whose echo is timed instead of the direct path"
    )
    echo_s: float = parameter(
        0.02, low=0.0, high=10.0, unit="s", help="mean delay of an echo, exponentially distributed"
    )
    clock_offset_s: float = parameter(
        1e-3, low=0.0, high=10.0, unit="s", help="standard deviation of a vehicle's clock error at the start"
    )
    clock_drift_ppm: float = parameter(
        1.0, low=0.0, high=1e4, unit="ppm", help="standard deviation of a clock's rate error"
    )
    sound_speed_error: float = parameter(
        0.003, low=0.0, high=0.1, help="relative standard deviation of the true speed of sound about the channel's"
    )


@configuration
class BathymetryConfig:
    """Source of the ground, and how a file is read."""

    file: str = parameter(
        "",
        help="bathymetry: CSV or XYZ of soundings, npz grid, ESRI ASCII grid (.asc), GeoTIFF, netCDF, BAG or S-102; "
        "empty: the synthetic lake",
    )
    resolution_m: float = parameter(
        5.0, above=0.0, high=500.0, unit="m", help="node spacing to which soundings are gridded"
    )
    max_gap_m: float = parameter(
        60.0, above=0.0, high=1e6, unit="m", help="ground farther than this from the nearest sounding is unknown"
    )
    smoothing_m: float = parameter(
        5.0, low=0.0, high=10e3, unit="m", help="Gaussian smoothing of gridded soundings; 0: none"
    )
    depth_sign: str = parameter("auto", choices=("auto", "down", "up"), help="direction of positive depth values")
    water_level_m: float | None = parameter(
        None,
        low=-1000.0,
        high=9000.0,
        unit="m",
        help="elevation of the water surface in the file's datum: depth = water_level_m - elevation. Left out: 0. "
        "If given, a raster holds elevations",
    )


#: Window of a lake in the default area, and the largest side (m) of one that follows from an area.
DEFAULT_WINDOW = Extent(north_min_m=-50.0, north_max_m=550.0, east_min_m=-50.0, east_max_m=650.0)
LARGEST_M = 5000.0


@configuration
class LakeConfig:
    """Synthetic lakes: a drowned river valley with side valleys (inlets), knolls (islands) and roughness."""

    seed: int = parameter(-1, low=-1, help="which lake of the family; -1: the mission's seed")
    deepest_m: float = parameter(35.0, above=0.0, high=1000.0, unit="m", help="depth of the valley floor")
    terrace_m: float = parameter(
        10.0, low=0.0, high=1e3, unit="m", help="depth of the old flood plain inside the window; 0 lets islands emerge"
    )
    level_m: float = parameter(
        15.0, above=0.0, high=1e3, unit="m", help="depth of the isobath that the lake is designed for"
    )
    deep_share_low: float = parameter(
        0.4, above=0.0, high=0.75, help="least fraction of the window deeper than level_m"
    )
    deep_share_high: float = parameter(
        0.6, low=0.25, high=0.95, help="largest fraction of the window deeper than level_m"
    )
    islands: int = parameter(2, low=0, high=8, help="knolls in the valley; at least one closed contour if > 0")
    inlets: int = parameter(4, low=0, high=12, help="side valleys")
    steepness: float = parameter(1.0, above=0.0, high=10.0, help="slopes relative to the default lake's")
    roughness_m: float = parameter(0.7, low=0.0, high=5.0, unit="m", help="standard deviation of the small relief")
    roughness_scale_m: float = parameter(60.0, low=5.0, high=100e3, unit="m", help="length scale of the small relief")
    north_m: float | None = parameter(
        None, low=-1e7, high=1e7, unit="m", help="north of the window's center; default: the area's"
    )
    east_m: float | None = parameter(
        None, low=-1e7, high=1e7, unit="m", help="east of the window's center; default: the area's"
    )
    height_m: float | None = parameter(
        None,
        low=100.0,
        high=100e3,
        unit="m",
        help="the window's length to the north; default: the area's, 600 to 5000 m",
    )
    width_m: float | None = parameter(
        None,
        low=100.0,
        high=100e3,
        unit="m",
        help="the window's length to the east; default: the area's, 700 to 5000 m",
    )
    shore_m: float = parameter(
        150.0, low=20.0, high=2e3, unit="m", help="width of the banks around the window, up to land"
    )

    def __post_init__(self) -> None:
        """Rejects depths and shares in the wrong order."""
        if not self.terrace_m < self.level_m < self.deepest_m:
            raise ValueError(
                f"terrace_m, level_m, deepest_m must be ascending depths, not {self.terrace_m:g}, "
                f"{self.level_m:g}, {self.deepest_m:g}"
            )
        if self.deep_share_low > self.deep_share_high:
            raise ValueError(
                f"deep_share_low is {self.deep_share_low:g}, but must not exceed deep_share_high "
                f"({self.deep_share_high:g})"
            )

    def in_area(self, north_m: Sequence[float], east_m: Sequence[float]) -> LakeConfig:
        """The lake with the window of an area where none is given: its rectangle, but neither too small for a lake nor
        so large that the lake takes minutes. An area within the default window does not change it.

        Args:
            north_m: North of the area's corners.
            east_m: East of the area's corners.
        """
        w = DEFAULT_WINDOW
        north, south, east, west = max(north_m), min(north_m), max(east_m), min(east_m)
        if south < w.north_min_m or north > w.north_max_m or west < w.east_min_m or east > w.east_max_m:
            w = Extent.around(
                ((north + south) / 2.0, (east + west) / 2.0),
                min(max(north - south, w.height_m), LARGEST_M),
                min(max(east - west, w.width_m), LARGEST_M),
            )
        north, east, height, width = self._window_or(w)
        return dataclasses.replace(self, north_m=north, east_m=east, height_m=height, width_m=width)

    def _window_or(self, default: Extent) -> tuple[float, ...]:
        """Center and sides of the window, where they are not given those of `default`."""
        given = self.north_m, self.east_m, self.height_m, self.width_m
        others = *default.center, default.height_m, default.width_m
        return tuple(other if value is None else value for value, other in zip(given, others, strict=True))

    @property
    def window(self) -> Extent:
        """The rectangle that the lake is designed for."""
        north, east, height, width = self._window_or(DEFAULT_WINDOW)
        return Extent.around((north, east), height, width)


@configuration
class ChannelConfig:
    """Acoustic channel between the modems. Each effect can be switched off (ideal)."""

    ideal: bool = parameter(
        False,
        help="true: all vehicles receive every packet at the end of its transmission, except for packet_loss and "
        "blackouts",
    )
    rate: int = parameter(4, low=3, high=5, help="Micromodem packet rate; 3 to 5 hold a 252-byte packet")
    overhead_s: float = parameter(
        0.45, unit="s", low=0.0, high=10.0, help="preamble and header of a transmission, before its data"
    )
    delay: bool = parameter(True, help="sound travels with sound_speed_mps; false: it arrives at once (ideal)")
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
        70.0, unit="dB re 1 uPa^2/Hz", low=0.0, high=150.0, help="ambient and own noise spectral level at the carrier"
    )
    fading_db: float = parameter(
        4.0,
        unit="dB",
        low=0.0,
        high=30.0,
        help="standard deviation of the level between receptions (multipath); 0: none (ideal)",
    )
    frame_errors: bool = parameter(
        True,
        help="frames are lost with the error rate of the packet rate; false: any signal-to-noise ratio is enough "
        "(ideal)",
    )
    half_duplex: bool = parameter(True, help="a vehicle that transmits cannot receive; false: it can (ideal)")
    interference: bool = parameter(True, help="overlapping arrivals count as noise; false: they do not (ideal)")
    packet_loss: float = parameter(0.0, low=0.0, high=1.0, help="additional probability that a reception is lost")
    land_blocks: bool = parameter(True, help="land between two vehicles blocks their link; false: it does not (ideal)")
    blackouts: tuple[float, ...] = parameter(
        (),
        help="scheduled outages, four numbers each: vehicle, vehicle (0: any), from (s), until (s); in both directions",
    )

    def __post_init__(self) -> None:
        """Checks the blackouts.

        Raises:
            ValueError: naming the wrong entry.
        """
        if len(self.blackouts) % 4:
            raise ValueError(f"blackouts has {len(self.blackouts)} numbers; give four for each: a, b, from_s, until_s")
        for a, b, start, end in self.outages:
            if a != int(a) or b != int(b) or min(a, b) < 0 or not start <= end:
                raise ValueError(
                    f"blackouts: {(a, b, start, end)} is not a blackout; give two vehicle numbers, then from_s "
                    "<= until_s"
                )

    @property
    def in_force(self) -> ChannelConfig:
        """This configuration, with every physical effect switched off if `ideal`."""
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
        """Scheduled outages: vehicle, vehicle, from (s), until (s)."""
        flat = self.blackouts
        return [(flat[i], flat[i + 1], flat[i + 2], flat[i + 3]) for i in range(0, len(flat), 4)]
