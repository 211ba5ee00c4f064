"""Counts in sentences: "1 vehicle", "3 vehicles"."""

from __future__ import annotations


def counted(count: int, what: str) -> str:
    """A count with its noun, whose plural ends in s."""
    return f"{count:,} {what}{'' if count == 1 else 's'}"
