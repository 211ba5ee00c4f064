"""The state machine of one vehicle's mission: waiting, running, holding, aborted, ended. No ROS, no clock.

The inputs are commands of operators and team mates, tripped limits of the safety watch, and whether the autopilot is
ready (armed, in a mode in which it follows targets). `TRANSITIONS` lists the next state for each command and state. A
tripped limit acts like the command HOLD, SURFACE or ABORT, and is latched: GO is refused until RESET.

In state RUNNING, while the autopilot is not ready, the status is WAITING if the vehicle has not moved yet, else
HOLDING; the mission continues by itself when the autopilot is ready again. It also waits for the first position and a
trusted depth; once the vehicle has moved, the limits watch both. Commands can only strengthen the response to a tripped
limit: HOLD does not replace SURFACE.

GO and RESET can set a vehicle in motion, so they are void if they arrive late, or after a command that was given later
and keeps it where it is, or if they were given before the vehicle's start, RESET also before a limit tripped. A command
is as old as its sender states, by the vehicle's own clock (RunMission.srv). All other commands act whenever they
arrive.

After a reboot of the vehicle's computer (`pause`, then `after_reboot`) a mission that ran holds until the vehicle's
depth is known. Under water it then resumes or surfaces. At the surface it waits for GO, which can reach it there.
"""

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple


class RunState(enum.IntEnum):
    """State of a vehicle's mission; numbers as in auv_lse_msgs/MissionState."""

    WAITING = 0
    RUNNING = 1
    HOLDING = 2
    ABORTED = 3
    ENDED = 4


class Action(enum.IntEnum):
    """A vehicle's action; numbers as in auv_lse_msgs/MissionState."""

    TRAVEL = 0
    HOLD = 1
    SURFACE = 2
    GO_TO = 3


class Command(enum.IntEnum):
    """A command to a vehicle's mission; numbers as in auv_lse_msgs/MissionCommand."""

    GO = 1
    HOLD = 2
    SURFACE = 3
    ABORT = 4
    RESET = 5
    END = 6


#: Next state by command and state. A missing state does not change; None: the command is refused.
TRANSITIONS: dict[Command, dict[RunState, RunState | None]] = {
    Command.GO: {
        RunState.WAITING: RunState.RUNNING,
        RunState.RUNNING: RunState.RUNNING,
        RunState.HOLDING: RunState.RUNNING,
        RunState.ABORTED: None,
        RunState.ENDED: None,
    },
    Command.HOLD: {
        RunState.WAITING: RunState.HOLDING,
        RunState.RUNNING: RunState.HOLDING,
        RunState.HOLDING: RunState.HOLDING,
        RunState.ABORTED: RunState.ABORTED,
        RunState.ENDED: RunState.ENDED,
    },
    Command.ABORT: {
        RunState.WAITING: RunState.ABORTED,
        RunState.RUNNING: RunState.ABORTED,
        RunState.HOLDING: RunState.ABORTED,
        RunState.ENDED: RunState.ABORTED,
    },
    Command.RESET: {RunState.HOLDING: RunState.HOLDING, RunState.ABORTED: RunState.HOLDING},
    Command.END: {RunState.WAITING: RunState.ENDED, RunState.RUNNING: RunState.ENDED},
}
TRANSITIONS[Command.SURFACE] = TRANSITIONS[Command.HOLD]

#: Commands that are void if they arrive late, each with the later commands that make it void at once.
STALES: dict[Command, tuple[Command, ...]] = {
    Command.GO: (Command.HOLD, Command.SURFACE, Command.ABORT, Command.RESET),
    Command.RESET: (Command.HOLD, Command.SURFACE, Command.ABORT),
}
#: Time (s) after which they are void if their sender states none. Such a GO may precede the nodes it is meant for.
VALID_S = 10.0

#: The start of a dive and the last trip of a limit, among the times of commands.
_START, _TRIP = "start", "trip"


class Given(NamedTuple):
    """When a command was given, by a clock that is never set while the computer runs: seconds since its start.

    Attributes:
        at_s: When; None: just now.
        now_s: The time.
        valid_s: For how long a GO or RESET counts (s).
    """

    at_s: float | None = None
    now_s: float = 0.0
    valid_s: float = VALID_S


