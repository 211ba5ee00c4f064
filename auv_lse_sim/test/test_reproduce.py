import json
import re
from dataclasses import replace

import pytest

from auv_lse_sim.campaign import reproduce
from auv_lse_sim.campaign.campaign import cluster
from auv_lse_sim.campaign.reproduce import METHODS, SWEEPS, full_plan, main, quick_plan, sweep_name

TINY = {
    "mission.steps": 3,
    "planner.iterations": 10,
    "gp.map_resolution_m": 20.0,
    "area.polygon_m": [-50.0, -50.0, 200.0, -50.0, 200.0, 200.0, -50.0, 200.0],
    "area.raster_m": 5.0,
    "sim.ideal": True,
}


def test_the_full_plan_is_what_was_asked_for():
    plan = full_plan(50, 10, ("trials", "large", "sensitivity"))
    trials = plan.campaigns["trials"]
    assert len(trials.settings) == 2 * len(METHODS)
    assert len(trials.seeds) == 50
    jobs = trials.jobs()
    assert len(jobs) == 400
    augmented = next(j for j in jobs if j.group == "3 AUVs, augmented").patterns["/**"]
    assert augmented["mission"]["steps"] == 100
    assert (augmented["level_set"]["cost_false_safe"], augmented["level_set"]["cost_false_unsafe"]) == (10.0, 10.0)
    assert augmented["tdma"]["slot_s"] == 10.0
    assert {s.name for s in SWEEPS} == {"loss", "slot", "navigation", "team", "horizon", "iterations", "costs"}
    loss = next(s for s in SWEEPS if s.name == "loss")
    assert [v for v, _ in loss.points] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    sensitivity = plan.campaigns["sensitivity"].jobs()  # refused if two settings were the same mission
    assert len(sensitivity) == len(plan.campaigns["sensitivity"].settings) * 10
    costs = {j.group: j.patterns["/**"]["level_set"] for j in sensitivity}["costs 4, best"]
    assert costs["cost_false_safe"] == pytest.approx(16.0)
    assert costs["cost_false_unsafe"] == pytest.approx(4.0)


def test_sensitivities_of_chosen_methods_are_the_same_missions():
    every = {j.id: j for j in full_plan(1, 2, ("sensitivity",)).campaigns["sensitivity"].jobs()}
    some = full_plan(1, 2, ("sensitivity",), ("best",)).campaigns["sensitivity"].jobs()
    assert len(some) * 3 == len(every)
    assert all(every[j.id].group.endswith(", best") for j in some)


def test_points_at_the_default_are_flown_once_for_all_sweeps():
    loss, team = SWEEPS[0], next(s for s in SWEEPS if s.name == "team")
    assert sweep_name(loss, 0.0, "best") == sweep_name(team, 3.0, "best") == "default, best"
    assert sweep_name(team, 2.0, "best") == "team 2, best"


def test_the_large_area_is_four_times_the_trials():
    plan = full_plan(1, 1, ("trials", "large"))
    from auv_lse_gp.area import corners

    def area(flat):
        low, high = corners("p", tuple(flat)).min(axis=0), corners("p", tuple(flat)).max(axis=0)
        return float((high - low).prod())

    trial, large = (plan.campaigns[name].jobs()[0].patterns["/**"]["area"]["polygon_m"] for name in ("trials", "large"))
    assert area(large) == pytest.approx(4.0 * area(trial))


def test_a_reproduction_in_miniature(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(reproduce, "SMALL", TINY)
    monkeypatch.setattr(reproduce, "METHODS", ("augmented", "lawnmower"))
    plan = replace(quick_plan(1e9), shown=((3, "augmented"),))
    for name, spec in plan.campaigns.items():
        plan.campaigns[name] = replace(spec, seeds=(1, 2) if name == "trials" else (1,))
    monkeypatch.setattr(reproduce, "quick_plan", lambda budget_s: plan)
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


def test_what_cannot_be_done_is_said(tmp_path, capsys):
    assert main(["--seeds", "0", "--out", str(tmp_path)]) == 2
    assert "--seeds 0" in capsys.readouterr().err
