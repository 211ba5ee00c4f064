"""The safety watch of one vehicle: compares reports with the limits. No ROS, no clock.

Theory of operation
-------------------
`odometry`, `altitude` and `autopilot` take the reports since the last step; `step` checks every limit. An exceeded
limit is a warning at once. A limit trips when it has been exceeded for `patience_s` in total within the last
`2 * patience_s`, is still exceeded, and its response is not "warn". `MissionRun.trip` latches it until RESET. A limit
that is exceeded without a break thus trips after `patience_s`. With wrong readings in between it trips within twice
that time, if at least half of the readings exceed it. For depth, fence and altitude every reading counts; the other
limits are states, read once a step (`exceeded_time`). Two exceptions:

- Before its first leg nothing trips while the vehicle is at the surface, whatever its state. After a restart of its
  computer, a submerged vehicle is watched.
- After a RESET outside the fence the vehicle may return: the fence applies again once it is inside.

Ages are measured with the step's clock from the step that took the report; that of odometry from its stamp, if that is
older. If the clock is set, ages are shifted with it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.exceeded_time import ExceededTime
from auv_lse_common.safety.fence import Fence
from auv_lse_common.vocabulary.frames import is_possible
from auv_lse_common.vocabulary.frozen_sensor import FrozenSensor
from auv_lse_common.vocabulary.jumping_heading import JumpingHeading
from auv_lse_common.vocabulary.mission_run import STOPS, Action, MissionRun, RunState, Stop
from auv_lse_common.vocabulary.sounding_gate import FLATTEST

#: A longer step (s), or a negative one, means that the clock was set.
LONGEST_STEP_S = 10.0
#: Limits of which each reading counts; the others are states, which are known at each step.
READINGS = ("depth", "fence", "altitude")
#: Share of a step's readings that makes an exceeded limit a warning.
WARNING_SHARE = 0.5
#: At most this many readings of a sensor count in one step, the newest.
MOST_READINGS = 1000
#: A vehicle that climbs has this much longer (s) than `patience_s` to be high enough.
CLIMB_S = 12.0
#: Distance (m) from the first position after which the vehicle has moved; before, its estimate may stand still.
MOVED_M = 1.0
#: Positions that are farther apart than this (m) are a jump of the estimate, no way.
LONGEST_MOVE_M = 10.0
#: A vehicle is at the surface, or on deck, up to this depth (m).
AFLOAT_M = 2.0
#: Below this speed (m/s) a vehicle may stand still.
STANDING_MPS = 0.05
#: No vehicle keeps its depth better than this (m per m travelled), or to the last digit over this distance (m).
STEADIEST = 0.0005
STEADY_M = 50.0


_ACTIONS = {**STOPS, "climb": Action.HOLD}


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotReport:
    """State of an autopilot, as it reports it.

    Attributes:
        heard: Whether its heartbeats arrive.
        armed: Whether its motors may turn.
        mode: Its flight mode's number; -1 unknown.
        mode_obeys: Whether it follows targets in that mode; True if unknown.
        battery: Charge left, 0 to 1; NaN unknown.
        leak: 1 water inside, 0 none, -1 unknown.
        disobeys: How it has refused or ignored its targets or a stop for some seconds; "" if it follows them.
        depth_problem: Reason not to trust the depth of its odometry; "" if there is none.
        stamp_s: When it was last heard (s, the host's clock); NaN unknown.
    """

    heard: bool
    armed: bool
    mode: int = -1
    mode_obeys: bool = True
    battery: float = math.nan
    leak: int = -1
    disobeys: str = ""
    depth_problem: str = ""
    stamp_s: float = math.nan

    @property
    def problem(self) -> str:
        """Reason why it cannot follow targets; "" if none is known."""
        if not self.heard:
            return "the autopilot is not heard"
        if not self.armed:
            return "the autopilot is not armed"
        if self.mode_obeys:
            return ""
        choice = "Choose GUIDED, or AUTO with link.mode: mission (PX4: Offboard, Mission)"
        return f"the autopilot is in mode {self.mode}, in which it follows no targets. {choice}"


class SafetyWatch:
    """Watches the limits of one vehicle; see the module's text.

    Attributes:
        warnings: Exceeded limits that have not tripped, each with its reason.
        exceeded: Exceeded limits that would trip again after RESET, each with its reason.
    """

    def __init__(
        self, config: SafetyConfig, fence: Fence, deepest_m: float, has_autopilot: bool = False, can_climb: bool = True
    ) -> None:
        """Starts without reports.

        Args:
            has_autopilot: Whether there is an autopilot; the mission then waits for it.
            can_climb: Whether the vehicle can climb: it is no boat.
        """
        self.warnings: dict[str, str] = {}
        self.exceeded: dict[str, str] = {}
        self._config, self._fence, self._deepest_m = config, fence, deepest_m
        self._responses = {
            "depth": config.depth_response,
            "fence": config.fence_response,
            "altitude": config.altitude_response,
            "depth gauge": "warn",
            "altimeter": "warn",
            "heading": "warn",
            "charge": "warn",
            "odometry": config.odometry_response,
            "link": config.link_response,
            "autopilot": config.autopilot_response,
            "battery": config.battery_response,
            "leak": config.leak_response,
            "pressure": config.pressure_response,
            "mission time": config.mission_time_response,
        }
        self._times = {name: ExceededTime(config.patience_s) for name in self._responses}
        if config.altitude_response == "climb":
            self._times["altitude"] = ExceededTime(config.patience_s + CLIMB_S * can_climb)
        self._reasons: dict[str, str] = {}  # why each limit was exceeded last
        self._position: tuple[float, float, float] | None = None  # north, east, depth (m)
        self._new_positions: deque[tuple[float, float, float]] = deque(maxlen=MOST_READINGS)  # since the last step
        self._first: tuple[float, float, float] | None = None  # first heading (rad), north, east (m)
        self._has_moved = False
        self._way_m = 0.0
        self._altitude_m = math.nan
        self._altitude_s = math.nan  # time of the last one; NaN before the first
        self._new_altitudes: deque[float] = deque(maxlen=MOST_READINGS)  # since the last step (m)
        self._altimeter = FrozenSensor(FLATTEST)
        self._depth_gauge = FrozenSensor(STEADIEST, STEADY_M)
        self._heading = JumpingHeading()
        self._altitude_frozen = self._depth_frozen = self._heading_jumps = False
        self._autopilot: AutopilotReport | None = AutopilotReport(heard=False, armed=False) if has_autopilot else None
        self._link_known = False  # the autopilot has been heard once
        self._stamp_s = -math.inf  # newest stamp of odometry since the last step
        self._stamps_behind_s = 0.0  # age of the stamps of the last odometry when it came
        self._was_inside = False
        self._fenced = False  # the fence had tripped at the last step
        self._now_s = math.nan
        self._odometry_s = math.nan  # newest stamp, at most the time of its step; or time of the first step
        self._link_s = math.nan
        self._charge_s = math.inf  # when the autopilot last reported one, or was first heard
        self._ran_s = 0.0

    def odometry(
        self, stamp_s: float, heading_rad: float, north_m: float, east_m: float, depth_m: float, speed_mps: float
    ) -> None:
        """Updates the vehicle's state to an estimate at `stamp_s`, a time of the steps' clock.

        Estimates with an old stamp are checked, but count as old odometry. Impossible estimates are ignored. So are
        estimates of a frozen estimator: the same position to the last digit with a speed, once the vehicle has moved.
        A depth that has varied and then stays the same under water while the vehicle moves is a warning, and so are
        headings that jump.
        """
        if not is_possible(heading_rad, north_m, east_m) or not math.isfinite(depth_m):
            return
        state = (heading_rad, north_m, east_m)
        self._first = self._first or state
        self._has_moved = self._has_moved or math.dist(state[1:], self._first[1:]) > MOVED_M
        still = self._position is not None and self._position[:2] == (north_m, east_m)
        if self._has_moved and still and abs(speed_mps) > STANDING_MPS:
            return
        moved_m = 0.0 if self._position is None else math.dist(self._position[:2], (north_m, east_m))
        self._way_m += moved_m if moved_m < LONGEST_MOVE_M else 0.0
        self._position = (north_m, east_m, depth_m)
        self._new_positions.append(self._position)
        self._stamp_s = max(self._stamp_s, stamp_s)
        self._heading_jumps = self._heading.update(stamp_s, heading_rad)
        frozen = self._depth_gauge.update(depth_m, north_m, east_m)
        self._depth_frozen = frozen and self._depth_gauge.has_varied and not self._afloat

    def altitude(self, altitude_m: float) -> None:
        """Updates the height above the ground (m); NaN or inf: no echo; 0 or less, and -inf: too low.

        Warns when altitudes stop arriving, and when one repeats itself over more ground than can be flat.
        """
        self._altitude_m = altitude_m
        self._new_altitudes.append(altitude_m)
        if self._position is not None and math.isfinite(altitude_m):
            self._altitude_frozen = self._altimeter.update(altitude_m, *self._position[:2])
        else:
            self._altitude_frozen = False

    def autopilot(self, report: AutopilotReport) -> None:
        """Updates the autopilot's state.

        While it is silent, only the limit *link* counts: no odometry, altitude or pressure can arrive.
        """
        if self._link_known and not report.heard and not self._link_lost and report.stamp_s < self._link_s:
            self._link_s = report.stamp_s
        self._autopilot = report
        self._link_known = self._link_known or report.heard

    @property
    def way(self) -> tuple[float, float, float, float] | None:
        """Way travelled (m), charge (NaN unknown), and the last north and east (m); None without a position."""
        if self._position is None:
            return None
        return self._way_m, self.charge, *self._position[:2]

    @property
    def charge(self) -> float:
        """Charge that the autopilot reports, 0 to 1; NaN unknown."""
        return math.nan if self._autopilot is None else self._autopilot.battery

    @property
    def autopilot_known(self) -> bool:
        """Whether the autopilot has been heard, or there is none."""
        return self._autopilot is None or self._link_known

    @property
    def under_water(self) -> bool | None:
        """Whether the vehicle is under water; None if its depth is unknown."""
        return None if self._position is None else not self._afloat

    def snapshot(self) -> dict[str, Any]:
        """State that must survive a restart and that new reports do not restore."""
        return {"ran_s": self._ran_s, "was_inside": self._was_inside}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self._ran_s, self._was_inside = values["ran_s"], values["was_inside"]

    def step(self, now_s: float, run: MissionRun) -> None:
        """Checks every limit.

        Args:
            run: The vehicle's mission: takes the tripped limits, and whether autopilot and position are ready.
        """
        passed_s = self._pass_time(now_s)
        if self._autopilot is not None:
            run.set_ready(self._autopilot.problem, self._autopilot.depth_problem or self._position_problem)
        else:
            run.set_ready("", self._position_problem)
        state = run.status.state
        if state is RunState.RUNNING:
            self._ran_s += passed_s
        if self._fenced and "fence" not in run.limits:
            self._was_inside = False
            self._times["fence"] = ExceededTime(self._config.patience_s)
        self._check_readings()
        self._check_states()
        exceeded, may_trip = {}, run.has_begun or not self._afloat
        for name, time in self._times.items():
            is_over = time.step(now_s)
            if time.share >= WARNING_SHARE:
                exceeded[name] = self._reasons[name]
            response = self._responses[name]
            if is_over and response != "warn" and may_trip:
                stop = None if response == "abort" else Stop(action=_ACTIONS[response])
                run.trip(name, stop, self._reasons[name])
        self.warnings = {name: reason for name, reason in exceeded.items() if name not in run.limits}
        obeyed = {name for name, response in self._responses.items() if response != "warn" and name != "fence"}
        self.exceeded = {name: why for name, why in exceeded.items() if may_trip and name in obeyed}
        self._fenced = "fence" in run.limits

    @property
    def _afloat(self) -> bool:
        """Whether the vehicle is at the surface; True if its depth is unknown."""
        return self._position is None or self._position[2] <= AFLOAT_M

    def _pass_time(self, now_s: float) -> float:
        """Advances to `now_s`; returns the time (s) since the last step."""
        if math.isnan(self._now_s):
            self._now_s = self._odometry_s = self._link_s = now_s
        passed_s = now_s - self._now_s
        if not 0.0 <= passed_s <= LONGEST_STEP_S:
            self._odometry_s += passed_s
            self._link_s += passed_s
            self._altitude_s += passed_s
            self._charge_s += passed_s
            for time in self._times.values():
                time.shift(passed_s)
            passed_s = 0.0
        self._now_s = now_s
        self._odometry_s = max(self._odometry_s, min(self._stamp_s, now_s))
        if self._stamp_s > -math.inf:
            self._stamps_behind_s, self._stamp_s = now_s - self._stamp_s, -math.inf
        if self._new_altitudes:
            self._altitude_s = now_s
        if not self._link_lost:
            self._link_s = now_s
        else:
            self._odometry_s += passed_s  # one loss, one limit
            self._altitude_s += passed_s
            self._charge_s += passed_s
        if self._autopilot is not None and self._link_known:
            known = math.isfinite(self._autopilot.battery) or math.isinf(self._charge_s)
            self._charge_s = now_s if known else self._charge_s
        return passed_s

    @property
    def _position_problem(self) -> str:
        """Reason why the mission cannot begin, without changing numbers; "" if the vehicle's position is known."""
        age_s = self._config.odometry_age_s
        if self._position is None:
            return "no position has arrived yet"
        if self._stamps_behind_s > age_s:
            return f"positions arrive with stamps more than {age_s:g} s old; check the clock of their sender"
        return f"no position for more than {age_s:g} s" if self._now_s - self._odometry_s > age_s else ""

    @property
    def _link_lost(self) -> bool:
        """Whether the autopilot has been heard, and is silent now."""
        return self._autopilot is not None and self._link_known and not self._autopilot.heard

    def _check_readings(self) -> None:
        """Compares each new position and altitude with its limits."""
        for north_m, east_m, depth_m in self._new_positions:
            why = ""
            if depth_m > self._deepest_m:
                why = f"depth {depth_m:.1f} m, deeper than {self._deepest_m:.1f} m"
            self._add("depth", why)
            outside_m, margin_m = self._fence.outside_m(north_m, east_m), self._fence.margin_m
            self._was_inside = self._was_inside or outside_m <= margin_m
            why = ""
            if self._was_inside and outside_m > margin_m:
                why = (
                    f"{outside_m:.0f} m outside the area (north {north_m:.0f}, east {east_m:.0f} m), more than "
                    f"{margin_m:.0f} m"
                )
            self._add("fence", why)
        least_m = self._config.min_altitude_m
        for altitude_m in self._new_altitudes:
            why = ""
            if altitude_m < least_m and least_m > 0.0:
                why = f"altitude {altitude_m:.1f} m, lower than {least_m:.1f} m"
            self._add("altitude", why)
        self._new_positions.clear()
        self._new_altitudes.clear()

    def _check_states(self) -> None:
        """Compares ages, devices and the mission's time with their limits."""
        found = self._exceeded_states()
        for name in self._times.keys() - set(READINGS):
            self._add(name, found.get(name, ""))

    def _add(self, name: str, reason: str) -> None:
        """Adds a reading of a limit; `reason` is why it exceeds the limit, "" if it does not."""
        self._times[name].add(bool(reason))
        if reason:
            self._reasons[name] = reason

    def _exceeded_states(self) -> dict[str, str]:
        """The exceeded limits of states, each with the reason."""
        config, found = self._config, {}
        if self._depth_frozen and self._position is not None:
            found["depth gauge"] = _frozen_text("depth", self._position[2], self._depth_gauge)
        if self._altitude_frozen:
            found["altimeter"] = _frozen_text("altitude", self._altitude_m, self._altimeter)
        if self._heading_jumps:
            found["heading"] = f"heading jumps by up to {self._heading.largest_deg:.0f} deg; check the compass"
        if (age_s := self._now_s - self._altitude_s) > config.odometry_age_s:
            found["altimeter"] = f"no altitude for {age_s:.0f} s, longer than {config.odometry_age_s:g} s"
        if (age_s := self._now_s - self._odometry_s) > config.odometry_age_s:
            found["odometry"] = f"no usable odometry for {age_s:.0f} s, longer than {config.odometry_age_s:g} s"
            if self._stamps_behind_s > config.odometry_age_s:
                found["odometry"] += f". It arrives with stamps {self._stamps_behind_s:.0f} s old: check its clock"
        if (age_s := self._now_s - self._link_s) > config.link_age_s:
            found["link"] = f"no autopilot heartbeat for {age_s:.0f} s, longer than {config.link_age_s:g} s"
        if self._autopilot is not None and self._autopilot.disobeys and not self._link_lost:
            found["autopilot"] = self._autopilot.disobeys
        if (age_s := self._now_s - self._charge_s) > config.odometry_age_s and config.min_battery > 0.0:
            found["charge"] = f"the autopilot has reported no battery charge for {age_s:.0f} s"
        if self._autopilot is not None and self._autopilot.battery < config.min_battery:
            found["battery"] = f"battery at {self._autopilot.battery:.0%}, below {config.min_battery:.0%}"
        if self._autopilot is not None and self._autopilot.leak == 1:
            found["leak"] = "the autopilot reports a leak"
        if self._autopilot is not None and self._autopilot.depth_problem and not self._link_lost:
            found["pressure"] = self._autopilot.depth_problem
        if 0.0 < config.mission_time_s < self._ran_s:
            found["mission time"] = f"running for {self._ran_s:.0f} s, longer than {config.mission_time_s:g} s"
        return found


def _frozen_text(what: str, value_m: float, sensor: FrozenSensor) -> str:
    return f"{what} frozen at {value_m:g} m for {sensor.moved_m:.0f} m of travel"
