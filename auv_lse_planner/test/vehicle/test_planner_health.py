"""What planner_node's diagnostics and log say."""

import dataclasses
import math

import numpy as np
import pytest
from planner_helpers import settings

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.vocabulary.health import Level, NewProblems
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_planner.safety import Safety
from auv_lse_planner.vehicle.health import planner_health, warnings_of
from auv_lse_planner.vehicle.intake import PlannerIntake
from auv_lse_planner.vehicle.problems import of_state
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner


def planner(vehicle=1, vehicles=1):
    of_planner = {"method": "plain", "plan_expiry_s": 60.0}
    return VehiclePlanner(vehicle, settings(of_planner, vehicles=vehicles, steps=4), np.random.default_rng(1))


def test_each_silent_mate_is_logged_once():
    own = planner(vehicle=3, vehicles=3)
    own.odometry(0.0, 0.0, 0.0, 0.0)
    own.decide(0.0)  # its leg takes longer than the silence that is reported
    new = NewProblems()
    first = new.of(own.problems(5.0))
    assert [text for text in first if "vehicle 1" in text]
    assert [text for text in first if "vehicle 2" in text], "one mate's problem hides no other's"
    assert new.of(own.problems(6.0)) == []


def test_health_contains_the_last_decision_and_the_problems():
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
    assert health.values["jbar"] == pytest.approx(decision.bound.expected_end)
    assert warnings_of(decision, 2.0) == []
    late = dataclasses.replace(decision, bound=dataclasses.replace(decision.bound, deadline_hit=True))
    (warning,) = warnings_of(late, 2.0)
    assert warning.startswith("step 0: the deadline of 2 s ended the search after ")


def test_a_mission_that_holds_is_reported_in_one_phrase():
    own = planner()
    intake = PlannerIntake(own)
    intake.set_run_status(RunStatus(state=RunState.HOLDING, stop=None, reason="HOLD by an operator"))
    intake.take(1.0)
    assert own.problems(1.0)["held"] == "not planning: the mission is HOLDING: HOLD by an operator"


def test_end_is_reported_until_the_missions_state_confirms_it():
    own = planner()
    intake = PlannerIntake(own)
    assert not intake.end_unreported, "the last leg is not travelled"
    own._travel.finished = True
    assert intake.end_unreported
    for state, news in ((RunState.RUNNING, True), (RunState.HOLDING, False), (RunState.ENDED, False)):
        intake.set_run_status(RunStatus(state=state, stop=None))
        intake.take(1.0)
        assert intake.end_unreported is news, state


def test_odometry_jump_is_reported_only_while_recent():
    own = planner()
    own.odometry(1.0, 0.0, 10.0, 10.0)
    own.odometry(2.0, 0.0, 900.0, 10.0)
    own.odometry(3.0, math.nan, 10.0, 10.0)
    found = own.problems(3.0)
    assert found["odometry jumps"].startswith("odometry: 1 (of 1) positions rejected")
    assert found["odometry impossible"].startswith("odometry: 1 (of 1) messages ignored")
    own.odometry(4.0, math.nan, 10.0, 10.0)
    assert own.problems(100.0)["odometry impossible"].startswith("odometry: 2 (of 2)")
    later = own.problems(300.0)
    assert "odometry jumps" not in later
    assert "odometry impossible" not in later


def test_silent_safety_node_is_a_problem():
    assert of_state(3.0) == {}
    assert "mission/state: last one 20 s ago" in of_state(20.0)["state old"]


@pytest.mark.parametrize("key", ["vehicle.at_end", "safety.abort"])
def test_recovery_position_beyond_the_fence_is_rejected(key):
    section, name = key.split(".")
    parameters = {
        "area": {"polygon_m": [0.0, 0.0, 300.0, 0.0, 300.0, 300.0, 0.0, 300.0]},
        "vehicle": {"recovery_north_m": -140.0, "recovery_east_m": 150.0},
    }
    parameters.setdefault(section, {})[name] = "go_to"
    assert Safety.of(parameters, "m.yaml", 1)
    parameters["vehicle"]["recovery_north_m"] = -160.0
    with pytest.raises(ParameterError, match=rf"recovery_east_m = -160, 150 m, the target of {key}, is 160 m outside"):
        Safety.of(parameters, "m.yaml", 1)
