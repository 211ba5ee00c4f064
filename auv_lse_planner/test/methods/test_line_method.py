"""The method `line`: it follows what it has found, keeps its account, and divides the line among a team."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from planner_helpers import settings

from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.methods.line import LOCATED
from auv_lse_planner.methods.line_routes import route_along
from auv_lse_planner.methods.method import PlanningContext, Situation
from auv_lse_planner.methods.tour_candidates import NO_FLOOR, TourProblem
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.reward.line import LineLoss
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

LINE_NORTH_M = 70.0


def planner_of(steps: int = 12, vehicle: int = 1, vehicles: int = 1) -> VehiclePlanner:
    return VehiclePlanner(vehicle, settings({"method": "line"}, vehicles, steps), np.random.default_rng(1))


def depth(locations_m: np.ndarray) -> np.ndarray:
    """Ground whose isobath runs east at `LINE_NORTH_M`."""
    return 15.0 + 0.12 * (locations_m[:, 0] - LINE_NORTH_M)


def travelled(planner: VehiclePlanner, decisions: int) -> np.ndarray:
    """Decides, jumps to each leg's end and sounds along it; the legs' ends (decisions, 2)."""
    v = planner.settings.vehicle
    state = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])
    planner.odometry(0.0, *state)
    sounded, ends = np.empty((0, 2)), []
    for i in range(decisions):
        planner.set_centers(Centers(sounded, depth(sounded), np.full(len(sounded), 0.3)), 15.7 * i)
        leg = planner.decide(15.7 * i).leg
        sounded = np.concatenate([sounded, [leg.state_at(s)[1:] for s in (8.0, 20.0)]])
        state = np.array([float(x) for x in leg.end_state])
        planner.odometry(15.7 * (i + 1), *state)
        ends.append(state[1:])
    return np.array(ends)


def test_it_finds_the_line_and_then_follows_it_and_keeps_its_account() -> None:
    planner = planner_of(24)
    ends = travelled(planner, 24)
    crossed = int(np.argmax(np.abs(ends[:, 0] - LINE_NORTH_M) < 20.0))
    after = ends[crossed + 6 : crossed + 14]
    assert np.median(np.abs(after[:, 0] - LINE_NORTH_M)) < 15.0
    assert np.ptp(ends[crossed:, 1]) > 150.0
    for before, record in itertools.pairwise(planner.records):
        change = record.expected_end - record.incumbent_value
        assert change >= -before.budget - 1e-9
        assert record.budget == pytest.approx(max(0.0, before.budget + change), abs=1e-9)
        assert record.lower_bound == pytest.approx(record.expected_total - record.budget)


def test_the_first_plan_is_expected_to_locate_no_less_than_the_best_naive_path() -> None:
    planner = planner_of(40)
    travelled(planner, 1)
    record = planner.records[0]
    assert record.budget >= 0.0
    context = planner._context
    from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS

    situation = Situation(planner=planner.planner, now_s=0.0, step=0, state=np.zeros(3))
    reward = planner._methods["line"].map_reward(situation)
    paths = [planner.rollout.follow(context.naive_plan(0, np.zeros(3), i)) for i in (FITTED[0], *COVERING, *LAWNMOWERS)]
    ends = [reward.value(context.map_locations(path)[: reward.legs]).expected_end for path in paths]
    assert record.expected_end >= max(ends) - 1e-9
    assert record.lower_bound == pytest.approx(max(ends), rel=1e-6)


def score_of(planner: VehiclePlanner, situation: Situation, path: PlannedPath) -> tuple[float, float]:
    """Share of the largest benefit, and isobath of the mean located per length, from the posterior after the path."""
    context, legs = planner._context, path.leg_locations_m[: situation.planner.horizon]
    at = legs.reshape(-1, 2)
    reward = context.path_reward(situation, np.empty((0, 2)))
    benefit = reward.value(context.posterior.at(at)) / (reward.level_set.largest_risk * len(at))
    cells = context.window.fine
    losses = LineLoss(15.0, context.map_grid.resolution_m).of_estimate().of(cells)
    measured = context.map_locations(path)[: len(legs)].reshape(-1, 2)
    left_m2 = context.posterior.with_planned(measured).moments(cells.locations_m)[1]
    located_m = float(losses.before.sum() - losses.sums(left_m2[None])[0])
    return benefit, located_m / (len(legs) * planner.space.motion.leg_length_m)


def test_of_the_plans_that_the_budget_allows_the_one_whose_next_legs_score_most_wins() -> None:
    planner, decided = planner_of(24), []
    method = planner._method_of("line")
    best = method._best

    def observed(situation, candidates, path_reward):
        chosen = best(situation, candidates, path_reward)
        scores = [float(np.dot((1.0, LOCATED), score_of(planner, situation, c.path))) for c in candidates]
        decided.append((len(candidates), scores[candidates.index(chosen)], max(scores)))
        return chosen

    method._best = observed
    travelled(planner, 12)
    assert max(number for number, _, _ in decided) > 5, "routes and heads are candidates between two searches, too"
    assert all(own == pytest.approx(most, rel=1e-6) for _, own, most in decided)


def on_flat_ground(planner: VehiclePlanner) -> tuple[Situation, PathReward, PlannedPath, PlannedPath]:
    """A known isobath on flat ground; a path along it, and one away from it."""
    east = np.arange(0.0, 160.0, 12.0)
    sounded = np.concatenate([np.column_stack([np.full_like(east, north), east]) for north in (58.0, 82.0)])
    flat = 15.0 + 0.02 * (sounded[:, 0] - LINE_NORTH_M)
    state = np.array([0.5 * np.pi, LINE_NORTH_M, 140.0])
    situation = Situation(planner=planner.planner, now_s=0.0, step=0, state=state)
    method, context = planner._method_of("line"), planner._context
    context.window.set_centers(Centers(sounded, flat, np.full(len(sounded), 0.3)))
    reward = context.path_reward(situation, np.empty((0, 2)))
    problem = TourProblem(situation, method.map_reward(situation), NO_FLOOR, lambda: reward, None)
    lines = [[[LINE_NORTH_M, 140.0], [north, 360.0]] for north in (LINE_NORTH_M, LINE_NORTH_M + 60.0)]
    ahead, away = (method._candidates.along(problem, np.array(line)).path for line in lines)
    return situation, reward, ahead, away


def test_on_flat_ground_where_all_plans_have_nearly_the_same_benefit_the_line_decides() -> None:
    planner = planner_of(24)
    situation, reward, ahead, away = on_flat_ground(planner)
    method = planner._method_of("line")
    benefits = [score_of(planner, situation, path)[0] for path in (ahead, away)]
    assert benefits[0] == pytest.approx(benefits[1], abs=0.05)
    scores = [method._next_legs(situation, path, lambda: reward) for path in (ahead, away)]
    assert scores[0] > scores[1] + 0.2


def test_a_stretch_of_the_line_that_a_mate_will_locate_adds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = planner_of(24)
    situation, _, ahead, _ = on_flat_ground(planner)
    method = planner._method_of("line")
    alone_m = method._located_m(situation, ahead)
    locations = planner._context.map_locations(ahead)
    mate = np.repeat(np.arange(1.0, len(locations) + 1.0), locations.shape[1]), locations.reshape(-1, 2)
    monkeypatch.setattr(PlanningContext, "mates_ahead", lambda self, situation: [mate])
    assert alone_m > 200.0
    assert 0.0 < method._located_m(replace(situation), ahead) < 0.2 * alone_m


def test_a_route_follows_near_stretches_first_and_is_no_longer_than_it_may_be() -> None:
    near = np.column_stack([np.full(11, 30.0), np.arange(0.0, 110.0, 10.0)])
    far = near + np.array([300.0, 0.0])
    found = route_along(np.zeros(2), [far, near], 700.0)
    route = found.line_m
    assert np.hypot(*(route[1] - [30.0, 0.0])) < 15.0
    assert route[-1, 0] == 330.0
    assert found.followed_m(130.0) == pytest.approx(100.0)
    assert route_along(np.zeros(2), [far], 200.0).line_m.tolist() == [[0.0, 0.0]]


def test_it_continues_from_a_snapshot() -> None:
    planner, other = planner_of(), planner_of()
    travelled(planner, 5)
    other.restore(planner.snapshot())
    assert other.snapshot() == planner.snapshot()
