"""How a node is: what its diagnostics say, and which problems are new and go to the log."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


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
