"""Result rows on disk."""

import pyarrow
import pyarrow.parquet
import pytest
import yaml
from sim_helpers import TINY, spec_of

from auv_lse_shore.campaign.mission_row import mission_row, row_head
from auv_lse_shore.campaign.page import write_results
from auv_lse_shore.campaign.rows import Rows, columns_of, rows_of
from auv_lse_shore.campaign.runner import CampaignState
from auv_lse_shore.campaign.spec import CampaignSpec


def test_rows_follow_the_campaign_file_as_it_is_now(tmp_path):
    def spec(**content):
        return CampaignSpec.from_mapping({"set": TINY, "seeds": 2, **content}, "test.yaml", tmp_path)

    first = spec(list=[{"label": "old name", "planner.method": "plain"}, {"planner.method": "lawnmower"}])
    rows = Rows(tmp_path, columns_of(first))
    for job in first.jobs():
        rows.write({**row_head(job), "status": "ok", "f1": 0.5, "risk_after": 1.0})
    now = spec(list=[{"label": "new name", "planner.method": "plain"}, {"planner.method": "max_variance"}])
    found = rows_of(now, Rows(tmp_path, columns_of(now)).read())
    assert [row["group"] for row in found] == ["new name"] * 2
    assert [row["planner.method"] for row in found] == ["plain"] * 2
    write_results(now, tmp_path, CampaignState(total=4, before=2))  # writes a page of what there is
    assert pyarrow.parquet.read_table(tmp_path / "results.parquet")["group"].to_pylist() == ["new name"] * 2
    assert len(list((tmp_path / "rows").glob("*.parquet"))) == 4, "rows of other missions stay"


def test_an_empty_row_file_is_put_aside(tmp_path):
    spec = spec_of(tmp_path, seeds=2)
    rows = Rows(tmp_path, columns_of(spec))
    first, second = spec.jobs()
    rows.folder.mkdir()
    (rows.folder / f"{first.id}.parquet").write_bytes(b"")
    empty = pyarrow.table({name: [] for name in columns_of(spec).names}, schema=columns_of(spec))
    pyarrow.parquet.write_table(empty, rows.folder / f"{second.id}.parquet")
    assert rows.read() == []
    assert len(list(rows.folder.glob("*.broken"))) == 2


def test_rows_are_whole_or_not_there(tmp_path):
    spec = spec_of(tmp_path, seeds=2)
    rows = Rows(tmp_path, columns_of(spec))
    first, second = spec.jobs()
    rows.write(mission_row(first))
    (rows.folder / f"{second.id}.parquet").write_bytes(b"PAR1 cut off")  # as a full disk would leave
    assert rows.statuses() == {first.id: "ok"}
    assert (rows.folder / f"{second.id}.broken").exists()
    (row,) = rows.read()
    assert row["steps"] == 2
    assert len(row["local_risk"]) == 2
    assert len(row["stepwise"]) == 3
    assert yaml.safe_load(row["parameters"]) == first.patterns


def test_a_row_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    def full(table, path):
        path.write_bytes(b"PAR1")
        raise OSError(28, "Error writing bytes to file. Detail: [errno 28]")

    spec = spec_of(tmp_path)
    (job,) = spec.jobs()
    monkeypatch.setattr(pyarrow.parquet, "write_table", full)
    with pytest.raises(OSError, match=rf"{tmp_path}/rows/{job.id}\.parquet: No space left on device"):
        Rows(tmp_path, columns_of(spec)).write(row_head(job))
    assert list((tmp_path / "rows").iterdir()) == []


def test_the_row_of_a_mission_whose_start_was_moved_has_a_note(tmp_path):
    far, near = spec_of(tmp_path, grid={"vehicle.start_north_m": [5000.0, 75.0]}).jobs()
    assert mission_row(far)["error"].startswith("start of every vehicle: north 5000, east 0 m has no room to turn")
    assert "start of" not in (mission_row(near)["error"] or "")
