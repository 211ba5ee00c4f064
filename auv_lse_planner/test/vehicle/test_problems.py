"""Each problem: when it is there, its key, and its words."""

import numpy as np
from planner_helpers import settings

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.vehicle import problems
from auv_lse_planner.vehicle.travel import EstimatedState, Travel
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

PLANNER = PlannerConfig(method="augmented", odometry_timeout_s=10.0, map_timeout_s=60.0, plan_expiry_s=600.0)


def _travel(odometry_s=None):
    travel = Travel(VehicleConfig(speed_mps=1.5), 3)
    if odometry_s is not None:
        travel.move(EstimatedState(odometry_s, 0.0, 0.0, 0.0))
    return travel


def test_missing_or_old_odometry():
    assert problems.of_odometry(5.0, _travel(), PLANNER, started=False) == {}
    assert problems.of_odometry(5.0, _travel(), PLANNER, started=True) == {
        "odometry missing": "odometry: none received; no planning without it"
    }
    assert problems.of_odometry(12.0, _travel(2.0), PLANNER, started=True) == {}
    assert problems.of_odometry(12.5, _travel(2.0), PLANNER, started=True) == {
        "odometry old": "odometry: last 10.5 s ago, more than planner.odometry_timeout_s = 10 s; planning has stopped"
    }


def test_location_outside_the_area():
    area = {"polygon_m": [0.0, 0.0, 300.0, 0.0, 300.0, 300.0, 0.0, 300.0], "margin_m": 10.0}
    planner = VehiclePlanner(1, settings(area=area), np.random.default_rng(0))

    def text(north_m, east_m):
        planner.odometry(0.0, 0.0, north_m, east_m)
        return planner.problems(0.0).get("outside", "")

    assert text(150.0, 0.5) == "", "in the margin, but in the area"
    assert text(150.0, -4.0) == "position: 4.0 m outside the area: returning"
    planner.set_map_offset(0.0, 6.0)
    assert text(150.0, -4.0) == "", "its corrected position is in the area"
    planner.set_map_offset(0.0, -6.0)
    assert text(150.0, 4.0) == "position: 2.0 m outside the area: returning"


def test_rejected_or_old_map():
    assert problems.of_map(100.0, None, "", PLANNER) == {}
    assert problems.of_map(100.0, 40.0, "", PLANNER) == {}
    assert problems.of_map(101.0, 40.0, "map: no", PLANNER) == {
        "map refused": "map: no",
        "map old": "map: last 61 s ago; planning continues with it",
    }


def test_missing_or_expired_plans_of_preceding_mates():
    def follow(plan):
        return PlannedPath(plan.step, np.zeros((1, 3)), np.zeros(0, np.int64), 0, np.zeros((0, 1, 2)))

    team = Team(3, 4, 20.0, 600.0, follow)
    team.receive_plan(100.0, 2, Plan(step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, actions=(), naive_path=NONE))
    missing = {"plan of 1 missing": "team: no plan received from vehicle 1 yet; planning without it"}
    assert problems.of_team(249.0, team, PLANNER, 149.0) == {}, "no slot of vehicle 1 may have come yet"
    assert problems.of_team(249.0, team, PLANNER, 150.0) == missing  # vehicle 4 comes after this one
    assert "no plan from vehicle 2 for 150 s" in problems.of_team(250.0, team, PLANNER, 250.0)["2 silent"]
    assert problems.of_team(700.0, team, PLANNER, 700.0) == {
        **missing,
        "plan of 2 expired": "team: plan of vehicle 2 expired, received 600 s ago",
    }


def test_overdue_leg():
    travel = _travel(0.0)
    assert problems.of_leg(1e6, travel) == {}, "no leg yet"
    leg = Leg(step=2, heading_rad=0.0, north_m=0.0, east_m=0.0, action_rad=0.0, radius_m=15.0, straight_m=30.0)
    travel.take(leg, 0.0, at_once=True)  # 30 m at 1.5 m/s: overdue after 4 x 20 s + 10 s
    assert problems.of_leg(90.0, travel) == {}
    assert problems.of_leg(95.0, travel) == {"leg overdue": "leg 2: not finished 95 s after its start"}
    travel.move(EstimatedState(96.0, 0.0, 31.0, 0.0))
    assert travel.finished
    assert problems.of_leg(97.0, travel) == {}
