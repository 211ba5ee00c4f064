"""Every benchmark runs at its smallest size, so that none can rot unnoticed. What the figures are is not tested."""

import dataclasses
import importlib
import json
import math
import os
import re
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from pyarrow import Table, parquet
from verb_main import verb_main

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_sim.ground.lake import SyntheticLake
from benchmarks import comms, gp, mission_pairs, mission_parts, vehicle
from benchmarks.command import end_with, parser_of
from benchmarks.planning import areas, peer_environment
from benchmarks.rows import KEYS

main = verb_main("bench")


def check(rows):
    """Rows as `auv_lse bench` prints them, with finite figures."""
    assert rows
    for row in rows:
        assert tuple(row) == KEYS
        assert row["value"] is not None
        assert math.isfinite(row["value"]), row
        assert row["ratio"] is None or math.isfinite(row["ratio"]), row
        assert bool(row["goal"]) == (row["holds"] is not None), row


@pytest.fixture
def survey(tmp_path):
    """Soundings of a small lake along lines, as a CSV file."""
    file = tmp_path / "lake.csv"
    lake = SyntheticLake(LakeConfig(seed=3, height_m=400.0, width_m=400.0, north_m=0.0, east_m=0.0, islands=0))
    positions = np.array([(n, e) for e in np.arange(-180.0, 181.0, 40.0) for n in np.arange(-180.0, 181.0, 6.0)])
    depths = lake.depth_m(positions[:, 0], positions[:, 1])
    rows = [f"{n},{e},{d}" for (n, e), d in zip(positions, depths, strict=True) if np.isfinite(d)]
    file.write_text("\n".join(["north_m,east_m,depth_m", *rows]) + "\n")
    return file


@pytest.mark.parametrize("group", ["gp", "planner", "comms", "day"])
def test_a_group_runs_at_its_smallest_size(group, tmp_path):
    file = tmp_path / "rows.json"
    assert main([group, "--smoke", "--json", str(file)]) == 0
    check(json.loads(file.read_text()))


@pytest.mark.ros
def test_the_executor_group_runs_at_its_smallest_size(tmp_path):
    file = tmp_path / "rows.json"
    assert main(["executor", "--smoke", "--json", str(file)]) == 0
    rows = json.loads(file.read_text())
    check(rows)
    assert next(row["value"] for row in rows if row["name"] == "executor: lost or out of order") == 0


@pytest.mark.ros
@pytest.mark.mission
def test_the_mission_group_runs_at_its_smallest_size(tmp_path):
    file = tmp_path / "rows.json"
    assert main(["mission", "--smoke", "--json", str(file)]) == 0
    check(json.loads(file.read_text()))


def test_the_part_of_a_mission_that_grew_is_named():
    before = {"map": 4.0, "positions": 2.0, "planner": 9.0, "messages": 9.0, "simulator": 6.0, "recorder": 4.0,
              "report": 7.0, "start and end": 6.0, "auv_lse --help": 0.2}  # fmt: skip

    def found(changed, of_fastest=1.0, pairs=1):
        rows = mission_pairs.compared([({**before, **changed}, before)] * pairs, of_fastest)
        check(rows)
        return mission_pairs.complaints(rows)

    assert found({}) == []
    assert found({"planner": 1.14 * 9.0}) == []
    assert found({"positions": 2.5}) == [
        "positions takes 1.25 times the processor time of the baseline; allowed: <= 1.15"
    ]
    assert found({"auv_lse --help": 0.24}) == [], "a twentieth of a second is noise"
    assert [text.split()[0] for text in found({"planner": 18.0})] == ["planner", "whole"]
    assert found({}, of_fastest=1.11) == [
        "whole takes 1.11 times the processor time of the fastest baseline; allowed: <= 1.1"
    ]


def test_a_part_counts_by_its_median_pair():
    """A slow minute slows both missions of a pair; other work beside one mission of three changes nothing."""
    before = dict.fromkeys(mission_parts.PARTS, 4.0)
    slow = dict.fromkeys(mission_parts.PARTS, 8.0)
    rows = mission_pairs.compared([(before, before), (slow, slow), (slow, before)], 1.0)
    assert {row["ratio"] for row in rows} == {1.0}


