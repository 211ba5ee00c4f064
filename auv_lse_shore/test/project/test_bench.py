"""Every benchmark runs at its smallest size, so that none can rot unnoticed. What the figures are is not tested."""

import importlib
import json
import math
import os
import re
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from pyarrow import Table, parquet

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_sim.ground.lake import SyntheticLake
from benchmarks import __main__ as bench
from benchmarks import vehicle
from benchmarks.command import end_with
from benchmarks.planning import missed, peer
from benchmarks.planning.missed import missed_pieces, pairs, table
from benchmarks.planning.planner_loop import settings_for
from benchmarks.rows import KEYS


def check(rows):
    """Rows as `scripts/bench` prints them, with finite figures."""
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


@pytest.mark.parametrize("group", ["gp", "planner", "comms", "fleet", "until"])
def test_a_group_runs_at_its_smallest_size(group, tmp_path):
    file = tmp_path / "rows.json"
    assert bench.main([group, "--smoke", "--json", str(file)]) == 0
    check(json.loads(file.read_text()))


def test_a_rule_ends_a_mission_at_the_first_run_of_judgements_that_is_long_enough():
    stop_rule = importlib.import_module("benchmarks.planning.quality.stop_rule")
    met = [False, True, False, True, True, True]
    assert [stop_rule.ended(met, rule) for rule in (1, 2, 3, 4)] == [1, 4, 5, None]


def test_the_path_along_a_known_isobath_takes_the_nearer_part_of_it():
    until = importlib.import_module("benchmarks.planning.quality.until")
    near = np.array([[0.0, 0.0], [0.0, 300.0]])
    far = near + np.array([400.0, 0.0])
    half, whole = (until.along_isobath([near, far], np.zeros(2), share) for share in (0.5, 1.0))
    assert until.length_m(half) == pytest.approx(290.0), "to the middle of the last 20 m"
    assert until.length_m(whole) == pytest.approx(290.0 + 400.0 + 280.0, rel=0.02)


def test_decisions_report_certificate_and_export_of_a_recording_are_timed():
    report_time = importlib.import_module("benchmarks.planning.report_time")
    rows = report_time.run(smoke=True)
    check(rows)
    subjects = list(dict.fromkeys(row["name"].split(":")[0] for row in rows))
    assert subjects == ["auv1", "recording", "report", "certificate", "export"]
    assert all(row["value"] > 0.0 for row in rows if "beyond" not in row["name"])


def test_late_decisions_are_compared_with_early_ones():
    report_time = importlib.import_module("benchmarks.planning.report_time")
    times = [(step, 5000.0 if step == 0 else 10.0 if step <= 200 else 600.0 if step == 300 else 30.0)
             for step in range(500)]  # fmt: skip
    rows = {row["name"]: row for row in report_time._of_decisions(1, times)}
    assert rows["auv1: first decision"]["value"] == 5000.0
    assert rows["auv1: other decisions, longest"]["holds"] is False
    assert rows["auv1: other decisions beyond 500 ms"]["value"] == 1
    assert rows["auv1: mean of the last 200 legs"]["ratio"] == pytest.approx(3.0 + 570.0 / 200.0 / 10.0, rel=0.02)


@pytest.mark.ros
def test_the_executor_group_runs_at_its_smallest_size(tmp_path):
    file = tmp_path / "rows.json"
    assert bench.main(["executor", "--smoke", "--json", str(file)]) == 0
    rows = json.loads(file.read_text())
    check(rows)
    assert next(row["value"] for row in rows if row["name"] == "executor: lost or out of order") == 0


@pytest.mark.ros
@pytest.mark.mission
def test_the_mission_group_runs_at_its_smallest_size(tmp_path):
    file = tmp_path / "rows.json"
    assert bench.main(["mission", "--smoke", "--json", str(file)]) == 0
    check(json.loads(file.read_text()))


