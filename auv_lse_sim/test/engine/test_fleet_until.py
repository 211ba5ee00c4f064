"""Missions that end with the quality of their maps."""

from __future__ import annotations

import math
from typing import Any

import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_comms.packet.codec import decode
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of

EASY: dict[str, Any] = {
    "mission.vehicles": 2,
    "mission.steps": 40,
    "mission.seed": 3,
    "mission.until.undiscovered_m": 5000.0,
    "planner.method": "plain",
    "planner.iterations": 10,
    "gp.map_resolution_m": 20.0,
}


def fleet(**overrides: Any) -> Fleet:
    settings = Settings.load(None, {**EASY, **overrides})
    return Fleet(settings, ground_of(settings))


@pytest.mark.parametrize("loss", [0.5])
def test_all_vehicles_end_early_although_packets_are_lost(loss: float) -> None:
    team = fleet(**{"sim.channel.packet_loss": loss, "auv1.vehicle.at_end": "surface"})
    run = team.run()
    steps = [vehicle.steps for vehicle in run.vehicles]
    assert all(7 < count < 35 for count in steps), steps
    assert all(vehicle.decisions[-1].plan.quality_reached for vehicle in run.vehicles)
    assert not run.vehicles[0].decisions[6].plan.quality_reached, "it is judged after five and seven legs"
    first, second = (next(p.stamp_s for p in run.sent if decode(p.payload).plan.quality_reached and p.source == k)
                     for k in (1, 2))  # fmt: skip
    ended_s = [vehicle.decisions[-1].now_s for vehicle in run.vehicles]
    assert ended_s[0] > second, "it has heard its mate"
    assert ended_s[1] > first
    for _ in range(60):
        team.tick()
    assert [cores.safety.run.status.state for cores in team.cores] == [RunState.ENDED] * 2
    assert team.world.vehicles[1].position[2] == 0.0, "it does what vehicle.at_end says"
    assert team.world.vehicles[2].position[2] > 2.0
    assert any(p.source == 1 and p.stamp_s > run.end_s for p in team.sent), "it goes on announcing"


def test_a_mission_that_ends_early_leads_to_the_recovery_position() -> None:
    recovery = {"vehicle.recovery_north_m": 200.0, "vehicle.recovery_east_m": 150.0}
    team = fleet(**{"mission.vehicles": 1, "vehicle.at_end": "go_to", **recovery})
    (vehicle,) = team.run().vehicles
    assert 7 < vehicle.steps < 12
    before_m = math.dist(team.world.vehicles[1].position[:2], (200.0, 150.0))
    assert before_m > 100.0, "it has not been there before"
    for _ in range(round(before_m / 1.5) + 60):
        team.tick()
    assert team.cores[0].safety.run.status.state is RunState.ENDED
    assert math.dist(team.world.vehicles[1].position[:2], (200.0, 150.0)) < 25.0


def test_a_mate_whose_map_lacks_the_quality_is_waited_for_until_it_is_silent() -> None:
    team = fleet(**{"sim.channel.packet_loss": 1.0, "planner.plan_expiry_s": 200.0})
    run = team.run()
    leg_s = 23.6 / 1.5
    assert all(200.0 / leg_s - 1 < vehicle.steps < 200.0 / leg_s + 4 for vehicle in run.vehicles)


def test_an_unreachable_quality_leaves_the_mission_as_it_is() -> None:
    plain = {"mission.steps": 12, "mission.until.undiscovered_m": 0.1}
    asked, unasked = fleet(**plain).run(), Fleet(*_unasked(plain)).run()
    assert [p.payload for p in asked.sent] == [p.payload for p in unasked.sent]
    assert [v.steps for v in asked.vehicles] == [12, 12]


def _unasked(overrides: dict[str, Any]) -> tuple[Settings, Any]:
    values = {k: v for k, v in {**EASY, **overrides}.items() if ".until." not in k}
    settings = Settings.load(None, values)
    return settings, ground_of(settings)
