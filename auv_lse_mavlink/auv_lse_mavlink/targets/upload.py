"""Upload of a mission over MAVLink: a state machine for the MAVLink mission protocol.

state      what happens                          next
IDLE       start(items)                          COUNTED    MISSION_COUNT sent
COUNTED    MISSION_REQUEST or _INT 0             GIVING     item 0 sent
GIVING     MISSION_REQUEST or _INT n             GIVING     item n sent; a repeated request is answered again
COUNTED, GIVING
           MISSION_ACK accepted                  SELECTING  the first item made current, as autopilots keep their index
           MISSION_ACK other                     FAILED     with the result
SELECTING  command refused                       the same   MISSION_SET_CURRENT sent instead
SELECTING  MISSION_CURRENT of that item, and     DONE
           its mission is not stopped
COUNTED, GIVING, SELECTING
           no answer for `timeout_s`            the same   the last message sent again, `retries` times
           no answer after that                  FAILED     "no answer"
DONE, FAILED
           start(items)                          COUNTED

MISSION_SET_CURRENT makes an item the current one. ArduPilot does not restart a completed mission with it, although it
accepts the next one; it needs the command DO_SET_MISSION_CURRENT with a reset. Older ArduPilots lack that command.
"""

import enum
from collections.abc import Callable, Sequence

from auv_lse_mavlink.messages.wire import Message, mavlink

#: MAV_MISSION_RESULT in words.
RESULTS = {value: entry.name for value, entry in mavlink.enums["MAV_MISSION_RESULT"].items()}
#: MISSION_STATE of a mission that an autopilot does not fly.
_STOPPED = (mavlink.MISSION_STATE_NO_MISSION, mavlink.MISSION_STATE_NOT_STARTED, mavlink.MISSION_STATE_PAUSED)


class UploadState(enum.Enum):
    """State of an upload."""

    IDLE = "idle"
    COUNTED = "counted"
    GIVING = "giving"
    SELECTING = "selecting"
    DONE = "done"
    FAILED = "failed"


class MissionUpload:
    """Uploads one mission after another to one autopilot.

    Attributes:
        state: State of the current upload.
        problem: Why it failed.
    """

    def __init__(
        self, send: Callable[[Message], None], system: int, component: int, timeout_s: float, retries: int
    ) -> None:
        """Uploads with `send` to the autopilot `system`, `component`."""
        self.state = UploadState.IDLE
        self.problem = ""
        self._send = send
        self._to = (system, component)
        self._timeout_s = timeout_s
        self._retries = retries
        self._items: tuple[Message, ...] = ()
        self._first = 0
        self._restarts = False  # whether the command makes the first item the current one
        self._last: Message | None = None
        self._sent_s = 0.0
        self._repeats = 0

    @property
    def busy(self) -> bool:
        """Whether an upload is in progress."""
        return self.state in (UploadState.COUNTED, UploadState.GIVING, UploadState.SELECTING)

    def start(self, now_s: float, items: Sequence[Message], first: int = 0, restarts: bool = False) -> None:
        """Begins to upload `items` (MISSION_ITEM_INT, numbered from 0); the vehicle begins with item `first`.

        With `restarts` a command restarts the mission there, as ArduPilot needs it.

        Raises:
            ValueError: if there are none.
            RuntimeError: if an upload is in progress.
        """
        if not items:
            raise ValueError("a mission needs at least one item")
        if self.busy:
            raise RuntimeError("mission upload: started while another is in progress")
        self._items, self._first, self._restarts = tuple(items), first, restarts
        self.state = UploadState.COUNTED
        self.problem = ""
        self._repeats = 0
        count = mavlink.MAVLink_mission_count_message(*self._to, len(items), mavlink.MAV_MISSION_TYPE_MISSION)
        self._ask(now_s, count)

    def request(self, now_s: float, number: int) -> None:
        """Handles the autopilot's request for an item."""
        if not self.busy or self.state is UploadState.SELECTING:
            return
        if not 0 <= number < len(self._items):
            self._fail(f"the autopilot requested item {number} of {len(self._items)}")
            return
        self.state = UploadState.GIVING
        self._repeats = 0
        self._ask(now_s, self._items[number])

    def acknowledge(self, now_s: float, result: int) -> None:
        """Handles MISSION_ACK, in which the autopilot accepts or refuses the mission."""
        if not self.busy or self.state is UploadState.SELECTING:
            return
        if result == mavlink.MAV_MISSION_ACCEPTED:
            self.state = UploadState.SELECTING
            self._repeats = 0
            self._select(now_s)
        else:
            self._fail(f"the autopilot refused the mission: {RESULTS.get(result, result)}")

    def restart_answered(self, now_s: float, result: int) -> None:
        """Handles the autopilot's answer to the command that makes an item the current one (MAV_RESULT)."""
        accepted = result in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)
        if self.state is UploadState.SELECTING and self._restarts and not accepted:
            self._restarts = False
            self._select(now_s)

    def current(self, number: int, state: int = 0, flies: bool = False) -> None:
        """Handles the autopilot's report of its current item.

        Args:
            number: The item.
            state: State of its mission (MISSION_STATE); 0: unknown.
            flies: Whether the autopilot is armed, and in the mode in which it flies missions.
        """
        stopped = state == mavlink.MISSION_STATE_COMPLETE or (flies and state in _STOPPED)
        if self.state is UploadState.SELECTING and number == self._first and not (self._restarts and stopped):
            self.state = UploadState.DONE

    def _select(self, now_s: float) -> None:
        """Makes the first item the current one."""
        if self._restarts:
            item, resets = float(self._first), 1.0
            command = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
            self._ask(now_s, mavlink.MAVLink_command_long_message(*self._to, command, 0, item, resets, *(0.0,) * 5))
        else:
            self._ask(now_s, mavlink.MAVLink_mission_set_current_message(*self._to, self._first))

    def poll(self, now_s: float) -> None:
        """Repeats the last message if it was not answered in time."""
        if not self.busy or self._last is None or now_s - self._sent_s < self._timeout_s:
            return
        if self._repeats >= self._retries:
            self._fail(f"no answer after {self._repeats} repeats")
            return
        self._repeats += 1
        self._ask(now_s, self._last)

    def abandon(self, reason: str) -> None:
        """Aborts an upload in progress."""
        if self.busy:
            self._fail(reason)

    def _ask(self, now_s: float, message: Message) -> None:
        self._last = message
        self._sent_s = now_s
        self._send(message)

    def _fail(self, problem: str) -> None:
        self.state = UploadState.FAILED
        self.problem = problem
