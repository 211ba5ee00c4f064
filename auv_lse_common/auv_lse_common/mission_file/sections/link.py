"""Section `link` of the parameter file: how the stack reaches the vehicle's autopilot over MAVLink."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import ParameterError, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConfig:
    """How `vehicle_link_node` reaches the autopilot, and how waypoints are given to it."""

    kind: str = parameter(
        "direct",
        choices=("direct", "mavlink"),
        help="direct: the simulator gives odometry and takes waypoints; mavlink: vehicle_link_node does",
    )
    endpoint: str = parameter(
        "udpin://127.0.0.1:14550",
        help="udpin://BIND:PORT (the autopilot calls), udpout://HOST:PORT, tcp://HOST:PORT, serial:///DEVICE:BAUD",
    )
    system_id: int = parameter(245, low=1, high=255, help="MAVLink system id of this stack")
    component_id: int = parameter(191, low=1, high=255, help="MAVLink component id (191: onboard computer)")
    autopilot_system_id: int = parameter(
        0, low=0, high=255, help="MAVLink system id of the autopilot; 0: the vehicle's number"
    )
    autopilot_component_id: int = parameter(1, low=1, high=255, help="MAVLink component id of the autopilot")
    mode: str = parameter(
        "position_target",
        choices=("position_target", "mission"),
        help="waypoints as SET_POSITION_TARGET_LOCAL_NED one after another, or as an uploaded mission",
    )
    modes: tuple[int, ...] = parameter(
        (),
        low=0,
        help="flight modes (the autopilot's numbers) in which the mission runs; empty: docs/reference/hardware.md",
    )
    key_file: str = parameter(
        "",
        help="sign messages, and believe only signed ones, with the key in this file (scripts/key); empty: no",
    )
    set_origin: bool = parameter(
        True, help="send the mission's origin as SET_GPS_GLOBAL_ORIGIN when the autopilot has none"
    )
    acceptance_m: float = parameter(
        4.0, unit="m", above=0.0, help="a leg counts as travelled this far before its end: the next one is then sent"
    )
    heartbeat_period_s: float = parameter(1.0, unit="s", above=0.0, help="time between heartbeats sent")
    lost_after_s: float = parameter(
        5.0, unit="s", above=0.0, help="the link is lost when no heartbeat has come from the autopilot for so long"
    )
    stale_after_s: float = parameter(
        3.0, unit="s", above=0.0, help="a position or attitude older than this gives no odometry"
    )
    soundings: bool = parameter(
        True, help="give `sounding` from odometry and altitude; false if another node gives it, as sim_node does"
    )
    sounding_every_s: float = parameter(
        1.0, unit="s", above=0.0, high=60.0, help="one sounding: the median of the altitudes in this time"
    )
    sounding_least_pings: int = parameter(
        1,
        low=1,
        high=1000,
        help="fewer altitudes than this in that time give no sounding; autopilots send DISTANCE_SENSOR at 0.5 to "
        "10 Hz: 1 takes every one, 3 rejects single outliers but needs 5 Hz or a longer sounding_every_s",
    )
    target_period_s: float = parameter(
        0.2,
        unit="s",
        above=0.0,
        help="position_target: time between repetitions of the current target; PX4 Offboard needs less than 0.5 s",
    )
    upload_timeout_s: float = parameter(
        1.5, unit="s", above=0.0, help="mission: longest wait for the autopilot's next request before a repeat"
    )
    upload_retries: int = parameter(5, low=0, high=100, help="mission: repeats before an upload counts as failed")
    backoff_min_s: float = parameter(0.2, unit="s", above=0.0, help="first wait before the endpoint is opened again")
    backoff_max_s: float = parameter(10.0, unit="s", above=0.0, help="longest wait: doubled at every failure up to it")

    def __post_init__(self) -> None:
        """Refuses combinations that cannot work.

        Raises:
            ParameterError: naming the keys and values.
        """
        if self.lost_after_s <= self.heartbeat_period_s:
            raise ParameterError(
                f"lost_after_s: got {self.lost_after_s:g}; expected more than heartbeat_period_s = "
                f"{self.heartbeat_period_s:g} s"
            )
        if self.backoff_max_s < self.backoff_min_s:
            raise ParameterError(
                f"backoff_max_s: got {self.backoff_max_s:g}; expected at least backoff_min_s = {self.backoff_min_s:g} s"
            )
