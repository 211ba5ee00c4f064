"""Campaigns on a cluster: flown, stopped, gone on with, repeated."""

import json
import os
import re
import signal

import pyarrow.parquet
import pytest
from sim_helpers import spec_of

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.campaign import runner
from auv_lse_shore.campaign.cluster import CampaignError
from auv_lse_shore.campaign.mission_row import simulate
from auv_lse_shore.campaign.page import write_results
from auv_lse_shore.campaign.rerun import rerun
from auv_lse_shore.campaign.rows import Rows, columns_of
from auv_lse_shore.campaign.runner import run_campaign


def test_a_campaign_flies_resumes_and_repeats(tmp_path, client):
    spec = spec_of(tmp_path, grid={"planner.method": ["augmented", "lawnmower"]}, seeds=2)
    state = run_campaign(spec, tmp_path, client, budget_s=0.0)  # no time for a single one
    assert (state.total, state.done) == (4, 0)
    half = spec_of(tmp_path, grid={"planner.method": ["augmented", "lawnmower"]}, seeds=1)
    assert run_campaign(half, tmp_path, client).done == 2
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "rows").glob("*.parquet")}
    seen = []
    state = run_campaign(spec, tmp_path, client, progress=lambda s: seen.append((s.done, s.last["seed"])))
    assert (state.before, state.done, state.failed) == (2, 2, 0)
    assert seen == [(1, 2), (2, 2)]
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in before.items())  # nothing repeated
    assert state.left_s == 0.0
    page = write_results(spec, tmp_path, state).read_text()
    assert "method lawnmower" in page
    assert page.count("data:image/png;base64,") == 3
    assert not re.search(r"(src|href)=[\"'](?!data:)", page)
    table = pyarrow.parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert sorted((r["planner.method"], r["seed"]) for r in table) == [
        ("augmented", 1), ("augmented", 2), ("lawnmower", 1), ("lawnmower", 2),
    ]  # fmt: skip
    assert json.loads((tmp_path / "progress.json").read_text())["threads"] == 2

    # One row flown again, alone, with full recording, comes out the same.
    row = table[0]
    folder, changed = rerun(tmp_path, row["id"][:10], tmp_path / "again")
    assert changed == []
    assert {"bag", "mission.yaml", "summary.json", "report.html"} <= {p.name for p in folder.iterdir()}
    assert json.loads((folder / "summary.json").read_text())["risk_after"] == row["risk_after"]
    with pytest.raises(CampaignError, match="not empty"):
        rerun(tmp_path, row["id"], tmp_path / "again")
    with pytest.raises(CampaignError, match="--rerun zz: 0 missions of"):
        rerun(tmp_path, "zz", None)


def test_a_mission_whose_prior_counts_from_another_origin_is_not_flown(tmp_path):
    """Its depths would be those of another place."""
    rows = [f"{n},{e},10,{46.5 + n / 111170:.7f},{6.6 + e / 76670:.7f}" for n, e in ((0, 0), (100, 0), (0, 100))]
    (tmp_path / "a.csv").write_text("\n".join(["north_m,east_m,depth_m,lat,lon", *rows]) + "\n")
    prior = {"gp.mean": "survey", "gp.survey_file": str(tmp_path / "a.csv")}
    origin = {"area.origin_lat_deg": 46.501, "area.origin_lon_deg": 6.6}
    (job,) = spec_of(tmp_path, list=[{"label": "a", **prior, **origin}], seeds=1).jobs()
    with pytest.raises(ParameterError, match=r"a\.csv' are relative to 46\.500000, 6\.600000 deg, 111 m from"):
        simulate(job.patterns, "test", tmp_path)


def test_a_mission_that_fails_is_recorded_and_stops_no_other(tmp_path, client):
    survey = tmp_path / "nothing.csv"
    survey.write_text("east_m,north_m,depth_m\n")
    spec = spec_of(tmp_path, list=[{"label": "no ground", "sim.bathymetry.file": str(survey)}, {"label": "lake"}])
    state = run_campaign(spec, tmp_path, client)
    assert (state.done, state.failed) == (2, 1)
    rows = {row["group"]: row for row in Rows(tmp_path, columns_of(spec)).read()}
    assert rows["lake"]["status"] == "ok"
    failed = rows["no ground"]
    assert failed["status"] == "failed"
    assert "nothing.csv" in failed["error"]
    assert "Traceback" in failed["traceback"]
    assert failed["seed"] == 1
    assert failed["risk_after"] is None
    again = run_campaign(spec, tmp_path, client)
    assert (again.done, again.failed) == (0, 1)  # a failure is a result too ...
    late = run_campaign(spec, tmp_path, client, retry_failed=True, budget_s=0.0)
    assert (late.done, late.failed) == (0, 1)  # there was no time to repeat it ...
    again = run_campaign(spec, tmp_path, client, retry_failed=True)
    assert (again.done, again.failed) == (1, 1)  # ... unless asked otherwise
    page = write_results(spec, tmp_path, state).read_text()
    assert f"<code>{failed['id']}</code>" in page
    with pytest.raises(Exception, match=r"nothing\.csv"):  # it fails alone as it failed in the campaign
        rerun(tmp_path, failed["id"], tmp_path / "again")


def test_a_killed_worker_costs_its_mission_only(tmp_path, client):
    spec = spec_of(tmp_path, seeds=6)
    pids = list(client.run(os.getpid).values())
    killed = []

    def kill(state):
        if not killed:  # the other missions are in the air now
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

    state = run_campaign(spec, tmp_path, client, progress=kill)
    assert (state.done, state.failed) == (6, 0)
    assert killed
    assert sorted(row["seed"] for row in Rows(tmp_path, columns_of(spec)).read()) == [1, 2, 3, 4, 5, 6]
    client.wait_for_workers(2, timeout=120)
    assert pids[0] not in client.run(os.getpid).values()


def test_a_mission_that_kills_its_workers_is_recorded(tmp_path, client, monkeypatch):
    spec = spec_of(tmp_path, seeds=1)
    monkeypatch.setattr(runner, "mission_row", lambda job: os.kill(os.getpid(), signal.SIGKILL))
    state = run_campaign(spec, tmp_path, client)
    assert (state.done, state.failed) == (1, 1)
    (row,) = Rows(tmp_path, columns_of(spec)).read()
    assert row["error"].startswith("KilledWorker")
    assert row["seed"] == 1


class _Lost:
    """A future whose cluster is gone."""

    status = "cancelled"

    def exception(self):
        return None


def test_a_lost_cluster_makes_no_row(tmp_path):
    (job,) = spec_of(tmp_path, seeds=1).jobs()
    with pytest.raises(CampaignError, match=r"lost the cluster .*cancelled.*Run the same command again"):
        runner._finished_row(_Lost(), job)
