"""Findings of a check: errors, warnings and notes."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Findings:
    """Findings in order: pairs of a level ("error", "warning", "note") and a sentence."""

    rows: list[tuple[str, str]] = field(default_factory=list)

    def error(self, text: str) -> None:
        """The mission is impossible, or would not do what the file asks for."""
        self.rows.append(("error", text))

    def warning(self, text: str) -> None:
        """The mission is possible, but something is probably not intended."""
        self.rows.append(("warning", text))

    def note(self, text: str) -> None:
        """An estimate or other information."""
        self.rows.append(("note", text))

    def count(self, level: str) -> int:
        """The number of findings of a level."""
        return sum(found == level for found, _ in self.rows)
