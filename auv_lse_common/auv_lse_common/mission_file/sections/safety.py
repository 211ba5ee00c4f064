"""Section `safety`: the limits of a vehicle, and the response to each."""

from auv_lse_common.mission_file.parameters import configuration, parameter
from auv_lse_common.vocabulary.mission_run import STOPS
from auv_lse_common.vocabulary.sounding import DEEPEST_M

RESPONSES = ("warn", "hold", "surface", "abort")
#: Responses to a vehicle that is too near to the ground.
ALTITUDE_RESPONSES = ("climb", *RESPONSES)


@configuration
class SafetyConfig:
    """Safety limits of one vehicle, and the responses."""

    max_depth_m: float | None = parameter(
        None, unit="m", above=0.0, high=DEEPEST_M, help="largest depth of the vehicle; left out: vehicle.depth_m + 5 m"
    )
    depth_response: str = parameter("surface", choices=RESPONSES, help="response below max_depth_m")
    min_altitude_m: float = parameter(
        1.0, unit="m", low=0.0, high=100.0, help="smallest height above the ground; 0: not watched"
    )
    altitude_response: str = parameter(
        "climb",
        choices=ALTITUDE_RESPONSES,
        help="response below min_altitude_m; climb: the vehicle climbs, and holds if it is still too low 15 s later; a "
        "boat holds at once",
    )
    fence_margin_m: float = parameter(
        150.0,
        unit="m",
        low=0.0,
        high=100e3,
        help="how far outside area.polygon_m a vehicle may be once it has been inside, and a waypoint at any time",
    )
    fence_response: str = parameter("surface", choices=RESPONSES, help="response outside the fence")
    odometry_age_s: float = parameter(30.0, unit="s", above=0.0, high=1e6, help="longest time without usable odometry")
    odometry_response: str = parameter("surface", choices=RESPONSES, help="response to missing odometry")
    link_age_s: float = parameter(
        30.0,
        unit="s",
        above=0.0,
        high=1e6,
        help="longest time without a heartbeat of the autopilot, after the first one",
    )
    link_response: str = parameter("hold", choices=RESPONSES, help="response to a lost autopilot, once it is back")
    autopilot_response: str = parameter(
        "surface",
        choices=RESPONSES,
        help="response when the autopilot refuses or ignores targets or a stop for 5 s",
    )
    min_battery: float = parameter(
        0.2, low=0.0, high=1.0, help="smallest charge that the autopilot may report, as a fraction of 1; 0: not watched"
    )
    battery_response: str = parameter("surface", choices=RESPONSES, help="response below min_battery")
    pressure_response: str = parameter(
        "hold",
        choices=RESPONSES,
        help="response to missing or contradicted pressure (link.depth_difference_m)",
    )
    leak_response: str = parameter("abort", choices=RESPONSES, help="response to a leak that the autopilot reports")
    mission_time_s: float = parameter(
        0.0, unit="s", low=0.0, high=1e8, help="longest running time of the mission, without holds; 0: not watched"
    )
    mission_time_response: str = parameter("abort", choices=RESPONSES, help="response after mission_time_s")
    patience_s: float = parameter(
        3.0,
        unit="s",
        low=0.0,
        high=3600.0,
        help="how long a limit must be exceeded before the response; the warning comes at once",
    )
    state_copies: str = parameter(
        "",
        help="folder for second copies of the state files, best on another disk than dives; empty: $STATE_DIRECTORY, "
        "else auv_lse in $XDG_STATE_HOME or ~/.local/state",
    )
    abort: str = parameter(
        "surface",
        choices=tuple(STOPS),
        help="what the vehicle does after an abort; go_to leads to vehicle.recovery_north_m, recovery_east_m",
    )
    after_reboot: str = parameter(
        "surface",
        choices=("resume", "surface"),
        help="what a running mission does after its computer was restarted under water; at the surface it waits for GO",
    )

    def kept_altitude_m(self, asked_m: float) -> float:
        """Altitude (m) that a vehicle keeps by climbing, if it is asked to keep `asked_m`; 0: none."""
        return max(asked_m, self.min_altitude_m if self.altitude_response == "climb" else 0.0)

    def deepest_m(self, depth_m: float) -> float:
        """Largest depth (m) of a vehicle that travels at `depth_m`."""
        return depth_m + 5.0 if self.max_depth_m is None else self.max_depth_m