JUST_NOW = Given()

#: Stops by their names in parameters.
STOPS = {"hold": Action.HOLD, "surface": Action.SURFACE, "go_to": Action.GO_TO}

#: Characters of a command's sender that are kept: the state must fit into its file.
MAX_SOURCE = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """A vehicle's action when it does not travel.

    Attributes:
        action: HOLD, SURFACE or GO_TO.
        position_m: North, east (m) of GO_TO; NaN otherwise.
    """

    action: Action
    position_m: tuple[float, float] = (math.nan, math.nan)

    def __post_init__(self) -> None:
        """Rejects TRAVEL, and GO_TO without a position.

        Raises:
            ValueError: naming the action or the position.
        """
        if self.action is Action.TRAVEL:
            raise ValueError("stop: TRAVEL does not stop a vehicle; use HOLD, SURFACE or GO_TO")
        if self.action is Action.GO_TO and not all(map(math.isfinite, self.position_m)):
            raise ValueError(f"stop: GO_TO needs a finite north and east (m), not {self.position_m}")

    def __eq__(self, other: object) -> bool:
        """Compares the action and, for GO_TO, the position."""
        if not isinstance(other, Stop):
            return NotImplemented
        return self.action is other.action and (self.action is not Action.GO_TO or self.position_m == other.position_m)

    def __hash__(self) -> int:
        """Hashes the action."""
        return hash(self.action)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """The status of a vehicle's mission, and the vehicle's action.

    Attributes:
        stop: The vehicle's action when it does not travel; None: it follows its waypoints.
        team_abort: Whether the abort is sent to the team mates by acoustic packet.
        reason: Why the mission is in this state, as a text for operators.
        limits: Tripped limits, each with the reason.
    """

    state: RunState
    stop: Stop | None
    team_abort: bool = False
    reason: str = ""
    limits: tuple[str, ...] = ()

    @property
    def blocked_reason(self) -> str:
        """Why the planner must not plan; "" if the mission runs."""
        if self.state is RunState.RUNNING:
            return ""
        return f"the mission is {self.state.name}: {self.reason}"

    @property
    def waits_for_people(self) -> bool:
        """Whether the mission waits for GO, or holds because of a command, so that only people can continue it."""
        commanded = any(self.reason.startswith(f"{command.name} by ") for command in Command)
        return not self.limits and (commanded or self.reason == _WAITS)

    @property
    def ended_early(self) -> bool:
        """Whether the mission ended or was aborted before its last leg; False without a reason."""
        return self.state in (RunState.ENDED, RunState.ABORTED) and self.reason not in ("", _LAST_LEG)

    def stop_after(self, then: Stop | None) -> Stop | None:
        """The vehicle's stop, given the stop `then` at the end of its newest leg; None: it travels.

        At the mission's end it completes a last leg that ends with the same stop.
        """
        return None if self.state is RunState.ENDED and self.stop == then else self.stop


_WAITS, _LAST_LEG = "waits for GO", "the last leg is complete"
_HOLD, _SURFACE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)


#: Without lockstep the state is published every second. Without one for this time (s), longer than a restart of
#: safety_node takes, no node watches the limits or takes commands.
LONGEST_SILENCE_S = 30.0
#: The state of a vehicle that travels then, until the next state arrives.
UNWATCHED = RunStatus(
    state=RunState.HOLDING, stop=_SURFACE, reason=f"safety_node has been silent for {LONGEST_SILENCE_S:g} s"
)


