"""metadata.json: vertical datum, corrections, uncertainties and coordinates of all files."""

import json

from auv_lse_shore.export.content import Export
from auv_lse_shore.export.uncertainty import EDITION

#: What an order means here.
S44 = f"{EDITION}: uncertainties at 95 % only; feature detection and coverage are not claimed"


def write(export: Export) -> str:
    """Writes what the files record of the survey, for those formats that cannot hold it."""
    (export.folder / "metadata.json").write_text(json.dumps({**export.metadata(), "s44": S44}, indent=1) + "\n")
    return "metadata.json"
