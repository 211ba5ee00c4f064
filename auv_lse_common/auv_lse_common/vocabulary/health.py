"""How a node is: what its diagnostics say, and which problems are new and go to the log."""

from __future__ import annotations

import enum
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: What was counted no longer ago than this (s) is a problem of now; what was counted before is history.
RECENT_S = 120.0


class Level(enum.IntEnum):
    """How bad it is; the numbers are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """The state of a node or device in one status.

    Attributes:
        level: How bad it is.
        text: One line for a person.
        values: Numbers and texts by name.
    """

    level: Level
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)


class NewProblems:
    """Tells which problems are new, so that each is logged once for as long as it lasts."""

    def __init__(self) -> None:
        """Starts with no problem known."""
        self._known: frozenset[str] = frozenset()

    def of(self, problems: Mapping[str, str]) -> list[str]:
        """The texts of the problems that were not there at the last call.

        Args:
            problems: Every problem there is now, {key: text}. The key stays the same while the problem lasts, the text
                may change ("heard 12 s ago").
        """
        new = [text for key, text in problems.items() if key not in self._known]
        self._known = frozenset(problems)
        return new


class Recent:
    """Tells by how much totals, which only grow, have grown lately: one spike must not warn for the whole dive."""

    def __init__(self) -> None:
        """Every total is 0."""
        self._last: dict[str, int] = {}
        self._grown: deque[tuple[float, str, int]] = deque()

    def of(self, now_s: float, totals: Mapping[str, int]) -> Counter[str]:
        """By how much each total has grown in the last `RECENT_S`; totals that have not are left out.

        Args:
            now_s: Time (s). A clock that was set back makes nothing recent.
            totals: What was counted so far. One that is less than it was is counted from 0 again.
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
