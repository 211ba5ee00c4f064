"""auv_lse bench planners: planners in a file or a package of others, their mistakes, and those of a manifest."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import pytest
from full_disk import full_disk

from benchmarks import bench, results_file
from benchmarks.planning.planners import grounds, page
from benchmarks.planning.planners.flight import mission
from benchmarks.planning.planners.interface import loaded, made, source_of

EAST = (
    "class East:\n    replan_legs = None\n"
    "    def path(self, view):\n        return view.position_m + [[0.0, 60.0]]\n"
    "def planner():\n    return East()\n"
)


def test_a_planner_file_may_have_a_dataclass_with_postponed_annotations(tmp_path: Path) -> None:
    file = tmp_path / "greedy.py"
    file.write_text(
        "from __future__ import annotations\nimport dataclasses\n"
        "@dataclasses.dataclass\nclass Greedy:\n    replan_legs: int | None = 2\n"
        "    def path(self, view):\n        return view.position_m\n"
        "def planner():\n    return Greedy()\n"
    )
    assert made(loaded(str(file))).replan_legs == 2
    assert "greedy" not in sys.modules, "it must not replace a module of that name"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def planner() return 3\n", r"own\.py: SyntaxError: .*own\.py, line 1"),
        ("import nothing_such\n", r"own\.py, line 1, in <module>: ModuleNotFoundError: No module named 'nothing_such'"),
        ("WIDTH = 1 / 0\n", r"own\.py, line 1, in <module>: ZeroDivisionError"),
        ("planner = 3\n", r"own\.py has no function planner\(\)"),
    ],
)
def test_a_planner_file_that_cannot_be_loaded_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(ValueError, match=message):
        loaded(str(tmp_path / "own.py"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "def planner():\n    open('/nowhere/weights.npz')\n",
            r"own\.py, line 2, in planner: FileNotFoundError: .*weig",
        ),
        ("def planner():\n    raise SystemExit('done')\n", r"own\.py, line 2, in planner: SystemExit: done"),
        ("def planner():\n    pass\n", r"planner\(\) must return an object with path\(view\) .*, not NoneType"),
        (
            EAST.replace("    replan_legs = None\n", ""),
            r"whole number of legs from 1, not East with replan_legs 'missing'",
        ),
        (EAST.replace("= None", "= '3'"), r"from 1, not East with replan_legs '3'"),
        (EAST.replace("= None", "= 0"), r"from 1, not East with replan_legs 0"),
    ],
)
def test_a_planner_that_cannot_be_made_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(ValueError, match=message):
        made(loaded(str(tmp_path / "own.py")))


def test_a_change_of_a_package_makes_other_missions_of_its_planner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its results would be those of the package before the change."""
    package, info = tmp_path / "lab_planners_of_test", tmp_path / "lab_planners_of_test-1.0.dist-info"
    package.mkdir()
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab_planners_of_test\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[auv_lse.planners]\nlab_east = lab_planners_of_test.east:planner\n")
    (package / "__init__.py").touch()
    (package / "east.py").write_text(EAST)
    (package / "step.py").write_text("STEP_M = 60.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = source_of("lab_east")
    assert made(loaded("lab_east")).replan_legs is None
    assert source_of("lab_east") == before
    (package / "step.py").write_text("STEP_M = 30.0\n")
    assert source_of("lab_east") != before
    assert source_of("tour") == b""
    monkeypatch.delitem(sys.modules, "lab_planners_of_test")
    monkeypatch.delitem(sys.modules, "lab_planners_of_test.east")


def test_a_manifest_names_unknown_keys_and_roles_also_of_grounds_of_another_role(tmp_path: Path) -> None:
    manifest = tmp_path / "grounds.yaml"

    def read(**change: object) -> None:
        bay = {"name": "bay", "role": "reporting"}
        manifest.write_text(json.dumps({"grounds": [bay, {"name": "pond", "role": "tuning", **change}]}))
        grounds.read(manifest, role="reporting")

    read()
    with pytest.raises(ValueError, match=r"pond: unknown key license; use file, licence, mission"):
        read(license="CC0")
    with pytest.raises(
        ValueError, match=r"pond: role is 'report'; a ground has a name, a role \(tuning, choosing or rep"
    ):
        read(role="report")


def test_parameters_of_a_ground_are_checked_before_the_first_mission(tmp_path: Path) -> None:
    manifest, results = tmp_path / "grounds.yaml", tmp_path / "results.jsonl"
    listed = [{"name": "bay", "role": "tuning"}, {"name": "pond", "role": "tuning", "mission": {"sim.lake.sead": 3}}]
    manifest.write_text(json.dumps({"grounds": listed}))
    words = ["planners", "--grounds", str(manifest), "--role", "tuning", "--out", str(results), "--legs", "2"]
    with pytest.raises(ValueError, match=re.escape(f"{manifest}: pond: sim.lake.sead: unknown parameter (value 3)")):
        bench.run(bench.parser().parse_args([*words, "--planners", "fitted_lanes"]))
    assert not results.exists()


def test_the_planner_of_the_page_about_methods_can_be_flown(tmp_path: Path) -> None:
    page = Path(__file__).resolve().parents[3] / "docs" / "extending" / "adding-a-method.md"
    file = tmp_path / "ambiguous.py"
    file.write_text(re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)[-1])
    small = {"area.polygon_m": [-40.0, -40.0, 200.0, -40.0, 200.0, 200.0, -40.0, 200.0], "gp.map_resolution_m": 10.0}
    figures = [mission(str(file), small, 1, seed, 4) for seed in (1, 1, 2)]
    for flown in figures:
        flown.pop("cpu_s")
    assert figures[0] == figures[1] != figures[2]


