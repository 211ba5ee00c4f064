"""A receiver rebuilds the sender's whole remaining path from a packet's bytes alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.naive_ids import FITTED, IDS, id_in_packet, id_in_plan
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_comms.packet.codec import Packet, decode, encode
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

MISSION_STEPS = 100
POLYGON = (-50.0, -50.0, 550.0, -50.0, 600.0, 650.0, -50.0, 600.0)
NO_GO = {"island": (200.0, 200.0, 280.0, 200.0, 280.0, 290.0, 200.0, 290.0)}
ACTION_SETS = {
    "paper": MotionConfig(),
    "growing straights": MotionConfig(straight="growing"),
    "three": MotionConfig(actions_deg=(-45.0, 0.0, 45.0)),
    "uneven": MotionConfig(actions_deg=(-80.0, -33.3, 0.0, 7.7, 61.1), turn_radius_m=11.0),
    "many": MotionConfig(actions_deg=tuple(float(a) for a in range(-90, 91, 4))),
}


def through_packet(plan: Plan, samples: Array) -> Plan:
    """The plan as a receiver has it: from the bytes and the source address alone."""
    sender = 1 + FITTED.index(plan.naive_path) if plan.naive_path in FITTED else 1
    data = encode(Packet(replace(plan, naive_path=id_in_packet(plan.naive_path)), samples))
    assert len(data) == 252
    heard = decode(data).plan
    return replace(heard, naive_path=id_in_plan(heard.naive_path, sender))


class Boat:
    """One end's own copies of everything a path is made from."""

    def __init__(self, motion: MotionConfig) -> None:
        self.area = OperatingArea(AreaConfig(polygon_m=POLYGON, no_go=NO_GO))
        self.motion = MotionTable(motion)
        self.space = FreeSpace(self.area, self.motion)
        self.naive = NaivePaths(self.space, PlannerConfig(), self.area.polygon, 3)
        self.rollout = Rollout(self.motion, self.naive, MISSION_STEPS, 1)


@pytest.mark.parametrize("kind", ACTION_SETS)
def test_the_rebuilt_path_is_the_senders(kind: str) -> None:
    """For every naive path and none, with and without a tour, from the first step to the last: to the last bit."""
    sender, receiver = Boat(ACTION_SETS[kind]), Boat(ACTION_SETS[kind])
    rng = np.random.default_rng(len(kind))
    compared = 0
    for naive_path in (*IDS, NONE):
        for step in (0, 1, 2, 50, 96, 97, 98, 99, 100):
            state = np.array([rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 500.0), rng.uniform(0.0, 550.0)])
            count = int(rng.choice([0, 1, 3, 10]))
            actions = tuple(rng.integers(0, sender.motion.actions, count).tolist())
            bearings = tuple(rng.integers(0, 256, int(rng.choice([0, 0, 1, 5, 50]))).tolist())
            plan = Plan(
                step=step,
                heading_rad=state[0],
                north_m=state[1],
                east_m=state[2],
                actions=actions,
                naive_path=naive_path,
                tour=Tour(segment_legs=int(rng.integers(1, 4)), bearings=bearings) if bearings else None,
            )
            sent = sender.rollout.follow(plan).states
            got = through_packet(plan, rng.uniform(0.0, 50.0, (5, 3)))
            assert got == plan
            rebuilt = receiver.rollout.follow(got).states
            assert rebuilt.shape == sent.shape
            if naive_path != NONE:
                assert len(rebuilt) == MISSION_STEPS - step + 1
            np.testing.assert_array_equal(rebuilt, sent)
            # and what the rounding to float32 does to the part of the path that the actions say: less than 1 mm
            exact = sender.motion.roll(state, actions[: MISSION_STEPS - step])
            np.testing.assert_allclose(rebuilt[: len(exact), 1:], exact[:, 1:], atol=1e-3)
            compared += len(sent)
    assert compared > 3000


@pytest.mark.parametrize("method", ["augmented", "plain", "lawnmower", "tour"])
def test_at_every_step_of_a_mission_team_mates_know_the_path_that_is_travelled(method: str) -> None:
    settings = PlannerSettings.from_parameters(
        {
            "area": {"polygon_m": list(POLYGON)},
            "mission": {"vehicles": 2, "steps": 30},
            "planner": {"method": method, "iterations": 30},
        },
        "test",
    )
    sender = VehiclePlanner(1, settings, np.random.default_rng(1))
    receiver = VehiclePlanner(2, settings, np.random.default_rng(2))
    state = np.zeros(3)
    for step in range(30):
        sender.odometry(20.0 * step, state[0], state[1], state[2])
        decision = sender.decide(20.0 * step)
        travelled = sender.path
        assert travelled is not None
        got = through_packet(decision.plan, np.zeros((0, 3)))
        assert got == decision.plan
        rebuilt = receiver.rollout.follow(got)
        gone = step + 1 - got.step
        np.testing.assert_array_equal(rebuilt.states[gone:], travelled.states)
        np.testing.assert_array_equal(rebuilt.actions[gone:], travelled.actions)
        assert decision.plan.naive_path == NONE or len(rebuilt) == 30 - decision.plan.step
        state = decision.leg.end_state
