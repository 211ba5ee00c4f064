"""Holds, limits and aborts of a whole team in one process: what the vehicles do, and that the mission goes on."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.mission_run import Command, RunState
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of


def fleet(**overrides: Any) -> Fleet:
    tiny = {"mission.steps": 8, "mission.vehicles": 2, "planner.method": "plain", "planner.iterations": 10}
    settings = Settings.load(None, {**tiny, **overrides})
    return Fleet(settings, ground_of(settings))


def until(team: Fleet, now_s: float) -> None:
    while team.now_s < now_s:
        team.tick()


def test_a_vehicle_holds_and_goes_on_and_no_step_is_lost() -> None:
    team = fleet()
    until(team, 40.0)
    first = team.cores[0]
    steps = len(first.log.decisions)
    position = np.array(first.log.truth[-1][1:3])
    first.safety.run.command(Command.HOLD, "test")
    until(team, 240.0)
    assert len(first.log.decisions) == steps, "nothing is decided"
    assert np.hypot(*(np.array(first.log.truth)[40:, 1:3] - position).T).max() < 45.0, "it stays"
    assert len(team.cores[1].log.decisions) == 8, "its mate goes on"
    first.safety.run.command(Command.GO, "test")
    run = team.run()
    assert [d.step for d in run.vehicles[0].decisions] == list(range(8))
    assert run.end_s > 300.0


def test_a_mission_on_call_does_not_start_by_itself() -> None:
    team = fleet(**{"vehicle.start": "on_call"})
    until(team, 100.0)
    assert [len(cores.log.decisions) for cores in team.cores] == [0, 0]
    for cores in team.cores:
        cores.safety.run.command(Command.GO, "test")
    assert [v.steps for v in team.run().vehicles] == [8, 8]


def test_a_limit_that_trips_brings_the_vehicle_to_the_surface() -> None:
    team = fleet(**{"safety.max_depth_m": 2.0, "safety.patience_s": 5.0})
    until(team, 20.0)
    status = team.cores[0].safety.run.status
    assert status.state is RunState.HOLDING
    assert "deeper than 2.0 m" in status.limits[0]
    until(team, 60.0)
    assert all(vehicle.position[2] == 0.0 for vehicle in team.world.vehicles.values())


def test_an_abort_is_heard_through_the_water_and_ends_the_mission() -> None:
    team = fleet(**{"packet.abort_without_tag": True, "mission.steps": 60})
    until(team, 60.0)
    team.cores[0].safety.run.command(Command.ABORT, "test", team=True)
    run = team.run()
    assert run.end_s < 200.0
    states = [cores.safety.run.status for cores in team.cores]
    assert [status.state for status in states] == [RunState.ABORTED] * 2
    assert states[1].reason == "ABORT by vehicle 1, by acoustic packet"
    deaf = fleet(**{"mission.steps": 12})
    until(deaf, 60.0)
    deaf.cores[0].safety.run.command(Command.ABORT, "test", team=True)
    deaf.run()
    assert deaf.cores[1].planner.finished, "without a tag nobody is believed"
    assert deaf.cores[1].bridge.counts["aborts_refused.1"] > 0


def test_mates_do_not_count_on_the_plan_of_an_aborted_vehicle() -> None:
    team = fleet(**{"mission.steps": 60, "planner.method": "tour"})
    mates, run = team.cores[1].planner.team, team.cores[0].safety.run
    until(team, 60.0)
    assert len(mates.locations_ahead(60.0, 1)) > 0
    run.command(Command.ABORT, "test")
    until(team, 120.0)
    assert len(mates.locations_ahead(120.0, 1)) == 0, "its legs are left to the others"
    run.command(Command.RESET, "test")
    run.command(Command.GO, "test")
    until(team, 200.0)
    assert run.status.state is RunState.RUNNING
    assert len(mates.locations_ahead(200.0, 1)) > 0


def test_a_vehicle_that_is_aborted_before_its_first_decision_leaves_its_ground_to_its_mates() -> None:
    team = fleet(**{"mission.steps": 60, "planner.method": "tour", "auv1.vehicle.start_delay_s": 300.0})
    mates = team.cores[1].planner.team
    until(team, 60.0)
    assert sum(len(locations) for _, locations in mates.in_time_order(60.0)) > 0, "a plan is assumed until one is heard"
    team.cores[0].safety.run.command(Command.ABORT, "test")
    until(team, 120.0)
    assert sum(len(locations) for _, locations in mates.in_time_order(120.0)) == 0


def test_after_a_team_abort_one_reset_is_enough_while_the_mates_still_call() -> None:
    team = fleet(**{"packet.abort_without_tag": True, "mission.steps": 60})
    until(team, 60.0)
    first, second = (cores.safety.run for cores in team.cores)
    first.command(Command.ABORT, "test", team=True)
    until(team, 120.0)
    assert second.status.state is RunState.ABORTED
    first.command(Command.RESET, "test")
    first.command(Command.GO, "test")
    until(team, 200.0)
    assert first.status.state is RunState.RUNNING, "its mate calls until it is reset itself"
    assert second.status.team_abort
    second.command(Command.RESET, "test")
    until(team, 240.0)
    second.command(Command.ABORT, "test", team=True)
    until(team, 300.0)
    assert first.status.state is RunState.ABORTED, "a new call is obeyed"


def test_at_the_end_a_vehicle_comes_up_if_it_is_told_to() -> None:
    team = fleet(**{"auv1.vehicle.at_end": "surface", "mission.steps": 4})
    team.run()
    until(team, team.now_s + 60.0)
    assert team.world.vehicles[1].position[2] == 0.0
    assert team.world.vehicles[2].position[2] > 2.0
