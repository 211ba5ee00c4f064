"""Report of one kind of fault: its row in the table of `auv_lse faults all`."""

import math
import statistics
from collections import Counter
from collections.abc import Callable, Sequence
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


class Moments:
    """Faults at one moment after another, and the recovery from each.

    Attributes:
        lost: What was lost or went wrong, a sentence each.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        """Args: say: Prints a line of progress."""
        self.lost: list[str] = []
        self._say = say
        self._times_s: dict[str, list[float]] = {}
        self._good: Counter[str] = Counter()

    def add(self, kind: str, what: str, back_s: float, wrong: Sequence[str]) -> None:
        """Adds a moment.

        Args:
            kind: Its row in the table.
            what: What was done, in words.
            back_s: Time until the recovery (s); NaN if there was none.
            wrong: What went wrong.
        """
        self._times_s.setdefault(kind, []).append(back_s)
        self._good[kind] += not wrong
        self.lost += [f"{what}: {text}" for text in wrong]
        number = sum(map(len, self._times_s.values()))
        self._say("; ".join([f"{number}: {what}: back after {back_s:.1f} s", *wrong]))

    def report(self, title: str, end: str) -> Report:
        """The table.

        Args:
            title: Heading of its first column.
            end: What holds if nothing was lost, for the last line.
        """
        lines = [f"| {title} | moments | survived | back after (median, worst) |", "|---|---|---|---|"]
        every = [s for times in self._times_s.values() for s in times]
        for kind, times in sorted(self._times_s.items()):
            known = [s for s in times if not math.isnan(s)]
            back = f"{statistics.median(known):.1f} s, {max(known):.1f} s" if known else "never"
            lines.append(f"| {kind} | {len(times)} | {self._good[kind]} | {back} |")
        lines.append("; ".join(self.lost) or f"nothing lost: {end}")
        worst_s = max((s for s in every if not math.isnan(s)), default=None)
        return Report(lines, len(every), self._good.total(), worst_s, self.lost)


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
