"""How it stands with the mission of one vehicle: waiting, running, holding, aborted, ended. Knows no ROS and no clock.

Theory of operation
-------------------
Somebody gives commands; limits of the safety watch trip; the autopilot may not be ready (disarmed, or in a mode in
which it does not follow targets). `MissionRun.standing` is what follows for the vehicle.

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
from dataclasses import dataclass


class RunState(enum.IntEnum):
    """Where a vehicle's mission is; the numbers are those of auv_lse_msgs/MissionState."""

    WAITING = 0
    RUNNING = 1
    HOLDING = 2
    ABORTED = 3
    ENDED = 4


class Action(enum.IntEnum):
    """What a vehicle is to do, the mildest first; the numbers are those of auv_lse_msgs/MissionState."""

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


#: Actions by the names that parameters have for them.
ACTIONS = {"hold": Action.HOLD, "surface": Action.SURFACE, "go_to": Action.GO_TO}


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """How it stands with a vehicle's mission, and what the vehicle is to do.

    Attributes:
        state: Where the mission is.
        action: What the vehicle is to do.
        place_m: North, east (m) of GO_TO; NaN otherwise.
        team_abort: Whether the team mates are to be told of the abort by acoustic packet.
        reason: Why it is so, for people.
        limits: Names of the limits that have tripped.
    """

    state: RunState
    action: Action
    place_m: tuple[float, float] = (math.nan, math.nan)
    team_abort: bool = False
    reason: str = ""
    limits: tuple[str, ...] = ()


class MissionRun:
    """The mission of one vehicle; see the module's text.

    Attributes:
        limits: Limits that have tripped since the last RESET, each with the reason.
    """

    def __init__(
        self, at_once: bool, on_abort: Action = Action.SURFACE, recovery_m: tuple[float, float] = (math.nan, math.nan)
    ) -> None:
        """Before the mission.

        Args:
            at_once: Whether it starts without a GO, as soon as the autopilot is ready.
            on_abort: What the vehicle does after an abort.
            recovery_m: North, east (m) where GO_TO leads.

        Raises:
            ValueError: if GO_TO is asked for and the place is not known.
        """
        if on_abort is Action.GO_TO and not all(map(math.isfinite, recovery_m)):
            raise ValueError(f"an abort is to lead to the place {recovery_m}; expected its north and east in m")
        self.limits: dict[str, str] = {}
        self._on_abort, self._recovery_m = on_abort, recovery_m
        self._state = RunState.RUNNING if at_once else RunState.WAITING
        self._action = Action.TRAVEL
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
                self._hold(Action.HOLD if command is Command.HOLD else Action.SURFACE, f"{command.name} by {source}")
            case Command.ABORT:
                self._team_abort = self._team_abort or team
                self._abort(f"ABORT by {source}")
            case Command.RESET:
                self._reset(source)
            case Command.END:
                if state in (RunState.WAITING, RunState.RUNNING):
                    self._state, self._action, self._reason = RunState.ENDED, Action.TRAVEL, "the last leg is travelled"
        return ""

    def trip(self, limit: str, action: Action | None, reason: str) -> None:
        """A limit of the safety watch has tripped; nothing happens if it had already.

        Args:
            limit: Its name.
            action: HOLD or SURFACE; None: the mission is aborted.
            reason: What has happened, with values, for people.
        """
        if limit in self.limits:
            return
        self.limits[limit] = reason
        if self._state is RunState.ABORTED:
            return
        if action is None:
            self._abort(reason)
        else:
            self._hold(max(action, self._action if self._action is not Action.GO_TO else Action.HOLD), reason)

    def set_ready(self, problem: str) -> None:
        """Whether the autopilot follows targets: "" if so, else what keeps it from that."""
        self._not_ready = problem
        if not problem and self._state is RunState.RUNNING:
            self._travelled = True

    @property
    def standing(self) -> Standing:
        """How it stands now."""
        state, action, reason = self._state, self._action, self._reason
        if state is RunState.RUNNING and self._not_ready:
            state = RunState.HOLDING if self._travelled else RunState.WAITING
            action, reason = Action.HOLD, self._not_ready
        elif state is RunState.WAITING:
            action = Action.HOLD
        return Standing(
            state=state,
            action=action,
            place_m=self._recovery_m if action is Action.GO_TO else (math.nan, math.nan),
            team_abort=self._team_abort and state is RunState.ABORTED,
            reason=reason,
            limits=tuple(self.limits),
        )

    def _go(self, source: str) -> str:
        if self._state is RunState.ENDED:
            return "GO: the mission has ended; expected a new one (the nodes started again)"
        if self.limits:
            return f"GO: limits have tripped: {'; '.join(self.limits.values())}; expected RESET first"
        self._state, self._action, self._reason = RunState.RUNNING, Action.TRAVEL, f"GO by {source}"
        return ""

    def _hold(self, action: Action, reason: str) -> None:
        least = Action.SURFACE if self.limits and self._action is Action.SURFACE else Action.HOLD
        if self._state is not RunState.ENDED:
            self._state = RunState.HOLDING
        self._action, self._reason = max(action, least), reason

    def _abort(self, reason: str) -> None:
        if self._state is not RunState.ABORTED:
            self._state, self._action, self._reason = RunState.ABORTED, self._on_abort, reason

    def _reset(self, source: str) -> None:
        self.limits.clear()
        self._team_abort = False
        if self._state in (RunState.HOLDING, RunState.ABORTED):
            self._state, self._action, self._reason = RunState.HOLDING, Action.HOLD, f"RESET by {source}"