def test_a_part_that_the_baseline_does_not_know_counts_in_the_whole():
    before = {"map": 4.0, "planner": 6.0}
    rows = mission_pairs.compared([({**dict.fromkeys(mission_parts.PARTS, 0.0), **before, "report": 3.0}, before)], 1.0)
    assert {row["name"]: row["ratio"] for row in rows} == {
        "mission: map": 1.0, "mission: planner": 1.0, "mission: whole": 1.3}  # fmt: skip


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A clone with a commit and a change that is not committed."""
    folder = tmp_path / "clone"
    monkeypatch.setattr(mission_pairs, "ROOT", folder)
    folder.mkdir()
    (folder / "code.py").write_text("1\n")
    mission_pairs._git("init", "--quiet")
    mission_pairs._git("add", "code.py")
    mission_pairs._git("-c", "user.name=a", "-c", "user.email=a@b.c", "commit", "--quiet", "-m", "one")
    (folder / "code.py").write_text("2\n")
    return folder


def test_the_baseline_has_a_checkout_of_its_own_that_is_used_again(clone, tmp_path):
    commit = mission_pairs._git("rev-parse", "HEAD")
    (tmp_path / "build" / "baseline-01234567").mkdir(parents=True)
    for name in ("baseline-89abcdef", f"baseline-{commit[:8]}"):
        (tmp_path / "build" / name).write_text("a file")
    for _ in range(2):
        folder = mission_pairs.checkout(commit, tmp_path / "build")
        assert (folder / "code.py").read_text() == "1\n", "as committed"
        (folder / "code.py").write_text("3\n")
    assert [entry.name for entry in (tmp_path / "build").iterdir()] == [f"baseline-{commit[:8]}"]


def test_neither_checkout_gets_the_others_code_or_is_compiled_at_every_start(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", "/here")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    assert not {"PYTHONPATH", "PYTHONDONTWRITEBYTECODE"} & mission_pairs._environment().keys()
    monkeypatch.setenv("ROS_DISTRO", "jazzy")  # its code is there, too
    assert mission_pairs._environment()["PYTHONPATH"] == "/here"
    assert "PYTHONDONTWRITEBYTECODE" not in mission_pairs._environment()


def test_a_baseline_that_the_clone_lacks_is_named_with_the_cure(clone, tmp_path):
    with pytest.raises(RuntimeError, match=r"the baseline is commit 01234567, which is not here .*git fetch --unsh"):
        mission_pairs.checkout("01234567" * 5, tmp_path / "build")
    assert not (tmp_path / "build").exists()


def test_a_new_baseline_is_a_commit(clone):
    with pytest.raises(RuntimeError, match=r"has changes\. Commit them first"):
        mission_pairs.run(new_baseline="faster")


def test_the_committed_baseline_has_a_reason():
    baseline = mission_pairs.Baseline.read()
    assert re.fullmatch("[0-9a-f]{40}", baseline.commit)
    assert baseline.reason
    assert baseline.of_fastest >= 1.0


def test_memory_counts_the_pages_of_this_process_alone_and_by_share():
    alone_mb, shares = vehicle.memory_mb([os.getpid()])
    rss_mb = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    assert 0.0 < shares[os.getpid()] <= 1.1 * alone_mb
    assert alone_mb == pytest.approx(rss_mb, rel=0.25), "one process: all its pages, files' too"
    twice_mb, _ = vehicle.memory_mb([os.getpid(), os.getpid()])
    assert twice_mb < 2.0 * alone_mb, "a file's pages count once"
    assert vehicle.memory_mb([2**22]) == (0.0, {}), "it has ended"


def test_the_made_up_survey_can_be_sounded():
    """It once held depths below 0, which `OnlineGp.add` refuses."""
    lake = gp.Survey.of(None)
    assert lake.depths_m.min() >= gp.LEAST_DEPTH_M
    assert len(lake.locations_m) > 2000


def test_the_map_is_compared_with_an_installed_library(monkeypatch):
    pytest.importorskip("sklearn")
    monkeypatch.setattr(gp, "RIVALS", Path(sys.executable))
    rows = gp.maps(dataclasses.replace(gp.SMOKE, repeats=2))
    assert any("scikit-learn 1." in row["against"] and row["ratio"] > 0.0 for row in rows)
    (off,) = [row for row in rows if "sums differ" in row["name"] and "scikit-learn" in row["against"]]
    assert off["holds"]


def test_the_figure_of_the_channel_is_drawn(tmp_path):
    comms.channel_figure(tmp_path / "channel.png", packets=1)
    assert (tmp_path / "channel.png").stat().st_size > 10_000


def test_methods_are_compared_scene_by_scene():
    from benchmarks.planning import headline_table

    names = (*(name for name, _, _ in headline_table.COLUMNS), "mowing_risk")
    groups = {
        "one: tour": {1: dict.fromkeys(names, 1.0), 2: dict.fromkeys(names, 3.0)},
        "one: lanes": {1: dict.fromkeys(names, 2.0), 2: dict.fromkeys(names, 4.0), 3: dict.fromkeys(names, 9.0)},
        "two: tour": {1: dict.fromkeys(names, 1.0)},
    }
    assert headline_table.means(groups)[3].startswith("| one: lanes | 3 | 5.00 | 5.000 |")
    (line,) = headline_table.pairs(groups)[2:]
    assert line.startswith("| one: tour against lanes | 2 | -38 % (-196..+121; worst -25; lower on 2) |")


def test_tables_come_from_a_campaigns_folder_in_the_campaigns_order(tmp_path, capsys):
    from benchmarks.planning import headline_table

    (tmp_path / "rows").mkdir()
    labels = ("two: tour", "two: lanes", "one: tour")
    listed = [{"label": label} for label in labels]
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump({"mission": "../missions/default.yaml", "list": listed}))
    names = {*(name for name, _, _ in headline_table.COLUMNS), "mowing_risk"}
    for number, label in enumerate(sorted(labels)):
        row = dict.fromkeys(sorted(names), 1.0 + number) | {"group": label, "seed": 1, "status": "ok"}
        row["position_error_m"] = [3.0, 4.0]  # of each vehicle
        parquet.write_table(Table.from_pylist([row]), tmp_path / "rows" / f"{number}.parquet")
    assert list(headline_table.rows_of([tmp_path])) == list(labels)
    assert headline_table.main([str(tmp_path)]) == 0
    table = capsys.readouterr().out
    assert "| two: tour against lanes | 1 | +50 %" in table
    assert "nan" not in table, "one lake has no interval"
    assert table.count("| 3.5 |") == 3, "the root mean square"
    assert headline_table.main([str(tmp_path / "none")]) == 2


def test_windows_of_a_real_lake_are_found_and_flown(tmp_path, capsys):
    lake = SyntheticLake(LakeConfig(seed=5001, height_m=500.0, width_m=600.0, north_m=200.0, east_m=250.0, islands=0))
    north_m, east_m = np.arange(-40.0, 441.0, 10.0), np.arange(-40.0, 541.0, 10.0)
    depth_m = lake.depth_m(*np.meshgrid(north_m, east_m, indexing="ij"))
    np.savez(tmp_path / "grid.npz", north_m=north_m, east_m=east_m, depth_m=depth_m)
    (name,) = areas.spread_windows(tmp_path / "grid.npz", "small", 1)
    window = areas.lake(name, "small", tmp_path / "grid.npz")
    assert np.isfinite(window.depth_m(*np.meshgrid([0.0, 360.0], [0.0, 460.0]))).all()
    whole = importlib.import_module("benchmarks.planning.real_lake")
    assert whole.main([str(tmp_path / "grid.npz"), "--windows", "1", "--vehicles", "1", "--steps", "2"]) == 0
    table = capsys.readouterr().out
    assert table.count("| 1 vehicle: ") == 5


def test_reference_missions_are_written_and_compared(tmp_path, monkeypatch, capsys):
    reference = importlib.import_module("benchmarks.reference_missions")
    short = {"mission.vehicles": 1, "mission.steps": 2, "planner.iterations": 4, "gp.map_resolution_m": 20.0}
    short["planner.method"] = "plain"
    monkeypatch.setitem(reference.MISSIONS, "plain", short)
    file = tmp_path / "before.json"
    assert reference.main(["--write", str(file), "--only", "plain"]) == 0
    assert reference.main(["--compare", str(file), "--only", "plain"]) == 0
    monkeypatch.setitem(reference.MISSIONS, "plain", {**short, "mission.seed": 2})
    assert reference.main(["--compare", str(file), "--only", "plain"]) == 1
    out = capsys.readouterr().out
    assert out.count(": the same") == 1
    assert out.count(": differs") == 1


def modules_in_pages():
    """Every benchmark that a page or a docstring tells to run by `python -m`."""
    root = Path(__file__).resolve().parents[3]
    files = [root / "README.md", root / "CONTRIBUTING.md", *root.glob("docs/**/*.md"), *root.glob("benchmarks/**/*.py")]
    command = re.compile(r"python -m (benchmarks\.[a-z_]+(?:\.[a-z_]+)*)")
    return sorted({name for file in files for name in command.findall(file.read_text())})


@pytest.mark.parametrize("name", modules_in_pages())
def test_each_command_describes_itself_and_refuses_unknown_options(name, capsys):
    is_package = hasattr(importlib.import_module(name), "__path__")
    main = importlib.import_module(f"{name}.__main__" if is_package else name).main
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert f"usage: python -m {name}" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        main(["--nonsense"])
    assert ended.value.code == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["planners", "gp"], "planners flies for hours, and runs alone"),
        (["gp", "--json", "."], "--json .: this is a folder"),
        (["gp", "--vehicles", "3"], "--vehicles is an option of bench planners, which does not run"),
        (["--seeds", "2"], "--seeds is an option of bench planners, which does not run"),
        (["comms", "--lake", "lake.csv"], "--lake is an option of bench gp, which does not run"),
        (["gp", "--new-baseline", "faster"], "--new-baseline is an option of bench mission, which does not run"),
        (["planners", "--smoke"], "--smoke is not an option of bench planners"),
        (["planners", "--json", "a.json"], "--json is not an option of bench planners"),
        (["planer", "--legs", "4"], "there is no group planer; choose from planners, mission, vehicle"),
        (["planners", "planer"], "there is no group planer"),
        (["gp", "--lake", "."], ".: Is a directory"),
        (["gp", "--lake", "/dev/null"], "/dev/null: it is a device; name a file"),
        (["planners", "--grounds", "/dev/null"], "/dev/null is not a manifest of grounds: it lacks the list grounds"),
        (["planners", "--grounds", "."], ".: cannot be read: Is a directory"),
        (["planners", "--vehicles", "99"], "--vehicles 99: mission.vehicles must be a whole number from 1 to 20"),
        (["planners", "--out", "."], "--out .: this is a folder; name a file in it"),
        (["planners", "--against", "nosuch"], "--against nosuch: not flown. Add it to --planners"),
        (["planners", "--data", "nosuch"], "--data nosuch: there is no such folder"),
        (["planners", "--page", "nosuch/page.md"], "--page nosuch/page.md: there is no folder nosuch"),
    ],
)
def test_what_would_lose_hours_is_refused_at_once(words, said, capsys):
    assert main(words) == 2
    assert said in capsys.readouterr().err


def test_options_at_their_default_and_those_of_one_of_several_groups_are_accepted(monkeypatch, survey):
    seen = []
    for name in ("gp", "comms"):
        module = SimpleNamespace(run=lambda name=name, **options: seen.append((name, options)) or [])
        monkeypatch.setitem(sys.modules, f"benchmarks.{name}", module)
    assert main(["comms", "gp", "--lake", str(survey), "--smoke", "--seeds", "1"]) == 0
    assert seen == [("comms", {"smoke": True}), ("gp", {"smoke": True, "lake": survey})]


def test_figures_replace_a_file_whole_also_through_a_link(monkeypatch, tmp_path):
    module = SimpleNamespace(run=lambda **options: [])
    monkeypatch.setitem(sys.modules, "benchmarks.comms", module)
    (tmp_path / "old.json").write_text("old")
    (tmp_path / "link.json").symlink_to("old.json")
    assert main(["comms", "--json", str(tmp_path / "link.json")]) == 0
    assert (tmp_path / "old.json").read_text() == "[]\n"
    monkeypatch.setattr(shutil, "copymode", lambda old, new: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["comms", "--json", str(tmp_path / "old.json")])
    assert (tmp_path / "old.json").read_text() == "[]\n"


def test_numbers_of_benchmarks_by_themselves_are_named_in_plain_words(capsys):
    p = parser_of("benchmarks.some", None)
    p.add_argument("--whole", type=int)
    p.add_argument("--number", type=float)
    assert p.parse_args(["--whole", "-3", "--number", "1e-3"]).number == 1e-3
    for option, given, wanted in (("--whole", "1.5", "whole number"), ("--number", "x", "number")):
        with pytest.raises(SystemExit, match="2"):
            p.parse_args([option, given])
        assert f"{option}: '{given}' is not a {wanted}" in capsys.readouterr().err


def test_a_benchmark_ends_with_its_code_or_130_after_ctrl_c(capsys):
    def stopped():
        raise KeyboardInterrupt

    for main, code in ((lambda: 1, 1), (lambda: None, 0), (stopped, 130)):
        with pytest.raises(SystemExit) as ended:
            end_with(main)
        assert ended.value.code == code
    assert capsys.readouterr().err == "interrupted\n"


def test_calibration_is_judged_where_the_depth_is_known(monkeypatch):
    undiscovered = importlib.import_module("benchmarks.planning.undiscovered")
    north, east = np.meshgrid(np.arange(0.0, 380.0, 40.0), np.arange(0.0, 480.0, 60.0), indexing="ij")

    def depth_m(north_m, east_m):
        """A plane that is 15 m deep at north = 180."""
        return 15.0 + 0.1 * (np.asarray(north_m, float) - 180.0) + 0.0 * np.asarray(east_m)

    def half_known(north_m, east_m):
        return np.where(np.asarray(east_m) < 240.0, depth_m(north_m, east_m), np.nan)

    depth = depth_m(north, east)
    rows = np.column_stack([np.arange(80.0), north.ravel(), east.ravel(), depth.ravel()])[east.ravel() < 100.0]
    line = {"kind": "valley", "vehicles": 1, "lake": "1", "real": "", "soundings": rows.tolist()}
    judged = []
    for known in (depth_m, half_known):
        monkeypatch.setattr(undiscovered, "ground_of", lambda *_, known=known: SimpleNamespace(depth_m=known))
        judged.append(undiscovered.figures(line))
    whole, half = judged
    assert half["missing"] < 0.6 * whole["missing"]
    assert half["expected"] < 0.6 * whole["expected"]
    assert half["limit"] < whole["limit"]
    assert half["band"] == pytest.approx(whole["band"], abs=0.05)
    text = undiscovered.table([{**whole, "limit": 2.0 * whole["missing"]}, {**half, "limit": 0.5 * half["missing"]}])
    (row,) = [row for row in text if row.startswith("| all |")]
    assert "| 2 |" in row
    assert "| 1.25 | 0.50 (" in row


def test_a_peer_that_cannot_be_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(peer_environment, "PEER", str(tmp_path / "no-such-package"))
    monkeypatch.setattr(peer_environment.venv, "create", lambda folder, **_: (folder / "bin").mkdir(parents=True))
    monkeypatch.setattr(peer_environment, "installer", lambda _: [sys.executable, "-m", "pip", "install", "-q"])
    with pytest.raises(SystemExit, match="no-such-package could not be installed into"):
        peer_environment.environment(tmp_path / "env")
    assert not (tmp_path / "env" / "peer-installed").exists()
