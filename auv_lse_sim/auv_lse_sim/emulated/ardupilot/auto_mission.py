"""AUTO as ArduPilot flies it: item 0 is the home, and a complete mission stays complete.

state (MISSION_CURRENT.mission_state)   event                                      next
1 no mission                            an upload                                  2
2 not started                           AUTO is entered                            3
3 active                                the last item is reached                   5
3 active                                MISSION_SET_CURRENT, or another mission    3, at that item
5 complete                              MISSION_SET_CURRENT                        2, and nothing moves
2, 5                                    DO_SET_MISSION_CURRENT with a reset        3 in AUTO, else 2
any                                     the mission is cleared                     1
"""

from collections.abc import Sequence

from auv_lse_mavlink.messages.conversion import target_of_item
from auv_lse_mavlink.messages.datum import Datum
from auv_lse_mavlink.messages.wire import Message, mavlink

NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 1, 2, 3, 4, 5


class AutoMission:
    """The mission of one autopilot.

    Attributes:
        items: Its items, the home first.
        current: Index of the current item.
    """

    def __init__(self) -> None:
        self.items: tuple[Message, ...] = ()
        self.current = 0
        self.state = NO_MISSION

    @property
    def item(self) -> Message | None:
        """The item to fly to; None: the mission is not active."""
        return self.items[self.current] if self.state == ACTIVE else None

    @property
    def total(self) -> int:
        """Number of items without the home."""
        return max(len(self.items) - 1, 0)

    def load(self, items: tuple[Message, ...]) -> None:
        """Replaces the mission; the index stays."""
        self.items = items
        if not self.total:
            self.state, self.current = NO_MISSION, 0
            return
        self.current = min(self.current, self.total)
        if self.state == NO_MISSION:
            self.state = NOT_STARTED
        if self.state == ACTIVE:
            self.current = max(self.current, 1)

    def select(self, number: int) -> bool:
        """Makes an item the current one; returns whether it exists."""
        if not 0 <= number < len(self.items):
            return False
        self.current = max(number, 1)
        if self.state == COMPLETE:
            self.state = NOT_STARTED
        return True

    def enter(self) -> None:
        """Handles the start of mode AUTO: the mission starts or continues, unless it is complete."""
        if self.state == NOT_STARTED:
            self.state, self.current = ACTIVE, max(self.current, 1)

    def leave(self) -> None:
        """Handles the end of mode AUTO."""
        if self.state == ACTIVE:
            self.state = NOT_STARTED

    def restart(self, number: int, in_auto: bool) -> bool:
        """Resets the mission and selects an item; returns whether it exists."""
        if not self.select(number):
            return False
        self.state = ACTIVE if in_auto else NOT_STARTED
        return True

    def reach(self) -> None:
        """Advances from the reached item to the next one; completes the mission after the last."""
        if self.current >= self.total:
            self.state = COMPLETE
        else:
            self.current += 1


def can_fly(items: Sequence[Message], datum: Datum) -> bool:
    """Whether every waypoint among the items can be converted to a position; commands to a camera or gimbal can."""
    try:
        for item in items:
            if item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
                target_of_item(item, datum)
    except ValueError:
        return False
    return True
