"""How it stands with the mission of one vehicle: waiting, running, holding, aborted, ended. Knows no ROS and no clock.

Theory of operation
-------------------
Somebody gives commands; limits of the safety watch trip; the autopilot may not be ready (disarmed, or in a mode in
which it does not follow targets). `MissionRun.status` is what follows for the vehicle.

    state     GO         HOLD, SURFACE   ABORT     RESET        END     a limit trips: hold, surface / abort
    WAITING   RUNNING    HOLDING         ABORTED   -            ENDED   HOLDING / ABORTED
    RUNNING   -          HOLDING         ABORTED   -            ENDED   HOLDING / ABORTED
    HOLDING   RUNNING*   HOLDING         ABORTED   HOLDING      -       HOLDING / ABORTED
    ABORTED   refused    refused         ABORTED   HOLDING      -       -
    ENDED     refused    ENDED           ABORTED   -            -       ENDED / ABORTED

    * refused while a limit has tripped: RESET forgets the limits first.

While RUNNING is asked for and the autopilot is not ready, the vehicle is WAITING if it has not travelled yet, else
HOLDING; it goes on by itself when the autopilot is ready again. A tripped limit's action is the least that is done: an
operator may ask for more, as the surface instead of a hold.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


class RunState(enum.IntEnum):
    """Where a vehicle's mission is; the numbers are those of auv_lse_msgs/MissionState."""

    WAITING = 0
    RUNNING = 1
    HOLDING = 2
    ABORTED = 3
    ENDED = 4


class Action(enum.IntEnum):
    """What a vehicle is to do; the numbers are those of auv_lse_msgs/MissionState."""

    TRAVEL = 0
    HOLD = 1
    SURFACE = 2
    GO_TO = 3


class Command(enum.IntEnum):
    """What somebody wants of a mission; the numbers are those of auv_lse_msgs/MissionCommand."""

    GO = 1
    HOLD = 2
    SURFACE = 3
    ABORT = 4
    RESET = 5
    END = 6


#: Stops by the names that parameters have for them.
STOPS = {"hold": Action.HOLD, "surface": Action.SURFACE, "go_to": Action.GO_TO}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """What a vehicle does in place of travelling.

    Attributes:
        action: HOLD, SURFACE or GO_TO.
        place_m: North, east (m) of GO_TO; NaN otherwise.
    """

    action: Action
    place_m: tuple[float, float] = (math.nan, math.nan)

    def __post_init__(self) -> None:
        """Refuses what is no stop.

        Raises:
            ValueError: naming the action or the place.
        """
        if self.action is Action.TRAVEL:
            raise ValueError("stop: TRAVEL is none; expected HOLD, SURFACE or GO_TO")
        if self.action is Action.GO_TO and not all(map(math.isfinite, self.place_m)):
            raise ValueError(f"stop: GO_TO the place {self.place_m}; expected its north and east in m")

    def __eq__(self, other: object) -> bool:
        """Equal in action and, for GO_TO, in place."""
        if not isinstance(other, Stop):
            return NotImplemented
        return self.action is other.action and (self.action is not Action.GO_TO or self.place_m == other.place_m)

    def __hash__(self) -> int:
        """As it is equal."""
        return hash(self.action)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """How it stands with a vehicle's mission, and what the vehicle is to do.

    Attributes:
        state: Where the mission is.
        stop: What the vehicle does in place of travelling; None: it follows its waypoints.
        team_abort: Whether the team mates are to be told of the abort by acoustic packet.
        reason: Why it is so, for people.
        limits: Limits that have tripped, each with the reason.
    """

    state: RunState
    stop: Stop | None
    team_abort: bool = False
    reason: str = ""
    limits: tuple[str, ...] = ()

    @property
    def blocked_reason(self) -> str:
        """Why nothing is to be planned now; "" if the mission goes, or has gone to its end."""
        if self.state in (RunState.RUNNING, RunState.ENDED):
            return ""
        return f"the mission is {self.state.name}: {self.reason}"


_HOLD, _SURFACE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)


