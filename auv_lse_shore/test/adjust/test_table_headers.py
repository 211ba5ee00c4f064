"""Headers of tables: behind a sign of comments, and with units in words; and columns that hold nothing."""

from __future__ import annotations

import pytest
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_shore.survey_import.survey_log import LogError


def row(t, a, o, d):
    return f"{a:.8f},{o:.8f},{d / 0.3048:.4f},{utc(t)}Z"


@pytest.mark.parametrize("sign", ["*", "# ", "% ", "#", "// ", "! ", "*  "])
@pytest.mark.parametrize("title", ["", "# Survey of the lake\n", "* lake, north\n\n"])
def test_a_header_behind_a_sign_of_comments_counts(tmp_path, sign, title):
    checked(gathered(tmp_path, title + lines(f"{sign}lat,lon,depth_ft,time", row)))
    data = title + lines(f"{sign}lat lon depth_ft time", lambda *r: row(*r).replace(",", " "))
    checked(gathered(tmp_path, data))


def test_a_row_of_units_behind_a_sign_of_comments_counts(tmp_path):
    checked(gathered(tmp_path, lines("# lat lon depth time\n# deg deg ft utc", lambda *r: row(*r).replace(",", " "))))


def test_a_comment_above_a_header_stays_one(tmp_path):
    checked(gathered(tmp_path, lines("# east, north, z, clock\nlat,lon,depth_ft,time\n# 1,2,3,4", row)))
    deeper = lines("# bathymetry of the north bay", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{1000 * t:.0f}")
    checked(gathered(tmp_path, deeper))


def test_rows_behind_a_star_are_counted(tmp_path):
    rows = [row(*r) for r in ROWS]
    data = "\n".join(["lat,lon,depth_ft,time", *rows[:100], *(f"*{text}" for text in rows[100:])])
    found = gathered(tmp_path, data)
    checked(found, count=100)
    assert found.placed[0].left_out["positions that are no numbers"] == 20
    with pytest.raises(LogError, match=r"its positions are no numbers .* '\*46.5"):
        gathered(tmp_path, lines("lat,lon,depth_ft,time", lambda *r: f"*{row(*r)}"))
