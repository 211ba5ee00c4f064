"""What a check finds: errors, warnings and notes."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Findings:
    """What was found, in order: pairs of a level ("error", "warning", "note") and a sentence."""

    rows: list[tuple[str, str]] = field(default_factory=list)

    def error(self, text: str) -> None:
        """The mission cannot be flown, or not as it was meant."""
        self.rows.append(("error", text))

    def warning(self, text: str) -> None:
        """The mission can be flown, and something is likely to be otherwise than meant."""
        self.rows.append(("warning", text))

    def note(self, text: str) -> None:
        """What to expect."""
        self.rows.append(("note", text))

    def count(self, level: str) -> int:
        """How many findings of a level there are."""
        return sum(found == level for found, _ in self.rows)
