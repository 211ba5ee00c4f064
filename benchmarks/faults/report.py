"""Report of one kind of fault: its row in the table of `auv_lse faults all`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

#: A row of a table: what was done, how often, how often it went well, figures, and what went wrong.
Part = tuple[str, int, int, str, list[str]]


@dataclass(frozen=True)
class Report:
    """Results of one kind of fault.

    Attributes:
        lines: The kind's own table, printed as it is.
        tried: Faults injected.
        survived: Faults after which everything worked again within its limit.
        worst_recovery_s: Longest time until it did [s]; None where nothing has to recover.
        lost: What was lost or went wrong, a sentence each.
    """

    lines: Sequence[str]
    tried: int
    survived: int
    worst_recovery_s: float | None = None
    lost: Sequence[str] = ()

    @property
    def good(self) -> bool:
        """Whether every fault was survived and nothing was lost."""
        return self.survived == self.tried and not self.lost


def summary(reports: dict[str, Report]) -> list[str]:
    """The table of all kinds, a row each and their sum."""
    lines = ["| kind | faults tried | survived | worst recovery | lost |", "|---|---|---|---|---|"]
    for kind, report in reports.items():
        lost = "; ".join(report.lost) or "nothing"
        lines.append(f"| {kind} | {report.tried} | {report.survived} | {_time(report.worst_recovery_s)} | {lost} |")
    tried, survived = (sum(getattr(r, name) for r in reports.values()) for name in ("tried", "survived"))
    worst = _time(max((r.worst_recovery_s for r in reports.values() if r.worst_recovery_s is not None), default=None))
    lost = str(sum(len(r.lost) for r in reports.values()) or "nothing")
    lines.append(f"| all | {tried} | {survived} | {worst} | {lost} |")
    return lines


def _time(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds:.1f} s"
