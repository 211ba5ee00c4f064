import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from planner_helpers import centers, settings

from auv_lse_common.support.compiled import USE_NUMBA
from auv_lse_common.vocabulary.naive_ids import FITTED, STRIPS
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.methods import coverage, tour_candidates
from auv_lse_planner.methods.method import Followed, Situation
from auv_lse_planner.methods.single_routes import single_routes_m
from auv_lse_planner.methods.tour import Tour
from auv_lse_planner.methods.tour_candidates import (
    FINER_BENDS,
    NO_FLOOR,
    SHARES_TRIED,
    START_BENDS,
    WEIGHT_SHARES,
    Candidates,
    TourCandidates,
    TourProblem,
)
from auv_lse_planner.paths.position_margin import LEGS, TOLERATED_M2, PositionMargin
from auv_lse_planner.paths.steering import DETOUR_LEGS
from auv_lse_planner.search.tour import TourSearch
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

STEPS = 12


def _travel(planner, decisions, data=None, heard=()):
    """Decides and jumps to the end of each leg; `data` gives the centers before a decision."""
    v = planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    given = []
    for i in range(decisions):
        now_s = 15.7 * i
        for at, mate, plan in heard:
            if at == i:
                planner.receive_plan(now_s, mate, plan)
        if data is not None:
            planner.set_centers(data(i), now_s)
        given.append(planner.decide(now_s))
        end = given[-1].leg.end_state
        planner.odometry(now_s + 15.7, *(float(x) for x in end))
    return given


def _planner(vehicle=1, vehicles=1, steps=STEPS, method="tour", **sections):
    planner = {"method": method, **sections.pop("planner", {})}
    if "vehicle_section" in sections:
        sections["vehicle"] = sections.pop("vehicle_section")
    return VehiclePlanner(vehicle, settings(planner, vehicles, steps, **sections), np.random.default_rng(1))


def _follow(monkeypatch, follows):
    """Lets every single vehicle follow the isobath, or none."""
    monkeypatch.setattr(coverage, "MAX_LANES_APART", 0.0 if follows else 1e9)
    monkeypatch.setattr(coverage, "OPEN_SHARE", 2.0)


def _growing(seed=3):
    """Data that grows by twenty soundings a decision."""
    return lambda i: centers(np.random.default_rng(seed), 1 + 20 * i)


def test_whole_mission_is_planned_and_the_budget_is_never_negative():
    planner = _planner()
    for decision in _travel(planner, STEPS, _growing()):
        path = planner.rollout.follow(decision.plan).from_step(decision.leg.step)
        assert path.step + len(path) == STEPS
        assert decision.bound.budget >= 0.0
    with pytest.raises(ValueError, match="all 12 steps are decided"):
        planner.decide(999.0)


def test_budget_grows_by_each_choices_gain_and_the_bound_starts_with_the_lawnmower():
    planner = _planner()
    records = [d.bound for d in _travel(planner, STEPS, _growing())]
    for before, after in itertools.pairwise(records):
        change = after.expected_end - after.incumbent_value
        assert after.budget == pytest.approx(max(0.0, before.budget + change), abs=1e-9)
        assert change >= -before.budget - 1e-9
        assert after.lower_bound == pytest.approx(after.expected_total - after.budget)
    assert records[0].lower_bound <= records[0].expected_total
    assert any(not r.incumbent_kept for r in records[1:])


@pytest.mark.parametrize(("vehicle", "vehicles", "follows"), [(1, 1, False), (1, 1, True), (2, 2, False)])
def test_the_floor_is_the_best_naive_path_or_the_strip_of_a_vehicle_that_follows_the_isobath(
    vehicle, vehicles, follows, monkeypatch
):
    _follow(monkeypatch, follows)
    planner = _planner(vehicle, vehicles, 40)
    promised = _travel(planner, 1)[0].bound.lower_bound
    strip = planner.rollout.path(0, np.zeros(3), (), STRIPS[vehicle - 1])
    context = planner._context
    situation = Situation(planner=planner.planner, now_s=0.0, step=0, state=np.zeros(3))
    covered = context.map_reward(situation).value(context.map_locations(strip)).expected_end
    if follows:
        assert promised == pytest.approx(covered)
    else:
        assert promised > covered + 1.0


