"""Counts, lists and sizes in sentences: "1 vehicle", "3 vehicles", "a, b and 3 more", "40 m2", "1.2 ha"."""

import re
from collections.abc import Sequence


def counted(count: int, what: str) -> str:
    """A count with its noun, whose plural ends in s."""
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def counted_as(count: int, plural: str) -> str:
    """A count with what is counted: "3 positions that are ...", "1 position that is ..."."""
    return f"{count:,} {_singular(plural) if count == 1 else plural}"


def _singular(plural: str) -> str:
    things, *which = plural.split(" that ", 1)
    verbs = {"are": "is", "have": "has", "repeat": "repeats", "jump": "jumps"}
    clauses = [" ".join(verbs.get(word, word) for word in text.split(" ")) for text in which]
    return " that ".join([re.sub(r"s\b", "", things, count=1), *clauses])


def listed(names: Sequence[str], most: int) -> str:
    """Names with commas: at most `most`, and the number of the others."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def area_size(area_m2: float) -> str:
    """The size of an area in the unit that suits it: m2 below 0.1 ha."""
    return f"{area_m2 / 1e4:,.1f} ha" if area_m2 >= 1e3 else f"{area_m2:.0f} m2"
