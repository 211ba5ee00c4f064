import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow
import pyarrow.parquet
import pytest
import yaml

from auv_lse_common.params import ParameterError
from auv_lse_sim.campaign import campaign
from auv_lse_sim.campaign import spec as campaign_spec
from auv_lse_sim.campaign.campaign import (
    CampaignError,
    Progress,
    cluster,
    columns_of,
    duration,
    finish,
    fly,
    main,
    rerun,
    rows_of,
    run_campaign,
)
from auv_lse_sim.campaign.rows import Rows
from auv_lse_sim.campaign.spec import CampaignSpec
from auv_lse_sim.settings import Settings

TINY = {
    "mission.steps": 2,
    "mission.vehicles": 2,
    "planner.iterations": 10,
    "gp.map_resolution_m": 20.0,
    "area.polygon_m": [-50.0, -50.0, 200.0, -50.0, 200.0, 200.0, -50.0, 200.0],
    "area.raster_m": 5.0,
    "sim.ideal": True,
}


def spec_of(tmp_path, **content):
    return CampaignSpec.from_mapping({"set": TINY, **content}, "test.yaml", tmp_path, "test")


@pytest.fixture(scope="module")
def client():
    with cluster(None, 2) as found:
        yield found


# The campaign file


def test_grid_times_list_times_seeds(tmp_path):
    spec = spec_of(
        tmp_path,
        grid={"planner.method": ["augmented", "plain"], "sim.channel.packet_loss": [0.0, 0.5]},
        list=[{"label": "one", "mission.vehicles": 1}, {"mission.vehicles": 3}],
        seeds=[5, 9],
    )
    jobs = spec.jobs()
    assert len(jobs) == 2 * 2 * 2 * 2
    assert [j.seed for j in jobs] == [5] * 8 + [9] * 8  # seed by seed
    assert jobs[0].group == "one, method augmented, packet_loss 0.0"
    assert jobs[7].group == "vehicles 3, method plain, packet_loss 0.5"
    assert jobs[7].varied == {"mission.vehicles": 3, "planner.method": "plain", "sim.channel.packet_loss": 0.5}
    common = jobs[7].patterns["/**"]
    assert common["mission"] == {"steps": 2, "seed": 5, "vehicles": 3}
    assert common["planner"]["method"] == "plain"
    assert common["sim"]["channel"]["packet_loss"] == 0.5
    assert len({j.id for j in jobs}) == 16


def test_ids_depend_on_the_mission_alone(tmp_path):
    few = {j.id for j in spec_of(tmp_path, grid={"planner.method": ["plain"]}, seeds=2).jobs()}
    more = {j.id for j in spec_of(tmp_path, grid={"planner.method": ["augmented", "plain"]}, seeds=3, name="x").jobs()}
    assert few < more


def test_a_mission_file_beside_the_campaign_is_the_base(tmp_path):
    (tmp_path / "m.yaml").write_text("/**:\n  ros__parameters:\n    level_set: {level_m: 12.0}\n")
    (job,) = spec_of(tmp_path, mission="m.yaml").jobs()
    assert job.patterns["/**"]["level_set"]["level_m"] == 12.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"grids": {}}, r"grids: unknown key; expected one of name, mission, set"),
        ({"grid": {"planner.method": "plain"}}, r"grid: planner\.method: got 'plain'; expected a list"),
        ({"grid": {"planner.metod": ["plain"]}}, r"planner\.metod: unknown parameter .* did you mean 'method'"),
        ({"grid": {"mission.steps": [0]}}, r"mission\.steps: got 0; expected int >= 1"),
        ({"seeds": [1, 1]}, r"seeds: got \[1, 1\]; expected"),
        ({"seeds": 0}, "seeds: got 0"),
        ({"list": [{"label": "a"}, {"label": "a"}]}, "two settings are called 'a'"),
        ({"list": [{"label": "a"}, {"label": "b"}]}, "the same mission as another"),
        ({"list": [{"planner.method": "plain"}], "grid": {"planner.method": ["plain"]}}, "in grid and in list"),
        ({"set": ["x"]}, r"set: got \['x'\]; expected parameters by dotted name"),
        ({"seeds": {"first": -5, "count": 3}}, r"seeds: got .*expected a number of seeds"),
        ({"seeds": {"first": 1, "count": 0}}, r"seeds: got .*expected a number of seeds"),
        ({"seeds": {"first": 1.9, "count": 2}}, r"seeds: got .*expected a number of seeds"),
        ({"seeds": {"first": "a", "count": 2}}, r"seeds: got .*expected a number of seeds"),
        ({"seeds": [True, 2]}, r"seeds: got .*expected a number of seeds"),
        ({"set": {**TINY, "mission.seed": 9}}, r"mission\.seed in setting 'all'; expected under `seeds`"),
        ({"set": {**TINY, "sim.bathymetry.file": "nope.csv"}}, r"'all'.*bathymetry\.file: nope\.csv: No such file"),
    ],
)
def test_a_wrong_campaign_is_refused_before_anything_flies(tmp_path, content, message):
    with pytest.raises(ParameterError, match=message):
        CampaignSpec.from_mapping({"set": TINY, **content}, "test.yaml", tmp_path).jobs()


