"""What can go wrong with an export."""

from __future__ import annotations


class ExportError(ValueError):
    """An export that cannot be made: a run that cannot be read, a library that is missing."""