def test_memory_counts_the_pages_of_this_process_alone_and_by_share():
    alone_mb, shares = vehicle.memory_mb([os.getpid()])
    rss_mb = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    assert 0.0 < shares[os.getpid()] <= 1.1 * alone_mb
    assert alone_mb == pytest.approx(rss_mb, rel=0.25), "one process: all its pages, files' too"
    twice_mb, _ = vehicle.memory_mb([os.getpid(), os.getpid()])
    assert twice_mb < 2.0 * alone_mb, "a file's pages count once"
    assert vehicle.memory_mb([2**22]) == (0.0, {}), "it has ended"


def test_gp_measures_its_choices_on_soundings_of_a_real_lake(survey):
    gp = importlib.import_module("benchmarks.gp")
    lake = gp.Survey.of(survey)
    warnings.simplefilter("ignore", UserWarning)  # short supports are what is measured
    rows = [*gp.local_subset(lake, gp.SMOKE), *gp.merging(lake, gp.SMOKE), *gp.hyperparameters(lake, gp.SMOKE)]
    check(rows)
    assert any("real lake, lake" in row["against"] for row in rows)


def test_the_made_up_survey_can_be_sounded():
    """It once held depths below 0, which `OnlineGp.add` refuses."""
    gp = importlib.import_module("benchmarks.gp")
    lake = gp.Survey.of(None)
    assert lake.depths_m.min() >= gp.LEAST_DEPTH_M
    assert len(lake.locations_m) > 2000


def test_the_other_libraries_are_asked_in_the_form_that_gp_writes(tmp_path, capsys, monkeypatch):
    rivals = importlib.import_module("benchmarks.navigation.gp_rivals")
    gp = importlib.import_module("benchmarks.gp")
    positions, depths = gp.made_up(30)
    scales = {"signal_std": 8.0, "length": 70.0, "noise_std": 0.3, "mean": 15.0}
    data = {
        "positions": positions,
        "depths": depths,
        "queries": positions[:5],
        "new": positions[:2],
        "new_depths": depths[:2],
    }
    np.savez(tmp_path / "data.npz", **data, **scales, fit_positions=positions, fit_depths=depths)
    monkeypatch.setattr(sys, "argv", ["gp_rivals.py", str(tmp_path / "data.npz")])
    rivals.main()
    results = json.loads(capsys.readouterr().out)
    assert results.keys() == {"scikit-learn", "GPyTorch"}
    for result in results.values():
        assert "missing" in result or {"version", "mean_sum", "std_sum"} <= result.keys()


def test_the_figure_of_the_channel_is_drawn(tmp_path):
    importlib.import_module("benchmarks.comms").channel_figure(tmp_path / "channel.png", packets=1)
    assert (tmp_path / "channel.png").stat().st_size > 10_000


def test_the_fuzzer_runs(capsys):
    importlib.import_module("benchmarks.comms_fuzz").main(["300"])
    assert "300 inputs, only PacketError escaped" in capsys.readouterr().out


def test_the_navigation_consistency_is_measured(capsys):
    assert importlib.import_module("benchmarks.navigation.navigation_consistency").main(["2", "60"]) == 0
    assert capsys.readouterr().out.count("drift at the end") == 3


def test_the_search_is_held_against_the_optimum(capsys):
    importlib.import_module("benchmarks.planning.planner_yardstick").main(["--situations", "1", "--iterations", "20"])
    assert capsys.readouterr().out.count("of 1 situations") == 2


def test_methods_are_held_against_hindsight(capsys):
    hindsight = importlib.import_module("benchmarks.planning.hindsight")
    assert hindsight.main(["--lakes", "1", "--steps", "4", "--methods", "random", "--mutations", "3"]) == 0
    out = capsys.readouterr().out
    assert "| hindsight |" in out
    assert "| hindsight on the isobath |" in out
    assert "| random |" in out
    assert out.count("100% |") == 2  # each aim by its own paths


def test_the_worth_of_corrected_positions_is_measured(tmp_path, monkeypatch, capsys):
    from benchmarks.navigation import positions_drift

    monkeypatch.setattr(positions_drift, "CONDITIONS", {"x3": (3.0, 0.0)})
    wanted = ["--seeds", "7500", "1", "--steps", "6", "--out", str(tmp_path / "new" / "rows.jsonl")]
    assert positions_drift.main(wanted) == 0
    first = capsys.readouterr().out
    assert [line.split(" | ")[1] for line in first.splitlines()[2:]] == list(positions_drift.WAYS)
    monkeypatch.setattr(positions_drift, "flown", None)  # what the file has is not flown again
    assert positions_drift.main(wanted) == 0
    assert capsys.readouterr().out == first


