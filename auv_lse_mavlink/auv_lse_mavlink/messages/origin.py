"""The autopilot's origin: requested until it is known, set if there is none, refused if it is implausible."""

import math
from collections import Counter
from collections.abc import Callable

from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.wire import Message, mavlink

#: Period of the requests for the autopilot's origin until it is known (s).
ORIGIN_PERIOD_S = 2.0
#: An autopilot that had an origin before the link was lost is asked for this long (s) before one is set again.
ASK_AGAIN_S = 30.0
#: Local and global position may contradict each other for this long (s) after the origin was requested again.
CONTRADICTS_S = 5.0
#: Distance from the mission's origin above which the autopilot's origin is reported (m).
ORIGIN_TOLERANCE_M = 1.0
#: Distance from the mission's origin above which the autopilot's origin is refused (m).
MAX_ORIGIN_OFFSET_M = 10_000.0


class OriginExchange:
    """Requests one autopilot's origin, or sets it.

    Attributes:
        datum: The mission's origin and the autopilot's.
        contradiction: Why positions cannot be trusted: local and global position contradict each other, or the local
            frame of a mission without an origin has moved; "" if neither is known.
        has_targets: Whether the mission has begun to send targets.
    """

    def __init__(
        self,
        mission: Origin | None,
        autopilot: tuple[int, int],
        set_origin: bool,
        send: Callable[[Message], None],
        report: Callable[[str], None],
        counts: Counter[str],
    ) -> None:
        """Starts without the autopilot's origin.

        Args:
            mission: The mission's origin; None: local positions are used unchanged.
            autopilot: The autopilot's system and component id.
            set_origin: Whether to set the mission's origin if the autopilot has none.
            send: Sends a message to the autopilot.
            report: Reports a text to the operator.
            counts: Counter for "origin_set" and "origins_refused".
        """
        self.datum = Datum(mission)
        self.contradiction = ""
        self.has_targets = False
        self._is_lost = False  # whether the frame of a mission without an origin has moved
        self._contradicts_s = math.nan  # since when positions contradict each other
        self._set_from_s = -math.inf  # time from which an origin may be set
        self._autopilot, self._set_origin = autopilot, set_origin
        self._send, self._report, self._counts = send, report, counts
        self._asked_s = -math.inf
        self._had = False  # whether the autopilot had an origin before the link was lost
        self._asking_s = -math.inf  # time of the first request after that
        self._refused: Origin | None = None  # the last one refused
        self._refusal = ""  # and why

    @property
    def placed(self) -> bool:
        """Whether positions are in the mission's frame: the autopilot's origin is known, or the mission has none."""
        return not self._is_lost and (self.datum.mission is None or self.datum.autopilot is not None)

    @property
    def problem(self) -> str:
        """Why positions are not in the mission's frame; "" if they are."""
        if self.placed:
            return ""
        return self._refusal if self._refused is not None else "the autopilot's origin is unknown"

    def forget(self, rebooted: bool) -> None:
        """Discards the origin: the autopilot may have another one now, or none if it has rebooted."""
        self._had = not rebooted and (self._had or self.datum.autopilot is not None)
        self._asking_s = -math.inf
        self.datum = Datum(self.datum.mission)
        if not self._is_lost:
            self.contradiction, self._contradicts_s = "", math.nan
        if rebooted:
            self._mark_lost("the autopilot rebooted")
        self._refused = None
        self._asked_s = -math.inf

    def _mark_lost(self, why: str) -> None:
        """Marks positions as unusable if there is no mission origin to show how far the local frame has moved."""
        if self.datum.mission is None and self.has_targets:
            self._is_lost = True
            self.contradiction = (
                f"{why}, so its local frame may have moved, and the mission has no origin to compare it with. Restart "
                "the mission, with area.origin_lat_deg and area.origin_lon_deg"
            )

    def setting_refused(self, now_s: float) -> None:
        """Handles a refusal of the origin: the autopilot has one, or waits for its GPS. It is set later if need be."""
        self._set_from_s = now_s + ASK_AGAIN_S

    def ask_at_once(self, now_s: float) -> None:
        """Requests the origin now if it is unknown: the autopilot has just been found."""
        self._asked_s = -math.inf
        self.poll(now_s)

    def poll(self, now_s: float) -> None:
        """Requests the origin if it is time; sets it if the autopilot did not answer before."""
        agrees = self.datum.autopilot is not None and math.isnan(self._contradicts_s)
        if agrees or now_s - self._asked_s < ORIGIN_PERIOD_S:
            return
        first = math.isinf(self._asked_s)
        self._asked_s = now_s
        if math.isinf(self._asking_s):
            self._asking_s = now_s
        mission = self.datum.mission
        answers_late = (self._had and now_s - self._asking_s < ASK_AGAIN_S) or now_s < self._set_from_s
        has_none = self.datum.autopilot is None and self._refused is None
        if not first and self._set_origin and mission is not None and has_none and not answers_late:
            self._set(mission)
        self._send(
            mavlink.MAVLink_command_long_message(
                *self._autopilot,
                mavlink.MAV_CMD_REQUEST_MESSAGE,
                0,
                mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
                *(0.0,) * 6,
            )
        )

    def _set(self, mission: Origin) -> None:
        self._counts["origin_set"] += 1
        if self._counts["origin_set"] == 1:
            self._report(
                "the autopilot has no origin: setting the mission's; without GPS its estimator will position its start "
                f"at latitude {mission.lat_deg:.7f}, longitude {mission.lon_deg:.7f} deg (start it there, or wait for "
                "its GPS and set link.set_origin to false)"
            )
        self._send(
            mavlink.MAVLink_set_gps_global_origin_message(
                self._autopilot[0], round(mission.lat_deg * 1e7), round(mission.lon_deg * 1e7), 0
            )
        )

    def take(self, lat_e7: int, lon_e7: int) -> None:
        """Processes the autopilot's origin (1e-7 deg); 0, 0: it has none."""
        if lat_e7 == 0 and lon_e7 == 0:
            return
        origin = Origin(lat_deg=lat_e7 * 1e-7, lon_deg=lon_e7 * 1e-7)
        if self.datum.autopilot == origin:
            return
        datum = Datum(self.datum.mission, origin)
        valid = abs(origin.lat_deg) <= 90.0 and abs(origin.lon_deg) <= 180.0
        north_m, east_m = datum.from_local_ned(0.0, 0.0) if valid else (math.inf, math.inf)
        offset_m = math.hypot(north_m, east_m)
        if not valid or not offset_m <= MAX_ORIGIN_OFFSET_M:
            self._refuse(origin, offset_m)
            return
        if self.datum.autopilot is not None:
            self._mark_lost("the autopilot has another origin")
        self.datum = datum
        self._refused = None
        if self.datum.mission is not None and offset_m > ORIGIN_TOLERANCE_M:
            self._report(
                f"the autopilot's origin lies {north_m:.1f} m north, {east_m:.1f} m east of the mission's: corrected"
            )

    def check(self, now_s: float, lat_e7: int, lon_e7: int, position_m: tuple[float, float], moved_m: float) -> None:
        """Compares a global position (1e-7 deg; 0, 0: unknown) with the local one.

        If they contradict each other, the origin has moved unnoticed: it is requested again. If they still do after
        `CONTRADICTS_S`, `contradiction` is set.

        Args:
            now_s: The host's clock.
            lat_e7: Latitude.
            lon_e7: Longitude.
            position_m: North, east of the local position (m).
            moved_m: How far the vehicle may have moved between both (m).
        """
        if self.datum.mission is None or (lat_e7 == 0 and lon_e7 == 0):
            return
        position = self.datum.from_geodetic(lat_e7, lon_e7)
        apart_m = math.dist(position, position_m)
        if apart_m <= ORIGIN_TOLERANCE_M + moved_m + 1e-3 * math.hypot(*position):
            self.contradiction, self._contradicts_s = "", math.nan
            return
        self._counts["datum_mismatch"] += 1
        if math.isnan(self._contradicts_s):
            self._contradicts_s = now_s
            self._report(f"local and global position are {apart_m:.1f} m apart: check the origin (datum {self.datum})")
        if now_s - self._contradicts_s >= CONTRADICTS_S:
            self.contradiction = (
                f"the autopilot's local and global position are {apart_m:.1f} m apart: its origin has moved. Restart "
                "the autopilot, or set its origin again"
            )

    def _refuse(self, origin: Origin, offset_m: float) -> None:
        """Counts an implausible origin, and reports it once; the autopilot's frame is unknown then."""
        self._counts["origins_refused"] += 1
        self.datum = Datum(self.datum.mission)
        if origin == self._refused:
            return
        self._refused = origin
        where = f", {offset_m / 1000.0:.1f} km from the mission's" if math.isfinite(offset_m) else ""
        self._refusal = (
            f"the autopilot's origin is refused: latitude {origin.lat_deg:.7f}, longitude {origin.lon_deg:.7f} "
            f"deg{where} is farther than {MAX_ORIGIN_OFFSET_M / 1000.0:g} km from the mission's origin. Check "
            "area.origin_lat_deg and origin_lon_deg, and the autopilot's GPS"
        )
        self._report(self._refusal)
