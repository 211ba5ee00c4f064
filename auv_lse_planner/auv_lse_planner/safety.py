"""One vehicle's mission and its safety watch, built from the parameters; `safety_node` owns them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig, with_depth
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_common.vocabulary.mission_run import JUST_NOW, Action, Command, Given, MissionRun, RunState, Stop
from auv_lse_planner.battery_watch import BatteryWatch

#: While a vehicle waits, its instruments have this time (s) to report before its operator sees which is missing.
STARTING_S = 10.0


@dataclass(slots=True)
class Safety:
    """The mission of a vehicle and the watch over it."""

    run: MissionRun
    watch: SafetyWatch
    config: SafetyConfig
    battery: BatteryWatch
    _rebooted: bool = False  # and the vehicle's depth is not known yet
    _wet_steps: int = 0  # steps under water minus steps at the surface, since the first known depth
    _since_s: float = math.nan  # time of the first of these steps; NaN if none
    _began_s: float = math.nan  # time of the first step

    @classmethod
    def of(cls, parameters: Mapping[str, Any], where: str, vehicle: int, waits: bool = False) -> Safety:
        """Builds mission and watch from a nested parameter mapping; other sections are ignored.

        Args:
            waits: Whether the mission waits for GO even if `vehicle.start` is at_once.

        Raises:
            ParameterError: naming the key, the value, what was expected and `where`.
        """
        parameters = with_depth(parameters, vehicle)
        safety = section(SafetyConfig, parameters, "safety", where)
        own = section(VehicleConfig, parameters, "vehicle", where)
        area = section(AreaConfig, parameters, "area", where)
        mission = section(MissionConfig, parameters, "mission", where)
        motion = section(MotionConfig, parameters, "motion", where)
        link = parameters.get("link", {})
        try:
            on_abort = own.stop("safety.abort", safety.abort)
        except ParameterError as error:
            raise ParameterError(f"{where}: {error}") from error
        fence = Fence(area.polygon_m, safety.fence_margin_m)
        for key, stop in (("vehicle.at_end", own.stop_at_end), ("safety.abort", on_abort)):
            if stop.action is Action.GO_TO and (outside_m := fence.outside_m(*stop.position_m)) > fence.margin_m:
                raise ParameterError(
                    f"{where}: vehicle.recovery_north_m, recovery_east_m = {stop.position_m[0]:g}, "
                    f"{stop.position_m[1]:g} m, the target of {key}, is {outside_m:.0f} m outside "
                    f"area.polygon_m, more than safety.fence_margin_m ({fence.margin_m:g} m). Move it inward"
                )
        has_autopilot = isinstance(link, Mapping) and link.get("kind") == "mavlink"
        # An old folder or another card looks like a first start, so a vehicle that can move never starts by itself.
        at_once = own.start == "at_once" and not waits and ("sim" in parameters or not has_autopilot)
        return cls(
            run=MissionRun(at_once, on_abort, own.stop_at_end),
            watch=SafetyWatch(safety, fence, safety.deepest_m(own.depth_m), has_autopilot, own.depth_m > 0.0),
            config=safety,
            battery=BatteryWatch.of(own, safety, area, mission, motion),
        )

    def command(self, command: Command, source: str, team: bool = False, given: Given = JUST_NOW) -> str:
        """Gives the mission a command; returns why it is refused, "" if it is accepted.

        The first GO is refused if the battery lasts for too little of the mission; RESET while a limit that has tripped
        is exceeded, because it would trip again at once. `MissionRun.command` describes the arguments.
        """
        exceeded = "; ".join(f"{name}: {why}" for name, why in self.watch.exceeded.items() if name in self.run.limits)
        if command is Command.RESET and exceeded:
            return f"RESET: a limit is still exceeded and would trip again ({exceeded}). Send RESET when it is not"
        is_first = not (self.run.has_begun or self.battery.went or self.run.status.state is RunState.RUNNING)
        if command is Command.GO and is_first:
            refusal, self.battery.warning = self.battery.answer_go(self.watch.charge)
            if refusal:
                return f"GO: {refusal}"
        refusal = self.run.command(command, source, team, given)
        self.battery.went = self.battery.went or (command is Command.GO and not refusal)
        return refusal

    def step(self, now_s: float) -> None:
        """Checks every limit; reacts to a reboot, and to waiting under water for a GO that cannot arrive."""
        self.watch.step(now_s, self.run)
        self._began_s = now_s if math.isnan(self._began_s) else self._began_s
        self._watch_battery(now_s)
        under_water = self.watch.under_water
        if under_water is None or not (self._rebooted or self.run.waits_for_go):
            self._wet_steps, self._since_s = 0, math.nan
            return
        if math.isnan(self._since_s) or now_s < self._since_s:  # the first step, or the clock was set back
            self._since_s = now_s
        self._wet_steps += 1 if under_water else -1
        if now_s - self._since_s < self.config.patience_s:
            return
        wet, self._wet_steps, self._since_s = self._wet_steps > 0, 0, now_s
        if self._rebooted:
            self._rebooted = False
            self.run.after_reboot(wet, self.config.after_reboot == "resume")
        if wet and self.run.waits_for_go:
            reason = "waits for GO under water, where none arrives"
            self.run.trip("waiting", Stop(action=Action.SURFACE), reason)

    def _watch_battery(self, now_s: float) -> None:
        """Updates the battery's range; ends the mission while it still reaches the recovery position."""
        way = self.watch.way
        if way is None or not self.battery.is_watched or self.run.status.state is not RunState.RUNNING:
            return
        if reason := self.battery.take(now_s, way):
            self.run.end_early(reason)

    @property
    def warnings(self) -> dict[str, str]:
        """Reasons of exceeded limits that have not tripped, by key, and of GO's warning until the battery is known."""
        is_news = self.battery.warning and not self.battery.use.is_known and self.run.status.state is RunState.RUNNING
        return self.watch.warnings | ({"mission": self.battery.warning} if is_news else {})

    def snapshot(self) -> dict[str, Any]:
        """The mission's and the watch's state, for a state file."""
        return {
            "run": self.run.snapshot(),
            "watch": self.watch.snapshot(),
            "battery": self.battery.use.snapshot(),
            "rebooted": self._rebooted,
            "under_water": self.watch.under_water,
        }

    def recover(self, values: Mapping[str, Any], lost: str, rebooted: bool, doubt: str = "") -> None:
        """Continues after a restart.

        Args:
            values: The last `snapshot`; empty at a first start, or if it is lost.
            lost: Why it is lost, or "".
            rebooted: Whether all the vehicle's programs were started again since.
            doubt: Why other state of the dive cannot be trusted, so that no mission may continue; or "".
        """
        if not values:
            if lost or doubt:
                self.distrust(lost or doubt)
            return
        self.run.restore(values["run"])
        self.watch.restore(values["watch"])
        self.battery.use.restore(values.get("battery", {}))
        self._rebooted = rebooted or values["rebooted"]
        if self._rebooted:
            self.run.pause("the computer was restarted; the vehicle's depth is not known yet")
        if rebooted and doubt:
            self.distrust(doubt)

    def distrust(self, reason: str) -> None:
        """Reacts to a lost state after a restart: the vehicle surfaces and holds until RESET.

        Args:
            reason: Why the state is lost, as a text for operators.
        """
        self.run.trip("state_lost", Stop(action=Action.SURFACE), reason)

    def problems(self) -> dict[str, str]:
        """Texts about exceeded and tripped limits, by key."""
        found = {f"tripped {name}": f"{name}: {why} (latched until RESET)" for name, why in self.run.limits.items()}
        return found | {name: f"{name}: {reason}" for name, reason in self.warnings.items()}

    def news(self, now_s: float) -> dict[str, str]:
        """The problems to show an operator; in the first `STARTING_S` of waiting, only limits that have tripped."""
        starts = self.run.status.state is RunState.WAITING and 0.0 <= now_s - self._began_s < STARTING_S
        return {key: text for key, text in self.problems().items() if not starts or key not in self.warnings}

    def health(self) -> Health:
        """The state of the mission."""
        status = self.run.status
        bad = Level.ERROR if self.run.limits or status.state is RunState.ABORTED else Level.OK
        level = max(bad, Level.WARN if self.warnings else Level.OK)
        text = "; ".join(self.problems().values()) or status.reason or "ok"
        action = Action.TRAVEL if status.stop is None else status.stop.action
        values = {"state": status.state.name, "action": action.name}
        if self.watch.way is not None and status.state is RunState.RUNNING:
            values |= self.battery.values(*self.watch.way[2:])
        return Health(level=level, text=text, values=values)