def test_the_time_of_a_fix_and_the_memory_of_a_planner_are_measured(monkeypatch, capsys):
    from benchmarks.navigation import surfacing_time
    from benchmarks.planning import planner_memory

    monkeypatch.setattr(surfacing_time, "PARTS", (0.5,))
    assert surfacing_time.main(["--seeds", "7500", "1", "--steps", "6"]) == 0
    assert capsys.readouterr().out.splitlines()[2].startswith("| 50% | 1 | ")
    assert planner_memory.main(["--most", "100"]) in (0, 1)
    assert capsys.readouterr().out.splitlines()[2].startswith("| 100 | ")


def test_settings_of_a_campaign_are_compared_with_their_first():
    from benchmarks.navigation.positions_table import table

    names = ("isobath_error_m", "isobath_error_true_positions_m", "risk_after", "loss_after", "error_over_std")
    groups = {
        group: {seed: dict.fromkeys(names, value + seed) | {"position_error_m": [3.0, 4.0]} for seed in (1, 2)}
        for group, value in (("x1, as before", 2.0), ("x1, corrected", 1.0))
    }
    lines = table(groups)
    assert "| -1 |" in lines[3]
    assert "3.536" in lines[2]


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
    from benchmarks.navigation import positions_table
    from benchmarks.planning import headline_table

    (tmp_path / "rows").mkdir()
    labels = ("two: tour", "two: lanes", "one: tour")
    listed = [{"label": label} for label in labels]
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump({"mission": "../missions/default.yaml", "list": listed}))
    names = {*(name for name, _, _ in headline_table.COLUMNS), "mowing_risk", "isobath_error_true_positions_m"}
    for number, label in enumerate(sorted(labels)):
        row = dict.fromkeys(sorted(names), 1.0 + number) | {"group": label, "seed": 1, "status": "ok"}
        parquet.write_table(Table.from_pylist([row]), tmp_path / "rows" / f"{number}.parquet")
    assert list(positions_table.rows_of([tmp_path])) == list(labels)
    assert headline_table.main([str(tmp_path)]) == 0
    assert "| two: tour against lanes | 1 | +50 %" in capsys.readouterr().out
    assert positions_table.main([str(tmp_path)]) == 0
    assert positions_table.main([str(tmp_path / "none")]) == 2


def test_missions_below_their_bound_are_counted(tmp_path, capsys):
    bound = importlib.import_module("benchmarks.planning.planner_bound")
    lines = tmp_path / "bound.jsonl"
    for number in (0, 12):  # a synthetic lake, and one of the planner's own prior with a quarter of the packets lost
        for method in bound.METHODS:
            row = bound.mission(number, method, rule=True, steps=2, iterations=4)
            lines.open("a").write(json.dumps(row) + "\n")
    bound.main(["--table", str(lines)])
    assert capsys.readouterr().out.count("| kept |") == 2 * len(bound.METHODS)


def test_the_same_soundings_are_mapped_by_each_prior(tmp_path, monkeypatch, capsys):
    prior = importlib.import_module("benchmarks.navigation.gp_prior")
    monkeypatch.setitem(prior.SMALL, "mission.steps", 2)
    lines = tmp_path / "new" / "prior.jsonl"
    options = ["--small", "--method", "lawnmower", "--lakes", "1", "--stds", "8", "--out", str(lines)]
    prior.main(options)
    prior.main(options)  # nothing is flown twice
    assert len(lines.read_text().splitlines()) == 4
    out = capsys.readouterr().out
    assert out.count("lake 8200 done") == 1
    assert out.count("| matern52, 70 m, 8 m | 1 |") == 2


def test_methods_are_flown_over_lakes(tmp_path, capsys):
    methods = importlib.import_module("benchmarks.planning.planner_methods")
    lines = tmp_path / "new" / "methods.jsonl"
    options = ["--out", str(lines), "--methods", "lawnmower", "random", "--vehicles", "1", "--lakes", "1"]
    methods.main([*options, "--steps", "2", "--processes", "1"])
    methods.main([*options, "--steps", "2", "--processes", "1"])  # nothing is flown twice
    assert len(lines.read_text().splitlines()) == 2
    assert "0 missions to fly, 2 in" in capsys.readouterr().out


