"""Tables of soundings of a known bottom, and a check of the soundings that are read from them."""

from __future__ import annotations

import numpy as np
import pytest
from adjust.survey_logs import START_S, depth_m, survey

from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import gather

ROWS = survey()[:120]


def gathered(tmp_path, data, *arguments):
    path = tmp_path / "table.txt"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    options = parser().parse_args([str(path), "--origin", "46.5", "6.6", *arguments])
    return gather(options.logs, user_facts(options))


def checked(found, count=120, starts=START_S):
    """Whether all soundings have the known depths; draughts are not in these tables."""
    rows = np.concatenate([log.soundings for log in found.placed])
    assert len(rows) == count
    assert rows[:, 3] == pytest.approx(depth_m(rows[:, 1], rows[:, 2]) - 0.3, abs=0.02)
    if starts is not None:
        assert rows[0, 0] == pytest.approx(starts, abs=0.01)


def utc(stamp_s, form="%Y-%m-%dT%H:%M:%S"):
    return str(np.datetime64(int(stamp_s), "s").astype("O").strftime(form))


def lines(header, row):
    return "\n".join([*([header] if header else []), *(row(*r) for r in ROWS)]) + "\n"
