"""A judged mission: the summary, and the maps behind it."""

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.topics.records import Transmission
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.certainty import FOUND, LIKELY, lines_of
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_planner.methods import coverage
from auv_lse_record.run_data import GroundGrid, PacketReceived, RunData, VehicleRun
from auv_lse_shore.judge.evaluation import evaluate, ground_grid, local_map
from auv_lse_shore.judge.team_map import mission_settings


class Valley:
    """The ground that `synthetic_run` sounds, over any area."""

    def depth_m(self, north_m, east_m):
        return 15.0 + (np.asarray(north_m) - 120.0 - 30.0 * np.sin(np.asarray(east_m) / 50.0)) / 15.0


@pytest.fixture
def evaluation(synthetic_run):
    return evaluate(synthetic_run())


def test_summary_of_a_known_mission(evaluation, synthetic_run):
    run, s = synthetic_run(), evaluation.summary
    assert (s.vehicles, s.steps, s.method, s.seed) == (2, 30, "augmented", 7)
    assert s.risk_before == pytest.approx(5.0)  # prior mean at the level, c1 = c2 = 10
    team, scored, level_set = evaluation.team, evaluation.scored, LevelSet.of(evaluation.settings[0].level_set)
    by_prior = level_set.risk(team.mean_m[scored], team.prior_std_m[scored])
    assert s.risk_after == pytest.approx(float(by_prior.mean()))
    assert s.loss_expected == pytest.approx(float(team.risk[scored].mean()))
    assert s.loss_expected < 0.8 * s.risk_after  # this ground is smoother than the prior
    assert s.risk_after < 0.2 * s.risk_before
    assert s.risk_after < s.risk_third < s.risk_before
    risk = evaluation.curves.risk
    assert risk[0] == pytest.approx(s.risk_before)
    assert risk[-1] == pytest.approx(s.risk_after, rel=0.1)  # over a part of the locations, soundings in another order
    assert s.area_m2 == 240.0 * 300.0
    assert s.misclassified_m2 == s.false_safe_m2 + s.false_unsafe_m2
    assert s.loss_after == pytest.approx(10.0 * s.misclassified_m2 / s.area_m2)
    assert s.f1 > 0.98
    assert s.isobath_error_m < 2.0
    assert s.distance_m == pytest.approx((30 * 15.0 * np.pi / 2.0,) * 2, rel=1e-3)
    assert s.navigation_error_end_m == pytest.approx((0.002 * run.end_s,) * 2, rel=1e-3)
    assert (s.packets_sent, s.packets_received) == (len(run.sent), len(run.received))
    assert s.delivery == pytest.approx(len(run.received) / len(run.sent))
    assert s.soundings == 2 * len(run.vehicles[0].soundings)
    assert all(0.0 < error < s.risk_before for error in s.local_risk_error)
    assert all(own > s.risk_after for own in s.local_risk)


def test_nothing_is_claimed_in_the_half_of_a_lake_that_nobody_visited(synthetic_run):
    """The line reaches into the west, where it is the prior's, and is far from the true one there; then it ends."""
    run = synthetic_run(steps=30)
    west_m = 1200.0
    run.parameters["/**"]["area"] = {
        "polygon_m": [0.0, -west_m, 240.0, -west_m, 240.0, 300.0, 0.0, 300.0],
        "margin_m": 5.0,
    }
    run.ground = ground_grid(mission_settings(run.parameters, 1)[0], Valley())
    evaluation = evaluate(run)
    s = evaluation.summary
    claimed = lines_of(evaluation.pieces, FOUND, LIKELY)
    assert min(line[:, 1].min() for line in claimed) > -60.0  # the vehicles came as far west as 0
    assert -0.5 * west_m < min(line[:, 1].min() for line in lines_of(evaluation.pieces)) < -150.0
    assert s.isobath_found_error_m < 2.0
    assert s.isobath_found_error_m < 0.5 * s.isobath_error_m  # the whole line's counts what nobody measured
    assert s.isobath_found < 0.35  # a fifth of the area was visited
    assert s.isobath_not_visited_m > 200.0
    assert s.isobath_found_m + s.isobath_likely_m + s.isobath_guessed_m == pytest.approx(s.isobath_length_m)


