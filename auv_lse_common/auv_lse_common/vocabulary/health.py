"""Health of a node: its diagnostics, and the detection of new problems."""

import enum
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Age (s) up to which a counted event is a current problem.
RECENT_S = 120.0
#: Values of `safety_node`: legs that the battery lasts before the way to the recovery position, and the way that a full
#: battery lasts. Value of `planner_node`: legs not yet travelled.
LEGS_LEFT, BATTERY_LASTS, LEGS_PLANNED = "legs left by battery", "full battery lasts", "legs planned"


class Level(enum.IntEnum):
    """Severity; numbers as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """The state of a node or device in one status.

    Attributes:
        text: One line for operators.
        values: Numbers and texts by name.
    """

    level: Level
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)


class NewProblems:
    """Finds new problems, so that each one is logged once."""

    def __init__(self) -> None:
        self._known: frozenset[str] = frozenset()

    def of(self, problems: Mapping[str, str]) -> list[str]:
        """The texts of the problems that did not exist at the last call.

        Args:
            problems: All current problems, {key: text}. A lasting problem keeps its key; its text may change ("heard 12
                s ago").
        """
        new = [text for key, text in problems.items() if key not in self._known]
        self._known = frozenset(problems)
        return new


class Recent:
    """Recent growth of counters, so that a single event does not warn for the whole dive."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._grown: deque[tuple[float, str, int]] = deque()

    def of(self, now_s: float, totals: Mapping[str, int]) -> Counter[str]:
        """Growth of each counter in the last `RECENT_S`, without counters that have not grown.

        Args:
            now_s: Time (s); when the clock is set back, earlier growth is dropped.
            totals: The counters; one that has decreased was reset to 0.
        """
        if self._grown and now_s < self._grown[-1][0]:
            self._grown.clear()
        for key, total in totals.items():
            before = self._last.get(key, 0)
            if more := total - before if total >= before else total:
                self._grown.append((now_s, key, more))
            self._last[key] = total
        while self._grown and now_s - self._grown[0][0] > RECENT_S:
            self._grown.popleft()
        found: Counter[str] = Counter()
        for _, key, more in self._grown:
            found[key] += more
        return found
