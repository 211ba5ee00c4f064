"""Findings of a check: errors, warnings and notes."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Findings:
    """Findings in order, and the parameters that later checks cannot use.

    Attributes:
        rows: Pairs of a level ("error", "warning", "note") and a sentence.
        refused: Dotted names of refused parameters, groups and sections, each with its vehicle (None: all vehicles).
    """

    rows: list[tuple[str, str]] = field(default_factory=list)
    refused: set[tuple[str, int | None]] = field(default_factory=set)

    def error(self, text: str) -> None:
        """Adds an error: the mission is impossible, or would not do what the file requests."""
        self.rows.append(("error", text))

    def warning(self, text: str) -> None:
        """Adds a warning: the mission is possible, but something is probably not intended."""
        self.rows.append(("warning", text))

    def note(self, text: str) -> None:
        """Adds a note: an estimate or other information."""
        self.rows.append(("note", text))

    def count(self, level: str) -> int:
        """The number of findings of a level."""
        return sum(found == level for found, _ in self.rows)

    def refuse(self, name: str, text: str, vehicle: int | None = None) -> None:
        """Adds an error, and marks `name` as refused."""
        self.error(text)
        self.refused.add((name, vehicle))

    def is_refused(self, name: str, vehicle: int | None = None) -> bool:
        """Whether this parameter itself is refused, for a vehicle or for all."""
        return bool(self.refused & {(name, None), (name, vehicle)})

    def usable(self, *names: str, vehicle: int | None = None) -> bool:
        """Whether no named parameter, and no group or member of one, is refused.

        Args:
            names: Dotted names of the parameters, groups or sections that a check reads.
            vehicle: The only vehicle whose values the check reads; None: all vehicles.
        """
        return not any(
            f"{name}.".startswith(f"{refused}.") or f"{refused}.".startswith(f"{name}.")
            for refused, owner in self.refused
            if vehicle is None or owner in (None, vehicle)
            for name in names
        )
