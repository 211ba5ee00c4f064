"""Results of a campaign: one table of its rows, its progress, its page."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from auv_lse_shore.campaign.page import write_page
from auv_lse_shore.campaign.rows import Rows, columns_of, rows_of
from auv_lse_shore.campaign.runner import CampaignState
from auv_lse_shore.campaign.spec import CampaignSpec


def write_results(spec: CampaignSpec, folder: Path, state: CampaignState) -> Path:
    """Merges the rows and writes the page; returns its path."""
    kept = Rows(folder, columns_of(spec))
    rows = rows_of(spec, kept.read())
    kept.write_table(rows)
    if state.done:
        facts = {k: v for k, v in dataclasses.asdict(state).items() if k != "last"}
        facts["efficiency"] = state.efficiency
        (folder / "progress.json").write_text(json.dumps(facts, indent=2) + "\n")
    page: Path = write_page(spec, rows, folder)
    return page