class MissionRun:
    """The mission of one vehicle; see the module's text.

    Attributes:
        limits: Limits that have tripped since the last RESET, each with the reason.
    """

    def __init__(self, at_once: bool, on_abort: Stop) -> None:
        """Before the mission.

        Args:
            at_once: Whether it starts without a GO, as soon as the autopilot is ready.
            on_abort: What the vehicle does after an abort.
        """
        self.limits: dict[str, str] = {}
        self._on_abort = on_abort
        self._state = RunState.RUNNING if at_once else RunState.WAITING
        self._stop: Stop | None = None if at_once else _HOLD
        self._reason = "" if at_once else "waits for GO"
        self._not_ready = ""
        self._travelled = False
        self._team_abort = False

    def command(self, command: Command, source: str, team: bool = False) -> str:
        """Takes a command.

        Args:
            command: What is wanted.
            source: Who wants it, for people.
            team: With ABORT: whether the team mates are to be told.

        Returns:
            Why it is refused; "" if it is taken.
        """
        state = self._state
        if state is RunState.ABORTED and command not in (Command.ABORT, Command.RESET, Command.END):
            return f"{command.name}: the mission is aborted ({self._reason}); expected RESET first"
        match command:
            case Command.GO:
                return self._go(source)
            case Command.HOLD | Command.SURFACE:
                self._hold(_HOLD if command is Command.HOLD else _SURFACE, f"{command.name} by {source}")
            case Command.ABORT:
                self._team_abort = self._team_abort or team
                self._abort(f"ABORT by {source}")
            case Command.RESET:
                self._reset(source)
            case Command.END:
                if state in (RunState.WAITING, RunState.RUNNING):
                    self._state, self._stop, self._reason = RunState.ENDED, None, "the last leg is travelled"
        return ""

    def trip(self, limit: str, stop: Stop | None, reason: str) -> None:
        """A limit of the safety watch has tripped; nothing happens if it had already.

        Args:
            limit: Its name.
            stop: HOLD or SURFACE; None: the mission is aborted.
            reason: What has happened, with values, for people.
        """
        if limit in self.limits:
            return
        if self._state is RunState.ABORTED:
            pass
        elif stop is None:
            self._abort(reason)
        else:
            self._hold(_SURFACE if self._stop == _SURFACE else stop, reason)
        self.limits[limit] = reason

    def snapshot(self) -> dict[str, Any]:
        """How it stands, for a journal; the autopilot tells anew whether it is ready."""
        stop = None if self._stop is None else [int(self._stop.action), *self._stop.place_m]
        return {
            "state": int(self._state),
            "stop": stop,
            "reason": self._reason,
            "limits": dict(self.limits),
            "team_abort": self._team_abort,
            "travelled": self._travelled,
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Goes on from what `snapshot` gave."""
        self._state, self._reason = RunState(values["state"]), values["reason"]
        self._stop = None
        if values["stop"] is not None:
            action, north_m, east_m = values["stop"]
            self._stop = Stop(action=Action(action), place_m=(north_m, east_m))
        self.limits = dict(values["limits"])
        self._team_abort, self._travelled = values["team_abort"], values["travelled"]

    def set_ready(self, problem: str) -> None:
        """Whether the autopilot follows targets: "" if so, else what keeps it from that."""
        self._not_ready = problem
        if not problem and self._state is RunState.RUNNING:
            self._travelled = True

    @property
    def status(self) -> RunStatus:
        """How it stands now."""
        state, stop, reason = self._state, self._stop, self._reason
        if state is RunState.RUNNING and self._not_ready:
            state = RunState.HOLDING if self._travelled else RunState.WAITING
            stop, reason = _HOLD, self._not_ready
        return RunStatus(
            state=state,
            stop=stop,
            team_abort=self._team_abort and state is RunState.ABORTED,
            reason=reason,
            limits=tuple(f"{name}: {reason}" for name, reason in self.limits.items()),
        )

    def _go(self, source: str) -> str:
        if self._state is RunState.ENDED:
            return "GO: the mission has ended; expected a new one (the nodes started again)"
        if self.limits:
            return f"GO: limits have tripped: {'; '.join(self.limits.values())}; expected RESET first"
        self._state, self._stop, self._reason = RunState.RUNNING, None, f"GO by {source}"
        return ""

    def _hold(self, stop: Stop, reason: str) -> None:
        if self.limits and self._stop == _SURFACE:
            stop = _SURFACE
        if self._state is not RunState.ENDED:
            self._state = RunState.HOLDING
        self._stop, self._reason = stop, reason

    def _abort(self, reason: str) -> None:
        if self._state is not RunState.ABORTED:
            self._state, self._stop, self._reason = RunState.ABORTED, self._on_abort, reason

    def _reset(self, source: str) -> None:
        self.limits.clear()
        self._team_abort = False
        if self._state in (RunState.HOLDING, RunState.ABORTED):
            self._state, self._stop, self._reason = RunState.HOLDING, _HOLD, f"RESET by {source}"