def test_the_papers_bounds_are_judged_for_its_methods_alone(synthetic_run):
    run = synthetic_run(steps=6)
    assert evaluate(run).summary.path_bound_kept is not None
    run.parameters["/**"]["planner"] = {"method": "tour"}
    s = evaluate(run).summary
    assert s.lower_bound is s.bound_kept is s.path_bound_start is s.path_bound_max is s.path_bound_kept is None


def test_the_bound_of_covering_strips_is_weaker_and_only_that_of_methods_that_promise_it(synthetic_run, monkeypatch):
    risks = {}
    for method, follows in (("tour", False), ("tour", True), ("augmented", True)):
        monkeypatch.setattr(coverage, "MAX_LANES_APART", 0.0 if follows else 1e9)
        monkeypatch.setattr(coverage, "OPEN_SHARE", 2.0)
        run = synthetic_run(steps=12)
        run.vehicles = run.vehicles[:1]
        run.parameters["/**"]["mission"]["vehicles"] = 1
        run.parameters["/**"]["planner"] = {"method": method}
        risks[method, follows] = evaluate(run).summary.mowing_risk
    assert risks["tour", False] < risks["tour", True]
    assert risks["augmented", True] == risks["tour", False]


def test_what_mates_brought_is_the_difference_to_working_alone(evaluation):
    s = evaluation.summary
    assert all(own < alone < s.risk_before for own, alone in zip(s.local_risk, s.alone_risk, strict=True))
    assert s.deep_m2 + s.shallow_m2 + s.unsure_m2 == pytest.approx(s.area_m2)


def test_the_bound_is_the_risk_expected_of_mowing(evaluation):
    s, curves = evaluation.summary, evaluation.curves
    assert s.mowing_risk == curves.mowing_risk
    assert s.mowing_risk < s.risk_before
    assert s.map_bound_kept == (s.risk_after <= s.mowing_risk)
    expected = curves.expected_risk[np.isfinite(curves.expected_risk)]
    assert len(expected) == 13  # at the same steps as the risk
    assert np.all(expected <= curves.risk[np.isfinite(curves.expected_risk)])  # a plan is expected to help
    assert expected[-1] == curves.risk[-1]


def test_a_mission_without_truth_is_judged_by_its_own_maps(synthetic_run):
    run = synthetic_run(steps=6, with_truth=False)
    for vehicle in run.vehicles:
        vehicle.truth = np.empty((0, 4))
    s = evaluate(run).summary
    assert s.isobath_found is s.isobath_found_error_m is s.isobath_true_m is None
    assert s.f1 is s.misclassified_m2 is s.isobath_error_m is s.navigation_error_m is s.f1_true_positions is None
    assert s.risk_after < s.risk_before
    assert s.distance_m[0] == pytest.approx(6 * 15.0 * np.pi / 2.0, rel=1e-2)


def test_a_mission_without_decisions_is_evaluated(synthetic_run):
    run = synthetic_run(steps=1)
    run = RunData(parameters=run.parameters, vehicles=[VehicleRun(vehicle=1)], ground=run.ground)
    s = evaluate(run).summary
    assert (s.steps, s.team_reward, s.soundings) == (0, 0.0, 0)
    assert s.risk_after == s.risk_before
    assert s.delivery is None