def test_the_page_names_the_number_of_missions_where_some_have_no_value() -> None:
    common = {"ground": "a", "role": "tuning", "simulation": "light", "vehicles": 1, "legs": 9, "found": [0.5] * 12}
    values = {"to_80": 1.0, "risk": 1.0, "missed_m": 9.0}
    lines = [
        {**common, **values, "planner": planner, "seed": seed, "error_m": error_m, "true_loss": loss}
        for planner, losses in (("line", (0.4, 0.5)), ("plain", (0.8, 0.0)))
        for seed, error_m, loss in zip((1, 2), (3.0, float("nan")), losses, strict=True)
    ]
    text = page.page(lines, ["plain"])
    assert "Each vehicle has 9 legs. *Found*: share of the true isobath within 10 m of the line called found." in text
    assert text.count("| 3.0 (1 of 2 missions) |") == 2
    assert "| 0.50 (1 of 2 pairs) |" in text


def test_a_mission_whose_process_is_killed_is_an_error_with_a_cure(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"process of a mission was killed.*rows\.jsonl keeps the missions"):
        list(results_file.fly(os._exit, [(1,)], tmp_path / "rows.jsonl", 1))


def test_a_full_disk_names_the_results_file(tmp_path: Path) -> None:
    rows = tmp_path / "rows.jsonl"
    with full_disk(4096), pytest.raises(OSError, match="File too large") as caught:
        list(results_file.fly(dict, [([("found", 5000 * "x")],)], rows, 1))
    assert caught.value.filename == str(rows)


def test_a_name_of_ours_for_a_planner_of_a_package_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "lab_lines_of_test-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab_lines_of_test\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[auv_lse.planners]\nline = lab_lines_of_test:planner\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    refused = r"--planners line: the entry point lab_lines_of_test:planner has that name, too. Rename it"
    with pytest.raises(ValueError, match=refused):
        bench.run(bench.parser().parse_args(["planners", "--planners", "line"]))


def test_a_planner_that_does_not_fly_is_not_compared_with(tmp_path: Path) -> None:
    words = ["planners", "--out", str(tmp_path / "rows.jsonl"), "--planners", "line", "--against", "plain", "tour"]
    with pytest.raises(ValueError, match=r"--against plain, tour: not flown. Add them to --planners"):
        bench.run(bench.parser().parse_args(words))
    assert not (tmp_path / "rows.jsonl").exists()


def test_a_mission_that_fails_stops_no_other_and_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest, results = tmp_path / "grounds.yaml", tmp_path / "results.jsonl"
    area_m = [-40.0, -40.0, 200.0, -40.0, 200.0, 200.0, -40.0, 200.0]
    small = {"area.polygon_m": area_m, "gp.map_resolution_m": 10.0}
    manifest.write_text(json.dumps({"grounds": [{"name": "small", "role": "tuning", "mission": small}]}))
    (tmp_path / "east.py").write_text(EAST)
    (tmp_path / "bad.py").write_text(EAST.replace("60.0", "1 / 0"))
    planners = [str(tmp_path / "bad.py"), str(tmp_path / "east.py")]
    words = ["planners", "--grounds", str(manifest), "--role", "tuning", "--out", str(results), "--legs", "2"]
    options = bench.parser().parse_args([*words, "--processes", "1", "--planners", *planners])
    assert bench.run(options) == 1
    (line,) = results.read_text().splitlines()
    assert json.loads(line)["planner"] == planners[1]
    printed = capsys.readouterr()
    assert re.search(r"failed: .*bad\.py on small, seed 1: step 0: .*bad\.py, line 4, in path: ZeroDiv", printed.err)
    assert printed.err.endswith("1 mission failed; the page has the others\n")
    assert "1 mission over 1 ground" in printed.out
    assert bench.run(bench.parser().parse_args([*words, "--processes", "1", "--planners", planners[0]])) == 1
    printed = capsys.readouterr()
    assert printed.err.endswith("every mission failed; there is no page\n")
    assert printed.out == ""


def test_a_planner_may_write_to_what_it_gets(tmp_path: Path) -> None:
    small = {"area.polygon_m": [-40.0, -40.0, 200.0, -40.0, 200.0, 200.0, -40.0, 200.0], "gp.map_resolution_m": 10.0}
    ambiguous = (
        "import numpy as np\nclass Own:\n    replan_legs = 1\n    def path(self, view):\n"
        "        mean_m, variance_m2 = view.posterior.moments(view.cells_m)\n"
        "        best = np.argmax(np.sqrt(variance_m2) - abs(mean_m - view.level_m) + view.depths_m.sum())\n"
        "        answer = view.cells_m[[best]]\n{}        return answer\n"
        "def planner():\n    return Own()\n"
    )
    arrays = ("locations_m", "depths_m", "noise_std_m", "cells_m", "position_m")
    scribble = "".join(f"        view.{name}[:] = 1.0\n" for name in arrays)
    figures = []
    for name, lines in (("tidy.py", ""), ("scribbles.py", scribble)):
        (tmp_path / name).write_text(ambiguous.format(lines))
        figures.append(mission(str(tmp_path / name), small, 1, 1, 8))
        figures[-1].pop("cpu_s")
    assert figures[0] == figures[1]
