"""A small mission with known ground, made without the simulator: what the tests of evaluation and reports judge."""

import copy
import math

import numpy as np

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.topics.records import Transmission
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_record.run_data import DecisionRecord, PacketReceived, RunData, VehicleRun
from auv_lse_shore.judge.evaluation import ground_grid
from auv_lse_shore.judge.team_map import mission_settings

STRAIGHT, RIGHT, LEFT = 5, 10, 0  # actions 0, +90, -90 degrees


class Valley:
    """Depth 15 m along a wavy line, 4 m deeper every 60 m north of it."""

    def depth_m(self, north_m, east_m):
        return 15.0 + (np.asarray(north_m) - 120.0 - 30.0 * np.sin(np.asarray(east_m) / 50.0)) / 15.0


PARAMETERS = {
    "/**": {
        "mission": {"steps": 30, "seed": 7, "vehicles": 2},
        "level_set": {"level_m": 15.0},
        "area": {"polygon_m": [0.0, 0.0, 240.0, 0.0, 240.0, 300.0, 0.0, 300.0], "margin_m": 5.0},
        "gp": {"length_scale_m": 60.0, "noise_std_m": 0.2, "map_resolution_m": 6.0},
        "planner": {"method": "augmented"},
        "sim": {"tick_s": 1.0},
    },
    "/auv2/**": {"vehicle": {"depth_m": 4.0}},
}


def lanes(turn_first, steps):
    """Actions of lanes six legs long, two 90 degree turns between them."""
    actions = []
    while len(actions) < steps:
        actions += [STRAIGHT] * 6 + [turn_first] * 2 + [STRAIGHT] * 6 + [RIGHT + LEFT - turn_first] * 2
    return actions[:steps]


def drive(vehicle, state, steps, drift_mps, rng):
    """One vehicle along lanes at 1.5 m/s: its track, drifting odometry, soundings and decisions."""
    table, ground = MotionTable(MotionConfig()), Valley()
    speed, truth, soundings, decisions = 1.5, [], [], []
    leg_s = table.leg_length_m / speed
    for step, action in enumerate(lanes(RIGHT if vehicle == 1 else LEFT, steps)):
        start_s = step * leg_s
        decisions.append(
            DecisionRecord(
                now_s=max(start_s - 4.0, 0.0),
                step=step,
                plan=Plan.at(step, state, tuple([action, STRAIGHT, STRAIGHT][: steps - step]), 0xF0),
                jbar=100.0 - step,
                reward_so_far=float(step),
                lower_bound=100.0,
                lower_bound_max=100.0,
                wall_s=0.01,
                method="augmented",
            )
        )
        track = table.tracks_m[action]
        c, s = math.cos(state[0]), math.sin(state[0])
        for i, (ahead, starboard) in enumerate(track[:-1]):
            t = start_s + leg_s * i / (len(track) - 1)
            heading = state[0] + table.turns_rad[action] * min(1.0, i * table.spacing_m / (15.0 * math.pi / 2.0))
            truth.append((t, state[1] + c * ahead - s * starboard, state[2] + s * ahead + c * starboard, heading))
        state = table.end_state(state, action)
    truth.append((steps * leg_s, state[1], state[2], state[0]))
    truth = np.array(truth)
    odometry = truth.copy()
    odometry[:, 1] += drift_mps * truth[:, 0]
    for row, estimate in zip(truth[1:], odometry[1:], strict=True):
        depth = ground.depth_m(row[1], row[2]) + 0.05 * rng.standard_normal()
        soundings.append((row[0], estimate[1], estimate[2], float(depth)))
    position_std = abs(drift_mps) * truth[:, :1] * np.array([[1.0, 0.5]])  # north, east
    return VehicleRun(
        vehicle=vehicle,
        truth=truth,
        odometry=odometry,
        soundings=Soundings.from_rows(soundings),
        decisions=decisions,
        position_std_m=position_std,
    )


def make_run(steps=30, drift_mps=0.002, with_truth=True):
    """Two vehicles, from west and east; every 30 s one packet with every tenth sounding, every third one lost."""
    rng = np.random.default_rng(3)
    parameters = copy.deepcopy(PARAMETERS)
    parameters["/**"]["mission"]["steps"] = steps
    vehicles = [
        drive(1, np.array([0.0, 40.0, 30.0]), steps, drift_mps, rng),
        drive(2, np.array([0.0, 40.0, 270.0]), steps, -drift_mps, rng),
    ]
    end_s = float(vehicles[0].truth[-1, 0])
    sent, received = [], []
    heard = {1: [], 2: []}
    for number, stamp in enumerate(np.arange(5.0, end_s, 15.0)):
        source, receiver = (1, 2) if number % 2 == 0 else (2, 1)
        payload = bytes([number % 256]) * 252
        sent.append(Transmission(stamp_s=float(stamp), source=source, payload=payload))
        if number % 3 == 2:
            continue
        arrival = float(stamp) + 5.25
        received.append(PacketReceived(stamp_s=arrival, receiver=receiver, source=source, snr_db=17.5, payload=payload))
        own = vehicles[source - 1].soundings
        chosen = own[(own.stamp_s > stamp - 30.0) & (own.stamp_s <= stamp)][::10]
        heard[receiver].append(Soundings.of_packet(arrival, source, np.float32(chosen.points_m)))
    for vehicle in vehicles:
        vehicle.received = Soundings.join(heard[vehicle.vehicle])
    run = RunData(parameters=parameters, vehicles=vehicles, sent=sent, received=received, end_s=end_s, wall_s=1.5)
    if with_truth:
        run.ground = ground_grid(mission_settings(parameters, 1)[0], Valley())
    return run
