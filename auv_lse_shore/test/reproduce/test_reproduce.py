"""The reproduction of the paper in miniature."""

import json
import math
import os
import re
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pytest
from sim_helpers import TINY, spec_of
from verb_main import verb_main

from auv_lse_shore.campaign.cluster import cluster
from auv_lse_shore.campaign.mission_row import row_head
from auv_lse_shore.campaign.rows import Rows, columns_of
from auv_lse_shore.reproduce import examples, reproduce
from auv_lse_shore.reproduce import study as studies
from auv_lse_shore.reproduce.study import quick_study
from auv_lse_shore.reproduce.study_runner import run_study

main = verb_main("reproduce")


def test_a_reproduction_in_miniature(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(studies, "SMALL", {**TINY, "mission.steps": 3})
    monkeypatch.setattr(studies, "METHODS", ("augmented", "lawnmower"))
    study = replace(quick_study(1e9), examples=((3, "augmented"),))
    for name, spec in study.campaigns.items():
        study.campaigns[name] = replace(spec, seeds=(1, 2) if name == "trials" else (1,))
    monkeypatch.setattr(reproduce, "quick_study", lambda budget_s: study)
    with cluster(None, 2) as client:
        scheduler = ["--scheduler", client.scheduler.address]
        _reproduced_in_miniature(tmp_path, [*scheduler, "--quick", "--out", str(tmp_path / "r")], capsys)


def _reproduced_in_miniature(tmp_path, arguments, capsys):
    assert main(arguments) == 0
    page = (tmp_path / "r" / "reproduce.html").read_text()
    assert not re.search(r"(src|href)=[\"'](?!data:)", page)
    assert "lower bound" in page
    assert page.count("data:image/png;base64,") == 3 + 2 + 1  # the paper's three, trials, sensitivity
    results = json.loads((tmp_path / "r" / "results.json").read_text())
    assert {(t["vehicles"], t["method"]) for t in results["trials"]} == {
        (k, m) for k in (2, 3) for m in ("augmented", "lawnmower")
    }
    assert all(t["seeds"] == 2 for t in results["trials"])
    text = (tmp_path / "r" / "results.md").read_text()
    assert "| 3 AUVs, lawnmower | 2 |" in text
    assert "| packets lost (share) | seeds | augmented |" in text
    assert "| 0.5 | 1 | " in text
    assert "11 simulated missions, 2 seeds in the trials, 0 missions failed." in text
    assert (tmp_path / "r" / "examples" / "3_auvs_augmented" / "report.html").exists()
    assert (tmp_path / "r" / "examples" / "3_auvs_augmented" / "bag" / "metadata.yaml").exists()
    capsys.readouterr()

    # Started again, it flies nothing and makes the same page from the rows and the recordings.
    assert main(arguments) == 0
    assert json.loads((tmp_path / "r" / "results.json").read_text()) == results


@pytest.mark.parametrize("fails", [False, True])
def test_an_example_is_kept_whole_or_not_at_all(tmp_path, monkeypatch, fails):
    left = tmp_path / "examples" / ".auv_lse.part-killed"
    left.mkdir(parents=True)
    os.utime(left, (1e9, 1e9))

    def outputs(evaluation, folder):
        assert not (tmp_path / "examples" / "a").exists()
        (folder / "report.html").write_text("x")
        if fails:
            raise OSError("no space")

    monkeypatch.setattr(examples.run_writer, "write_run", lambda run, folder: folder.mkdir())
    monkeypatch.setattr(examples, "write_outputs", outputs)
    evaluation = SimpleNamespace(run=SimpleNamespace(ground=None))
    with pytest.raises(OSError, match="no space") if fails else nullcontext():
        examples._keep(evaluation, tmp_path / "examples" / "a")
    assert [str(path.relative_to(tmp_path)) for path in sorted(tmp_path.rglob("*"))] == [
        "examples",
        *([] if fails else ["examples/a", "examples/a/report.html"]),
    ], "a folder that a killed process left is removed"


def test_missions_that_failed_are_repeated_when_a_reproduction_continues(tmp_path, client):
    spec = spec_of(tmp_path, seeds=1)
    (job,) = spec.jobs()
    Rows(tmp_path / "trials", columns_of(spec)).write({**row_head(job), "status": "failed", "error": "killed"})
    study = SimpleNamespace(selected={"trials": spec}, budget_s=math.inf)
    state = run_study(study, tmp_path, client, lambda name, state: None)["trials"]
    assert (state.before, state.done, state.failed) == (0, 1, 0)


def test_an_estimate_of_the_small_version_simulates_and_writes_nothing(tmp_path, monkeypatch, capsys, client):
    monkeypatch.setattr(reproduce, "run_study", lambda *_: pytest.fail("simulates"))
    scheduler = ["--scheduler", client.scheduler.address]
    assert main(["--quick", "--estimate", *scheduler, "--out", str(tmp_path / "r")]) == 0
    assert "about 3 min on 2 cores" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_during_an_estimate_ends_without_a_traceback_and_without_a_folder(tmp_path):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED)
    path = os.pathsep.join(sys.path)
    command = [sys.executable, str(script), "--estimate", "--workers", "1", "--out", str(tmp_path / "r")]
    environment = {**os.environ, "PYTHONPATH": path}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert process.returncode == 130, process.stderr
    assert "Run the same command again to continue" in process.stderr
    assert "Traceback" not in process.stderr
    assert not (tmp_path / "r").exists()


#: A command with missions that last; the first one interrupts it.
INTERRUPTED = """
import contextlib, gc, os, signal, sys, time
from pathlib import Path

from auv_lse_run.command.main import main
from auv_lse_shore.reproduce import study_runner

COMMAND, BEGUN = os.getpid(), __file__ + ".begun"

def probe_s(*_):
    with contextlib.suppress(FileNotFoundError):
        os.remove(BEGUN)
        os.kill(COMMAND, signal.SIGINT)
    time.sleep(60.0)

if __name__ == "__main__":
    Path(BEGUN).touch()
    study_runner._probe_s = probe_s
    code = main(["reproduce", *sys.argv[1:]])
    gc.collect()  # asyncio reports a task's unseen error when the task is deleted
    sys.exit(code)
"""


def test_an_impossible_number_of_seeds_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--seeds", "0", "--out", str(tmp_path)])
    assert ended.value.code == 2
    assert "--seeds: '0' is not a whole number of at least 1" in capsys.readouterr().err


def test_a_page_of_no_missions_and_a_file_for_a_folder_are_refused(tmp_path, capsys):
    assert main(["--page", "--out", str(tmp_path / "none")]) == 2
    assert "none has no simulated missions. Run the same command without --page" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    file = tmp_path / "file"
    file.touch()
    assert main(["--quick", "--out", str(file)]) == 2
    assert f"{file} is a file, not a folder; choose another name" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--seeds", "3"], ["--only", "trials"], ["--sweeps", "loss"]])
def test_quick_refuses_options_that_it_would_ignore(tmp_path, capsys, option):
    assert main(["--quick", *option, "--out", str(tmp_path / "r")]) == 2
    assert f"{option[0]} is for the full version" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
