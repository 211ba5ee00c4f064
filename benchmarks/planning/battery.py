"""Missions whose battery does not last: with a head current, old cells, and a reading that jumps.

`auv_lse bench battery` compares the leg at which each vehicle turns home with the last one at which it still could.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from auv_lse_common.safety.battery_use import STRETCH_M, BatteryUse
from benchmarks.rows import Row, row

#: Charge that must be left, legs of the way home, and readings per leg.
RESERVE, HOME_LEGS, READINGS = 0.2, 6.0, 16


@dataclass(frozen=True)
class Outcome:
    """Of one mission.

    Attributes:
        legs: Legs travelled before the way home.
        possible: Legs after which it still came home above the reserve.
        planned: Legs planned.
        left: True charge at home.
    """

    legs: int
    possible: int
    planned: int
    left: float


def fly(rng: np.random.Generator) -> Outcome:
    """One mission: what its legs cost is random, depends on a current, and rises as the cells empty."""
    planned = int(rng.integers(40, 160))
    full_legs = planned * rng.uniform(0.7, 1.6)  # what the battery lasts, full, without current
    current, old = rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.4)
    phase, jumps = rng.uniform(0.0, 2.0 * math.pi), rng.random() < 0.5
    use, charge = BatteryUse(RESERVE), rng.uniform(0.85, 1.0)

    def cost(leg: float, charge: float) -> float:
        head = 1.0 + current * math.sin(phase + 2.0 * math.pi * leg / 12.0)  # back and forth
        return (head * (1.0 + old * (1.0 - charge)) + 0.15 * float(rng.standard_normal())) / full_legs

    def at_home(charge: float) -> float:
        worst = (1.0 + current) * (1.0 + old * (1.0 - charge))
        return charge - HOME_LEGS * worst / full_legs

    legs = possible = 0
    turned, left = False, math.nan
    jump, until = 0.0, 0
    for leg in range(planned):
        if jumps and leg >= until:
            is_off = rng.random() < 0.05
            jump, until = (rng.uniform(-0.15, 0.15), leg + int(rng.integers(1, 3))) if is_off else (0.0, leg + 1)
        spent = max(cost(leg, charge), 0.0)
        for part in range(READINGS):
            shown = charge - spent * part / READINGS + jump
            use.take(round(min(max(shown, 0.0), 1.0), 2), leg * STRETCH_M)
        charge -= spent
        if at_home(charge) >= RESERVE:
            possible = leg + 1
        if not turned:
            legs, left = leg + 1, at_home(charge)
            turned = use.must_turn(HOME_LEGS * STRETCH_M)
    return Outcome(legs, possible, planned, left)


def run(smoke: bool = False, missions: int = 300) -> list[Row]:
    """How many of the missions came home below the reserve, or turned too early."""
    outcomes = [fly(np.random.default_rng(seed)) for seed in range(10 if smoke else missions)]
    below = sum(o.left < RESERVE and o.possible > 0 for o in outcomes)
    lost = [1.0 - o.legs / min(o.possible, o.planned) for o in outcomes if o.possible]
    early = sum(share > 0.1 for share in lost)
    short = sum(o.possible < o.planned for o in outcomes)
    return [
        row(f"of {len(outcomes)} missions, battery does not last", short),
        row("came home below the reserve", below, goal="0", holds=below == 0),
        row("turned home more than 10 % early", early, goal="0", holds=early == 0),
        row("legs given away: mean", 100.0 * float(np.mean(lost)), "%"),
        row("legs given away: most", 100.0 * max(lost), "%"),
    ]
