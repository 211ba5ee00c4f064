"""What can go wrong with an adjustment."""

from __future__ import annotations


class AdjustError(ValueError):
    """Recordings whose places cannot be adjusted: something is missing in them, or they do not go together."""
