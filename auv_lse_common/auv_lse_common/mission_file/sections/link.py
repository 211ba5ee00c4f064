"""Section `link`: the MAVLink connection to the autopilot."""

from auv_lse_common.mission_file.parameters import ParameterError, configuration, parameter
from auv_lse_common.mission_file.port_address import check_address
from auv_lse_common.mission_file.sections.area import AreaConfig


@configuration
class LinkConfig:
    """MAVLink connection to the autopilot, and how waypoints are sent to it."""

    kind: str = parameter(
        "direct",
        choices=("direct", "mavlink"),
        help="direct: the simulator publishes odometry and takes waypoints; mavlink: vehicle_link_node does, with "
        "an autopilot",
    )
    endpoint: str = parameter(
        "udpin://127.0.0.1:14550",
        help="udpin://BIND:PORT (the autopilot connects), udpout://HOST:PORT, tcp://HOST:PORT, serial:///DEVICE:BAUD",
    )
    system_id: int = parameter(245, low=1, high=255, help="MAVLink system id of this stack")
    component_id: int = parameter(
        191, low=1, high=255, help="MAVLink component id of this stack (191: onboard computer)"
    )
    autopilot_system_id: int = parameter(
        0, low=0, high=255, help="MAVLink system id of the autopilot; 0: the vehicle's number"
    )
    autopilot_component_id: int = parameter(1, low=1, high=255, help="MAVLink component id of the autopilot")
    mode: str = parameter(
        "position_target",
        choices=("position_target", "mission"),
        help="position_target: one SET_POSITION_TARGET_LOCAL_NED after another; mission: an uploaded mission",
    )
    modes: tuple[int, ...] = parameter(
        (),
        low=0,
        help="flight modes (the autopilot's numbers) in which the mission runs; empty: the default of its firmware"
        " (docs/reference/hardware.md)",
    )
    key_file: str = parameter(
        "",
        help="sign messages, and accept signed ones only, with the key in this file (auv_lse key); empty: no signing",
    )
    set_origin: bool = parameter(
        True, help="send the mission's origin as SET_GPS_GLOBAL_ORIGIN if the autopilot has none"
    )
    acceptance_m: float = parameter(
        4.0,
        unit="m",
        above=0.0,
        high=1e3,
        help="a leg is complete this far before its end; the next target is then sent",
    )
    heartbeat_period_s: float = parameter(
        0.5,
        unit="s",
        above=0.0,
        high=10.0,
        help="time between sent heartbeats; ArduSub's failsafe acts 2.5 s after the last one",
    )
    lost_after_s: float = parameter(
        5.0,
        unit="s",
        above=0.0,
        high=3600.0,
        help="the link is lost when the autopilot has sent no heartbeat for this time",
    )
    stale_after_s: float = parameter(
        3.0, unit="s", above=0.0, high=3600.0, help="age of a position or attitude above which no odometry is published"
    )
    pressure: str = parameter(
        "SCALED_PRESSURE2",
        choices=("none", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"),
        help="message with the water's pressure, for depth; none: no sensor; with vehicle.depth_m 0, depth is then 0",
    )
    water_density_kgpm3: float = parameter(
        1000.0, unit="kg/m3", low=980.0, high=1080.0, help="density of the water: 1000 fresh, about 1025 sea"
    )
    depth_difference_m: float = parameter(
        1.0,
        unit="m",
        above=0.0,
        high=1e3,
        help="largest change, under water, of pressure depth minus the autopilot's own",
    )
    sensor_depth_m: float = parameter(
        0.0,
        unit="m",
        low=0.0,
        high=20.0,
        help="depth of the pressure sensor below the waterline of the floating vehicle",
    )
    zero_afloat: bool = parameter(
        False,
        help="whether the vehicle floats while it is disarmed before the mission: its zero of depth is then corrected "
        "by sensor_depth_m; false: it is on deck",
    )
    battery_wh: float = parameter(
        0.0,
        unit="Wh",
        low=0.0,
        high=1e6,
        help="energy of the battery, full at power-on: BATTERY_STATUS gives the charge; 0: SYS_STATUS does",
    )
    soundings: bool = parameter(
        True, help="publish `sounding` from odometry and altitude; false if another node does, as sim_node"
    )
    sounding_every_s: float = parameter(
        1.0, unit="s", above=0.0, high=60.0, help="one sounding is the median of the altitudes in this time"
    )
    sounding_least_pings: int = parameter(
        1,
        low=1,
        high=1000,
        help="least altitudes for a sounding: 1 accepts every altitude, 3 rejects single outliers but needs 5 Hz or a "
        "longer sounding_every_s",
    )
    target_period_s: float = parameter(
        0.2,
        unit="s",
        above=0.0,
        high=60.0,
        help="position_target: repetition period of the current target, which PX4 Offboard needs within 0.5 s; "
        "ArduPilot gets each target once",
    )
    upload_timeout_s: float = parameter(
        1.5,
        unit="s",
        above=0.0,
        high=60.0,
        help="mission: time without a request of the autopilot before an upload is repeated",
    )
    upload_retries: int = parameter(5, low=0, high=100, help="mission: repetitions before an upload has failed")
    backoff_min_s: float = parameter(
        0.2, unit="s", above=0.0, high=3600.0, help="first wait before the endpoint is reopened"
    )
    backoff_max_s: float = parameter(
        10.0, unit="s", above=0.0, high=3600.0, help="longest wait; each failure doubles the wait up to it"
    )

    def __post_init__(self) -> None:
        """Rejects combinations that cannot work.

        Raises:
            ParameterError: naming the keys and values.
        """
        if self.kind == "mavlink":
            check_address("endpoint", self.endpoint)
        if self.lost_after_s <= self.heartbeat_period_s:
            raise ParameterError(
                f"lost_after_s is {self.lost_after_s:g} s, but must be longer than heartbeat_period_s "
                f"({self.heartbeat_period_s:g} s)"
            )
        if self.zero_afloat and self.sensor_depth_m == 0.0:
            raise ParameterError(
                "zero_afloat: true needs sensor_depth_m, the depth of the pressure sensor below the waterline (m); "
                "without it all depths are too small by that much. Measure it, or zero the vehicle on deck"
            )
        if self.backoff_max_s < self.backoff_min_s:
            raise ParameterError(
                f"backoff_max_s is {self.backoff_max_s:g} s, but must be at least backoff_min_s "
                f"({self.backoff_min_s:g} s)"
            )


def check_origin(link: LinkConfig, area: AreaConfig, where: str) -> None:
    """Rejects missions of an autopilot in an area that is nowhere on Earth.

    Raises:
        ParameterError: naming the keys.
    """
    if link.kind == "mavlink" and link.mode == "mission" and area.origin_deg is None:
        raise ParameterError(
            f"{where}: link.mode: 'mission' needs area.origin_lat_deg and area.origin_lon_deg, because mission items "
            "are geodetic"
        )
