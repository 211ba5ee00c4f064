"""Depth below the surface from an autopilot's pressure messages, and the autopilot's own depth compared with it.

Theory of operation
-------------------
No MAVLink message holds a vehicle's depth. LOCAL_POSITION_NED.z and the altitude above home count from a point that
a ground station or GPS may have set metres off. So depth comes from absolute pressure minus the pressure at the
surface, the zero.

*Zero.* While the vehicle is disarmed, or stopped with a GPS fix, the zero is the median of the last pressures. It is
refused, with a reason, outside `SURFACE_PA`, if pressure is not steady, and if it is higher than the last zero by more
than `HIGHEST_RISE_PA`: such a vehicle is under water. A vehicle that floats has its sensor under water: armed, or with
`link.zero_afloat`, the pressure at `link.sensor_depth_m` is subtracted. Until there is a zero, depth counts from
standard air pressure, which may be metres wrong; `problem` reports it.

*Drift.* At the first GPS fix after a dive, the depth that the gauge shows is reported, and not corrected.

*Offset.* The autopilot's own depth minus pressure depth, filtered. Depth targets are shifted by it. Under water it may
differ from its value at the surface by at most `link.depth_difference_m`; beyond it `problem` is set. The shift stops
there, so that a stuck gauge cannot make a vehicle dive ever deeper. A sudden step of the autopilot's own depth, faster
than a vehicle or a gauge, is a step of its datum: the shift follows it. Targets at the surface take the smaller of both
shifts. When the autopilot reboots or gets another origin, its datum may change (`forget`).

*No pressure* for `link.stale_after_s`: depth is the autopilot's own minus the last offset, and `problem` reports it.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable
from statistics import median

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.water import HIGHEST_AIR_PA, MEAN_LATITUDE_DEG, depth_of, gauge_pressure_pa
from auv_lse_mavlink.messages.events import Event, Problem, Surfaced, Zeroed

#: Plausible pressures at the surface (Pa): air at sea level to 2,500 m, with a sensor's offset of 200 hPa.
SURFACE_PA = (55_000.0, 125_000.0)
#: Standard air pressure (Pa).
AIR_PA = 101_325.0
#: Pressures below this (Pa) are no measurement.
LEAST_PA = 30_000.0
#: A zero may be at most this much (Pa) above the last one: 50 hPa, or half a metre of water.
HIGHEST_RISE_PA = 5_000.0
#: Pressures of a zero may differ by at most this (Pa), as in waves of half a metre.
STEADY_PA = 5_000.0
#: A zero that has changed by this much (Pa) is reported: 2 cm.
REPORTED_PA = 200.0
#: Number of pressures for a zero or a drift, and the largest number that is used.
ZERO_SAMPLES, MOST_SAMPLES = 5, 40
#: Number of differences for a first offset, and of those whose median is filtered.
FIRST_DIFFERENCES, DIFFERENCES = 3, 5
#: A restarted link has this time (s) to learn the offset: for pressures that come once a second.
SETTLING_S = 8.0
#: Time constant of the offset (s).
OFFSET_TIME_S = 5.0
#: The autopilot's own depth changes by more than this (m), and faster than this (m/s), only if its datum steps.
STEP_M, STEP_MPS = 0.5, 1.5
#: Below this depth (m) the vehicle has dived; a GPS fix above this depth means that it is at the surface.
DIVED_M = 1.0


class DepthGauge:
    """Depth of one vehicle.

    Attributes:
        zero_pa: Pressure at the surface (Pa); NaN before the first.
        drift_m: Depth shown at the last surfacing (m); NaN before the first.
        offset_m: The autopilot's own depth minus pressure depth (m), filtered; NaN while unknown.
    """

    def __init__(
        self,
        config: LinkConfig,
        latitude_deg: float | None,
        report: Callable[[Event], None],
        counts: Counter[str],
        is_afloat: bool = False,
    ) -> None:
        """Starts without a zero.

        Args:
            config: Section `link`.
            latitude_deg: Latitude (deg); None: `MEAN_LATITUDE_DEG`.
            report: Takes events.
            counts: Counter for "bad_pressures", "zeros" and "zeros_refused".
            is_afloat: Whether the vehicle travels at the surface only; without pressure its depth is then 0.
        """
        self.zero_pa = self.drift_m = self.offset_m = math.nan
        self._message, self._density = config.pressure, config.water_density_kgpm3
        self._latitude_deg = MEAN_LATITUDE_DEG if latitude_deg is None else latitude_deg
        self._limit_m, self._stale_s = config.depth_difference_m, config.stale_after_s
        self._report, self._counts = report, counts
        self._is_boat = is_afloat and not self.is_used
        self._sensor_m, self._zeroes_afloat = config.sensor_depth_m, config.zero_afloat
        self._floats = False  # whether the sensor is under water while the zero is set
        self._refusal = ""  # why the last zero was refused
        self._may_zero = self._has_fix = self._has_dived = self._is_ready = False
        self._zeroing: deque[float] = deque(maxlen=MOST_SAMPLES)  # pressures (Pa) while the zero may be set
        self._surfaced: deque[float] = deque(maxlen=MOST_SAMPLES)  # depths (m) since GPS has a fix
        self._differences: deque[float] = deque(maxlen=DIFFERENCES)
        self._reference_m = self._newest_m = math.nan  # the offset at the surface, and unfiltered
        self._center_m = math.nan  # the offset at the surface, with the steps of the autopilot's datum since then
        self._compared_m = (math.nan, math.nan)  # the last depths compared: the autopilot's own, pressure depth
        self._is_alive = True  # whether the last two pressures differ
        self._waiting_m = math.nan  # pressure depth (m) that awaits the autopilot's own
        self._pressure_s = self._own_s = self._compared_s = self._restored_s = -math.inf
        self._depth_m = self._own_m = self._last_pa = math.nan

    # ------------------------------------------------------------------ input

    def set_state(self, may_zero: bool, has_fix: bool, armed: bool = False) -> None:
        """Sets whether the zero may be set now, whether GPS has a fix, and whether the vehicle is armed: it floats."""
        self._floats = armed or self._zeroes_afloat
        if not may_zero:
            self._zeroing.clear()
            self._refusal = ""
        if not has_fix:
            self._surfaced.clear()
        self._may_zero, self._has_fix = may_zero, has_fix

    def restore(self, zero_pa: float, now_s: float = -math.inf) -> None:
        """Continues at `now_s` (s) with the zero of an earlier process; -inf: long ago."""
        self.zero_pa, self._restored_s = zero_pa, now_s

    def own_depth(self, now_s: float, depth_m: float) -> None:
        """Adds the autopilot's own depth (m, positive down) in its own datum."""
        if not math.isfinite(depth_m):
            return
        before_s, before_m = self._own_s, self._own_m
        self._own_m, self._own_s = depth_m, now_s
        if math.isnan(self._waiting_m):
            return
        part = 1.0  # fraction of the time between the last two own depths at which the pressure was measured
        if now_s > before_s and now_s - before_s <= self._stale_s:
            part = (self._pressure_s - before_s) / (now_s - before_s)
        own_m = before_m + part * (depth_m - before_m) if part < 1.0 else depth_m
        pressure_m, self._waiting_m = self._waiting_m, math.nan
        self._compare(now_s, own_m, pressure_m)

    def pressure(self, now_s: float, pressure_pa: float) -> None:
        """Adds an absolute pressure (Pa)."""
        if not (math.isfinite(pressure_pa) and pressure_pa > LEAST_PA):
            self._counts["bad_pressures"] += 1
            return
        self._pressure_s = now_s
        self._is_alive, self._last_pa = pressure_pa != self._last_pa, pressure_pa
        if self._may_zero:
            self._zeroing.append(pressure_pa)
            if len(self._zeroing) >= ZERO_SAMPLES:
                self._set_zero(median(self._zeroing) - self._sensor_pa)
        zero_pa = AIR_PA if math.isnan(self.zero_pa) else self.zero_pa
        self._depth_m = depth_of(pressure_pa - zero_pa, self._density, self._latitude_deg)
        self._has_dived = self._has_dived or self._depth_m > DIVED_M
        if self._has_fix:
            self._note_surfacing()
        self._waiting_m = self._depth_m

    def forget(self) -> None:
        """Discards the offset, because the autopilot's datum may have changed."""
        self._differences.clear()
        self._waiting_m = self.offset_m = self._reference_m = self._center_m = math.nan

    # ------------------------------------------------------------------ output

    @property
    def is_used(self) -> bool:
        """Whether depth comes from pressure at all."""
        return self._message != "none"

    @property
    def is_ready(self) -> bool:
        """Whether zero and offset have been known once, or are not needed."""
        return not self.is_used or self._is_ready

    @property
    def is_known(self) -> bool:
        """Whether the offset is known, or is not needed."""
        return not (self.is_used and math.isnan(self.offset_m))

    def depth_m(self, now_s: float, own_m: float) -> float:
        """Depth below the surface (m); `own_m` is the autopilot's own, returned if no better one is known."""
        if self.is_used and now_s - self._pressure_s <= self._stale_s:
            return self._depth_m
        if self._is_boat:
            return 0.0  # its own depth follows waves and errors of GPS
        return own_m if math.isnan(self.offset_m) else self._own_m - self.offset_m

    @property
    def shift_m(self) -> float:
        """The shift (m) from a depth to a target in the autopilot's datum; 0 while unknown."""
        if math.isnan(self.offset_m):
            return 0.0
        return min(max(self.offset_m, self._center_m - self._limit_m), self._center_m + self._limit_m)

    def own_target_m(self, depth_m: float) -> float:
        """A target's depth (m) in the autopilot's datum; at the surface the shallower of both results."""
        surfaces = depth_m <= 0.0 and not math.isnan(self.offset_m)
        return depth_m + (min(self.shift_m, self.offset_m) if surfaces else self.shift_m)

    def settling(self, now_s: float) -> bool:
        """Whether the offset will be known soon, so that targets should wait."""
        is_fresh = now_s - min(self._pressure_s, self._own_s) <= self._stale_s
        return self.is_used and math.isnan(self.offset_m) and is_fresh

    def problem(self, now_s: float) -> str:
        """Reason not to trust the depth; "" if there is none, or if a restarted link is still learning the offset."""
        if not self.is_used or (not self.is_known and now_s - self._restored_s <= SETTLING_S):
            return ""
        age_s = now_s - self._pressure_s
        if math.isinf(age_s):
            return f"no {self._message} from the autopilot (link.pressure)"
        if age_s > self._stale_s:
            return f"no {self._message} for {age_s:.0f} s: depth is the autopilot's own"
        if math.isnan(self.zero_pa):
            return self._refusal or "depth has no zero: disarm the vehicle at the surface or on deck"
        if math.isnan(self.offset_m):
            return "the autopilot's own depth is unknown: targets cannot be converted"
        change_m = self._newest_m - self._reference_m
        if abs(change_m) <= self._limit_m:
            return ""
        return (
            f"pressure depth {self._depth_m:.1f} m and the autopilot's own depth have diverged by "
            f"{change_m:+z.1f} m, more than {self._limit_m:g} m (link.depth_difference_m). Check the sensor and "
            "both densities"
        )

    @property
    def values(self) -> dict[str, float]:
        """For diagnostics: zero (hPa), offset and drift (m), where known."""
        found = {
            "pressure zero hPa": self.zero_pa / 100.0,
            "own depth offset m": self.offset_m,
            "pressure drift m": self.drift_m,
        }
        return {name: round(value, 2) for name, value in found.items() if not math.isnan(value)}

    # ------------------------------------------------------------------ helpers

    @property
    def _sensor_pa(self) -> float:
        """Pressure (Pa) of the water above the sensor while the zero is set."""
        return gauge_pressure_pa(self._sensor_m, self._density, self._latitude_deg) if self._floats else 0.0

    def _set_zero(self, pressure_pa: float) -> None:
        refusal = _refusal(pressure_pa, self._zeroing, self.zero_pa)
        if refusal:
            self._counts["zeros_refused"] += 1
            if not self._refusal:
                self._report(Problem(text=refusal))
            self._refusal = refusal
            return
        self._refusal, self._has_dived = "", False
        self._surfaced.clear()
        if math.isnan(self.zero_pa) or abs(pressure_pa - self.zero_pa) >= REPORTED_PA:
            self._counts["zeros"] += 1
            was_doubtful, self.zero_pa = self.zero_pa > HIGHEST_AIR_PA, pressure_pa
            self._differences.clear()
            self._waiting_m = math.nan
            self._report(Zeroed(pressure_pa=pressure_pa, sensor_depth_m=self._sensor_m if self._floats else 0.0))
            if pressure_pa > HIGHEST_AIR_PA and not was_doubtful:
                self._report(Problem(text=self._doubt_of_zero()))

    def _doubt_of_zero(self) -> str:
        """A warning of a zero that only a sensor's error can explain, or water above it."""
        too_small_m = depth_of(self.zero_pa - AIR_PA, self._density, self._latitude_deg)
        return (
            f"depth is zeroed at {self.zero_pa / 100.0:.0f} hPa, more than air ever has. If the vehicle is under "
            f"water, it travels {too_small_m:.1f} m too deep: bring it to the surface, disarmed, before GO. If it is "
            "at the surface, check the sensor"
        )

    def _note_surfacing(self) -> None:
        if not self._has_dived or abs(self._depth_m) > DIVED_M:
            return
        self._surfaced.append(self._depth_m)
        if len(self._surfaced) >= ZERO_SAMPLES:
            self.drift_m, self._has_dived = median(self._surfaced) - self._sensor_m, False
            self._surfaced.clear()
            self._report(Surfaced(drift_m=self.drift_m))

    def _compare(self, now_s: float, own_m: float, pressure_m: float) -> None:
        """Updates the offset with both depths of one time; at the surface it is the reference."""
        passed_s, self._compared_s = now_s - self._compared_s, now_s
        moved_m, sank_m = own_m - self._compared_m[0], pressure_m - self._compared_m[1]
        self._compared_m = own_m, pressure_m
        if abs(moved_m - sank_m) > STEP_M + STEP_MPS * passed_s and abs(moved_m) > abs(sank_m):
            self._differences.clear()
            self.offset_m += moved_m - sank_m
            self._center_m += moved_m - sank_m
        self._differences.append(own_m - pressure_m)
        if len(self._differences) < FIRST_DIFFERENCES:
            return
        self._newest_m = newest_m = median(self._differences)
        self._is_ready = self._is_ready or not math.isnan(self.zero_pa)
        if math.isnan(self.offset_m):
            self.offset_m = self._reference_m = self._center_m = newest_m
        self.offset_m += (newest_m - self.offset_m) * min(passed_s / OFFSET_TIME_S, 1.0)
        at_surface = self._may_zero and not self._refusal
        if at_surface or (self._has_fix and self._is_alive and abs(self._depth_m) <= DIVED_M):
            self.offset_m = self._reference_m = self._center_m = newest_m


def _refusal(pressure_pa: float, pressures: Iterable[float], last_pa: float) -> str:
    """Why a pressure cannot be the surface's; "" if it can."""
    seen = list(pressures)
    low_pa, high_pa = SURFACE_PA
    if not low_pa <= pressure_pa <= high_pa:
        return (
            f"zero of pressure refused: {pressure_pa / 100.0:.0f} hPa is not the surface's, which is "
            f"{low_pa / 100.0:.0f} to {high_pa / 100.0:.0f} hPa. Is the vehicle under water, or link.pressure "
            "another sensor's?"
        )
    if pressure_pa - last_pa > HIGHEST_RISE_PA:
        return (
            f"zero of pressure refused: {pressure_pa / 100.0:.0f} hPa is {(pressure_pa - last_pa) / 100.0:.0f} "
            f"hPa above the last zero, more than {HIGHEST_RISE_PA / 100.0:.0f} hPa. Is the vehicle under water?"
        )
    if max(seen) - min(seen) > STEADY_PA:
        return (
            f"zero of pressure refused: pressures vary by {(max(seen) - min(seen)) / 100.0:.0f} hPa, more than "
            f"{STEADY_PA / 100.0:.0f} hPa. Keep the vehicle at the surface"
        )
    return ""
