"""A simulated ArduPilot's estimator: its origin, its time since boot, and whether it has a position."""

import math

from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated.ardupilot.setup import Setup

#: Times (s): since boot when the simulation begins; from a boot with GPS until it has its origin, and until it uses
#: GPS.
RUNNING_S, GPS_ORIGIN_S, GPS_USED_S = 120.0, 19.0, 40.0


class Estimator:
    """The estimator of one autopilot.

    Attributes:
        datum: The mission's origin and the estimator's.
        height_m: Height of the estimator's origin above the surface.
    """

    def __init__(self, setup: Setup, mission: Origin | None) -> None:
        """Starts as installed; `mission` is the mission's origin."""
        self.datum = Datum(mission, (setup.origin or mission) if setup.has_origin else None)
        self.height_m = setup.origin_height_m
        self._setup = setup
        self._has_origin = setup.has_origin
        self._now_s = 0.0
        self._boot_s: float | None = None

    def tick(self, now_s: float) -> None:
        """Advances to a time."""
        self._now_s = now_s
        if self._boot_s is None:
            self._boot_s = now_s - RUNNING_S

    def boot(self) -> None:
        """Forgets the origin."""
        self._boot_s, self._has_origin = self._now_s, False
        self.datum = Datum(self.datum.mission)

    @property
    def up_s(self) -> float:
        """Time since boot (s)."""
        return 0.0 if self._boot_s is None else self._now_s - self._boot_s

    @property
    def boot_ms(self) -> int:
        """Time since boot (ms), as messages count it."""
        return round(self.up_s * 1000.0) % 2**32

    @property
    def unix_us(self) -> int:
        """UTC (us since 1970); 0: unknown, without GPS."""
        return round(self._now_s * 1e6) if self.uses_gps else 0

    @property
    def uses_gps(self) -> bool:
        """Whether there is a GPS receiver."""
        return self._setup.aiding == "gps"

    @property
    def has_origin(self) -> bool:
        """Whether there is an origin."""
        return self._has_origin

    @property
    def has_position(self) -> bool:
        """Whether there is a position: from GPS, from velocities, or from an origin that was set."""
        if self.uses_gps:
            return self._has_origin and self.up_s >= GPS_USED_S
        return self._setup.aiding == "dvl" or self._has_origin

    def origin_messages(self) -> list[Message]:
        """GPS_GLOBAL_ORIGIN and HOME_POSITION; none without an origin."""
        origin = self.datum.autopilot
        if origin is None:
            return []
        position = round(origin.lat_deg * 1e7), round(origin.lon_deg * 1e7)
        home = (*position, 0, 0.0, 0.0, 0.0, [math.nan] * 4, 0.0, 0.0, 0.0)
        return [
            mavlink.MAVLink_gps_global_origin_message(*position, 0, round(self.up_s * 1e6)),
            mavlink.MAVLink_home_position_message(*home),
        ]

    def settle(self, has_fix: bool) -> bool:
        """Sets the origin from GPS once `GPS_ORIGIN_S` have passed since boot; returns whether it did so now."""
        if self._has_origin or not (self.uses_gps and has_fix) or self.up_s < GPS_ORIGIN_S:
            return False
        self.take(self._setup.origin or self.datum.mission)
        return True

    def take(self, origin: Origin | None) -> None:
        """Sets the origin."""
        self.datum, self._has_origin = Datum(self.datum.mission, origin), True
