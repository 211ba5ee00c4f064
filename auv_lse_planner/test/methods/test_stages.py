"""Long missions, here with short stages."""

import json

import numpy as np
import pytest
from planner_helpers import centers, settings

from auv_lse_planner.methods import stages
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


def test_account_goes_on_when_a_stage_begins(monkeypatch):
    ends = []
    extended = stages.Stages._extended

    def spy(self, s, last):
        before = self._end_risk
        found = extended(self, s, last)
        reward = self._context.map_reward(s, self.rest())
        value = reward.value(self._context.map_places(found.path)[: reward.legs])
        ends.append((s.step, before, reward.risk_before - value.expected_end))
        return found

    monkeypatch.setattr(stages.Stages, "_extended", spy)
    planner = _planner()
    bounds = [_decide(planner, step).bound for step in range(STEPS)]
    assert [step for step, _, _ in ends] == list(range(0, STEPS, RENEW))
    for step, before, after in ends[1:]:
        if STEPS - step > RENEW:
            assert after == pytest.approx(before)
    assert planner._method._stages.rest().drop == 0.0
    assert all(bound.budget >= 0.0 for bound in bounds)


def test_first_plan_is_expected_to_end_as_the_best_naive_path():
    planner = _planner()
    bound = _decide(planner, 0).bound
    assert bound.lower_bound == pytest.approx(bound.incumbent_value)
    assert bound.expected_end >= bound.incumbent_value


def test_naive_paths_of_a_large_team_are_compared_at_few_of_its_legs(monkeypatch):
    compared, value = [], stages.AnytimeReward.value

    def spy(self, places_m):
        compared.append(self.legs)
        return value(self, places_m)

    monkeypatch.setattr(stages, "COMPARED_TEAM_LEGS", STEPS)
    monkeypatch.setattr(stages.AnytimeReward, "value", spy)
    parameters = settings({"method": "tour"}, 5, STEPS)
    planner = VehiclePlanner(1, parameters, np.random.default_rng(1))
    v = planner.settings.vehicle
    planner.odometry(0.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    _decide(planner, 0)
    assert compared[0] == -(-STEPS // 5)


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


def test_restored_planner_continues_the_account_and_the_line():
    planner = _planner()
    for step in range(7):
        _decide(planner, step)
    kept = json.loads(json.dumps(planner.snapshot()))
    other = _planner()
    other.restore(kept)
    end = planner.path.states[min(3, len(planner.path)), 1:]
    other.odometry(15.7 * 7, *(float(x) for x in planner.path.states[0]))
    first, again = _decide(planner, 7), _decide(other, 7)
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