def test_vehicles_of_a_larger_team_have_depths_of_their_own(tmp_path):
    (job,) = CampaignSpec.from_mapping({"set": {"mission.vehicles": 5}}, "test.yaml", tmp_path).jobs()
    settings = Settings.from_patterns(job.patterns, "job")
    assert [own.vehicle.depth_m for own in settings.vehicles] == [3.0, 4.0, 5.0, 3.0, 4.0]


def test_another_survey_under_the_same_name_is_another_mission(tmp_path):
    survey = tmp_path / "survey.csv"

    def ids():
        campaign_spec._digest.cache_clear()  # a new process
        return {j.id for j in spec_of(tmp_path, set={**TINY, "sim.bathymetry.file": str(survey)}).jobs()}

    survey.write_text("east_m,north_m,depth_m\n0,0,10\n")
    before = ids()
    assert before == ids()
    survey.write_text("east_m,north_m,depth_m\n0,0,11\n")
    assert before != ids()


# Rows


def test_rows_follow_the_campaign_file_as_it_is_now(tmp_path):
    def spec(**content):
        return CampaignSpec.from_mapping({"set": TINY, "seeds": 2, **content}, "test.yaml", tmp_path)

    first = spec(list=[{"label": "old name", "planner.method": "plain"}, {"planner.method": "lawnmower"}])
    rows = Rows(tmp_path, columns_of(first))
    for job in first.jobs():
        rows.write({**campaign._head(job), "status": "ok", "f1": 0.5, "risk_after": 1.0})
    now = spec(list=[{"label": "new name", "planner.method": "plain"}, {"planner.method": "max_variance"}])
    found = rows_of(now, Rows(tmp_path, columns_of(now)).read())
    assert [row["group"] for row in found] == ["new name"] * 2
    assert [row["planner.method"] for row in found] == ["plain"] * 2
    finish(now, tmp_path, Progress(total=4, before=2))  # writes a page of what there is
    assert pyarrow.parquet.read_table(tmp_path / "results.parquet")["group"].to_pylist() == ["new name"] * 2
    assert len(list((tmp_path / "rows").glob("*.parquet"))) == 4, "rows of other missions stay"


def test_an_empty_row_file_is_put_aside(tmp_path):
    spec = spec_of(tmp_path, seeds=2)
    rows = Rows(tmp_path, columns_of(spec))
    first, second = spec.jobs()
    (rows.folder / f"{first.id}.parquet").write_bytes(b"")
    empty = pyarrow.table({name: [] for name in columns_of(spec).names}, schema=columns_of(spec))
    pyarrow.parquet.write_table(empty, rows.folder / f"{second.id}.parquet")
    assert rows.read() == []
    assert len(list(rows.folder.glob("*.broken"))) == 2


def test_rows_are_whole_or_not_there(tmp_path):
    spec = spec_of(tmp_path, seeds=2)
    rows = Rows(tmp_path, columns_of(spec))
    first, second = spec.jobs()
    rows.write(fly(first))
    (rows.folder / f"{second.id}.parquet").write_bytes(b"PAR1 cut off")  # as a full disk would leave
    assert rows.statuses() == {first.id: "ok"}
    assert (rows.folder / f"{second.id}.broken").exists()
    (row,) = rows.read()
    assert row["steps"] == 2
    assert len(row["local_risk"]) == 2
    assert len(row["stepwise"]) == 3
    assert yaml.safe_load(row["parameters"]) == first.patterns


# Flying


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
    page = finish(spec, tmp_path, state).read_text()
    assert "method lawnmower" in page
    assert page.count("data:image/png;base64,") == 2
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
    with pytest.raises(CampaignError, match="0 rows have an id that begins with 'zz'"):
        rerun(tmp_path, "zz", None)


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
    assert run_campaign(spec, tmp_path, client).done == 0  # a failure is a result too ...
    assert run_campaign(spec, tmp_path, client, retry_failed=True).done == 1  # ... unless asked otherwise
    page = finish(spec, tmp_path, state).read_text()
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


