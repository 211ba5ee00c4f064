"""What planner_node's diagnostics and log say."""

import dataclasses

import numpy as np
import pytest
from planner_helpers import settings

from auv_lse_common.health import Level, NewProblems
from auv_lse_planner.health import planner_health, warnings_of
from auv_lse_planner.intake import PlannerIntake
from auv_lse_planner.vehicle_planner import VehiclePlanner


def planner(vehicle=1, vehicles=1):
    return VehiclePlanner(vehicle, settings({"method": "plain"}, vehicles=vehicles, steps=4), np.random.default_rng(1))


def test_every_team_mate_that_is_not_heard_is_logged_once():
    own = planner(vehicle=3, vehicles=3)
    new = NewProblems()
    first = new.of(own.problems(5.0))
    assert [text for text in first if "vehicle 1" in text]
    assert [text for text in first if "vehicle 2" in text], "one mate's problem hides no other's"
    assert new.of(own.problems(6.0)) == []


def test_health_tells_the_last_decision_and_the_problems():
    own = planner()
    assert planner_health(own, own.problems(5.0), 0.0).level is Level.WARN
    v = own.settings.vehicle
    intake = PlannerIntake(own)
    intake.set_odometry(5.0, v.start_heading_rad, v.start_north_m, v.start_east_m)
    assert intake.take(5.0), "a decision is due"
    decision = own.decide(5.0)
    health = planner_health(own, {}, 0.25)
    assert (health.level, health.text) == (Level.OK, "ok")
    assert health.values["planning_ms"] == "250.0"
    assert health.values["jbar"] == pytest.approx(decision.bound.jbar)
    assert warnings_of(decision, 2.0) == []
    late = dataclasses.replace(decision, bound=dataclasses.replace(decision.bound, deadline_hit=True))
    (warning,) = warnings_of(late, 2.0)
    assert warning.startswith("step 0: the deadline of 2 s ended the search after ")