class MissionRun:
    """The mission of one vehicle; see the module's text.

    Attributes:
        limits: Limits that have tripped since the last RESET, each with the reason.
    """

    def __init__(self, at_once: bool, on_abort: Stop, at_end: Stop = _HOLD) -> None:
        """Sets up the mission.

        Args:
            at_once: Whether it starts without a GO, as soon as autopilot and position are ready.
            on_abort: The vehicle's action after an abort.
            at_end: Its action after the last leg.
        """
        self.limits: dict[str, str] = {}
        self._stops = {
            Command.HOLD: _HOLD,
            Command.SURFACE: _SURFACE,
            Command.RESET: _HOLD,
            Command.ABORT: on_abort,
            Command.END: at_end,
        }
        self._state = RunState.RUNNING if at_once else RunState.WAITING
        self._stop: Stop | None = None if at_once else _HOLD
        self._reason = "" if at_once else _WAITS
        self._not_ready = self._paused = ""
        self._travelled = False
        self._team_abort = False
        self._given_s: dict[str, float] = {}  # when HOLD, SURFACE, ABORT, RESET were given last, _START and _TRIP

    def note_start(self, now_s: float) -> None:
        """Notes when the dive starts, by the clock of commands; `restore` replaces it with the first start."""
        self._given_s[_START] = now_s

    def note_trip(self, now_s: float) -> None:
        """Notes when a limit tripped, by the clock of commands: a RESET given earlier does not clear it."""
        self._given_s[_TRIP] = now_s

    def command(self, command: Command, source: str, team: bool = False, given: Given = JUST_NOW) -> str:
        """Executes a command.

        Args:
            source: Sender, as a text for operators.
            team: With ABORT: whether to send it to the team mates.

        Returns:
            Reason of the refusal; "" if it is accepted.
        """
        if refusal := self._staleness(command, given) or self._refusal(command):
            return f"{command.name}: {refusal}"
        if command in STALES[Command.GO]:  # of a stop, the time of its arrival counts
            at_s = given.now_s if given.at_s is None or command not in STALES else given.at_s
            before_s = self._given_s.get(command.name, at_s)
            self._given_s[command.name] = max(at_s, before_s) if before_s <= given.now_s else at_s  # else a reboot ago
        if command is Command.RESET:
            self.limits.clear()
            self._team_abort = False
        self._team_abort = self._team_abort or (command is Command.ABORT and team)
        reason = _LAST_LEG if command is Command.END else f"{command.name} by {source[:MAX_SOURCE]}"
        self._apply(command, reason)
        return ""

    def trip(self, limit: str, stop: Stop | None, reason: str) -> None:
        """Responds to a tripped limit of the safety watch; ignored if it has already tripped.

        Args:
            stop: HOLD or SURFACE; None: the mission is aborted.
            reason: What has happened, with values, as a text for operators.
        """
        if limit in self.limits:
            return
        if self._state is not RunState.ABORTED:
            command = Command.ABORT if stop is None else Command.SURFACE if stop == _SURFACE else Command.HOLD
            self._apply(command, reason, keep_surface=True)
        self.limits[limit] = reason

    def end_early(self, reason: str) -> None:
        """Ends a running mission before its last leg, with the vehicle's action at the mission's end."""
        if self._state is RunState.RUNNING and not self._paused:
            self._apply(Command.END, reason)

    def snapshot(self) -> dict[str, Any]:
        """The state for a journal, without the autopilot's readiness."""
        stop = None if self._stop is None else [int(self._stop.action), *self._stop.position_m]
        return {
            "state": int(self._state),
            "stop": stop,
            "reason": self._reason,
            "limits": dict(self.limits),
            "team_abort": self._team_abort,
            "travelled": self._travelled,
            "received_s": dict(self._given_s),
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self._state, self._reason = RunState(values["state"]), values["reason"]
        self._stop = None
        if values["stop"] is not None:
            action, north_m, east_m = values["stop"]
            self._stop = Stop(action=Action(action), position_m=(north_m, east_m))
        self.limits = dict(values["limits"])
        self._team_abort, self._travelled = values["team_abort"], values["travelled"]
        self._given_s = dict(values.get("received_s", {}))

    def set_ready(self, problem: str, before_start: str = "") -> None:
        """Sets the reason why the autopilot does not follow targets; "" if it does.

        Args:
            problem: The reason, at any time.
            before_start: Another reason, which counts only until the vehicle has begun to travel.
        """
        self._not_ready = problem or ("" if self._travelled else before_start)
        if not self._not_ready and self._state is RunState.RUNNING:
            self._travelled = True

    @property
    def has_begun(self) -> bool:
        """Whether the vehicle has begun to travel."""
        return self._travelled

    @property
    def waits_for_go(self) -> bool:
        """Whether the mission needs a GO to begin."""
        return self._state is RunState.WAITING

    def pause(self, reason: str) -> None:
        """Holds a running mission until `after_reboot`."""
        self._paused = reason

    def after_reboot(self, under_water: bool, resume: bool) -> None:
        """Ends the pause after a reboot, once it is known where the vehicle is.

        Args:
            under_water: Whether the vehicle is under water, where no GO arrives.
            resume: Whether it resumes a running mission there; else it surfaces.
        """
        self._paused = ""
        if self._state is RunState.RUNNING and under_water and not resume:
            self.trip("reboot", _SURFACE, "the computer was restarted under water")
        elif self._state is RunState.RUNNING and not under_water:
            self._apply(Command.SURFACE, "the computer was restarted at the surface; GO resumes the mission")
        elif self._state is RunState.HOLDING and under_water and self._stop == _HOLD:
            self._stop = _SURFACE
            self._reason += "; surfaces, because the computer was restarted under water, where no GO arrives"

    @property
    def status(self) -> RunStatus:
        """The current status."""
        state, stop, reason = self._state, self._stop, self._reason
        if state is RunState.RUNNING and (self._not_ready or self._paused):
            state = RunState.HOLDING if self._travelled or self._paused else RunState.WAITING
            stop, reason = _HOLD, self._not_ready or self._paused
        return RunStatus(
            state=state,
            stop=stop,
            team_abort=self._team_abort and state is RunState.ABORTED,
            reason=reason,
            limits=tuple(f"{name}: {reason}" for name, reason in self.limits.items()),
        )

    def _staleness(self, command: Command, given: Given) -> str:
        """Why a command comes too late; "" if it does not. A time beyond the present one is from before a reboot."""
        if given.at_s is None or command not in STALES:
            return ""
        if not 0.0 <= given.at_s <= given.now_s:  # nor is NaN
            return "the vehicle's computer has restarted since it was given. Give it again"
        age_s = given.now_s - given.at_s
        if not age_s <= given.valid_s:
            return f"it may be up to {age_s:.0f} s old, and is void after {given.valid_s:g} s. Give it again"
        if age_s > VALID_S and given.at_s < self._given_s.get(_START, -math.inf) <= given.now_s:
            return "the vehicle's nodes have started since it was given. Give it again"
        if command is Command.RESET and given.at_s < self._given_s.get(_TRIP, -math.inf) <= given.now_s:
            return f"a limit has tripped since it was given ({'; '.join(self.limits.values())}). Give it again"
        for later in STALES[command]:
            if given.at_s < self._given_s.get(later.name, -math.inf) <= given.now_s:
                now = f"{self.status.state.name}: {self.status.reason}".rstrip(": ")
                return f"{later.name} was given after it ({now}). Give {command.name} again if you mean it"
        return ""

    def _refusal(self, command: Command) -> str:
        """Why a command is refused; "" if it is not."""
        if TRANSITIONS[command].get(self._state, self._state) is None:
            if self._state is RunState.ABORTED:
                return f"the mission is aborted ({self._reason}); send RESET first"
            return "the mission has ended; restart the nodes for a new one"
        if command is Command.GO and self.limits:
            return f"limits have tripped: {'; '.join(self.limits.values())}; send RESET first"
        return ""

    def _apply(self, command: Command, reason: str, keep_surface: bool = False) -> None:
        """Changes the state according to an accepted command."""
        state = TRANSITIONS[command].get(self._state)
        if state is None:
            return
        stop = self._stops.get(command)
        keep_surface = keep_surface or bool(self.limits) or self._state is RunState.ABORTED
        if command is Command.HOLD and self._stop == _SURFACE and keep_surface:
            stop = _SURFACE
        if state is not self._state or state not in (RunState.ENDED, RunState.ABORTED):
            self._reason = reason  # a mission that is over keeps why
        self._state, self._stop = state, stop