def test_a_scheduler_elsewhere_is_used(tmp_path, client):
    file = tmp_path / "tiny.yaml"
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 2}))
    client.wait_for_workers(2, timeout=120)
    address = client.scheduler_info()["address"]
    assert main([str(file), "--out", str(tmp_path / "out"), "--scheduler", address]) == 0
    workers = {row["worker"].split(":")[1] for row in Rows(tmp_path / "out", None).read()}
    assert workers <= set(map(str, client.run(os.getpid).values()))


def test_a_mission_that_kills_its_workers_is_recorded(tmp_path, client, monkeypatch):
    spec = spec_of(tmp_path, seeds=1)
    monkeypatch.setattr(campaign, "fly", lambda job: os.kill(os.getpid(), signal.SIGKILL))
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
    with pytest.raises(CampaignError, match=r"the cluster is gone .*cancelled.*the same command goes on"):
        campaign._landed(_Lost(), job)


@pytest.mark.parametrize("arguments", [["--workers", "0"], ["--workers", "-1"], ["--workers", "2", "--scheduler", "x"]])
def test_workers_that_make_no_sense_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["spec.yaml", *arguments])
    assert ended.value.code == 2
    assert "--workers" in capsys.readouterr().err


def test_nan_is_the_same_as_nothing():
    assert campaign._same((math.nan, 1.0), [None, 1.0])
    assert campaign._same((math.nan, 1.0), [math.nan, 1.0])
    assert not campaign._same((0.5, 1.0), [math.nan, 1.0])


def test_two_campaigns_in_one_folder_are_refused(tmp_path, client):
    spec = spec_of(tmp_path, seeds=1)
    with campaign._locked(tmp_path), pytest.raises(CampaignError, match="another process works on this campaign"):
        run_campaign(spec, tmp_path, client)


# The command


def test_the_command_flies_and_lists(tmp_path, capsys):
    file = tmp_path / "tiny.yaml"
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 1}))
    assert main([str(file), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "1 missions flown, 0 had been, 0 failed" in capsys.readouterr().out
    assert main([str(file), "--out", str(tmp_path / "out"), "--list"]) == 0
    assert re.match(r"[0-9a-f]{16}  ok      seed 1", capsys.readouterr().out)


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml: cannot be read: No such file" in capsys.readouterr().err
    assert main([]) == 2
    assert "SPEC.yaml: missing" in capsys.readouterr().err
    assert main(["--rerun", "abc"]) == 2
    assert "--out DIR" in capsys.readouterr().err


def test_an_unreachable_scheduler_is_named(monkeypatch):
    import distributed

    def refuse(address, timeout):
        raise OSError(f"Timed out trying to connect to {address}")

    monkeypatch.setattr(distributed, "Client", refuse)
    with (
        pytest.raises(CampaignError, match=r"--scheduler tcp://127\.0\.0\.1:1: cannot be used"),
        cluster("tcp://127.0.0.1:1", None),
    ):
        pass


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(float("nan"), "unknown time"), (45.2, "45 s"), (720.0, "12 min"), (12000.0, "3 h 20 min")],
)
def test_durations_for_readers(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_campaign_that_is_ended_at_any_moment_goes_on(tmp_path, client, sign):
    spec_file, out = tmp_path / "tiny.yaml", tmp_path / "out"
    spec_file.write_text(yaml.safe_dump({"set": TINY, "seeds": 16, "name": "test"}))
    packages = [str(p) for p in Path(__file__).resolve().parents[2].glob("auv_lse_*") if (p / "setup.py").exists()]
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    path = os.pathsep.join([*packages, os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "TMPDIR": str(scratch)}
    module = "auv_lse_sim.campaign.campaign"
    command = [sys.executable, "-m", module, str(spec_file), "--out", str(out), "--workers", "1"]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        until = time.monotonic() + 60.0
        while not list(out.glob("rows/*.parquet")) and time.monotonic() < until:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.05)
        process.send_signal(sign)
        _, errors = process.communicate(timeout=30)
    finally:
        process.kill()
    if sign != signal.SIGKILL:
        assert process.returncode == 130
        assert not list(scratch.glob("auv_lse_dask_*")), "its workers' folder is gone"
        assert "the same command goes on from here" in errors
    spec = CampaignSpec.load(spec_file)
    rows = Rows(out, columns_of(spec))
    kept = {p: p.stat().st_mtime_ns for p in rows.folder.glob("*.parquet")}
    assert 1 <= len(kept) < 16
    assert set(rows.statuses().values()) == {"ok"}
    client.wait_for_workers(2, timeout=120)
    state = run_campaign(spec, out, client)
    assert (state.before, state.done, state.failed) == (len(kept), 16 - len(kept), 0)
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in kept.items())
    assert sorted(row["seed"] for row in rows.read()) == list(range(1, 17))
