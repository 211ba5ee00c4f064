import dataclasses
import itertools
import math
import re

import numpy as np
import pytest
from planner_helpers import centers, depth, is_free, settings, track_of

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.map.online import OnlineGp
from auv_lse_planner.methods import single_routes, stages
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner


def _fly(planner, gp=None, ticks=2000, until=None, push=None):
    """Perfect tracking at 1 Hz; `push(t)` is added to the reported position. Yields every decision."""
    v = planner.settings.vehicle
    state = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])
    leg, queue, decisions = None, [], []
    for t in range(ticks):
        off = np.zeros(2) if push is None else push(t)
        planner.odometry(float(t), state[0], state[1] + off[0], state[2] + off[1])
        if planner.finished or (until is not None and len(decisions) >= until):
            return decisions
        if planner.due(float(t)):
            if gp is not None:
                planner.set_centers(gp.centers, float(t))
            decisions.append(planner.decide(float(t)))
            if leg is None:
                leg = decisions[-1].leg
            else:
                queue.append(decisions[-1].leg)
        if leg is None:
            continue
        along = leg.progress_m(state[1], state[2]) + v.speed_mps
        if along > leg.length_m and queue:
            along -= leg.length_m
            leg = queue.pop(0)
        state = leg.state_at(along)
        if gp is not None and t % 3 == 0:
            gp.add(state[1], state[2], float(depth(state[None, 1:])[0]))
    return decisions


@pytest.mark.parametrize("method", METHODS)
def test_every_method_completes_a_mission_on_connected_feasible_legs(method):
    s = settings({"method": method}, steps=12)
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    decisions = _fly(planner, OnlineGp(s.gp))
    assert planner.finished
    assert [d.leg.step for d in decisions] == list(range(12))
    assert [r.step for r in planner.records] == list(range(12))
    for before, after in itertools.pairwise(decisions):
        end = before.leg.end_state
        assert (after.leg.north_m, after.leg.east_m) == pytest.approx((end[1], end[2]), abs=1e-3)
    for d in decisions:
        assert is_free(
            planner.space,
            np.array([d.leg.heading_rad, d.leg.north_m, d.leg.east_m]),
            int(np.argmin(np.abs(planner.motion.turns_rad - d.leg.action_rad))),
        )
        assert d.bound.lower_bound_max >= d.bound.lower_bound
        assert math.isfinite(d.bound.expected_end)
    assert not planner.due(1e6)
    with pytest.raises(ValueError, match="all 12 steps are decided"):
        planner.decide(1e6)


def surfacing_pays(planner):
    """The planner, to which a fix brings more than any legs that it costs."""
    weigh = planner._method.weigh_surfacing
    planner._method.weigh_surfacing = lambda *where: dataclasses.replace(weigh(*where), gain=math.inf)
    return planner


def test_lawnmower_continues_its_lanes_after_a_surfacing():
    """Lanes are fitted to the legs that are left: with fewer of them they would begin anew."""
    s = settings({"method": "lawnmower"}, steps=80, vehicle={"surfacings": 1})
    planner = surfacing_pays(VehiclePlanner(1, s, np.random.default_rng(1)))
    decisions = _fly(planner, ticks=3000)
    without = settings({"method": "lawnmower"}, steps=80, vehicle={"surfacings": 0})
    through = _fly(VehiclePlanner(1, without, np.random.default_rng(1)), ticks=3000)
    surfaced = [decision.leg.step for decision in decisions if decision.leg.surface]
    assert len(surfaced) == 1
    assert planner.finished
    assert len(decisions) == 76
    locations = [[(d.leg.north_m, d.leg.east_m) for d in flown] for flown in (decisions, through)]
    assert np.array(locations[0]) == pytest.approx(np.array(locations[1][:76]), abs=1e-2)


