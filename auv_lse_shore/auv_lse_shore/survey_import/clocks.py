"""Converts the times of logs to UTC, from what the log or the user states, and asks if neither does."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime

from auv_lse_shore.survey_import.log_content import Clock, LogContent
from auv_lse_shore.survey_import.parsing.times import GPS_FROM_S, ROLLOVER_S, UTC_FROM_S, UTC_TO_S, date_question

_DAY_S = 86_400.0
#: Times at which unset clocks begin (s since 1970): 1970, GPS and its second count of weeks (1980-01-06, 1999-08-22),
#: and 2000. They are set within a day; the next times of their log are later by the second number (s) or more.
_BEGINS_S, _APART_S = (0.0, GPS_FROM_S, GPS_FROM_S + ROLLOVER_S, UTC_FROM_S), 365.0 * _DAY_S


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFacts:
    """What the user knows about the logs' clocks.

    Attributes:
        start: The first log's first day, or for times from an unknown start, its first moment; None if unknown.
        ahead_h: Hours by which a local clock is ahead of UTC; None if unknown.
        today: Today, to recognize impossible dates.
        used: Names of those that some log needed.
    """

    start: datetime | None = None
    ahead_h: float | None = None
    today: date = date.max
    used: set[str] = field(default_factory=set, compare=False)


def to_utc(contents: Sequence[LogContent], facts: ClockFacts) -> list[str]:
    """Moves the times of logs to UTC where possible; returns questions that remain, each once."""
    questions: dict[str, None] = {}
    for content in contents:  # 1,024 weeks too many, as a receiver may count, are beyond what stamps hold
        content.drop_impossible_times(UTC_TO_S if facts.start is None else UTC_TO_S + ROLLOVER_S)
        if content.clock in (Clock.UTC, Clock.LOCAL):
            for begins_s in _BEGINS_S:
                content.drop_unset_clock(begins_s, _DAY_S, _APART_S)
    starts = [content.span_s[0] for content in contents if content.clock in (Clock.UTC, Clock.LOCAL, Clock.DAY)]
    days_s = 0.0
    known = [start for start in starts if math.isfinite(start)]
    if facts.start is not None and known:
        days_s = _DAY_S * (facts.start.timestamp() // _DAY_S - min(known) // _DAY_S)
    for content in contents:
        question = _to_utc(content, facts, days_s)
        content.drop_impossible_times(UTC_TO_S)
        if question:
            questions[question] = None
    return list(questions)


def _to_utc(content: LogContent, facts: ClockFacts, days_s: float) -> str:
    """Moves one log's times; returns the question that remains, or ""."""
    first_s, last_s = content.span_s
    if not math.isfinite(first_s) or content.clock is Clock.NONE:
        return ""
    if content.clock is Clock.ELAPSED:
        if facts.start is None:
            return "times count from an unknown start: --date 2026-06-14T10:00:00Z gives it"
        content.shift(facts.start.timestamp() - first_s)
        content.clock = Clock.UTC
        return ""
    content.shift(days_s)
    if content.clock is Clock.DAY:
        if facts.start is None:
            return "the log has times of day and no date: --date 2026-06-14 gives it"
        _shift_to_utc(content, facts)
    elif content.clock is Clock.LOCAL:
        _shift_to_utc(content, facts)
        if facts.ahead_h is None:
            return "times have no zone and are taken as UTC: --utc-offset gives the hours that a local clock is ahead"
    if facts.start is None:
        return date_question(first_s, last_s, facts.today)
    return ""


def _shift_to_utc(content: LogContent, facts: ClockFacts) -> None:
    facts.used.add("utc_offset")
    content.shift(-3600.0 * (facts.ahead_h or 0.0))
    content.clock = Clock.UTC


def start_of(text: str) -> datetime:
    """A day, or a moment in UTC, from the command line.

    Raises:
        ValueError: if it is neither.
    """
    moment = datetime.fromisoformat(text)
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
