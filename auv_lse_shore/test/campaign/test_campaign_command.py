"""The command auv_lse campaign."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from sim_helpers import TINY, spec_of
from verb_main import verb_main

from auv_lse_shore.campaign import command
from auv_lse_shore.campaign.cluster import CampaignError
from auv_lse_shore.campaign.mission_row import mission_row
from auv_lse_shore.campaign.rows import Rows, columns_of
from auv_lse_shore.campaign.runner import run_campaign
from auv_lse_shore.campaign.spec import CampaignSpec

main = verb_main("campaign")


def test_the_command_simulates_and_lists(tmp_path, capsys):
    file = tmp_path / "tiny.yaml"
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 1}))
    assert main([str(file), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "1 mission simulated, 0 already there, 0 failed" in capsys.readouterr().out
    assert main([str(file), "--out", str(tmp_path / "out"), "--list"]) == 0
    assert re.match(r"[0-9a-f]{16}  ok      seed 1", listed := capsys.readouterr().out)
    assert main(["--out", str(tmp_path / "out"), "--list"]) == 0
    assert capsys.readouterr().out == listed.replace("1 of 1 mission", "1 mission").replace(" (--out)", "")


def test_two_campaigns_in_one_folder_are_refused_also_while_workers_start(tmp_path, capsys, monkeypatch):
    file, out, refused = tmp_path / "tiny.yaml", tmp_path / "out", []
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 1}))

    @contextlib.contextmanager
    def starting(*_):
        refused.append(main([str(file), "--out", str(out)]))
        raise CampaignError("no cluster")
        yield

    monkeypatch.setattr(command, "cluster", starting)
    assert main([str(file), "--out", str(out)]) == 2
    assert refused == [2]
    assert f"{out}: another process works on this campaign" in capsys.readouterr().err


def test_the_command_names_folder_and_ids(tmp_path, capsys):
    file, out = tmp_path / "tiny.yaml", tmp_path / "out"
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 2}))
    assert main([str(file), "--out", str(out), "--list"]) == 0
    assert f"0 of 2 missions flown in {out}" in capsys.readouterr().out
    assert main(["--rerun", "abc", "--out", str(out)]) == 2
    assert "0 missions of" in (text := capsys.readouterr().err)
    assert "--list shows the ids" in text


def test_a_mission_that_fails_again_names_its_error(tmp_path, capsys):
    spec = spec_of(tmp_path, set={**TINY, "vehicle.min_water_m": 900.0})
    (job,) = spec.jobs()
    Rows(tmp_path, columns_of(spec)).write(mission_row(job))
    assert main(["--rerun", job.id, "--out", str(tmp_path)]) == 2
    assert "error: area: the requested area (6.2 ha) has no known water of 904 m" in capsys.readouterr().err


def test_the_command_reports_errors(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml: cannot be read: No such file" in capsys.readouterr().err
    assert main([]) == 2
    assert "SPEC.yaml is missing" in capsys.readouterr().err
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump({"set": TINY}))
    assert main([str(tmp_path / "tiny.yaml"), "--out", str(tmp_path / "tiny.yaml")]) == 2
    assert "tiny.yaml is a file, not a folder" in capsys.readouterr().err
    assert main(["--list", "--out", str(tmp_path)]) == 2
    assert f"{tmp_path} holds no missions of a campaign; name the campaign file" in capsys.readouterr().err
    assert main(["--rerun", "abc"]) == 2
    assert "--out DIR" in capsys.readouterr().err
    assert (
        main([str(tmp_path / "tiny.yaml"), "--to", str(tmp_path / "run"), "--out", str(tmp_path / "c"), "--list"]) == 2
    )
    assert "--to requires --rerun ID" in capsys.readouterr().err


def test_an_impossible_setting_leaves_the_file_as_flown(tmp_path, capsys):
    file, folder = tmp_path / "tiny.yaml", tmp_path / "out"
    folder.mkdir()
    (folder / "campaign.yaml").write_text("name: flown\n")
    file.write_text(yaml.safe_dump({"set": {"mission.stepz": 3}}))
    assert main([str(file), "--out", str(folder), "--workers", "1"]) == 2
    assert "mission.stepz: unknown parameter" in capsys.readouterr().err
    assert (folder / "campaign.yaml").read_text() == "name: flown\n"


@pytest.mark.parametrize("arguments", [["--workers", "0"], ["--workers", "-1"], ["--workers", "2", "--scheduler", "x"]])
def test_workers_that_make_no_sense_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["spec.yaml", *arguments])
    assert ended.value.code == 2
    assert "--workers" in capsys.readouterr().err


def test_a_scheduler_elsewhere_is_used(tmp_path, client):
    file = tmp_path / "tiny.yaml"
    file.write_text(yaml.safe_dump({"set": TINY, "seeds": 2}))
    client.wait_for_workers(2, timeout=120)
    address = client.scheduler_info()["address"]
    assert main([str(file), "--out", str(tmp_path / "out"), "--scheduler", address]) == 0
    workers = {row["worker"].split(":")[1] for row in Rows(tmp_path / "out", None).read()}
    assert workers <= set(map(str, client.run(os.getpid).values()))


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_campaign_that_is_ended_at_any_moment_goes_on(tmp_path, client, sign):
    spec_file, out = tmp_path / "tiny.yaml", tmp_path / "out"
    spec_file.write_text(yaml.safe_dump({"set": TINY, "seeds": 6, "name": "test"}))
    packages = [str(p) for p in Path(__file__).resolve().parents[3].glob("auv_lse_*") if (p / "setup.py").exists()]
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    path = os.pathsep.join([*packages, os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "TMPDIR": str(scratch)}
    module = "campaign"
    command = [sys.executable, "-m", "auv_lse_run", module, str(spec_file), "--out", str(out), "--workers", "1"]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        # The start imports and compiles, which takes seconds, and minutes on a machine that is busy. The limits are
        # there to end a hung campaign only.
        until = time.monotonic() + 300.0
        while not list(out.glob("rows/*.parquet")):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < until, "no mission has ended within 300 s"
            time.sleep(0.05)
        if sign in (signal.SIGINT, signal.SIGHUP):
            os.killpg(process.pid, sign)  # those of a terminal reach the workers, too
        else:
            process.send_signal(sign)
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    if sign != signal.SIGKILL:
        assert process.returncode == 128 + sign
        assert not list(scratch.glob("auv_lse_*")), "what its workers left is gone"
        assert errors == "stopped; finished missions are kept. Run the same command again to continue\n"
    spec = CampaignSpec.load(spec_file)
    rows = Rows(out, columns_of(spec))
    kept = {p: p.stat().st_mtime_ns for p in rows.folder.glob("*.parquet")}
    assert 1 <= len(kept) < 6
    assert set(rows.statuses().values()) == {"ok"}
    client.wait_for_workers(2, timeout=120)
    state = run_campaign(spec, out, client)
    assert (state.before, state.done, state.failed) == (len(kept), 6 - len(kept), 0)
    assert all(p.stat().st_mtime_ns == stamp for p, stamp in kept.items())
    assert sorted(row["seed"] for row in rows.read()) == list(range(1, 7))