def test_windows_of_a_real_lake_are_found_and_flown(tmp_path, capsys):
    methods = importlib.import_module("benchmarks.planning.planner_methods")
    lake = SyntheticLake(LakeConfig(seed=5001, height_m=500.0, width_m=600.0, north_m=200.0, east_m=250.0, islands=0))
    north_m, east_m = np.arange(-40.0, 441.0, 10.0), np.arange(-40.0, 541.0, 10.0)
    depth_m = lake.depth_m(*np.meshgrid(north_m, east_m, indexing="ij"))
    np.savez(tmp_path / "grid.npz", north_m=north_m, east_m=east_m, depth_m=depth_m)
    name = next(methods.windows(tmp_path / "grid.npz", "small"))[0]
    row = methods.mission("lawnmower", 1, "small", name, 0.0, str(tmp_path / "grid.npz"), 2)
    assert row["lake"] == name
    assert math.isfinite(row["risk_end"])
    whole = importlib.import_module("benchmarks.planning.real_lake")
    assert whole.main([str(tmp_path / "grid.npz"), "--windows", "1", "--vehicles", "1", "--steps", "2"]) == 0
    table = capsys.readouterr().out
    assert table.count("| 1 vehicle: ") == 5


def test_whole_lakes_are_continued_from_their_file_of_summaries(tmp_path, monkeypatch, capsys):
    whole = importlib.import_module("benchmarks.planning.real_lake")
    names = ("risk_third", "risk_after", "loss_after", "isobath_error_m", "loss_expected", "isobath_found")
    flown = []

    def fly(settings, *, open_ground):
        flown.append(settings.sim.lake.seed)
        found = 0.5 if settings.planner_settings(1).planner.method == "plain" else 0.75
        return {**dict.fromkeys(names, 2.0), "mowing_risk": 3.0, "isobath_found": found}

    monkeypatch.setattr(whole, "flown", fly)
    (tmp_path / "lake.npz").touch()
    rows = tmp_path / "rows.jsonl"
    command = [str(tmp_path / "lake.npz"), "--whole", "--vehicles", "2", "--seeds", "1", "--out", str(rows)]
    for lakes in (["7"], ["7", "8"]):
        assert whole.main([*command, "--lakes", *lakes, "--methods", "tour", "plain"]) == 0
    assert flown[2:] == [7, 7, 8, 8], "lake 7 and the file's lake are flown once"
    assert len(rows.read_text().splitlines()) == len(flown) == 6
    assert "| 2 vehicles: tour against plain | 3 |" in (table := capsys.readouterr().out)
    assert "+0.25 (+0.25..+0.25; lower on 0) |" in table


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


def test_the_table_of_a_file_that_is_not_there_is_refused(tmp_path, capsys):
    """It once was a table of nothing."""
    for name in ("planning.planner_bound", "planning.planner_methods", "navigation.gp_prior"):
        with pytest.raises(SystemExit, match="2"):
            importlib.import_module(f"benchmarks.{name}").main(["--table", str(tmp_path / "none.jsonl")])
        assert "none.jsonl: there is no such file" in capsys.readouterr().err


def test_a_benchmark_ends_with_its_code_or_130_after_ctrl_c(capsys):
    def stopped():
        raise KeyboardInterrupt

    for main, code in ((lambda: 1, 1), (lambda: None, 0), (stopped, 130)):
        with pytest.raises(SystemExit) as ended:
            end_with(main)
        assert ended.value.code == code
    assert capsys.readouterr().err == "interrupted\n"


