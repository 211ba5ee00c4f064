"""How far ArduSub strays from planned legs, and how fast it is, by the points along each leg that it is sent.

ArduSub travels a straight line to each target and restarts its trajectory from rest with each: measured, it then loses
0.66 m at 1 m/s (`auv_lse_mavlink/targets/delivery.py`). Run `python -m benchmarks.navigation.straight_legs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.vocabulary.leg import Leg
from benchmarks.command import end_with, parser_of

Array = NDArray[np.float64]

#: Speed (m/s) at a commanded 1 m/s, and time (s) in which it is reached after a restart.
REACHED_MPS, RISE_S = 0.88, 0.85
#: Time step (s), and distance (m) between the points of a planned path.
STEP_S, EVERY_M = 0.05, 0.25
#: Parts of each leg: one target at its end, or several.
PARTS = (1, 2, 3, 4, 6, 12)


def planned(actions_rad: Sequence[float], config: MotionConfig) -> list[Leg]:
    """Legs of equal length with the given heading changes, one after another."""
    state = np.zeros(3)
    legs = []
    for step, action in enumerate(actions_rad):
        straight_m = config.turn_radius_m * (math.radians(config.theta_max_deg) - abs(action))
        heading, north, east = map(float, state)
        leg = Leg(
            step=step, heading_rad=heading, north_m=north, east_m=east, action_rad=action,
            radius_m=config.turn_radius_m, straight_m=straight_m,
        )  # fmt: skip
        legs.append(leg)
        state = leg.state_at(leg.length_m)
    return legs


def flown(legs: Sequence[Leg], parts: int, acceptance_m: float) -> tuple[Array, float]:
    """Travels legs in straight lines to `parts` points of each.

    Returns:
        The positions (n, 2), north and east (m), and the time (s).
    """
    targets = [leg.state_at(leg.length_m * (k + 1) / parts)[1:] for leg in legs for k in range(parts)]
    position, track, time_s = np.array([legs[0].north_m, legs[0].east_m]), [], 0.0
    for number, target in enumerate(targets):
        since_s = 0.0
        while True:
            to_go = target - position
            far_m = float(np.hypot(*to_go))
            if far_m <= (acceptance_m if number + 1 < len(targets) else 0.1):
                break
            since_s += STEP_S
            speed_mps = REACHED_MPS * (1.0 - math.exp(-((since_s / RISE_S) ** 2)))
            position = position + to_go / far_m * min(speed_mps * STEP_S, far_m)
            track.append(position)
            time_s += STEP_S
    return np.array(track), time_s


def strays_m(legs: Sequence[Leg], track: Array) -> Array:
    """Distance (n,) of each position from the planned path (m)."""
    path = np.array([leg.state_at(along)[1:] for leg in legs for along in np.arange(0.0, leg.length_m, EVERY_M)])
    return np.array([np.hypot(*(path - position).T).min() for position in track[::10]])


def compare(actions_rad: Sequence[float], acceptance_m: float) -> list[tuple[int, float, float, float]]:
    """For each number of parts: speed along the plan (m/s), and 95 % and all of the distances from it (m)."""
    config = MotionConfig()
    legs = planned(actions_rad, config)
    length_m = sum(leg.length_m for leg in legs)
    rows = []
    for parts in PARTS:
        track, time_s = flown(legs, parts, min(acceptance_m, 0.5 * legs[0].length_m / parts))
        strays = strays_m(legs, track)
        rows.append((parts, length_m / time_s, float(np.quantile(strays, 0.95)), float(strays.max())))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a table for random legs, quarter turns to one side, and quarter turns to both sides in turn."""
    parser_of("benchmarks.navigation.straight_legs", __doc__).parse_args(arguments)
    quarter, rng = 0.5 * math.pi, np.random.default_rng(1)
    missions = {
        "random": [math.radians(a) for a in rng.choice(MotionConfig().actions_deg, 40)],
        "one side": [quarter, 0.0] * 20,
        "both sides": [quarter, -quarter] * 20,
    }
    print(
        "| legs | points per leg | speed along the plan (m/s) | 95 % within (m) | farthest (m) |\n|---|---|---|---|---|"
    )
    for name, actions in missions.items():
        for parts, speed_mps, most_m, farthest_m in compare(actions, LinkConfig().acceptance_m):
            print(f"| {name} | {parts} | {speed_mps:.2f} | {most_m:.1f} | {farthest_m:.1f} |")
    return 0


if __name__ == "__main__":
    end_with(main)