@pytest.fixture(scope="module")
def surfaced():
    """Settings, planner and decisions of a mission by tours, with a surfacing."""
    s = settings({"method": "tour", "iterations": 20}, steps=80, vehicle={"surfacings": 1})
    planner = surfacing_pays(VehiclePlanner(1, s, np.random.default_rng(1)))
    return s, planner, _fly(planner, ticks=3000)


def test_sent_plan_is_delayed_by_a_surfacing(surfaced):
    s, planner, decisions = surfaced
    at = next(i for i, decision in enumerate(decisions) if decision.leg.surface)
    decision, after = decisions[at], decisions[at + 1].leg
    assert after.step == decision.leg.step + 5
    told = planner.rollout.follow(decision.plan).from_step(after.step)
    assert told.states[0] == pytest.approx(decision.leg.end_state, abs=1e-3), "it waits where the leg ends"
    assert len(told) == 80 - after.step
    # a mate that knew the plan from before: during the stop it thinks it somewhat behind, and then where it is
    both = dataclasses.replace(s, mission=dataclasses.replace(s.mission, vehicles=2))
    mate = VehiclePlanner(2, both, np.random.default_rng(1))
    mate.receive_plan(0.0, 1, dataclasses.replace(decision.plan, step=decision.plan.step - 4))
    leg_s = mate.motion.leg_length_m / s.vehicle.speed_mps
    gone_s = (decision.leg.step + 4 - decision.plan.step) * leg_s
    mate.receive_plan(gone_s, 1, decision.plan)
    ahead = mate.team.locations_ahead(gone_s + 5.0 * leg_s, 1)
    assert ahead[0] == pytest.approx(told.locations_m[0], abs=1e-3)


def test_surfacing_is_charged_to_the_budget(surfaced):
    """What its legs would have brought is missing from what is expected, and from the budget as far as it goes."""
    _, _, decisions = surfaced
    at = next(i for i, decision in enumerate(decisions) if decision.leg.surface)
    before, now, after = (decisions[i].bound for i in (at - 1, at, at + 1))
    assert now.expected_total < before.expected_total
    assert 0.0 <= now.budget < before.budget or now.budget == 0.0
    assert now.lower_bound == pytest.approx(now.expected_total - now.budget)
    assert after.expected_total == pytest.approx(now.expected_total, rel=0.02), "as much is expected with fewer legs"


def test_replay_adopts_recorded_surfacings(surfaced):
    s, _, decisions = surfaced
    at = next(i for i, decision in enumerate(decisions) if decision.leg.surface)
    other = VehiclePlanner(1, s, np.random.default_rng(2))
    for decision in decisions[: at + 1]:
        other.odometry(decision.bound.now_s, decision.leg.heading_rad, decision.leg.north_m, decision.leg.east_m)
        other.decide(decision.bound.now_s)
        other.adopt(decision.plan, decision.leg)
    assert other._travel.decided == decisions[at + 1].leg.step
    assert other._surfacings.done == 1
    assert other.path.states[0] == pytest.approx(decisions[at].leg.end_state, abs=1e-3)


@pytest.mark.parametrize("method", ["augmented", "tour"])
def test_same_seed_gives_the_same_decisions(method):
    s = settings({"method": method, "iterations": 100}, steps=5)
    runs = [_fly(VehiclePlanner(1, s, np.random.default_rng(3)), OnlineGp(s.gp)) for _ in range(2)]
    assert [d.leg for d in runs[0]] == [d.leg for d in runs[1]]
    assert [d.plan for d in runs[0]] == [d.plan for d in runs[1]]


def test_decisions_are_due_after_the_delay_and_near_the_legs_end():
    s = settings(steps=3, vehicle={"start_delay_s": 5.0})
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    assert not planner.due(10.0)  # no odometry
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    assert not planner.due(4.0)
    assert planner.due(5.0)
    first = planner.decide(5.0)
    assert planner.leg == first.leg
    assert not planner.due(5.5)
    lead = s.planner.replan_lead_s * s.vehicle.speed_mps
    for left, due in ((lead + 0.5, False), (lead - 0.5, True)):
        at = first.leg.state_at(first.leg.length_m - left)
        planner.odometry(15.0, *at)
        assert planner.due(15.0) is due
    second = planner.decide(15.0)
    assert planner.leg == first.leg  # still on the first
    assert not planner.due(15.5)
    at = second.leg.state_at(1.0)
    planner.odometry(20.0, *at)
    assert planner.leg == second.leg


