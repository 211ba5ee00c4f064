"""The findings of a check of a device, as commands print them."""

from collections.abc import Sequence
from dataclasses import dataclass

_MARKS = {True: "ok", False: "MISSING", None: "note"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One result of a check: whether it is as expected (None: a note), and a text with what was seen and expected."""

    ok: bool | None
    text: str


def print_findings(findings: Sequence[Finding]) -> int:
    """Prints findings, and how many are missing; returns 1 if any is, else 0."""
    for finding in findings:
        print(f"{_MARKS[finding.ok]:8}{finding.text}")
    missing = sum(finding.ok is False for finding in findings)
    print(f"{missing} missing" if missing else "nothing is missing")
    return int(missing > 0)
