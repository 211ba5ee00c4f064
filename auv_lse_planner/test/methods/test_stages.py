"""Long missions, here with short stages."""

import json

import numpy as np
import pytest
from planner_helpers import centers, settings

from auv_lse_common.vocabulary.naive_ids import FITTED, LAWNMOWERS
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.methods import ground_window, method, stages
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

STEPS, STAGE, RENEW = 26, 10, 4


@pytest.fixture(autouse=True)
def _short_stages(monkeypatch):
    monkeypatch.setattr(stages, "MAX_WHOLE_LEGS", STEPS - 1)
    monkeypatch.setattr(stages, "STAGE_LEGS", STAGE)
    monkeypatch.setattr(stages, "RENEW_LEGS", RENEW)


def _planner(steps=STEPS, method="tour"):
    parameters = settings({"method": method}, 1, steps, vehicle={"surfacings": 0})
    made = VehiclePlanner(1, parameters, np.random.default_rng(1))
    v = made.settings.vehicle
    made.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    return made


def _decide(planner, step):
    planner.set_centers(centers(np.random.default_rng(3), 1 + 8 * step), 15.7 * step)
    decision = planner.decide(15.7 * step)
    planner.odometry(15.7 * (step + 1), *(float(x) for x in decision.leg.end_state))
    return decision


def test_near_legs_are_exact_and_the_rest_is_a_tour():
    planner = _planner()
    for step in range(STEPS):
        plan = _decide(planner, step).plan
        path = planner.rollout.follow(plan).from_step(step)
        explicit = plan.step + len(plan.actions) - step
        if not planner._method._stages.is_last:
            assert STAGE - RENEW < explicit <= STAGE
        assert path.states[: explicit + 1] == pytest.approx(planner._followed.path.states[: explicit + 1], abs=1e-9)
        assert abs(step + len(path) - STEPS) <= stages.REST_SEGMENT_LEGS