def test_old_odometry_stops_planning_and_is_reported():
    planner = VehiclePlanner(1, settings(), np.random.default_rng(1))
    assert any("odometry: none" in p for p in planner.problems(1.0).values())
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    assert planner.problems(1.0) == {}
    assert planner.due(9.0)
    assert not planner.due(11.0)
    assert any("planning has stopped" in p for p in planner.problems(11.0).values())
    planner.odometry(12.0, 0.0, 0.0, 0.0)
    assert planner.due(12.0)
    planner.odometry(13.0, math.nan, 0.0, 0.0)  # not a state: as if nothing had come
    assert planner.due(13.0)


def test_old_map_or_plans_are_reported_and_planning_continues():
    planner = VehiclePlanner(2, settings({"plan_expiry_s": 60.0}, vehicles=2), np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    planner.set_centers(centers(np.random.default_rng(1), 5), 0.0)
    assert planner.problems(1.0) == {}, "no slot of vehicle 1 may have come yet"
    planner.odometry(100.0, 0.0, 0.0, 0.0)
    assert any(p.startswith("map: last 100 s ago") for p in planner.problems(100.0).values())
    assert planner.due(100.0)
    planner.decide(100.0)
    assert any("no plan received from vehicle 1" in p for p in planner.problems(100.0).values())


def test_each_mate_has_its_own_problem():
    planner = VehiclePlanner(3, settings({"plan_expiry_s": 60.0}, vehicles=3), np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    planner.decide(0.0)
    first = {key for key, text in planner.problems(1.0).items() if text.startswith("team:")}
    assert first == {"plan of 1 missing", "plan of 2 missing"}
    planner.receive_plan(2.0, 1, Plan(step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, actions=(5,), naive_path=0xFF))
    expiry_s = planner.settings.planner.plan_expiry_s
    later = [{k: t for k, t in planner.problems(s).items() if t.startswith("team:")} for s in (3.0, 3.0 + expiry_s)]
    assert set(later[0]) == {"plan of 2 missing"}
    assert set(later[1]) == {"plan of 1 expired", "plan of 2 missing"}
    assert set(planner.problems(4.0 + expiry_s)) == set(planner.problems(3.0 + expiry_s))  # keys last, texts change


def test_expected_end_never_decreases_on_unchanged_data():
    for method in ("augmented", "plain"):
        s = settings({"method": method, "iterations": 40, "incumbent": True}, steps=15)
        planner = VehiclePlanner(1, s, np.random.default_rng(2))
        decisions = _fly(planner)  # no data ever arrives
        for d in decisions[1:]:
            assert d.bound.expected_end >= d.bound.incumbent_value - 1e-9
            assert d.bound.incumbent_kept == (d.bound.incumbent_value >= d.statistics.best_new_value)


def test_without_the_incumbent_the_search_decides():
    s = settings({"method": "augmented", "iterations": 10, "incumbent": False}, steps=10)
    decisions = _fly(VehiclePlanner(1, s, np.random.default_rng(2)))
    assert not any(d.bound.incumbent_kept for d in decisions)
    assert any(d.bound.incumbent_value > d.bound.expected_end for d in decisions[1:])


def test_kept_plan_is_travelled_as_published():
    s = settings({"method": "augmented", "iterations": 30}, steps=30)
    planner = VehiclePlanner(1, s, np.random.default_rng(5))
    decisions = _fly(planner)
    kept = [d for d in decisions if d.bound.incumbent_kept]
    assert kept
    for d in kept:
        path = planner.rollout.follow(d.plan)  # what every receiver does
        at = path.from_step(d.leg.step).states[0]
        assert (d.leg.heading_rad, d.leg.north_m, d.leg.east_m) == tuple(at)
        assert len(path) == 30 - d.plan.step


def test_plans_are_exact_in_float32():
    s = settings(steps=10)
    planner = VehiclePlanner(1, s, np.random.default_rng(5))
    for d in _fly(planner):
        p = d.plan
        received = dataclasses.replace(
            p,
            heading_rad=float(np.float32(p.heading_rad)),
            north_m=float(np.float32(p.north_m)),
            east_m=float(np.float32(p.east_m)),
        )
        assert received == p
        other = VehiclePlanner(1, s, np.random.default_rng(99))
        assert np.array_equal(other.rollout.follow(received).states, planner.rollout.follow(p).states)


def test_vehicle_off_its_leg_plans_from_odometry():
    s = settings(steps=6)
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    first = planner.decide(0.0)
    at = first.leg.state_at(first.leg.length_m - 3.0)
    pushed = (at[1] + 30.0 * math.sin(at[0]), at[2] - 30.0 * math.cos(at[0]))
    planner.odometry(14.0, at[0], *pushed)
    second = planner.decide(14.0)
    assert second.statistics.reanchored
    assert math.hypot(second.leg.north_m - pushed[0], second.leg.east_m - pushed[1]) < 6.1
    assert planner.leg == second.leg  # it does not wait for the end of a leg that it is not on


def test_start_elsewhere_is_taken_from_odometry():
    planner = VehiclePlanner(1, settings(), np.random.default_rng(1))
    planner.odometry(0.0, 1.0, 200.0, 300.0)
    decision = planner.decide(0.0)
    assert decision.statistics.reanchored
    assert (decision.leg.north_m, decision.leg.east_m) == (200.0, 300.0)


def test_planner_escapes_from_a_corner():
    s = settings(vehicle={"start_north_m": 375.0, "start_east_m": 475.0, "start_heading_rad": 0.8}, steps=8)
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    decisions = _fly(planner)
    assert decisions[0].statistics.escape
    assert not decisions[-1].statistics.escape
    assert planner.finished


@pytest.mark.parametrize(
    ("method", "north", "east", "heading", "steps"),
    [
        ("augmented", -700.0, 30.0, 3.1, 200),
        ("augmented", 900.0, -2000.0, 0.0, 200),
        ("straddle", -700.0, 30.0, 3.1, 200),
        ("tour", -300.0, 30.0, 3.1, 40),
        ("tour", 600.0, 30.0, 0.0, 40),
    ],
)
def test_vehicle_outside_returns_and_reports_it(method, north, east, heading, steps):
    planner = VehiclePlanner(1, settings({"method": method}, steps=steps), np.random.default_rng(0))
    state, said = np.array([heading, north, east]), []
    for step in range(steps):
        planner.odometry(100.0 * step, *state)
        said += [text for key, text in planner.problems(100.0 * step).items() if key == "outside"]
        state = planner.decide(100.0 * step).leg.end_state
        if planner.space.clearance_m(*state[1:]) > 0.0:
            break
    else:
        pytest.fail(f"still outside, at {state}")
    straight_m = math.hypot(north, east) + 200.0
    assert step * planner.motion.leg_length_m < straight_m + 200.0
    assert re.search(r"\d\.\d m outside the area: returning", said[0]), "never 0 m outside"


def test_vehicle_beyond_the_limit_holds_and_reports_it():
    planner = VehiclePlanner(1, settings({"method": "augmented"}, steps=100), np.random.default_rng(0))
    start = state = np.array([1.0, 5500.0, 300.0])
    for step in range(20):
        planner.odometry(100.0 * step, *state)
        (text,) = (text for key, text in planner.problems(100.0 * step).items() if key == "outside")
        assert "more than 5000 m: holding" in text
        state = planner.decide(100.0 * step).leg.end_state
    assert np.hypot(*(state - start)[1:]) < 100.0


@pytest.mark.parametrize("value", [1e39, -1e39, 1e7, math.nan, math.inf])
@pytest.mark.parametrize("field", [1, 2, 3])
def test_impossible_odometry_is_ignored_and_counted(value, field):
    planner = VehiclePlanner(1, settings({"method": "augmented"}, steps=10), np.random.default_rng(0))
    good = [0.0, 0.1, 20.0, 30.0]
    planner.odometry(*good)
    bad = [1.0, *good[1:]]
    bad[field] = value
    planner.odometry(*bad)
    assert "1 (of 1) messages" in planner.problems(1.0)["odometry impossible"]
    assert np.isfinite(planner.decide(1.0).leg.end_state).all()


@pytest.mark.parametrize("change", [{"heading_rad": 1e30}, {"north_m": 1e30}, {"east_m": -1e9}, {"heading_rad": -7.0}])
def test_impossible_plans_are_rejected_and_do_not_hang(change):
    planner = VehiclePlanner(2, settings({"method": "augmented"}, steps=10, vehicles=2), np.random.default_rng(0))
    good = Plan.at(0, np.array([0.1, 20.0, 30.0]), (), 0xF0)
    planner.receive_plan(0.0, 1, dataclasses.replace(good, **change))
    assert planner.plans_refused == 1


def test_shallow_ground_on_the_map_ends_the_incumbent():
    s = settings({"method": "lawnmower"}, steps=12)
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    first = planner.decide(0.0)
    ahead = planner.rollout.follow(first.plan).states[3, 1:]
    # a survey at every 20 m: 20 m of water, but for a shoal of 30 m radius in the third leg's way
    survey = np.array([[n, e] for n in np.arange(-20.0, 200.0, 20.0) for e in np.arange(-20.0, 200.0, 20.0)])
    depths = np.where(np.hypot(*(survey - ahead).T) < 30.0, 1.0, 20.0)
    shoal = Centers(survey, depths, np.full(len(survey), 0.3))
    planner.set_centers(shoal)
    at = first.leg.end_state
    planner.odometry(15.0, *at)
    second = planner.decide(15.0)
    assert second.statistics.incumbent_infeasible
    assert not second.bound.incumbent_kept
    path = planner.rollout.follow(second.plan)
    for state, action in zip(path.states[:4], path.actions[:4], strict=False):
        track = track_of(planner.motion, state, int(action), 1.0)
        assert planner.posterior.mean_m(track).min() > 3.0


def test_the_vehicle_passes_above_ground_that_the_map_expects_and_avoids_what_it_cannot_pass():
    wanted = {"depth_m": 10.0, "min_altitude_m": 3.0}
    planner = VehiclePlanner(1, settings({"method": "lawnmower"}, steps=12, vehicle=wanted), np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    leg = planner.decide(0.0).leg
    ahead = leg.state_at(leg.length_m)[1:]
    survey = np.array([[n, e] for n in np.arange(-20.0, 200.0, 10.0) for e in np.arange(-20.0, 200.0, 10.0)])
    off = np.hypot(*(survey - ahead).T)
    vehicle = planner.settings.vehicle
    for shoal_m, depth_m, passes in ((30.0, 10.0, True), (9.0, 6.0, True), (3.0, 1.0, False)):
        depths = np.where(off < 40.0, shoal_m, 30.0)
        planner.set_centers(Centers(survey, depths, np.full(len(survey), 0.3)))
        planner.odometry(0.5, 0.0, 0.0, 0.0)
        planner.decide(0.5)
        assert planner.shallow_ground.travel_depth_m(leg, vehicle) == pytest.approx(depth_m, abs=1.2)
        blocked = planner.space.arguments().raster is not planner.space.area_raster
        assert blocked != passes
    assert planner.shallow_ground.travel_depth_m(leg, dataclasses.replace(vehicle, min_altitude_m=0.0)) == 10.0


def test_mates_locations_change_the_path_and_bad_plans_are_rejected():
    s = settings({"method": "augmented", "credit": "beyond"}, vehicles=2, steps=10)
    one = VehiclePlanner(1, s, np.random.default_rng(1))
    two = VehiclePlanner(2, s, np.random.default_rng(1))
    one.odometry(0.0, 0.0, 0.0, 0.0)
    two.odometry(0.0, 0.0, 0.0, 0.0)
    plan = one.decide(0.0).plan
    two.receive_plan(0.0, 1, dataclasses.replace(plan, naive_path=0x20))
    two.receive_plan(0.0, 1, dataclasses.replace(plan, actions=(77,)))
    two.receive_plan(0.0, 1, dataclasses.replace(plan, north_m=math.nan))
    two.receive_plan(
        0.0, 1, dataclasses.replace(plan, step=s.mission.steps + 1)
    )  # else all true plans would count as older
    assert any("4 (of 4) received plans" in p for p in two.problems(0.0).values())
    two.receive_plan(0.0, 1, plan)
    decision = two.decide(0.0)
    assert decision.statistics.team_locations == 10
    mine, theirs = two.rollout.follow(decision.plan).states[:, 1:], one.rollout.follow(plan).states[:, 1:]
    apart = np.hypot(*(mine[-1] - theirs[-1]))
    assert apart > 20.0


def test_parameters_can_be_changed_during_a_mission():
    s = settings({"method": "augmented", "iterations": 20}, steps=10)
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    first = planner.decide(0.0)
    planner.set_planner(PlannerConfig(method="plain", iterations=200))
    planner.odometry(15.0, *first.leg.end_state)
    second = planner.decide(15.0)
    assert second.bound.method == "plain"
    assert second.bound.iterations == 200
    assert math.isfinite(second.bound.lower_bound)


@pytest.mark.parametrize("method", ["augmented", "plain", "tour"])
def test_a_deadline_gives_a_feasible_plan(method):
    planner = VehiclePlanner(1, settings({"method": method}, steps=60), np.random.default_rng(1))
    planner.set_centers(centers(np.random.default_rng(1), 100))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    decision = planner.decide(0.0, deadline=lambda: True)
    assert decision.bound.deadline_hit
    state = np.array([0.0, 0.0, 0.0])
    for action in decision.plan.actions:
        assert action in planner.space.feasible(state)
        state = planner.motion.end_state(state, action)


def test_samples_per_leg_count_in_the_reward():
    values = []
    for samples in (1, 3):
        planner = VehiclePlanner(1, settings({"method": "plain", "samples_per_leg": samples}), np.random.default_rng(1))
        planner.odometry(0.0, 0.0, 0.0, 0.0)
        values.append(planner.decide(0.0).bound.expected_end)
    assert values[1] > 2.0 * values[0]


def test_nonexistent_vehicle_is_rejected():
    with pytest.raises(ValueError, match=r"vehicle 4 does not exist; mission\.vehicles is 2"):
        VehiclePlanner(4, settings(vehicles=2), np.random.default_rng(1))


def test_finished_vehicle_stays_finished_while_circling():
    planner = VehiclePlanner(1, settings({"method": "random"}, steps=2), np.random.default_rng(1))
    last = _fly(planner)[-1].leg
    assert planner.finished
    planner.odometry(1e3, last.heading_rad, last.north_m, last.east_m)  # round the circle, back at its start
    assert planner.finished
    assert not [p for p in planner.problems(1e3).values() if p.startswith("leg")]


def test_plans_use_the_map_frame_and_legs_the_odometry_frame():
    """The plan begins where the map has the vehicle; a small change displaces the next leg, a large one the plan."""
    planner = VehiclePlanner(1, settings({"method": "lawnmower"}, steps=20), np.random.default_rng(1))
    planner.odometry(0.0, 0.0, 0.0, 0.0)
    first = planner.decide(0.0)
    steps = [(4.0, -3.0, False), (6.0, -3.0, False), (40.0, -3.0, True)]
    leg, before = first.leg, (0.0, 0.0)
    for number, (north_m, east_m, anew) in enumerate(steps, 1):
        end = leg.end_state
        planner.odometry(15.0 * number, *end)
        planner.set_map_offset(north_m, east_m)
        decision = planner.decide(15.0 * number)
        leg = decision.leg
        assert decision.statistics.reanchored is anew
        in_map = np.array([leg.north_m + north_m, leg.east_m + east_m])
        expected = end[1:] + ((north_m, east_m) if anew else before)
        assert in_map == pytest.approx(expected, abs=1e-4), "in the map the path goes on, or begins where it now is"
        before = (north_m, east_m)
    assert decision.plan.state[1:] == pytest.approx(in_map, abs=1e-4), "mates are told the plan in the map"


def test_restarted_planner_keeps_the_map_offset():
    planners = [VehiclePlanner(1, settings(steps=20), np.random.default_rng(1)) for _ in range(2)]
    planners[0].set_map_offset(5.0, 6.0, np.diag([9.0, 4.0]))
    planners[0].odometry(0.0, 0.0, 0.0, 0.0)
    leg = planners[0].decide(0.0).leg
    planners[1].restore(planners[0].snapshot())
    assert planners[1].in_odometry_frame(leg) == planners[0].in_odometry_frame(leg) != leg
    assert np.array_equal(planners[1]._position_margin.covariance_m2, np.diag([9.0, 4.0]))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("has_journal", [True, False])
def test_steps_that_a_journal_has_lost_are_skipped_and_not_repeated(method, has_journal):
    """After power loss the state file has the step, and the journal an earlier one or none."""
    s = settings({"method": method}, steps=12)
    first = VehiclePlanner(1, s, np.random.default_rng(1))
    _fly(first, OnlineGp(s.gp), until=3)
    journal = first.snapshot() if has_journal else None
    again = VehiclePlanner(1, s, np.random.default_rng(1))
    if journal is not None:
        again.restore(journal)
    again.resume_at(6)
    decisions = _fly(again, OnlineGp(s.gp))
    assert [d.leg.step for d in decisions] == list(range(6, 12))
    assert again.finished
    over = VehiclePlanner(1, s, np.random.default_rng(1))
    over.resume_at(12)
    assert over.finished


def test_a_leg_does_not_time_out_because_the_clock_was_wrong_after_a_reboot():
    s = settings({"method": "plain"}, steps=4)
    first = VehiclePlanner(1, s, np.random.default_rng(1))
    (decision,) = _fly(first, until=1)
    for clock_s in (0.0, 1e3, 1e9):
        again = VehiclePlanner(1, s, np.random.default_rng(1))
        again.set_blocked(0.0, "starting")
        again.restore(first.snapshot())
        again.forget_clock()
        again.set_blocked(clock_s, "")
        state = decision.leg.state_at(1.0)
        again.odometry(clock_s + 1.0, *state)
        assert "leg overdue" not in again.problems(clock_s + 5.0)
        assert again._travel.overdue(clock_s + 200.0)


class Deadline:
    """Passes at its n-th check."""

    def __init__(self, checks):
        self.checks_left = checks

    def __call__(self):
        self.checks_left -= 1
        return self.passed

    @property
    def passed(self):
        return self.checks_left <= 0


@pytest.fixture
def work_after(monkeypatch):
    """Counts the evaluations and routes that begin after a deadline, the first element, has passed."""
    counted = [Deadline(1), 0]

    def counting(owner, name):
        original = getattr(owner, name)

        def counted_call(*arguments, **options):
            counted[1] += counted[0].passed
            return original(*arguments, **options)

        monkeypatch.setattr(owner, name, counted_call)

    for name in ("value", "value_and_gradient", "coarse_value"):
        counting(AnytimeReward, name)
    counting(single_routes, "route_m")
    return counted


@pytest.mark.parametrize(("steps", "vehicles"), [(30, 1), (60, 2), (210, 2)])
def test_the_first_decision_ends_soon_after_its_deadline(steps, vehicles, work_after, monkeypatch):
    monkeypatch.setattr(single_routes, "USE_NUMBA", True)
    for checks in (1, 4, 12, 40, 90):
        planner = VehiclePlanner(1, settings(steps=steps, vehicles=vehicles), np.random.default_rng(1))
        planner.odometry(0.0, 0.0, 0.0, 0.0)
        work_after[:] = [Deadline(checks), 0]
        bound = planner.decide(0.0, work_after[0]).bound
        assert bound.deadline_hit == work_after[0].passed
        assert work_after[1] <= 3, f"deadline at check {checks}"


@pytest.mark.parametrize("steps", [40, 210])
def test_a_later_decision_past_its_deadline_evaluates_the_last_plan_alone(steps, work_after):
    planner = VehiclePlanner(1, settings(steps=steps, vehicles=2), np.random.default_rng(1))
    intervals = stages.INTERVALS if stages.is_staged(settings(steps=steps, vehicles=2).mission) else 1
    leg = _fly(planner, until=intervals * planner.planner.tour_interval)[-1].leg
    work_after[:] = [Deadline(1), 0]
    decision = planner.decide(1000.0, work_after[0])
    assert decision.leg.step == leg.step + 1
    assert decision.bound.deadline_hit
    assert decision.bound.incumbent_kept
    assert work_after[1] <= 1


@pytest.mark.parametrize("method", ["tour", "line", "plain"])
def test_a_restart_in_a_large_area_goes_on_with_the_cells_within_reach(method):
    """The map is limited to them; a restarted planner and one that drifted far limit it anew, and keep the reward."""
    side = 3000.0
    s = settings({"method": method}, steps=12, area={"polygon_m": [0.0, 0.0, side, 0.0, side, side, 0.0, side]})
    s = dataclasses.replace(s, vehicle=dataclasses.replace(s.vehicle, start_north_m=1500.0, start_east_m=1500.0))
    first = VehiclePlanner(1, s, np.random.default_rng(1))
    decisions = _fly(first, OnlineGp(s.gp), until=6)
    assert len(first._context.map_grid.locations_m) < 0.15 * (side / 20.0) ** 2
    again = VehiclePlanner(1, s, np.random.default_rng(1))
    again.restore(first.snapshot())
    again.set_centers(Centers(np.array([[1500.0, 1500.0]]), np.array([15.0]), np.array([0.3])))
    again.odometry(500.0, 0.0, 2500.0, 700.0)
    decision = again.decide(500.0)
    assert decision.statistics.reanchored
    assert np.hypot(*(again._context.map_grid.locations_m - [2500.0, 700.0]).T).max() < 450.0
    if method != "plain":
        assert decision.bound.reward_so_far == pytest.approx(decisions[-1].bound.reward_so_far)
    assert decision.bound.expected_end > 0.0


def test_a_mission_in_a_swimming_pool_flies():
    pool = {"polygon_m": [20.0, 18.0, 40.0, 18.0, 40.0, 28.0, 20.0, 28.0], "margin_m": 0.5, "raster_m": 0.2}
    s = settings(
        {"map_spacing_m": 1.0, "lane_spacing_m": 3.0},
        steps=8,
        area=pool,
        motion={"turn_radius_m": 1.0},
        gp={"length_scale_m": 4.0, "map_resolution_m": 0.5, "min_spacing_m": 0.5},
        vehicle={"start_north_m": 24.0, "start_east_m": 22.0, "speed_mps": 0.3, "depth_m": 0.5},
    )
    planner = VehiclePlanner(1, s, np.random.default_rng(1))
    _fly(planner, OnlineGp(s.gp))
    assert planner.finished
