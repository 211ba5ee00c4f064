"""The reward curves against dense computation, and the locations that they credit."""

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_shore.judge import reward
from auv_lse_shore.judge.planned_paths import PlannedPaths, leg_times
from auv_lse_shore.judge.reward import reward_curves, running_maximum
from auv_lse_shore.judge.team_map import mission_settings


def settings_of(run):
    settings = mission_settings(run.parameters, len(run.vehicles))
    return settings, OperatingArea(settings[0].area)


def dense_risk(settings, soundings, locations):
    """Risk at locations from the textbook formula, with every sounding a datum (no spacing rule)."""
    kernel, gp = Kernel(settings.gp), settings.gp
    x, z = soundings[:, 1:3], soundings[:, 3]
    gram = kernel(x, x) + gp.noise_std_m**2 * np.eye(len(x))
    cross = kernel(x, locations)
    mean = gp.mean_depth_m + cross.T @ np.linalg.solve(gram, z - gp.mean_depth_m)
    variance = gp.signal_std_m**2 - np.sum(cross * np.linalg.solve(gram, cross), axis=0)
    return LevelSet.of(settings.level_set).risk(mean, np.sqrt(variance))


def test_leg_times_are_when_the_states_were_passed(synthetic_run):
    run = synthetic_run(steps=10, drift_mps=0.0)
    leg_s = 15.0 * np.pi / 2.0 / 1.5
    settings, area = settings_of(run)
    times = leg_times(run.vehicles[0], PlannedPaths(settings[0], area))
    assert times[-1] == np.inf
    assert times[:-1] == pytest.approx(leg_s * np.arange(10), abs=0.7)  # odometry every 0.65 s


def test_reward_is_the_drop_of_risk_at_the_legs_own_locations(synthetic_run):
    run = synthetic_run(steps=3, drift_mps=0.0)
    for pattern in run.parameters.values():
        if "gp" in pattern:
            pattern["gp"] = {**pattern["gp"], "min_spacing_m": 0.0, "merge": False}
    settings, area = settings_of(run)
    curves = reward_curves(run, settings, area)
    leg_s = 15.0 * np.pi / 2.0 / 1.5
    data = np.empty((0, 4))
    total, visited = 0.0, np.empty((0, 2))
    for step in range(3):
        locations = []
        for vehicle in run.vehicles:
            end = vehicle.decisions[step]
            locations.append(
                [end.plan.north_m + 15.0 * np.pi / 2.0, end.plan.east_m]
            )  # the first legs go straight north
        here = np.array(locations)
        before = dense_risk(settings[0], data, here)
        for vehicle in run.vehicles:
            stamps = vehicle.soundings.stamp_s
            on_leg = (stamps >= leg_s * step - 1e-9) & (stamps < leg_s * (step + 1) - 1e-9)
            data = np.concatenate([data, vehicle.soundings[on_leg].rows])
        drop = before - dense_risk(settings[0], data, here)
        total += drop.sum()
        visited = np.concatenate([visited, here])
        assert curves.stepwise[step + 1] == pytest.approx(total, abs=1e-6)
        assert curves.per_vehicle[:, step] == pytest.approx(drop, abs=1e-6)
    prior = 5.0 * len(visited)  # the prior mean is the level: each call is a coin toss, min(10 / 2, 10 / 2)
    assert curves.whole[-1] == pytest.approx(prior - dense_risk(settings[0], data, visited).sum(), abs=1e-6)


def test_bounds_follow_the_plans(synthetic_run):
    run = synthetic_run(steps=8)
    settings, area = settings_of(run)
    curves = reward_curves(run, settings, area)
    assert curves.stepwise[0] == curves.whole[0] == 0.0
    # At the start the whole path is planned: 16 locations worth 5 each at most.
    assert 0.0 < curves.bound[0] < curves.whole_bound[0] < 80.0
    assert np.all(np.diff(curves.bound_max[np.isfinite(curves.bound_max)]) >= 0.0)
    assert curves.bound[-1] == curves.stepwise[-1]
    assert curves.whole_bound[-1] == curves.whole[-1]
    # The last plans have no naive part left: a bound that is the sum so far.
    assert curves.bound[7] == pytest.approx(curves.stepwise[7])


def test_expected_whole_path_reward_of_the_first_plan_is_its_expected_benefit(synthetic_run):
    run = synthetic_run(steps=8)
    settings, area = settings_of(run)
    paths = [PlannedPaths(s, area) for s in settings]
    locations = np.concatenate([p.ahead(v.decisions[0]).locations_m for p, v in zip(paths, run.vehicles, strict=True)])
    covariance = Kernel(settings[0].gp)(locations, locations)
    noise = settings[0].gp.noise_std_m ** 2 * np.eye(len(locations))
    after = np.diag(covariance - covariance @ np.linalg.solve(covariance + noise, covariance))
    std = np.sqrt(np.diag(covariance) - after)
    benefit = LevelSet.of(settings[0].level_set).benefit(np.full(len(locations), 15.0), std, np.sqrt(after))
    assert reward_curves(run, settings, area).whole_bound[0] == pytest.approx(benefit.sum(), rel=1e-9)