def test_surfacing_is_compared_at_the_drift_that_is_asked_for(capsys):
    loop = importlib.import_module("benchmarks.navigation.surfacing_loop")
    assert loop.main(["--seeds", "7700", "1", "--drifts", "3", "--steps", "6"]) == 0
    rows = [line.split("|") for line in capsys.readouterr().out.splitlines()[2:]]
    assert [(row[1].strip(), row[2].strip()) for row in rows] == [("x3", "nobody"), ("x3", "where it pays")]
    assert float(rows[0][4]) == 0.0  # nobody surfaced
    with_it, without = (loop.settings_of(1, 3.0, surfaces, 6) for surfaces in (True, False))
    assert [own.vehicle.surfacings for own in without.vehicles] == [0, 0, 0]
    assert all(own.vehicle.surfacings != 0 for own in with_it.vehicles)
    assert with_it.sim.dvl.scale == pytest.approx(0.009)


NORTH = np.arange(0.0, 200.5, 1.0)
LINE = np.column_stack([NORTH, np.zeros_like(NORTH)])
#: A closed line of 160 m that begins in the middle of its eastern side.
SQUARE = np.array([[20.0, 340.0], [40.0, 340.0], [40.0, 300.0], [0.0, 300.0], [0.0, 340.0], [20.0, 340.0]])


def missed_m(truth, estimate):
    return [piece.length_m for piece in missed_pieces(truth, estimate)]


def test_a_stretch_that_the_estimate_does_not_come_near_is_missed():
    assert missed_m([LINE], [np.add(LINE, (0.0, 9.0))]) == []
    assert missed_m([LINE], [LINE[:101]]) == [pytest.approx(90.0, abs=3.0)]  # it is near up to 10 m beyond its end
    assert missed_m([LINE], [LINE[:171]]) == []  # 20 m is short
    assert missed_m([LINE], []) == [pytest.approx(200.0, abs=3.0)]


def test_a_stretch_through_a_closed_lines_start_is_one_piece():
    west = np.column_stack([np.linspace(0.0, 40.0, 21), np.full(21, 300.0)])
    (piece,) = missed_pieces([SQUARE, LINE], [LINE, west])
    assert piece.length_m == pytest.approx(40.0 + 2.0 * 30.0, abs=4.0)
    assert piece.line_m == pytest.approx(160.0)
    east, north = piece.locations_m[:, 1], piece.locations_m[:, 0]
    assert east.min() > 309.0  # the positions are those of the stretch
    assert north[0] == pytest.approx(0.0, abs=2.0)
    assert north[-1] == pytest.approx(40.0, abs=2.0)
    assert missed_m([SQUARE], [LINE]) == [pytest.approx(160.0, abs=4.0)]


PIECE = {"length_m": 50.0, "line_m": 90.0, "track_m": 31.0, "std_m": 1.2, "error_stds": 2.5, "slope": 0.3}


def test_variants_are_compared_lake_by_lake():
    def line(variant, lake, error, missed):
        figures = {"isobath_error_m": error, "isobath_found": 0.9, "risk_third": 2.0, "risk_after": error / 10.0}
        losses = {"loss_expected": 0.1, "loss_after": 0.2, "isobath_undiscovered_m": 1.0}
        names = {"variant": variant, "vehicles": 3, "lake": lake, "pieces": [PIECE] * missed}
        names["lengths_m"] = {"near": [60.0, 0.0], "middle": [30.0, 10.0], "far": [10.0, 10.0], "border": [20.0, 5.0]}
        within = {"isobath_found_within_m": 9.0, "isobath_found_error_p95_m": None}
        return {**names, **figures, **losses, **within, "isobath_undiscovered_limit_m": 2.0}

    lines = [line("tour", "1", 2.0, 0), line("tour", "2", 4.0, 1), line("another", "2", 5.0, 0)]
    text = table(lines)
    assert "| made up, 3: tour | 2 | 0.50 (0.09 to 0.91) | 1 | 50 | 3.0 | 4.0 |" in text[2]
    assert "| made up, 3: tour | far | 0.100 | 1.000 | 0.500 |" in text
    assert "| made up, 3: tour | border | 0.200 | 0.250 | 0.250 |" in text
    assert "| 3, 2: tour | 50 | 90 | 31 | 1.2 | 2.5 | 0.30 | 4.0 |" in text[-1]
    assert "| 3: another | 1 | +1.00 (" in pairs(lines)[-1]
    assert "+25 %" in pairs(lines)[-1]


