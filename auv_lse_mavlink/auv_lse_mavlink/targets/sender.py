"""Sends targets, the ends of legs, to the autopilot: one after another or as an uploaded mission; and stops.

Theory of operation
-------------------
Targets arrive in order, each before the previous one is reached. A target with the step of an earlier one replaces it
and all later ones. A target whose leg begins elsewhere than at the last target (by more than `acceptance_m`) replaces
all: the planner has dropped that leg and plans from the vehicle's position. The first target is the current one; the
next replaces it when the vehicle is within `acceptance_m` of it or has passed it. In mode "position_target" the current
one is sent at once, and again as the autopilot needs it (`delivery.py`). In mode "mission" all are uploaded whenever
one is added, and when the autopilot is armed or enters the mode; the first is made the current item, because autopilots
keep their index.

If a target requires it, the vehicle surfaces there for a fix before it continues (`surfacing.py`): the same position is
sent at the surface, then at its depth, and later targets wait.

A stop replaces all targets until it is lifted: it is a target at the vehicle's position when the stop arrived, the same
at the surface, or a position to go to. Then the current target, or the mission, is sent again.

A vehicle that holds, surfaces or has ended its mission stays where it is: when the autopilot is armed, changes its
mode, reboots or returns, the target is the vehicle's position at that time, because it may have been moved. After
the mission's end a vehicle may still be under way, to a recovery position or the last leg's end. If its autopilot then
reboots or is disarmed, people may have it, so it surfaces where it is and goes there only after another command.

The way to the surface and back down is vertical: such a target is the vehicle's position whenever it is sent.

A target that is too deep, or outside the fence and farther out than the vehicle itself, is refused.

`problem` reports an autopilot that refuses its mission, or a vehicle that does not follow its target (`obedience.py`).
"""

import dataclasses
import math
from collections import Counter, deque
from collections.abc import Callable

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.messages.conversion import Target, mission_item, position_target, speed_command
from auv_lse_mavlink.messages.datum import Datum
from auv_lse_mavlink.messages.events import AutopilotEstimate, Event, Problem, TargetSent
from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_mavlink.targets.delivery import Delivery
from auv_lse_mavlink.targets.lift import Lift
from auv_lse_mavlink.targets.limits import TargetLimits
from auv_lse_mavlink.targets.obedience import IGNORED_S, Obedience
from auv_lse_mavlink.targets.surfacing import LONGEST_S, Stage, Surfacing
from auv_lse_mavlink.targets.upload import MissionUpload, UploadState
from auv_lse_mavlink.targets.vertical import VerticalWay
from auv_lse_mavlink.targets.waypoints import following, shifted

#: MAV_RESULT in words.
RESULTS = {value: entry.name for value, entry in mavlink.enums["MAV_RESULT"].items()}
_RISE = Stop(action=Action.SURFACE)
#: A vehicle that stops keeps its target's depth if it is within this (m) of it, else its own.
STOPPED_M = 1.0
#: Largest number of waiting targets, and of the items of an uploaded mission.
MAX_TARGETS = 64