def test_plans_without_naive_part_have_no_bound(synthetic_run):
    from dataclasses import replace

    run = synthetic_run(steps=5)
    for vehicle in run.vehicles:
        vehicle.decisions = [replace(d, plan=replace(d.plan, naive_path=NONE)) for d in vehicle.decisions]
    settings, area = settings_of(run)
    curves = reward_curves(run, settings, area)
    assert np.all(np.isnan(curves.bound))
    assert np.isfinite(curves.naive_value)
    assert curves.naive_value > 0.0


def test_planned_paths_are_those_of_the_packet(synthetic_run):
    run = synthetic_run(steps=30)
    settings, area = settings_of(run)
    path = PlannedPaths(settings[0], area)
    decision = run.vehicles[0].decisions[4]
    ahead = path.ahead(decision)
    assert (len(ahead.own_locations_m), len(ahead.naive_locations_m)) == (3, 30 - 4 - 3)
    following = run.vehicles[0].decisions[5]
    assert ahead.own_locations_m[0] == pytest.approx(following.plan.state[1:], abs=1e-3)
    assert np.all(area.clearance_m(ahead.naive_locations_m) >= 0.0)


@pytest.mark.parametrize("samples", [1, 3, 5, 7])
def test_credited_locations_are_those_that_the_planner_counts(synthetic_run, samples):
    run = synthetic_run(steps=12)
    for pattern in run.parameters.values():
        if "planner" in pattern:
            pattern["planner"] = {**pattern["planner"], "samples_per_leg": samples}
    settings, area = settings_of(run)
    planner = VehiclePlanner(1, settings[0], np.random.default_rng(1))
    path = PlannedPaths(settings[0], area)
    for decision in run.vehicles[0].decisions[::5]:
        followed = planner.rollout.follow(decision.plan)
        legs = [planner.motion.leg(0, s, int(a)) for s, a in zip(followed.states, followed.actions, strict=False)]
        along = (np.arange(samples) + 1.0) / samples
        expected = np.array([[leg.state_at(f * leg.length_m)[1:] for f in along] for leg in legs])
        assert followed.leg_locations_m == pytest.approx(expected, abs=1e-9)
        assert np.array_equal(path.ahead(decision).leg_locations_m, followed.leg_locations_m)
        assert np.array_equal(path.leg(decision), followed.locations_m[:samples])
        assert path.ahead(decision).states[0][1:] == pytest.approx(decision.plan.state[1:])


def test_running_maximum_passes_over_unknowns():
    assert running_maximum(np.array([np.nan, 2.0, np.nan, 1.0, 3.0]))[1:].tolist() == [2.0, 2.0, 2.0, 3.0]
    assert np.isnan(running_maximum(np.array([np.nan, 1.0]))[0])


def test_a_plan_that_is_kept_is_read_from_where_the_vehicle_is(synthetic_run):
    from dataclasses import replace

    run = synthetic_run(steps=30)
    settings, area = settings_of(run)
    path = PlannedPaths(settings[0], area)
    first = run.vehicles[0].decisions[0]
    everything = path.ahead(first).locations_m
    for step in (2, 3, 10):  # within the actions, at their end, on the naive part
        kept = replace(first, step=step)
        assert path.ahead(kept).own == max(3 - step, 0)
        assert np.array_equal(path.ahead(kept).locations_m, everything[step:])
        assert np.array_equal(path.leg(kept)[-1], everything[step])
        assert path.ahead(kept).states[0][1:] == pytest.approx(everything[step - 1])


@pytest.mark.parametrize("decided", [1, 4])
def test_soundings_of_a_leg_that_was_cut_off_are_in_the_last_map_but_the_leg_is_not_travelled(synthetic_run, decided):
    run = synthetic_run(steps=4)
    settings, area = settings_of(run)
    map_m = np.array([[30.0, 50.0], [70.0, 120.0]])
    for vehicle in run.vehicles:
        vehicle.decisions = vehicle.decisions[:decided]
    whole = reward_curves(run, settings, area, map_m=map_m)
    for vehicle in run.vehicles:
        vehicle.unfinished_legs = 1
    curves = reward_curves(run, settings, area, map_m=map_m)
    assert (run.steps, len(curves.stepwise)) == (decided - 1, decided)
    if run.steps:
        assert curves.risk[-1] == pytest.approx(whole.risk[-1], rel=1e-9)
        assert curves.flown_risk > whole.flown_risk, "expected after fewer legs"
        assert curves.mowing_risk > whole.mowing_risk, "compared with fewer legs"