def _far_from_the_isobath_m(planner, legs):
    """Mean distance of the legs' ends from a straight isobath through the start, with one sounding each 5 m."""
    locations, v = [], planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    for i in range(legs):
        if locations:
            on = np.concatenate(locations)
            planner.set_centers(Centers(on, 15.0 + 0.12 * (on[:, 1] - 200.0), np.full(len(on), 0.3)), 15.7 * i)
        end = planner.decide(15.7 * i).leg.end_state
        start = np.array([v.start_north_m, v.start_east_m]) if not i else locations[-1][-1]
        locations.append(start + np.linspace(0.2, 1.0, 5)[:, None] * (end[1:] - start))
        planner.odometry(15.7 * (i + 1), *(float(x) for x in end))
    return float(np.abs(np.array([p[-1, 1] for p in locations]) - 200.0).mean())


def test_a_vehicle_that_cannot_cover_its_ground_follows_the_isobath(monkeypatch):
    start = {"start_north_m": 20.0, "start_east_m": 200.0}
    _follow(monkeypatch, True)
    followed = _far_from_the_isobath_m(_planner(steps=20, vehicle_section=start), 14)
    _follow(monkeypatch, False)
    spread = _far_from_the_isobath_m(_planner(steps=20, vehicle_section=start), 14)
    assert followed < 0.6 * spread


def test_a_single_vehicles_first_path_is_searched_from_many_routes(monkeypatch):
    if not USE_NUMBA:
        pytest.skip("routes of a single vehicle need compiled code")
    found = {}
    for searched in (False, True):
        with monkeypatch.context() as patch:
            if not searched:
                patch.setattr(tour_candidates, "single_routes_m", lambda *_: [])
            planner = _planner(steps=30, planner={"anytime_weight": 0.0, "own_share": 0.0})
            found[searched] = _travel(planner, 1)[0].bound.expected_end
    assert found[True] > 1.005 * found[False]
    team = _planner(1, 2, 40)
    assert single_routes_m(team._context, np.zeros(2), 40) == []


@pytest.mark.parametrize(("vehicles", "behind", "improved"), [(2, math.inf, True), (2, -1.0, False), (1, -1.0, True)])
def test_a_team_does_not_optimize_a_tour_further_that_is_far_behind_the_naive_paths(
    monkeypatch, vehicles, behind, improved
):
    iterations, improve = [], TourSearch.improve

    def spy(self, waypoints_m, legs, reward, most, *others):
        iterations.append(most)
        return improve(self, waypoints_m, legs, reward, min(most, 2), *others)

    monkeypatch.setattr(TourSearch, "improve", spy)
    monkeypatch.setattr(tour_candidates, "FAR_BEHIND", behind)
    monkeypatch.setattr(tour_candidates, "single_routes_m", lambda *_: [])
    _travel(_planner(1, vehicles, 20), 1)
    assert (tour_candidates.FIRST_ITERATIONS in iterations) == improved