class TargetSender:
    """The targets of one vehicle.

    Attributes:
        refused_speed: The result of DO_CHANGE_SPEED if the autopilot refused the last one.
        lift: Keeps targets above the ground.
    """

    def __init__(
        self,
        config: LinkConfig,
        autopilot: tuple[int, int],
        limits: TargetLimits,
        send: Callable[[Message], None],
        report: Callable[[Event], None],
        counts: Counter[str],
    ) -> None:
        """Starts without targets; `autopilot` is its system and component id, `counts` a counter for targets."""
        self._config, self._autopilot, self._limits = config, autopilot, limits
        self._send, self._report, self._counts = send, report, counts
        self._upload = MissionUpload(send, *autopilot, timeout_s=config.upload_timeout_s, retries=config.upload_retries)
        self._targets: deque[Target] = deque(maxlen=MAX_TARGETS)
        self._surfacing: Surfacing | None = None
        self._surfaced_at: int | None = None  # step of the target at which the vehicle surfaced last
        self._stop: Stop | None = None
        self._stopped_at: Target | None = None
        self._unsent = False  # whether another target was chosen, or the mission must be sent
        self._delivery = Delivery(config.target_period_s)
        self._has_ended = False  # whether the mission's last target, or a stop's position to go to, is reached
        self._stays = False  # whether its next reported position becomes its target
        self._mission_ended = self._abandoned = False  # whether the mission ended, and its way since then was abandoned
        self._here: AutopilotEstimate | None = None  # the vehicle's last position
        self._vertical = VerticalWay()
        self.lift = Lift(limits.least_altitude_m)
        self._autopilot_state, self._was_armed = (False, -1), False  # armed, mode
        self._target_s = -math.inf
        self._uploading: tuple[Target, ...] = ()
        self._speed_mps = math.nan  # the last one sent
        self.refused_speed = ""
        self._obedience = Obedience(config.acceptance_m, limits.turn_radius_m)
        self._unaccepted_s = math.nan  # time since which the autopilot has not accepted a mission; NaN: it has
        self._last_requested = -1  # the last item that it requested
        self._refusal = ""  # why it refused the last one

    @property
    def targets(self) -> tuple[Target, ...]:
        """Ends of legs not yet reached, the current one first."""
        return tuple(self._targets)

    @property
    def settled(self) -> bool:
        """Whether no answer is pending and nothing waits to be sent."""
        waits = self._unsent and (self._is_mission or not self._delivery.once or self._delivery.may_follow)
        return not self._upload.busy and not waits

    @property
    def _is_mission(self) -> bool:
        return self._config.mode == "mission"

    @property
    def current(self) -> Target | None:
        """The target to go to now; None: there is none, or the position of a stop is unknown yet."""
        if self._stop is not None or self._abandoned:
            return self._stopped_at
        if self._stays:
            return None
        if self._surfacing is not None:
            return self._surfacing.target
        return self._targets[0] if self._targets else None

    @property
    def under_way(self) -> bool:
        """Whether targets wait and the mission's last one is not among them."""
        return bool(self._targets) and self._targets[-1].then is None and not self._targets[-1].at_surface

    def problem(self, now_s: float) -> tuple[float, str]:
        """Time (s) for which the autopilot has refused or ignored targets, and how; (0, text) if it is only slow."""
        refused_s = now_s - self._unaccepted_s
        if refused_s >= IGNORED_S:
            return refused_s, f"the autopilot takes no mission for {refused_s:.0f} s: {self._refusal or 'no answer'}"
        if self._obedience.problem:
            return self._obedience.ignored_s, self._obedience.problem
        return 0.0, self._obedience.slow

    def watch(self, now_s: float, position: AutopilotEstimate | None) -> None:
        """Compares an estimate with the current target; None: it cannot be compared now.

        While the vehicle ignores its target, a mission is uploaded again every `IGNORED_S`, a position target is sent
        again as described in `delivery.py`.
        """
        target = self.current
        if position is None or target is None or self.lift.climbs or not (self.settled or self._obedience.problem):
            self._obedience.excuse()
            return
        stopped = self._stop is not None and self._stop.action is Action.HOLD
        diving = self._stop is None and self._surfacing is not None and not target.at_surface
        self._obedience.update(now_s, target, stopped, diving, position)
        if self._obedience.problem and self._is_mission:
            self._unsent = self._unsent or now_s - self._target_s >= IGNORED_S
        elif self._obedience.problem or self._obedience.slow:
            self._delivery.doubt(now_s)

    def feedback(self, now_s: float, wp_dist_m: float, position: AutopilotEstimate) -> None:
        """Adds the distance (m) to its target that the autopilot reports, and an estimate of the same time."""
        if (target := self.current) is not None and not (self._is_mission or self.lift.climbs):
            apart_m = math.dist((target.north_m, target.east_m), (position.north_m, position.east_m))
            self._delivery.feedback(now_s, wp_dist_m, apart_m, position.speed_mps)

    def origin_moved(self) -> None:
        """Discards the delivered target, because the autopilot's frame has moved."""
        self._delivery.forget()

    def doubt(self, now_s: float) -> None:
        """Handles a jump of the autopilot's estimate, by which it may have lost its target."""
        self._delivery.doubt(now_s)

    def add(self, target: Target, position: AutopilotEstimate | None) -> None:
        """Queues the end of the next leg; it replaces a queued end of the same step, and all that follow.

        Raises:
            ValueError: if a number in it is not finite, or it is beyond the limits.
        """
        if not all(map(math.isfinite, (target.north_m, target.east_m, target.depth_m, target.heading_rad))):
            raise ValueError(f"target must be finite: {target}")
        try:
            self._limits.check(target, position)
        except ValueError:
            self._counts["targets_refused"] += 1
            raise
        while self._targets and (self._targets[-1].step >= target.step or self._begins_elsewhere(target)):
            if len(self._targets) == 1:
                self._surfacing = None
            self._targets.pop()
            self._counts["targets_replaced"] += 1
        if len(self._targets) == MAX_TARGETS:
            self._counts["targets_dropped"] += 1
            self._report(Problem(text=f"more than {MAX_TARGETS} targets wait: dropped the oldest"))
        self._targets.append(target)
        self._counts["targets"] += 1
        self._has_ended = self._stays = self._abandoned = False
        if self._is_mission or len(self._targets) == 1:
            self._unsent = True
        if target.then is not None and target.then.action is not Action.HOLD:  # autopilots hold at the last target
            self._targets.append(following(target, target.then))

    def _begins_elsewhere(self, target: Target) -> bool:
        """Whether a leg begins away from the last target, so that the vehicle need not reach that."""
        last = self._targets[-1]
        if target.begins_m is None or last.surface or self._surfacing is not None:
            return False
        return math.dist(target.begins_m, (last.north_m, last.east_m)) > self._config.acceptance_m

    @property
    def stopped(self) -> bool:
        """Whether a stop replaces the targets."""
        return self._stop is not None

    def stop(self, stop: Stop | None, ended: bool = False) -> None:
        """Stops the vehicle, or lets it continue (None); `ended`: after the mission's end."""
        self._mission_ended = ended
        if stop == self._stop:
            return
        self._stop, self._stopped_at, self._abandoned = stop, None, False
        self._has_ended = self._has_ended and self._stops_here
        self._unsent = stop is None and bool(self._targets)

    def resend(self, rebooted: bool = False) -> None:
        """Sends the present targets again: the autopilot was lost, or has rebooted."""
        if rebooted:
            self._abandon_way("rebooted")
        self._upload.abandon("link lost, or autopilot rebooted")
        self._watch_upload()
        self._unaccepted_s = math.nan
        self._autopilot_state = (False, -1)
        self._renew()

    def set_state(self, ardupilot: bool, armed: bool, mode: int, obeys: bool) -> None:
        """Updates the autopilot's state: it forgets target and speed when it is armed or enters a mode.

        Args:
            ardupilot: Whether it is ArduPilot.
            armed: Whether it is armed.
            mode: Its flight mode.
            obeys: Whether it follows targets in that mode.
        """
        if self._was_armed and not armed:
            self._abandon_way("was disarmed")
        self._was_armed = armed
        self._delivery.once, self._delivery.may_follow = ardupilot, armed and obeys
        if self._delivery.may_follow and (armed, mode) != self._autopilot_state:
            self._renew()
        self._autopilot_state = (armed, mode)

    def _abandon_way(self, cause: str) -> None:
        """Ends a way after the mission's end, or to the position of a stop: people may have the vehicle by now."""
        goes_to = self._stop is not None and self._stop.action is Action.GO_TO
        if self._has_ended or self._abandoned or not (goes_to or (self._mission_ended and self._stop is None)):
            return
        if self.current is None:
            return
        self._abandoned, self._stopped_at, self._surfacing = True, None, None
        text = f"the autopilot {cause} on the vehicle's way after its mission: it surfaces where it is"
        self._report(Problem(text=f"{text} (ABORT, with safety.abort: go_to, sends it to the recovery position)"))

    def _renew(self) -> None:
        """Sends target and speed again, or takes the vehicle's position as its target."""
        self._speed_mps, self.refused_speed = math.nan, ""
        self._delivery.forget()
        if self._abandoned or (self._stop is not None and (self._has_ended or self._stops_here)):
            self._stopped_at = None
        elif self._stop is None and self._has_ended:
            self._stays = True
        self._unsent = self.current is not None

    @property
    def _stops_here(self) -> bool:
        return self._stop is None or self._stop.action is not Action.GO_TO

    def poll(self, now_s: float) -> None:
        """Lets time pass: repeats unanswered messages of an upload."""
        self._upload.poll(now_s)
        self._watch_upload()

    def requested(self, now_s: float, number: int) -> None:
        """Handles the autopilot's request for an item of the mission."""
        self._upload.request(now_s, number)
        if not self._refusal and number > self._last_requested:  # a long upload may take its time
            self._last_requested, self._unaccepted_s = number, now_s
        self._watch_upload()

    def acknowledged(self, now_s: float, result: int) -> None:
        """Handles the autopilot's answer to the mission."""
        if self._upload.busy:
            self._upload.acknowledge(now_s, result)
            self._watch_upload()

    def speed_answered(self, result: int) -> None:
        """Handles the autopilot's answer to a speed (MAV_RESULT)."""
        self.refused_speed = ""
        if result not in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS):
            self._counts["speeds_refused"] += 1
            self.refused_speed = RESULTS.get(result, str(result))

    def restart_answered(self, now_s: float, result: int) -> None:
        """Handles the autopilot's answer to the command that makes an item the current one (MAV_RESULT)."""
        self._upload.restart_answered(now_s, result)

    def now_at_item(self, number: int, state: int) -> None:
        """Handles the autopilot's report of its current item and the mission's state (MISSION_STATE; 0: unknown)."""
        self._upload.current(number, state, self._delivery.may_follow)
        self._watch_upload()

    def gps(self, now_s: float, has_fix: bool) -> None:
        """Records whether GPS has a fix at `now_s` (s)."""
        if self._surfacing is not None:
            self._surfacing.gps(now_s, has_fix)

    def pass_reached(self, now_s: float, position: AutopilotEstimate | None) -> None:
        """Drops reached targets, begins surfacings, and determines the position of a stop."""
        self._here = position
        self._pass_reached(now_s, position)
        if position is not None and self.lift.update(now_s, self.current, position):
            self._counts["lifts"] += 1
            self._unsent = True

    def _pass_reached(self, now_s: float, position: AutopilotEstimate | None) -> None:
        if self._stop is not None or self._abandoned:
            if position is not None:
                self._stop_at(self._stop or _RISE, position)
            return
        if self._stays and position is not None:
            self._targets[0] = dataclasses.replace(
                self._targets[0], north_m=position.north_m, east_m=position.east_m, heading_rad=position.heading_rad
            )
            if not self._targets[0].at_surface:
                self._targets[0] = dataclasses.replace(self._targets[0], depth_m=position.depth_m)
            self._stays, self._unsent = False, True
        if position is None or (self._surfacing is not None and not self._surfaced(now_s, self._surfacing, position)):
            return
        while self._targets and self._reached(self._targets[0], position):
            if self._targets[0].surface:
                self._targets[0] = dataclasses.replace(self._targets[0], surface=False)
                self._surfacing, self._unsent = Surfacing(self._targets[0], now_s), True
                self._counts["surfacings"] += 1
                return
            if len(self._targets) == 1:
                self._has_ended = self._has_ended or not self.under_way
                return
            self._targets.popleft()
            self._counts["reached"] += 1
            if not self._is_mission:
                self._unsent = True

    def _stop_at(self, stop: Stop, position: AutopilotEstimate) -> None:
        """Determines the position of a stop."""
        if self._stopped_at is None:
            here = Stop(action=Action.HOLD) if self._has_ended and stop.action is Action.GO_TO else stop
            self._stopped_at = self._position_of(_RISE if self._abandoned else here, position)
            self._unsent = True
        if stop.action is Action.GO_TO and not self._abandoned:
            self._has_ended = self._has_ended or self._reached(self._stopped_at, position)

    def _surfaced(self, now_s: float, surfacing: Surfacing, position: AutopilotEstimate) -> bool:
        """Advances a surfacing; returns whether it is over."""
        if not surfacing.proceed(now_s, position.depth_m):
            return False
        if surfacing.stage is Stage.DOWN and not surfacing.fixed:
            self._counts["surfacings_without_fix"] += 1
            self._report(Problem(text=f"surfaced for {LONGEST_S:.0f} s without a GPS fix: diving again"))
        if surfacing.stage is Stage.OVER:
            self._surfacing, self._surfaced_at = None, self._targets[0].step
        self._unsent = True
        return surfacing.stage is Stage.OVER

    def send(self, now_s: float, boot_ms: int, datum: Datum, own_depth: Callable[[float], float]) -> None:
        """Sends due messages; call it only if the autopilot is heard and its frame is known.

        Args:
            now_s: The host's clock.
            boot_ms: The autopilot's time since boot.
            datum: The mission's origin and the autopilot's.
            own_depth: Converts a depth (m) to the autopilot's own.
        """
        current = self.current
        if current is None:
            return
        current = self.lift.lifted(current)
        is_vertical = current.at_surface or (self._stop is None and self._surfacing is not None) or self.lift.climbs
        renewed = self._unsent or self._delivery.is_doubtful
        current = self._vertical.target(current, self._here, renewed) if is_vertical else current
        if self._is_mission:
            later = self._stop is None and self._surfacing is None and not current.at_surface and not self._abandoned
            later = later and not self.lift.climbs
            self._send_mission(now_s, datum, (current, *list(self._targets)[1:] * later), own_depth)
        else:
            self._send_position_target(now_s, boot_ms, datum, current, own_depth)

    def _send_position_target(
        self, now_s: float, boot_ms: int, datum: Datum, target: Target, own_depth: Callable[[float], float]
    ) -> None:
        own = shifted(target, own_depth)
        north_m, east_m = datum.to_local_ned(target.north_m, target.east_m)
        in_its_frame = dataclasses.replace(own, north_m=north_m, east_m=east_m)
        if not self._delivery.is_due(now_s, in_its_frame, self._unsent):
            self._unsent = self._unsent and not self._delivery.may_follow
            return
        if self._delivery.is_doubtful:
            self._speed_mps = math.nan
            self._counts["targets_forgotten"] += 1
        self._send_speed(target)
        self._send(position_target(own, datum, boot_ms, *self._autopilot))
        self._delivery.sent(now_s, in_its_frame)
        self._counts["target_messages"] += 1
        if self._unsent:
            self._counts["targets_sent"] += 1
            self._report(TargetSent(target=target))
        self._unsent = False
        self._target_s = now_s

    def _send_mission(
        self,
        now_s: float,
        datum: Datum,
        wanted: tuple[Target, ...],
        own_depth: Callable[[float], float],
    ) -> None:
        if self._upload.busy or not self._unsent:
            return
        if self._upload.state is UploadState.FAILED and now_s - self._target_s < self._config.upload_timeout_s:
            return
        self._unsent = False
        self._target_s = now_s
        if math.isnan(self._unaccepted_s):
            self._unaccepted_s = now_s
        self._uploading, self._last_requested = wanted, -1
        ardupilot = self._delivery.once
        ends = [wanted[0], *wanted] if ardupilot else wanted  # ArduPilot: item 0 is the home
        items = [
            mission_item(shifted(end, own_depth), datum, number, self._config.acceptance_m, *self._autopilot)
            for number, end in enumerate(ends)
        ]
        self._upload.start(now_s, items, first=int(ardupilot), restarts=ardupilot)

    def _send_speed(self, target: Target) -> None:
        if math.isfinite(target.speed_mps) and target.speed_mps != self._speed_mps:
            self._speed_mps = target.speed_mps
            self._send(speed_command(target.speed_mps, *self._autopilot))
            self._counts["speeds"] += 1

    def _watch_upload(self) -> None:
        """Reports an upload that has just ended."""
        if not self._uploading or self._upload.busy:
            return
        if self._upload.state is UploadState.DONE:
            self._counts["uploads"] += 1
            self._unaccepted_s, self._refusal = math.nan, ""
            self._send_speed(self._uploading[0])  # a mission that begins would reset an earlier one
            self._report(TargetSent(target=self._uploading[-1]))
        else:
            self._counts["uploads_failed"] += 1
            self._refusal = self._upload.problem
            self._report(Problem(text=f"mission upload: {self._upload.problem}"))
            self._unsent = True  # tried again after upload_timeout_s, with the targets of that time
        self._uploading = ()

    def _position_of(self, stop: Stop, position: AutopilotEstimate) -> Target:
        depth_m = self._targets[0].depth_m if self._targets else position.depth_m
        if abs(depth_m - position.depth_m) > STOPPED_M:
            depth_m = position.depth_m
        here = Target(
            north_m=position.north_m, east_m=position.east_m, depth_m=depth_m, heading_rad=position.heading_rad
        )
        return following(here, stop)

    def _reached(self, target: Target, position: AutopilotEstimate) -> bool:
        if target.step == self._surfaced_at:  # it may have drifted at the surface, and continues from there
            return True
        north, east = target.north_m - position.north_m, target.east_m - position.east_m
        ahead_m = north * math.cos(target.heading_rad) + east * math.sin(target.heading_rad)
        aside_m = abs(east * math.cos(target.heading_rad) - north * math.sin(target.heading_rad))
        # near it, or past the line across the leg's end, at most twice the acceptance aside
        acceptance_m = self._config.acceptance_m
        return math.hypot(north, east) <= acceptance_m or (ahead_m <= 0.0 and aside_m <= 2.0 * acceptance_m)
