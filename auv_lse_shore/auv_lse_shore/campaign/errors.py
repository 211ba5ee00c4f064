"""The error of a campaign that cannot go on."""

from __future__ import annotations


class CampaignError(RuntimeError):
    """A campaign that cannot go on: its folder is in use, its cluster is gone, a row is not there."""
