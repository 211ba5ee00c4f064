"""What the reproduction flies."""

import pytest

from auv_lse_common.mission_file.sections.area import corners
from auv_lse_shore.reproduce.study import METHODS, SWEEPS, full_study, sweep_name


def test_the_full_study_is_what_was_asked_for():
    study = full_study(50, 10, ("trials", "large", "sensitivity"))
    trials = study.campaigns["trials"]
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
    sensitivity = study.campaigns["sensitivity"].jobs()  # refused if two settings were the same mission
    assert len(sensitivity) == len(study.campaigns["sensitivity"].settings) * 10
    costs = {j.group: j.patterns["/**"]["level_set"] for j in sensitivity}["costs 4, tour"]
    assert costs["cost_false_safe"] == pytest.approx(16.0)
    assert costs["cost_false_unsafe"] == pytest.approx(4.0)


def test_sensitivities_of_chosen_methods_are_the_same_missions():
    every = {j.id: j for j in full_study(1, 2, ("sensitivity",)).campaigns["sensitivity"].jobs()}
    some = full_study(1, 2, ("sensitivity",), ("tour",)).campaigns["sensitivity"].jobs()
    assert len(some) * 3 == len(every)
    assert all(every[j.id].group.endswith(", tour") for j in some)


def test_points_at_the_default_are_flown_once_for_all_sweeps():
    loss, team = SWEEPS[0], next(s for s in SWEEPS if s.name == "team")
    assert sweep_name(loss, 0.0, "tour") == sweep_name(team, 3.0, "tour") == "default, tour"
    assert sweep_name(team, 2.0, "tour") == "team 2, tour"


def test_the_large_area_is_four_times_the_trials():
    study = full_study(1, 1, ("trials", "large"))

    def area(flat):
        low, high = corners("p", tuple(flat)).min(axis=0), corners("p", tuple(flat)).max(axis=0)
        return float((high - low).prod())

    trial, large = (
        study.campaigns[name].jobs()[0].patterns["/**"]["area"]["polygon_m"] for name in ("trials", "large")
    )
    assert area(large) == pytest.approx(4.0 * area(trial))


def test_the_trials_are_flown_with_a_chart_too():
    study = full_study(50, 10, ("trials", "charted"))
    charted = study.campaigns["charted"].jobs()
    assert len({job.seed for job in charted}) == 20
    assert {job.group for job in charted} == {job.group for job in study.campaigns["trials"].jobs()}
    parameters = charted[0].patterns["/**"]
    assert parameters["sim"]["chart"] == {"smoothing_m": 75.0, "error_m": 2.5, "error_length_m": 75.0}
    assert parameters["gp"]["signal_std_m"] == 5.0


def test_some_sensitivities_can_be_flown_alone():
    study = full_study(1, 5, ("sensitivity",), ("augmented", "plain"), ("loss", "slot", "team"))
    jobs = study.campaigns["sensitivity"].jobs()
    # 6 losses, 4 slot lengths, 8 teams, the default of the three flown once
    assert len(jobs) == (6 + 4 + 8 - 2) * 2 * 5