def test_a_packet_under_way_at_the_end_is_not_lost(synthetic_run):
    run = synthetic_run(steps=3)
    run.sent, run.received = [], []
    assert (evaluate(run).summary.packets_lost, evaluate(run).summary.delivery) == (0, None)
    for stamp_s, payload in ((10.0, b"heard"), (20.0, b"lost"), (run.end_s - 2.0, b"just heard"), (run.end_s, b"last")):
        run.sent.append(Transmission(stamp_s=stamp_s, source=1, payload=payload))
        if b"heard" in payload:
            run.received.append(PacketReceived(stamp_s=stamp_s + 2.0, receiver=2, source=1, payload=payload))
    s = evaluate(run).summary
    assert (s.packets_sent, s.packets_received, s.packets_lost) == (4, 2, 1)
    assert s.delivery == 2 / 3


def test_navigation_error_costs_what_true_positions_would_save(synthetic_run):
    ideal = evaluate(synthetic_run(drift_mps=0.0)).summary
    assert ideal.misclassified_true_positions_m2 == ideal.misclassified_m2
    drifting = evaluate(synthetic_run(drift_mps=0.03)).summary  # 14 m at the end
    assert drifting.misclassified_m2 > 1.5 * drifting.misclassified_true_positions_m2
    assert drifting.isobath_error_m > drifting.isobath_error_true_positions_m


def test_local_map_takes_what_the_vehicle_took_in_its_order(synthetic_run):
    run = synthetic_run(steps=6)
    settings = mission_settings(run.parameters, 2)
    area = OperatingArea(settings[0].area)
    vehicle = run.vehicles[1]
    by_tick = DepthMap(settings[1].gp, settings[1].level_set, area)
    for tick in range(1, int(run.end_s) + 2):  # as fleet and nodes do: own soundings, then arrivals
        own, heard = (s[(s.stamp_s > tick - 1) & (s.stamp_s <= tick)] for s in (vehicle.soundings, vehicle.received))
        by_tick.add_soundings(own.rows)
        for arrival, source in dict.fromkeys(zip(heard.stamp_s.tolist(), heard.vehicle.tolist(), strict=True)):
            packet = heard[(heard.stamp_s == arrival) & (heard.vehicle == source)]
            by_tick.add_samples(packet.points_m, source)
    rebuilt = local_map(vehicle, settings[1], area, 1.0)
    assert np.array_equal(rebuilt.centers.locations_m, by_tick.centers.locations_m)
    assert np.array_equal(rebuilt.field().risk, by_tick.field().risk)
    assert len(rebuilt.centers) > len(
        local_map(VehicleRun(vehicle=2, soundings=vehicle.soundings), settings[1], area, 1.0).centers
    )


def test_a_large_local_map_takes_the_rest_together(synthetic_run, monkeypatch):
    run = synthetic_run(steps=20)
    settings = mission_settings(run.parameters, 2)[1]
    area = OperatingArea(settings.area)
    by_tick = local_map(run.vehicles[1], settings, area, 1.0)
    calls, add = [], DepthMap.add_samples
    monkeypatch.setattr(DepthMap, "add_samples", lambda m, *a: calls.append(m.gp.is_tiled) or add(m, *a))
    monkeypatch.setattr("auv_lse_gp.map.online.MAX_DENSE", len(by_tick.centers) // 2)
    together = local_map(run.vehicles[1], settings, area, 1.0)
    assert calls.count(True) == 1
    assert calls.count(False) > 1
    assert len(together.centers) == pytest.approx(len(by_tick.centers), rel=0.02)
    assert np.nanmean(together.field().risk) == pytest.approx(np.nanmean(by_tick.field().risk), rel=0.02)


def test_two_processes_find_the_same_results(synthetic_run):
    run = synthetic_run(steps=6)
    assert evaluate(run, bounds=2, on_two_cores=True).summary == evaluate(run, bounds=2).summary


def test_ground_on_another_grid_is_refused(synthetic_run):
    run = synthetic_run(steps=1)
    g = run.ground
    run.ground = GroundGrid(north_m=g.north_m[1:], east_m=g.east_m, depth_m=g.depth_m[1:], inside=g.inside[1:])
    with pytest.raises(ValueError, match=r"run\.ground has the shape \(39, 50\), but the map has \(40, 50\)"):
        evaluate(run)