@pytest.mark.skipif(not USE_NUMBA, reason="a single vehicle's routes need compiled code")
def test_each_round_bends_the_best_third_of_the_starts(monkeypatch):
    """The first round too: it bends the best third of the optimized starts."""
    optimized, bends, bent, routes_m = [], [], TourCandidates._bent_for_end, single_routes_m

    def routes(*arguments):
        optimized.clear()  # only what is optimized from here on is bent
        return routes_m(*arguments)

    def through(self, problem, waypoints_m, through=TourCandidates._through):
        optimized.append(through(self, problem, waypoints_m))
        return optimized[-1]

    def spy(self, problem, path, search, result):
        bends.append((path, bent(self, problem, path, search, result), search is self._finer))
        return bends[-1][1]

    monkeypatch.setattr(tour_candidates, "single_routes_m", routes)
    monkeypatch.setattr(TourCandidates, "_through", through)
    monkeypatch.setattr(TourCandidates, "_bent_for_end", spy)
    _travel(_planner(steps=30), 1)
    starts, first = len(optimized), -(-len(optimized) // 3)
    ends = [c.value.expected_end for _, c, finer in bends if not finer]
    assert starts >= 4
    assert len(ends) == sum(-(-starts // 3**k) for k in range(1, START_BENDS + 1))
    better = sorted(optimized, key=lambda c: -c.value.expected_end)[:first]
    assert [id(path) for path, *_ in bends[:first]] == [id(c.path) for c in better]
    assert id(bends[first][0]) in {id(c.path) for _, c, _ in bends[:first]}, "the second round bends what it bent"
    finer = [path for path, _, is_finer in bends if is_finer]
    assert len(finer) == FINER_BENDS
    best = max([*optimized, *(c for _, c, is_finer in bends if not is_finer)], key=lambda c: c.value.expected_end)
    assert finer[0] is best.path


def test_the_first_plans_of_a_large_team_bring_together_what_each_vehicle_expects():
    # Of eight vehicles that each took the best plan beside seven lawnmowers, several would take the same way.
    area = {"polygon_m": [-50.0, -50.0, 550.0, -50.0, 550.0, 650.0, -50.0, 650.0]}
    team = [_planner(k, 8, 25, area=area) for k in range(1, 9)]
    first = [_travel(planner, 1)[0] for planner in team]
    promised = first[0].bound.lower_bound
    for mate, decision in enumerate(first[1:], start=2):
        team[0].receive_plan(1.0, mate, decision.plan)
    context, situation = team[0]._context, Situation(planner=team[0].planner, now_s=1.0, step=0, state=np.zeros(3))
    path = team[0].rollout.follow(first[0].plan)
    together = context.map_reward(situation).value(context.map_locations(path)).expected_end
    assert together > promised


def test_tour_without_new_data_is_kept():
    decisions = _travel(_planner(method="fixed_tour"), STEPS, _growing())
    assert all(d.plan == decisions[0].plan for d in decisions)
    assert all(d.bound.incumbent_kept for d in decisions[1:])


@pytest.mark.parametrize("saved", [0.0, 1e6])
def test_shallow_ground_voids_the_tour_and_its_loss_is_charged_to_the_budget(saved):
    def ground(i):
        data = centers(np.random.default_rng(5), 40)
        ahead = np.stack([np.full(9, 60.0), np.linspace(-20, 60, 9)], axis=1)
        return (
            data
            if i < 2
            else type(data)(
                np.concatenate([data.locations_m, ahead]),
                np.concatenate([data.depths_m, np.full(9, 1.0)]),
                np.concatenate([data.noise_std_m, np.full(9, 0.1)]),
            )
        )

    planner = _planner(gp={"length_scale_m": 20.0})
    straight = Plan.at(0, np.zeros(3), (), 0xF8)
    _travel(planner, 1, ground)
    planner._followed = Followed(straight, planner.rollout.follow(straight))
    method = planner._method_of("tour")
    method.budget = saved
    planner.set_centers(ground(2), 10.0)
    planner.decide(15.7)
    record = planner.records[-1]
    assert record.void == "shallow ground"
    assert not record.incumbent_kept
    assert record.budget == pytest.approx(max(0.0, saved + record.expected_end - record.void_value))
    assert record.expected_end != record.void_value
    assert np.isnan(record.incumbent_value)


def test_a_void_plan_at_the_areas_border_is_not_called_shallow():
    planner = _planner()
    _travel(planner, 1, _growing())
    beyond = Plan.at(0, np.array([0.0, 1e4, 0.0]), (), 0xF8)
    planner._followed = Followed(beyond, planner.rollout.follow(beyond))
    s = Situation(planner=planner.planner, now_s=1.0, step=1, state=np.array([0.0, 1e4, 0.0]), last=planner._followed)
    assert planner._method_of("tour")._void(s) == "border of the area"


def _along_the_border(deviation_m):
    """Decisions of a vehicle that follows the eastern border 12 m away, with a position uncertain eastwards."""
    planner = _planner(steps=40, vehicle_section={"start_north_m": 20.0, "start_east_m": 468.0})
    _travel(planner, 1, _growing())
    straight = Plan.at(0, np.array([0.0, 20.0, 468.0]), (), 0xF8)
    path = planner.rollout.follow(straight)
    planner.adopt(straight, planner.motion.leg(0, path.states[0], int(path.actions[0])))
    planner.odometry(15.7, *(float(x) for x in path.states[1]))
    decisions = []
    for i in range(1, 9):
        planner.set_map_offset(0.0, 0.0, np.diag([1.0, deviation_m**2]))
        planner.set_centers(_growing()(i), 15.7 * i)
        decisions.append(planner.decide(15.7 * i))
        planner.odometry(15.7 * (i + 1), *(float(x) for x in decisions[-1].leg.end_state))
    return planner, decisions


def test_a_vehicle_with_an_uncertain_place_returns_from_the_border_without_a_void_plan():
    planner, decisions = _along_the_border(20.0)
    assert not any(d.bound.void or d.statistics.escape for d in decisions)
    path = planner.path
    assert path is not None
    margin = PositionMargin(np.diag([1.0, 400.0]))
    locations_m = planner.rollout.leg_locations(path.states[:-1], path.actions, 2)[:LEGS]
    assert margin.shortfall_m2(planner.space, locations_m.reshape(-1, 2))[0] <= TOLERATED_M2
    sent = planner.rollout.follow(decisions[-1].plan).from_step(path.step)
    assert np.array_equal(sent.states, path.states), "team mates rebuild the path"
    for before, after in itertools.pairwise(decisions):
        lost = before.bound.lower_bound - after.bound.lower_bound
        assert lost <= 1e-9 or after.bound.budget == 0.0, "a loss is charged to the budget first"


def test_an_uncertainty_within_the_areas_margin_changes_nothing():
    (_, exact), (_, known) = _along_the_border(0.0), _along_the_border(9.9)
    assert [d.plan for d in exact] == [d.plan for d in known]
    assert [repr(d.bound) for d in exact] == [repr(d.bound) for d in known], "as text: a NaN differs from itself"


def test_mates_without_a_plan_are_assumed_to_mow_until_expiry():
    planner = _planner(2, 3, planner={"plan_expiry_s": 100.0})
    assert planner.team.in_time_order(0.0) == []
    planner.team.assume_plans(0.0)
    ahead = planner.team.in_time_order(0.0)
    assert len(ahead) == 2
    legs, locations = ahead[0]
    mowing = planner.rollout.path(0, np.zeros(3), (), FITTED[0])
    assert locations == pytest.approx(mowing.locations_m)
    assert legs == pytest.approx(np.arange(1, STEPS + 1))
    later, remaining = planner.team.in_time_order(31.5)[0]  # two legs of 15.7 s
    assert remaining == pytest.approx(mowing.locations_m[2:])
    assert later[0] == pytest.approx(3.0 - 31.5 / 15.70796)
    assert planner.team.in_time_order(101.0) == []


def test_received_plan_replaces_the_assumed_one_and_expires():
    planner = _planner(1, 2, planner={"plan_expiry_s": 100.0})
    planner.team.assume_plans(0.0)
    planner.receive_plan(5.0, 2, Plan.at(0, np.array([0.0, 100.0, 100.0]), (5, 5, 5), 0xFF))
    ((legs, locations),) = planner.team.in_time_order(5.0)
    assert locations[:, 1] == pytest.approx([100.0] * 3)
    assert legs == pytest.approx([1, 2, 3])
    assert planner.team.in_time_order(106.0) == []


def test_without_time_the_start_is_a_naive_path():
    planner = _planner(steps=40)
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    decision = planner.decide(0.0, deadline=lambda: True)
    assert decision.bound.deadline_hit
    assert decision.bound.budget >= 0.0
    assert decision.statistics.evaluations == 2
    rested = _planner(steps=40)
    rested.odometry(0.0, 0.0, 0.0, 0.0)
    assert decision.bound.expected_end >= 0.9 * rested.decide(0.0).bound.expected_end


def test_incumbent_is_followed_without_a_search_between_optimizations():
    decisions = _travel(_planner(planner={"tour_interval": 4}), STEPS, _growing())
    searched = [d.leg.step for d in decisions if d.statistics.evaluations > 1]
    assert searched == [0, 4, 8]
    assert all(d.bound.incumbent_kept for d in decisions if d.leg.step not in searched)


def test_plans_are_evaluated_only_where_one_is_searched_and_at_the_end(monkeypatch):
    evaluated, reward = [], Tour.map_reward

    def spy(self, situation):
        evaluated.append(situation.step)
        return reward(self, situation)

    monkeypatch.setattr(Tour, "map_reward", spy)
    planner = _planner(planner={"tour_interval": 4}, vehicle_section={"surfacings": 0})
    bounds = [d.bound for d in _travel(planner, STEPS, _growing())]
    assert evaluated == [0, 4, 8, STEPS - 1]
    assert {b.expected_total for b in bounds[4:8]} == {bounds[4].expected_total}
    assert bounds[8].expected_total != bounds[7].expected_total


def _candidates(planner):
    return planner._method_of("tour")._candidates


def _problem(planner, floor):
    """The problem of the second decision."""
    s = Situation(planner=planner.planner, now_s=1.0, step=1, state=planner.path.states[0])
    context = planner._context
    return TourProblem(s, context.map_reward(s), floor, lambda: context.path_reward(s, np.empty((0, 2))))


def test_bend_favors_early_reward_within_the_expected_end(monkeypatch):
    tried: dict[int, list[tuple[float, float]]] = {}
    bent = TourCandidates._bent

    def spy(self, problem, path, share, iterations):
        found = bent(self, problem, path, share, iterations)
        tried.setdefault(problem.situation.step, []).append((share, found[0].value.expected_end))
        return found

    monkeypatch.setattr(TourCandidates, "_bent", spy)
    planner = _planner()
    _travel(planner, STEPS, _growing())
    records = {r.step: r for r in planner.records}
    first = 0
    for step in sorted(tried):
        shares = [share for share, _ in tried[step]]
        assert shares == list(WEIGHT_SHARES[first : first + len(shares)])
        last = first + len(shares) - 1
        if step:
            floor = records[step].incumbent_value - records[step - 1].budget
            assert all(end < floor for _, end in tried[step][:-1])
            allowed = tried[step][-1][1] >= floor
            assert allowed or len(shares) == SHARES_TRIED or last == len(WEIGHT_SHARES) - 1
        else:
            allowed = last < len(WEIGHT_SHARES) - 1 or records[0].budget > 0.0
        first = max(last - 1, 0) if allowed else min(last + 1, len(WEIGHT_SHARES) - 1)


def test_next_bend_starts_near_the_last_allowed_share(monkeypatch):
    tried: list[float] = []
    allowed, bent = 1.0, TourCandidates._bent

    def spy(self, problem, path, share, iterations):
        tried.append(share)
        candidate, found = bent(self, problem, path, share, iterations)
        end = 1e9 if share == allowed else -1e9
        return replace(candidate, value=replace(candidate.value, expected_end=end)), found

    planner = _planner()
    _travel(planner, 1, _growing())
    candidates = _candidates(planner)
    candidates.restore({**candidates.snapshot(), "earliness": 0})
    monkeypatch.setattr(TourCandidates, "_bent", spy)
    began = []
    for share in (0.25, 0.25, 0.25, 0.5, 0.0, 0.0, 1.0):
        allowed = share
        tried.clear()
        candidates._bend_early(_problem(planner, 0.0), planner.path, 1, SHARES_TRIED, Candidates())
        began.append(list(tried))
    assert began == [[1.0, 0.5], [0.25], [0.5, 0.25], [0.5], [1.0, 0.5], [0.25, 0.0], [0.25, 0.0]]


def test_void_plan_uses_the_full_share_and_an_interrupted_bend_keeps_the_share():
    planner = _planner()
    _travel(planner, 1, _growing())
    candidates = _candidates(planner)
    candidates.restore({**candidates.snapshot(), "earliness": 2})
    result, problem = Candidates(), _problem(planner, NO_FLOOR)
    candidates._bend_early(problem, planner.path, 5, SHARES_TRIED, result)
    whole, _ = candidates._bent(problem, planner.path, WEIGHT_SHARES[0], 5)
    assert [c.plan for c in result.plans] == [whole.plan]
    assert candidates.snapshot()["earliness"] == 2, "nothing limited it"
    limited = _problem(planner, 1e9)
    hurried = replace(limited, situation=replace(limited.situation, deadline=lambda: True))
    result = Candidates()
    candidates._bend_early(hurried, planner.path, 5, SHARES_TRIED, result)
    assert result.deadline_hit
    assert len(result.plans) == 1
    assert candidates.snapshot()["earliness"] == 2


def test_path_too_long_for_explicit_actions_stays_a_tour(monkeypatch):
    monkeypatch.setattr("auv_lse_planner.methods.tour_candidates.MAX_EXPLICIT_ACTIONS", 5)
    decisions = _travel(_planner(), STEPS, _growing())
    assert all(len(d.plan.actions) <= DETOUR_LEGS for d in decisions if d.leg.step < STEPS - 5)
    assert any(d.plan.tour is not None for d in decisions)