@pytest.mark.parametrize("north", [True, False])
def test_ideal_lanes_are_as_long_as_the_distance_and_equally_far_apart(north):
    positions = missed.lanes((0.0, 600.0, 0.0, 700.0), 7000.0, north)
    across = np.unique(positions[:, 1 if north else 0])
    assert np.ptp(np.diff(across)) < 1e-9
    along_m = len(positions) * missed.ALONG_M  # the ways between the lanes add the area's breadth
    assert along_m + np.ptp(across) == pytest.approx(7000.0, rel=0.1)


def test_free_soundings_go_where_the_isobath_is():
    settings = settings_for("tour", 1)
    cells = np.stack(np.meshgrid(np.arange(0.0, 300.0, 20.0), np.arange(0.0, 300.0, 20.0)), axis=-1).reshape(-1, 2)

    def depth_m(north, east):  # the isobath lies at 200 m north
        return 15.0 + 0.1 * (200.0 - north) + 0.0 * east

    positions = missed.free_locations(settings, depth_m, cells, 60, np.random.default_rng(0))
    assert len(np.unique(positions, axis=0)) == 60
    assert np.mean(np.abs(positions[20:, 0] - 200.0)) < 0.8 * np.mean(np.abs(cells[:, 0] - 200.0))


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


def test_a_path_given_by_waypoints_is_flown_and_judged_like_a_mission():
    ground = SyntheticLake(LakeConfig(seed=3, height_m=400.0, width_m=500.0, north_m=180.0, east_m=230.0))
    lanes = np.array([[0.0, 0.0], [360.0, 30.0], [360.0, 230.0], [0.0, 230.0], [0.0, 430.0], [360.0, 430.0]])
    crossed = peer.steered(lanes, ground, 3)
    stayed = peer.steered(np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 60.0], [0.0, 60.0], [0.0, 0.0]] * 9), ground, 3)
    assert tuple(crossed) == tuple(peer.FIGURES)
    assert crossed["risk_end"] < 0.6 * stayed["risk_end"]
    assert crossed["risk_end"] < crossed["risk_third"]


def test_the_peers_table_pairs_the_missions_of_a_lake():
    lines = [
        {"kind": "valley", "method": method, "lake": lake, **dict.fromkeys(peer.FIGURES, risk)}
        for method, lake, risk in (
            ("tour", "1", 0.5), ("tour", "2", 0.9), ("tour", "3", 9.0),
            ("peer, seed 1", "1", 1.0), ("peer, seed 1", "2", 2.0),
        )
    ]  # fmt: skip
    table = peer.table(lines)
    assert "| valley: tour | 3 | 3.47 |" in table
    assert "| -52 % (-84 to -21; worst -50) |" in table


def test_a_peer_that_cannot_be_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(peer, "PEER", str(tmp_path / "no-such-package"))
    monkeypatch.setattr(peer.venv, "create", lambda folder, **_: (folder / "bin").mkdir(parents=True))
    monkeypatch.setattr(peer, "installer", lambda _: [sys.executable, "-m", "pip", "install", "-q"])
    with pytest.raises(SystemExit, match="no-such-package could not be installed into"):
        peer.environment(tmp_path / "env")
    assert not (tmp_path / "env" / "peer-installed").exists()


def test_two_versions_are_compared_on_the_lakes_that_both_have(tmp_path):
    two_versions = importlib.import_module("benchmarks.planning.cost.two_versions")
    line = two_versions.flown(1, 3, **{"mission.steps": 4})
    assert (line["vehicles"], line["seed"]) == (1, 3)
    assert 0.0 < line["first_s"] < line["mission_s"]
    files = tmp_path / "before.jsonl", tmp_path / "now.jsonl"
    for file, risks in zip(files, ([1.0, 2.0, 9.0], [1.5, 2.5]), strict=True):
        file.write_text("".join(json.dumps({**line, "seed": i, "risk": r}) + "\n" for i, r in enumerate(risks)))
    table = two_versions.table(*files)
    assert table.startswith("| vehicles: 1, lakes: 2 |")
    assert "| risk at the end | 1.500 | 2.000 | +0.500 +- 0.000 | 1.37 (" in table
