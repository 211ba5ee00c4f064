"""auv_lse bench planners: manifests, planners of others, and the page."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import bench
from benchmarks.planning.planners import grounds, page
from benchmarks.planning.planners.flight import mission
from benchmarks.planning.planners.interface import loaded
from benchmarks.planning.planners.judge import Judgement

SMALL = {
    "area.polygon_m": [-40.0, -40.0, 200.0, -40.0, 200.0, 200.0, -40.0, 200.0],
    "sim.lake.north_m": 80.0,
    "sim.lake.east_m": 80.0,
    "sim.lake.height_m": 240.0,
    "sim.lake.width_m": 240.0,
    "gp.map_resolution_m": 10.0,
}


def judgement(*found: float) -> Judgement:
    return Judgement(found=found, risk=1.0, true_loss=0.5, false_share=0.0, error_m=1.0, true_m=100.0, found_m=90.0)


def test_the_distance_to_a_share_is_interpolated_and_1_if_it_is_never_reached() -> None:
    found = judgement(0.2, 0.6, 0.6, 0.9)
    assert found.distance(0.5) == pytest.approx((1.0 + 0.75) / 4.0)
    assert found.distance(0.8) == pytest.approx((3.0 + 2.0 / 3.0) / 4.0)
    assert found.distance(0.95) == 1.0


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


def test_the_shipped_manifest_uses_no_ground_for_two_roles() -> None:
    import yaml

    listed = yaml.safe_load(Path("config/planner_grounds.yaml").read_text())["grounds"]
    assert len({entry["name"] for entry in listed}) == len(listed)
    made_up = [str(entry["mission"]) for entry in listed if "file" not in entry]
    assert len(set(made_up)) == len(made_up)


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


def test_rivals_return_locations_inside_the_area() -> None:
    for name in ("straddle", "randomized_straddle", "level_set_ucb", "truvar"):
        assert np.isfinite(mission(name, SMALL, 1, 1, 3)["risk"])


def test_the_page_pairs_missions_ground_by_ground() -> None:
    lines = [
        {
            "ground": ground, "role": "reporting", "planner": planner, "vehicles": 1, "seed": 1, "legs": 100,
            "found": [end / 12.0 * n for n in range(1, 13)], "to_50": 0.5, "to_80": 0.8, "to_95": 1.0, "risk": 1.0,
            "true_loss": 0.5, "false_share": 0.0, "error_m": 1.0, "cpu_s": 1.0,
        }
        for ground in ("a", "b") for planner, end in (("line", 0.9), ("plain", 0.6))
    ]  # fmt: skip
    text = page.page(lines, ["plain"])
    assert "| line | 2 | +0.30 (+0.30 to +0.30)" in text
    assert "| a | 0.90 | 0.60 |" in text


def test_the_command_names_an_unknown_ground() -> None:
    options = bench.parser().parse_args(["planners", "--only", "nowhere", "--planners", "line"])
    with pytest.raises(ValueError, match="has no reporting ground nowhere"):
        bench.run(options)


def test_a_ground_whose_file_is_missing_is_left_out_with_a_sentence_unless_it_is_named(tmp_path: Path) -> None:
    left_out: list[str] = []
    found = grounds.read(Path("config/planner_grounds.yaml"), tmp_path, "reporting", leave_out=left_out.append)
    assert len(found) == 6
    assert len(left_out) == 2
    assert "Lake Caputh: there is no file" in left_out[0]
    with pytest.raises(ValueError, match="Lake Caputh: there is no file"):
        grounds.read(Path("config/planner_grounds.yaml"), tmp_path, "reporting", ["Lake Caputh"], left_out.append)