def test_what_is_expected_elsewhere_is_carried_to_the_end(monkeypatch):
    """A mate's plan over ground that this vehicle never comes near counts, in the last legs too."""
    monkeypatch.setattr(ground_window, "CELLS_SCALES", 0.6)
    parameters = settings({"method": "tour"}, 2, STEPS, vehicle={"surfacings": 0})
    planner = VehiclePlanner(1, parameters, np.random.default_rng(1))
    v = planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    for step in range(STEPS - RENEW // 2):
        mate = Plan.at(step, np.array([0.0, -20.0, 150.0]), (), FITTED[1])
        planner.receive_plan(15.7 * step, 2, mate)
        bound = _decide(planner, step).bound
        assert bound.expected_end > 0.0
        assert bound.lower_bound == pytest.approx(bound.expected_total - bound.budget)
    stage = planner._method._stages
    assert stage.is_last
    assert 0.0 < stage.rest().drop < bound.expected_end


def test_reward_expected_at_the_end_is_never_below_the_reward_so_far():
    planner = _planner()
    for step in range(STEPS):
        bound = _decide(planner, step).bound
        assert bound.expected_end >= 0.0
        assert bound.budget >= 0.0
    assert 0.0 <= planner._method._stages.rest().drop < 0.2 * planner.records[0].expected_end


def test_between_bends_the_last_plan_and_its_value_are_carried_on():
    planner = _planner()
    interval = stages.INTERVALS * planner.planner.tour_interval
    for step in range(2 * interval):
        before = planner.records[-1] if planner.records else None
        rows = planner.posterior.data_rows
        plan, decision = planner._followed, _decide(planner, step)
        if step % interval and step % RENEW:
            assert decision.plan == plan.plan
            assert decision.bound.incumbent_kept
            assert decision.bound.expected_total == before.expected_total
            assert planner.posterior.data_rows == rows
        else:
            assert planner.posterior.data_rows > rows or step == 0


def test_shallow_ground_ahead_voids_a_plan_between_bends():
    planner = _planner()
    _decide(planner, 0)
    location = planner.path.states[2, 1:]
    around = location + 6.0 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    planner.set_centers(Centers(around, np.full(4, 1.0), np.full(4, 0.2)), 15.7)
    decision = planner.decide(15.7)
    assert decision.bound.void == "shallow ground"
    assert decision.bound.iterations


def test_first_plan_is_expected_to_end_as_the_best_naive_path():
    planner = _planner()
    bound = _decide(planner, 0).bound
    assert bound.lower_bound == pytest.approx(bound.incumbent_value)
    assert bound.expected_end >= bound.incumbent_value


def test_naive_paths_of_a_large_team_are_compared_at_few_of_its_legs(monkeypatch):
    compared, value = [], stages.AnytimeReward.value

    def spy(self, locations_m):
        compared.append(self.legs)
        return value(self, locations_m)

    monkeypatch.setattr(stages, "COMPARED_TEAM_LEGS", STEPS)
    monkeypatch.setattr(stages.AnytimeReward, "value", spy)
    parameters = settings({"method": "tour"}, 5, STEPS)
    planner = VehiclePlanner(1, parameters, np.random.default_rng(1))
    v = planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    _decide(planner, 0)
    assert compared[0] == -(-STEPS // 5)


def test_naive_paths_are_compared_given_the_mates_as_in_time_order(monkeypatch):
    """The mates' locations are conditioned on once; a path adds its own locations only."""
    compared, given_mates = [], stages.Stages._given_mates

    def spy(self, s, cells_m, every):
        given, by_mates = given_mates(self, s, cells_m, every)
        context, legs = self._context, STEPS - s.step
        mates = [(ahead[::every], locations[::every]) for ahead, locations in context.mates_ahead(s)]
        points, weighting = CachedPoints(context.posterior, cells_m), Weighting(-(-legs // every), 0, legs)
        together = AnytimeReward(points, context.settings.level_set, mates, weighting)
        for naive_path in (FITTED[0], *LAWNMOWERS[:2]):
            path = context.rollout.follow(Plan.at(s.step, s.state, (), naive_path)).leg_locations_m[::every]
            compared.append((given.value(path).expected_end + by_mates, together.value(path).expected_end))
        assert not given.mates
        assert sum(len(locations) for _, locations in mates) > legs
        return given, by_mates

    monkeypatch.setattr(stages.Stages, "_given_mates", spy)
    planner = VehiclePlanner(1, settings({"method": "tour"}, 3, STEPS), np.random.default_rng(1))
    v = planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    _decide(planner, 0)
    assert len(compared) == 3
    for given, together in compared:  # but for cells whose risk given the mates is negligible (VALUE_RISK_SHARE)
        assert given == pytest.approx(together, rel=1e-8)


def test_mates_planned_locations_near_a_stage_are_thinned_out(monkeypatch):
    """The expected drop of risk stays within 1 % of that with all of them."""
    expected, locations = [], []
    for most in (10_000, 40):
        monkeypatch.setattr(method, "MAX_MATE_LOCATIONS", most)
        planner = VehiclePlanner(1, settings({"method": "tour"}, 6, STEPS), np.random.default_rng(1))
        v = planner.settings.vehicle
        planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
        given, ahead = [], method.PlanningContext.mates_ahead

        def spy(self, situation, given=given, ahead=ahead):
            found = ahead(self, situation)
            given.append(sum(len(mate) for _, mate in found))
            return found

        with monkeypatch.context() as patched:
            patched.setattr(method.PlanningContext, "mates_ahead", spy)
            expected.append(_decide(planner, 0).bound.expected_end)
        locations.append(given[-1])
    assert locations[1] <= 40 + 6 < locations[0]
    assert expected[1] == pytest.approx(expected[0], rel=0.01)


def test_stage_is_bent_less_often_than_a_short_mission():
    planner = _planner()
    interval = stages.INTERVALS * planner.planner.tour_interval
    bent = [step for step in range(2 * interval + 1) if _decide(planner, step).bound.iterations]
    assert bent == [0, interval, 2 * interval]


def test_short_mission_has_no_stages():
    planner = _planner(STEPS - 1)
    _decide(planner, 0)
    assert planner._method._stages is None
    assert not planner._context.window.is_focused


def test_short_mission_of_a_large_team_has_stages(monkeypatch):
    """Else the first decision takes 35 s for 20 vehicles with 100 legs, against 0.8 s."""
    monkeypatch.setattr(stages, "MAX_WHOLE_TEAM_LEGS", 4 * (STEPS - 1))
    for vehicles in (4, 5):
        parameters = settings({"method": "tour"}, vehicles, STEPS - 1, vehicle={"surfacings": 0})
        planner = VehiclePlanner(1, parameters, np.random.default_rng(1))
        assert (planner._method._stages is not None) == (vehicles == 5)


def test_restored_planner_continues_the_account_and_the_line():
    planner = _planner()
    for step in range(12):
        _decide(planner, step)
    kept = json.loads(json.dumps(planner.snapshot()))
    other = _planner()
    other.restore(kept)
    end = planner.path.states[min(3, len(planner.path)), 1:]
    other.odometry(15.7 * 12, *(float(x) for x in planner.path.states[0]))
    first, again = _decide(planner, 12), _decide(other, 12)
    assert again.bound.expected_total == pytest.approx(first.bound.expected_total, rel=0.05)
    assert other.path.states[min(3, len(other.path)), 1:] == pytest.approx(end, abs=30.0)


def test_another_method_plans_with_the_whole_map():
    planner = _planner()
    _decide(planner, 0)
    _decide(planner, 1)
    assert planner._context.window.is_focused
    planner.set_planner(type(planner.planner)(method="plain"))
    _decide(planner, 2)
    assert planner.posterior.data_rows == 17
