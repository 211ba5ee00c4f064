"""auv_lse bench planners: manifests, planners of others, and the page."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_record.run_data import RunData
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.positions.adjustment import corrects_positions
from benchmarks import bench, results_file
from benchmarks.planning.planners import dec_mcts, flight, grounds, page, rivals, sgptools_rivals
from benchmarks.planning.planners.flight import mission
from benchmarks.planning.planners.interface import View, loaded, waypoints_of
from benchmarks.planning.planners.judge import Judgement, longest_missed_m
from benchmarks.planning.planners.options import PEER_NAMES, RIVAL_NAMES

SMALL = {
    "area.polygon_m": [-40.0, -40.0, 200.0, -40.0, 200.0, 200.0, -40.0, 200.0],
    "sim.lake.north_m": 80.0,
    "sim.lake.east_m": 80.0,
    "sim.lake.height_m": 240.0,
    "sim.lake.width_m": 240.0,
    "gp.map_resolution_m": 10.0,
}


def judgement(*found: float) -> Judgement:
    return Judgement(found=found, risk=1.0, true_loss=0.5, false_share=0.0, error_m=1.0, true_m=100.0, missed_m=8.0)


def test_the_distance_to_a_share_is_interpolated_and_1_if_it_is_never_reached() -> None:
    found = judgement(0.2, 0.6, 0.6, 0.9)
    assert found.distance(0.5) == pytest.approx((1.0 + 0.75) / 4.0)
    assert found.distance(0.8) == pytest.approx((3.0 + 2.0 / 3.0) / 4.0)
    assert found.distance(0.95) == 1.0


def test_the_longest_missed_piece_is_connected_also_across_the_ends_of_a_closed_line() -> None:
    ring = np.array([[0.0, 0.0], [0.0, 200.0], [100.0, 200.0], [100.0, 0.0], [0.0, 0.0]])
    line = np.array([[500.0, 0.0], [500.0, 300.0]])
    assert longest_missed_m([], []) == 0.0
    assert longest_missed_m([ring, line], []) == pytest.approx(600.0)
    assert longest_missed_m([line], [np.array([[500.0, 100.0], [500.0, 200.0]])]) == pytest.approx(90.0, abs=3.0)
    side = ring[2:4]  # 200 m of 600 m, and 10 m beyond its ends count as found
    assert longest_missed_m([ring, line], [side, line]) == pytest.approx(380.0, abs=5.0)


def test_a_manifest_names_source_and_hash_of_each_file_and_refuses_another_file(tmp_path: Path) -> None:
    (tmp_path / "lake.npz").write_bytes(b"depths")
    entry = {
        "name": "lake", "role": "reporting", "file": "lake.npz", "source": "https://example.org", "licence": "CC0",
        "projection": "local", "sha256": hashlib.sha256(b"depths").hexdigest(),
    }  # fmt: skip
    manifest = tmp_path / "grounds.yaml"

    def read(**change: object) -> list[grounds.Ground]:
        manifest.write_text(json.dumps({"grounds": [{**entry, **change}]}))
        return grounds.read(manifest)

    assert read()[0].parameters["sim.bathymetry.file"] == str(tmp_path / "lake.npz")
    with pytest.raises(ValueError, match="not the one listed"):
        read(sha256="0" * 64)
    with pytest.raises(ValueError, match="also has licence"):
        read(licence="")
    with pytest.raises(ValueError, match="has a name, a role"):
        read(role="anything")
    with pytest.raises(ValueError, match="there is no file"):
        read(file="other.npz")


def test_a_manifest_with_two_grounds_of_one_name_or_without_mappings_is_refused(tmp_path: Path) -> None:
    manifest = tmp_path / "grounds.yaml"

    def read(listed: object) -> None:
        manifest.write_text(json.dumps({"grounds": listed}))
        grounds.read(manifest)

    bay = {"name": "bay", "role": "tuning"}
    with pytest.raises(ValueError, match="several grounds are called bay; give each a name of its own"):
        read([bay, {**bay, "mission": {"sim.lake.seed": 2}}])
    with pytest.raises(ValueError, match=r"grounds must be a list of mappings, not \['bay'\]"):
        read(["bay"])
    with pytest.raises(ValueError, match="bay: mission must hold parameters by dotted name"):
        read([{**bay, "mission": [3]}])


@pytest.mark.parametrize("manifest", sorted(Path("config").glob("planner_grounds*.yaml")), ids=lambda path: path.stem)
def test_a_shipped_manifest_uses_no_ground_for_two_roles(manifest: Path) -> None:
    import yaml

    listed = yaml.safe_load(manifest.read_text())["grounds"]
    assert len({entry["name"] for entry in listed}) == len(listed)
    made_up = [str(entry["mission"]) for entry in listed if "file" not in entry]
    assert len(set(made_up)) == len(made_up)
    left_out: list[str] = []
    found = grounds.read(manifest, leave_out=left_out.append)
    assert len(found) + len(left_out) == len(listed)
    for ground in found:
        Settings.load(None, ground.parameters)


def test_a_planner_in_a_file_is_flown_by_our_steering_and_judged(tmp_path: Path) -> None:
    file = tmp_path / "east.py"
    file.write_text(
        "class East:\n    replan_legs = None\n"
        "    def path(self, view):\n"
        "        assert view.noise_std_m.shape == view.depths_m.shape\n"
        "        return view.position_m + [[0.0, 60.0]]\n"
        "def planner():\n    return East()\n"
    )
    result = mission(str(file), SMALL, 1, 1, 5)
    assert len(result["found"]) == 12
    assert result["risk"] > 0.0
    assert result["true_m"] > 0.0
    with pytest.raises(ValueError, match="There is no planner"):
        loaded("nobody")


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ([[10.0, 20.0, 30.0, 40.0], [0.0, 0.0, 0.0, 0.0]], r"step 0: path\(\) .* not the shape \(2, 4\)"),
        ([[10.0, 20.0, 1.5]], r"not the shape \(1, 3\)"),
        ([], r"n at least 1, not the shape \(0,\)"),
        (None, r"not the shape \(\)"),
        ([[10.0], [1.0, 2.0]], r"must return waypoints \(n, 2\) in metres"),
        ([[10.0, 20.0], [float("nan"), 3.0]], r"returned the waypoint \[nan, 3\.0\]; return finite metres"),
    ],
)
def test_an_answer_that_is_no_waypoints_is_refused(answer: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        waypoints_of(answer, 0)


def test_an_error_of_a_planner_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "divides.py"
    file.write_text(
        "class Divides:\n    replan_legs = 1\n"
        "    def path(self, view):\n"
        "        return self.next(view) if view.legs_left < 5 else view.position_m\n"
        "    def next(self, view):\n"
        "        return float('x')\n"
        "def planner():\n    return Divides()\n"
    )
    with pytest.raises(ValueError, match=r"step 1: .*divides.py, line 6, in next: ValueError: could not convert"):
        mission(str(file), SMALL, 1, 1, 5)


def test_one_waypoint_may_be_a_row() -> None:
    assert waypoints_of((3, 4), 0).tolist() == [[3.0, 4.0]]


def test_a_waypoint_behind_land_is_reached(tmp_path: Path) -> None:
    # a bay of land, open to the west, between the start and the waypoint in the east
    bay = [-20.0, 10.0, -20.0, 80.0, 100.0, 80.0, 100.0, 60.0, 0.0, 60.0, 0.0, 10.0]
    file, track = tmp_path / "east.py", tmp_path / "track"
    file.write_text(
        "class East:\n    replan_legs = 1\n"
        "    def path(self, view):\n"
        f"        open({str(track)!r}, 'a').write(f'{{view.position_m[0]}} {{view.position_m[1]}}\\n')\n"
        "        return [[30.0, 150.0]]\n"
        "def planner():\n    return East()\n"
    )
    start = {"vehicle.start_north_m": 30.0, "vehicle.start_east_m": 35.0, "vehicle.start_heading_rad": 1.57}
    mission(str(file), {**SMALL, **start, "area.no_go": {"bay": bay}}, 1, 1, 20)
    off_m = np.hypot(*(np.loadtxt(track) - [30.0, 150.0]).T)
    assert off_m.min() < 20.0


def test_a_mission_of_the_whole_simulation_is_judged_in_thirds_by_the_map_of_its_report() -> None:
    result = mission("fitted_lanes", SMALL, 2, 1, 15, whole=True)
    overrides = {**SMALL, "planner.method": "lawnmower", "mission.vehicles": 2, "mission.steps": 15}
    report = simulate_and_evaluate(Settings.load(None, overrides).to_patterns(), "test", 2).summary
    assert len(result["found"]) == 3
    assert 0.1 < result["found"][-1] == report.isobath_found
    assert result["found"][0] < result["found"][-1]
    assert (result["risk"], result["true_loss"]) == (report.risk_after, report.loss_after)


@pytest.mark.parametrize(("planner", "corrected"), [("plain", True), ("plain_uncorrected", False)])
def test_the_papers_methods_are_judged_at_corrected_positions_as_all_others(
    monkeypatch: pytest.MonkeyPatch, planner: str, corrected: bool
) -> None:
    runs: list[RunData] = []
    monkeypatch.setattr(flight, "judgement_of", lambda run: (runs.append(run), judgement(0.5))[1])
    mission(planner, SMALL, 2, 1, 6, whole=True)
    assert corrects_positions(runs[-1]) == corrected
    assert any(vehicle.mates for vehicle in runs[-1].vehicles) == corrected, "packets carry navigation"


def test_a_ground_on_which_the_level_does_not_occur_is_refused() -> None:
    for planner in ("fitted_lanes", "hindsight"):
        with pytest.raises(ValueError, match=r"no isobath at 200 m in its area\. Change level_set\.level_m"):
            mission(planner, {**SMALL, "level_set.level_m": 200.0}, 1, 1, 3)


def test_a_mission_that_ended_early_keeps_the_share_of_its_end() -> None:
    soon = {**SMALL, "mission.until.found": 0.05}
    result = mission("tour", soon, 1, 1, 60, whole=True)
    assert len(result["found"]) == 3
    assert 0.0 < result["found"][0] == result["found"][1] == result["found"][2]


def view_of(west_m: float = 40.0, mates_m: list[np.ndarray] | None = None, vehicle: int = 1) -> View:
    """A vehicle in the middle of 400 m x 400 m, 9 soundings on each side: at the level in the east, `west_m` in the
    west."""
    prior = GpConfig(mean_depth_m=15.0, signal_std_m=8.0, length_scale_m=85.0, noise_std_m=0.3)
    area = OperatingArea(AreaConfig(polygon_m=(-200.0, -200.0, 200.0, -200.0, 200.0, 200.0, -200.0, 200.0)))
    side = np.stack(np.meshgrid([-150.0, 0.0, 150.0], [50.0, 100.0, 150.0], indexing="ij"), -1).reshape(-1, 2)
    depths = np.repeat([15.0, west_m], len(side))
    data = Centers(np.concatenate([side, side * [1.0, -1.0]]), depths, np.full(len(depths), 0.3), None)
    posterior = Posterior(prior)
    posterior.extend(data)
    cells = area.grid(20.0).locations_m
    motion = MotionTable(MotionConfig())
    return View(
        locations_m=data.locations_m, depths_m=data.depths_m, noise_std_m=data.noise_std_m, prior=prior,
        posterior=posterior, level_m=15.0, area=area, cells_m=cells[area.clearance_m(cells) >= area.margin_m],
        position_m=np.zeros(2), heading_rad=0.0, legs_left=30, leg_m=motion.leg_length_m, motion=motion,
        vehicle=vehicle, mates_m=mates_m or [], rng=np.random.default_rng(1),
    )  # fmt: skip


def test_rivals_fly_and_prefer_the_ambiguous_side() -> None:
    for name in RIVAL_NAMES:
        if name not in PEER_NAMES:
            assert np.isfinite(mission(name, SMALL, 1, 1, 3)["risk"])
            view = view_of()
            path = rivals.RIVALS[name]().path(view)
            assert (view.area.clearance_m(path) >= view.area.margin_m).all(), name
            assert path[-1, 1] > 0.0, name


def test_planners_get_cells_that_a_vehicle_can_reach_and_their_number_in_the_team(tmp_path: Path) -> None:
    file = tmp_path / "looks.py"
    file.write_text(
        "class Looks:\n    replan_legs = None\n"
        "    def path(self, view):\n"
        "        assert (view.area.clearance_m(view.cells_m) >= view.area.margin_m).all()\n"
        f"        open(r'{tmp_path}/numbers', 'a').write(str(view.vehicle))\n"
        "        return view.position_m + [[0.0, 60.0]]\n"
        "def planner():\n    return Looks()\n"
    )
    mission(str(file), SMALL, 2, 1, 2)
    assert set((tmp_path / "numbers").read_text()) == {"1", "2"}


def test_a_waypoint_out_of_reach_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "outside.py"
    file.write_text(
        "class Outside:\n    replan_legs = None\n"
        "    def path(self, view):\n"
        f"        open(r'{tmp_path}/legs', 'a').write(f'{{view.legs_left}} ')\n"
        "        return view.position_m + [[0.0, 2000.0]]\n"
        "def planner():\n    return Outside()\n"
    )
    mission(str(file), SMALL, 1, 1, 30)
    legs = [int(left) for left in (tmp_path / "legs").read_text().split()]
    assert legs[0] == 30
    assert 30 - legs[1] < 20  # 9 legs to the border, then 6


def test_the_look_ahead_is_that_of_a_posterior_with_the_measurement() -> None:
    view = view_of(mates_m=[np.array([[100.0, 120.0], [120.0, 120.0]])])
    cells, at, covariance = rivals._joint(view)
    scores = rivals.GlobalSur()._scores(view, at, covariance)
    level = LevelSet(level_m=15.0, cost_false_safe=1.0, cost_false_unsafe=1.0)
    for number in (3, 150):
        after = view.posterior.with_planned(np.concatenate([*view.mates_m, cells[[number]]])).at(cells)
        moved = np.sqrt(after.data_var_m2 - after.planned_var_m2)
        expected = level.expected_risk(after.mean_m, moved, np.sqrt(after.planned_var_m2)).sum()
        assert -scores[number] == pytest.approx(expected, rel=1e-6)


def test_the_expected_change_of_volume_agrees_with_a_dense_sum_over_outcomes() -> None:
    view = view_of()
    _, at, covariance = rivals._joint(view)
    scores = rivals.ExpectedAbsoluteVolumeChange()._scores(view, at, covariance)
    number, z = int(np.argmax(scores)), np.linspace(-6.0, 6.0, 1201)
    moves = covariance[number] / np.sqrt(covariance[number, number] + 0.3**2)
    gap = 15.0 - at.mean_m
    after = ndtr((gap - z[:, None] * moves) / np.sqrt(at.planned_var_m2 - moves**2 + 1e-9)).sum(axis=1)
    change = np.abs(after - ndtr(gap / np.sqrt(at.planned_var_m2)).sum())
    dense = float((change * np.exp(-0.5 * z**2)).sum() * (z[1] - z[0]) / np.sqrt(2.0 * np.pi))
    assert scores[number] == pytest.approx(dense, rel=0.03)  # 16 outcomes; for |z| their mean is 2 % low


def test_dec_mcts_avoids_what_a_mate_plans() -> None:
    for side in (1.0, -1.0):
        mate = np.stack([np.tile(np.arange(-180.0, 181.0, 20.0), 4), side * np.repeat([30.0, 70.0, 110.0, 150.0], 19)])
        path = dec_mcts.DecMcts().path(view_of(west_m=15.0, mates_m=[mate.T]))
        assert side * path[-1, 1] < 0.0


def test_the_distribution_of_dec_mcts_follows_the_papers_gradient() -> None:
    once = dec_mcts.updated(np.array([0.5, 0.5]), np.array([1.0, 0.0]), 1.0, 0.01)
    assert once == pytest.approx([0.5025, 0.4975])  # slopes (.5 - 1) and (.5 - 0); the entropy cancels; alpha = .01
    chances, values = np.full(3, 1.0 / 3.0), np.array([0.2, 1.0, 0.6])
    for _ in range(5000):
        chances = dec_mcts.updated(chances, values, 0.5, 0.01)
    assert chances == pytest.approx(np.exp(values / 0.5) / np.exp(values / 0.5).sum(), rel=1e-3)  # least free energy


def test_rivals_with_two_sets_of_parameters_choose_by_each() -> None:
    view = view_of()
    mean, std = rivals._moments(view)
    wide = rivals.RIVALS["level_set_ucb_3"]().path(view)
    assert (wide == view.cells_m[np.argmax(3.0 * std - np.abs(mean - view.level_m))]).all()
    children = [dec_mcts._Node((n,), np.zeros(3), [], dec_mcts.PARAMETERS) for n in (0, 1)]
    for now, (number, value) in enumerate([(0, 0.5), (0, 0.5), (0, 0.5), (1, 0.0)], 1):
        children[number].back_up(now, value, (number,))
    for parameters, chosen in ((dec_mcts.PARAMETERS, 0), (dec_mcts.WIDE, 1)):
        root = dec_mcts._Node((), np.zeros(3), [], parameters, children)
        assert root.child(4, 1.0).actions == (chosen,)


def test_rollouts_of_dec_mcts_fade() -> None:
    node = dec_mcts._Node((), np.zeros(3), [], dec_mcts.PARAMETERS)
    node.back_up(1, 1.0, (0,))
    node.back_up(3, 0.0, (1,))
    assert (node.visits, node.total) == pytest.approx((1.81, 0.81))  # .9 ** 2 each, and 1 more visit
    assert node.best == (1.0, (0,))
    assert node.visits_at(4) == pytest.approx(0.9 * 1.81)


def test_each_vehicle_travels_its_share_of_the_path_of_sgptools(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def answer(python: Path, wanted: dict[str, object]) -> list[list[list[float]]]:
        asked.append(wanted)
        return [[[0.0, 0.0], [vehicle, 1.0], [vehicle, 2.0]] for vehicle in (1.0, 2.0)]

    monkeypatch.setattr(sgptools_rivals, "answer", answer)
    for make in (sgptools_rivals.ContinuousSgp, sgptools_rivals.GcbCover):
        for vehicle in (1, 2):
            planner, view = make(Path("python")), view_of(mates_m=[np.empty((0, 2))], vehicle=vehicle)
            assert planner.path(view).tolist() == [[vehicle, 1.0], [vehicle, 2.0]]
            assert planner.path(view).tolist() == [[vehicle, 2.0], [vehicle, 1.0]]
    assert [wanted.get("variance_m2") for wanted in asked] == [None, pytest.approx(0.7 * 64.0)]  # once for the team
    assert asked[0]["vehicles"] == 2
    sgptools_rivals.maker("gcb_cover", Path("python"))().path(view)
    assert len(asked) == 3  # another mission plans anew, so that its time counts
    with pytest.raises(ValueError, match="--environment FOLDER"):
        mission("gcb_cover", SMALL, 1, 1, 3)


def test_the_command_names_the_environment_that_a_planner_needs() -> None:
    options = bench.parser().parse_args(["planners", "--only", "banks 51", "--planners", "line", "continuous_sgp"])
    with pytest.raises(ValueError, match=r"^continuous_sgp: sgptools==.*--environment FOLDER"):
        bench.run(options)


def test_the_page_pairs_missions_ground_by_ground() -> None:
    lines = [
        {
            "ground": ground, "role": "reporting", "simulation": "light", "planner": planner, "vehicles": 1,
            "seed": 1, "legs": 100,
            "found": [end / 12.0 * n for n in range(1, 13)], "to_50": 0.5, "to_80": 0.8, "to_95": 1.0, "risk": 1.0,
            "true_loss": 0.5, "false_share": 0.0, "error_m": 1.0, "cpu_s": 1.0, "missed_m": missed_m,
        }
        for ground, missed_m in (("a", 40.0), ("b", 90.0)) for planner, end in (("line", 0.9), ("plain", 0.6))
    ]  # fmt: skip
    lines[0]["found"][10:] = [0.6, 0.9]
    text = page.page(lines, ["plain"])
    means = text.splitlines()[text.splitlines().index("## 1 vehicle") + 2 :][:4]
    assert means[0].split(" | ")[9] == "fell by"
    assert [row.split(" | ")[9] for row in means[2:]] == ["0.15", "0.00"], "the largest fall of the planner's missions"
    assert "| line | 2 | +0.30 (+0.30 to +0.30)" in text
    assert "| a | 0.90 | 0.60 |" in text
    assert "| misses 40 m | longest missed (m) |" in text
    assert "| 0.50 | 90 |" in text


def test_hindsight_has_no_ratios_and_others_can_be_compared_with_it() -> None:
    light = {"ground": "a", "role": "tuning", "simulation": "light", "vehicles": 1, "seed": 1, "legs": 100}
    common = {**light, "found": [0.5] * 12, "to_50": 0.5, "to_80": 0.8, "to_95": 1.0}
    lines = [{**common, "planner": "hindsight"}, {**common, "planner": "line", "risk": 1.0, "true_loss": 0.5}]
    assert "| line | 1 | +0.00 | +0.00 | +0.00 | 1.00 |  |  |" in page.page(lines, ["hindsight"])


def flown_lines(tmp_path: Path, *arguments: str, seed: int = 1) -> list[dict[str, object]]:
    """Lines of the results file after the command with a planner `own.py` on one small ground."""
    manifest, results = tmp_path / "grounds.yaml", tmp_path / "results.jsonl"
    ground = {"name": "small", "role": "tuning", "mission": {**SMALL, "sim.lake.seed": seed}}
    manifest.write_text(json.dumps({"grounds": [ground]}))
    files = ["--grounds", str(manifest), "--out", str(results), "--page", str(tmp_path / "page.md")]
    options = ["--planners", str(tmp_path / "own.py"), "--role", "tuning", "--legs", "2", "--processes", "1"]
    assert bench.run(bench.parser().parse_args(["planners", *files, *options, *arguments])) == 0
    return [json.loads(line) for line in results.read_text().splitlines()]


def test_a_changed_planner_or_ground_is_flown_again_and_nothing_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        "class East:\n    replan_legs = None\n"
        "    def path(self, view):\n        return view.position_m + [[0.0, 60.0]]\n"
        "def planner():\n    return East()\n"
    )
    (tmp_path / "own.py").write_text(text)
    assert len(flown_lines(tmp_path, "--vehicles", "1", "1")) == 1
    assert len(flown_lines(tmp_path)) == 1
    results = tmp_path / "results.jsonl"
    assert "version" not in capsys.readouterr().err
    (line,) = results.read_text().splitlines()
    results.write_text(json.dumps({**json.loads(line), "version": "0.1"}) + "\n" + line + "\n")  # two commands at once
    flown_lines(tmp_path)
    assert (tmp_path / "page.md").read_text().splitlines()[2].startswith("1 mission over 1 ground for")
    results.write_text(json.dumps({**json.loads(line), "version": "0.1"}) + "\n")
    flown_lines(tmp_path)
    assert "results.jsonl come from version 0.1; this is " in capsys.readouterr().err
    (tmp_path / "own.py").write_text(text.replace("60.0", "-60.0"))
    assert len(flown_lines(tmp_path)) == 2
    assert len(flown_lines(tmp_path, seed=2)) == 3
    assert (tmp_path / "page.md").read_text().splitlines()[2].startswith("1 mission over 1 ground for")


def test_a_signal_to_the_command_alone_does_not_wait_for_missions_under_way(tmp_path: Path) -> None:
    """SIGTERM reaches the command only; Ctrl-C and a closed terminal reach its processes, too."""
    (tmp_path / "command.py").write_text(
        "import pathlib, tempfile, time\nfrom benchmarks import results_file\ndef flight(lasts_s):\n"
        "    with tempfile.TemporaryDirectory():\n        time.sleep(lasts_s)\nif __name__ == '__main__':\n"
        "    for _ in results_file.fly(flight, [(0.5,), (60.0,), (60.0,)], pathlib.Path('rows.jsonl'), 2):\n"
        "        raise KeyboardInterrupt\n"
    )
    (tmp_path / "scratch").mkdir()
    root = str(Path(results_file.__file__).parents[1])
    path = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "TMPDIR": str(tmp_path / "scratch")}
    command = [sys.executable, "command.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=30)
    assert done.stderr.splitlines()[-1] == "KeyboardInterrupt"
    assert (tmp_path / "rows.jsonl").read_text() == "null\n"
    assert list((tmp_path / "scratch").iterdir()) == []


def test_a_command_with_nothing_to_fly_or_a_damaged_results_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "grounds.yaml").write_text("grounds: []")
    with pytest.raises(ValueError, match=r"grounds\.yaml has no reporting ground to fly"):
        bench.run(bench.parser().parse_args(["planners", "--grounds", str(tmp_path / "grounds.yaml")]))
    for option in ("--seeds", "--legs", "--vehicles", "--processes"):
        with pytest.raises(SystemExit):
            bench.parser().parse_args(["planners", option, "0"])
    (tmp_path / "results.jsonl").write_text('{"seed": 1}\n{"seed"\n')
    with pytest.raises(ValueError, match=r"results\.jsonl:2: this line is damaged"):
        results_file.read(tmp_path / "results.jsonl")


def test_the_command_names_an_unknown_ground() -> None:
    options = bench.parser().parse_args(["planners", "--only", "nowhere", "--planners", "line"])
    with pytest.raises(ValueError, match=r"has no reporting ground nowhere; it has [^.]*\.$"):
        bench.run(options)
    options = bench.parser().parse_args(["planners", "--only", "banks 1", "--planners", "line"])
    with pytest.raises(ValueError, match=r"has no reporting ground banks 1; .* Add --role tuning\.$"):
        bench.run(options)


def test_a_ground_whose_file_is_missing_is_left_out_with_a_sentence_unless_it_is_named(tmp_path: Path) -> None:
    left_out: list[str] = []
    found = grounds.read(Path("config/planner_grounds.yaml"), tmp_path, "reporting", leave_out=left_out.append)
    assert len(found) == 6
    assert len(left_out) == 6
    assert "Lake Caputh: there is no file" in left_out[0]
    with pytest.raises(ValueError, match="Lake Caputh: there is no file"):
        grounds.read(Path("config/planner_grounds.yaml"), tmp_path, "reporting", ["Lake Caputh"], left_out.append)