def test_a_leg_decided_twice_keeps_all_its_soundings(synthetic_run):
    from dataclasses import replace

    run = synthetic_run(steps=4)
    settings, area = settings_of(run)
    once = reward_curves(run, settings, area)
    vehicle = run.vehicles[0]
    again = replace(vehicle.decisions[2], now_s=vehicle.decisions[2].now_s + 5.0)
    vehicle.decisions.insert(3, again)
    assert reward_curves(run, settings, area).stepwise[-1] == pytest.approx(once.stepwise[-1])


@pytest.mark.parametrize("method", ["augmented", "plain", "lawnmower", "tour"])
def test_credited_locations_lie_on_the_flown_tracks(method):
    """The judge rebuilds legs from plans alone: kept plans, naive paths and strips come out as they were flown."""
    from scipy.spatial import cKDTree

    from auv_lse_common.mission_file.settings import Settings
    from auv_lse_sim.engine.fleet import Fleet
    from auv_lse_sim.ground.ground_source import ground_of

    overrides = {"mission.steps": 12, "mission.vehicles": 3, "planner.method": method, "planner.iterations": 20}
    small = {"area.polygon_m": [-50.0, -50.0, 250.0, -50.0, 250.0, 250.0, -50.0, 250.0], "sim.ideal": True}
    settings = Settings.load(None, {**overrides, **small, "gp.map_resolution_m": 20.0})
    run = Fleet(settings, ground_of(settings)).run()
    planner, area = settings_of(run)
    for vehicle, own in zip(run.vehicles, planner, strict=True):
        path = PlannedPaths(own, area)
        ends = np.array([path.leg(decision)[-1] for decision in vehicle.decisions])
        assert len(ends) == 12
        off = cKDTree(vehicle.odometry[:, 1:3]).query(ends)[0]
        assert off.max() < 1.5  # a second at 1.5 m/s lies between two odometry messages


def test_a_long_missions_path_reward_is_computed_at_a_bounded_number_of_steps(synthetic_run, monkeypatch):
    run = synthetic_run(steps=9, drift_mps=0.0)
    settings, area = settings_of(run)
    every = reward_curves(run, settings, area)
    calls, whole = [], reward._Replay.whole
    monkeypatch.setattr(reward, "WHOLE_STEPS", 3)
    monkeypatch.setattr(reward._Replay, "whole", lambda replay: calls.append(0) or whole(replay))
    some = reward_curves(run, settings, area)
    assert len(calls) == 3
    assert some.whole[[0, 3, 6, 9]].tolist() == every.whole[[0, 3, 6, 9]].tolist()
    assert some.whole[4] == pytest.approx((2.0 * every.whole[3] + every.whole[6]) / 3.0)
    assert some.stepwise.tolist() == every.stepwise.tolist()


def test_a_long_mission_is_computed_tile_by_tile(synthetic_run, monkeypatch):
    """Within what tiles may be off: .01 of a standard deviation of the depth moves a mean risk by far less than 1 %."""
    run = synthetic_run(steps=20)
    settings, area = settings_of(run)
    locations = area.grid(10.0).locations_m
    dense = reward_curves(run, settings, area, 2, locations)
    monkeypatch.setattr("auv_lse_shore.judge.lawnmower.MAX_DENSE", 10)
    monkeypatch.setattr("auv_lse_gp.map.online.MAX_DENSE", 10)
    tiled = reward_curves(run, settings, area, 2, locations)
    for name in ("stepwise", "whole", "whole_bound", "risk", "expected_risk"):
        found, expected = getattr(tiled, name), getattr(dense, name)
        assert np.array_equal(np.isnan(found), np.isnan(expected))
        assert found[np.isfinite(found)] == pytest.approx(expected[np.isfinite(expected)], rel=2e-3, abs=2e-3)
    for name in ("naive_value", "mowing_risk", "flown_risk"):
        assert getattr(tiled, name) == pytest.approx(getattr(dense, name), rel=1e-3)


def test_of_a_long_mission_only_the_papers_methods_get_the_whole_path_reward_in_between(synthetic_run, monkeypatch):
    run = synthetic_run(steps=9)
    monkeypatch.setattr(reward, "WHOLE_STEPS", 3)
    every = reward_curves(run, *settings_of(run)).whole
    run.parameters["/**"]["planner"] = {"method": "tour"}
    ends = reward_curves(run, *settings_of(run)).whole
    assert ends[-1] == pytest.approx(every[-1])
    assert ends == pytest.approx(np.linspace(0.0, ends[-1], 10))


def test_a_legs_risk_in_a_large_map_is_that_of_the_map(synthetic_run, monkeypatch):
    run = synthetic_run(steps=12)
    settings, area = settings_of(run)
    monkeypatch.setattr("auv_lse_gp.map.online.MAX_DENSE", 10)
    replay = reward._Replay(run, settings, [PlannedPaths(s, area) for s in settings])
    for step in range(12):
        replay.travel(step)
        here = replay.visited[-2:]
        assert replay.risk_here(here) == pytest.approx(replay.risk(replay.gp, here), rel=1e-9)
    assert replay.gp.is_tiled
