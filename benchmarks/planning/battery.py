"""Missions whose battery does not last: with a current, cells that age, and a reading that jumps.

`auv_lse bench battery` compares where each vehicle turns home with the last position from which it still could.
"""

import math
from dataclasses import dataclass

import numpy as np

from auv_lse_common.safety.battery_use import BatteryUse
from auv_lse_common.support.arrays import Array
from benchmarks.rows import Row, row

#: Charge that must be left, length of a leg (m), its parts, and readings of each.
RESERVE, LEG_M, PARTS, READINGS = 0.2, 25.0, 10, 2
#: Side of the square area (m), and how far (m) outside a recovery position may be.
SIDE_M, OUTSIDE_M = 250.0, 100.0
#: Standard deviation of a leg's cost, and of the logarithm of the way that a full battery is stated to last.
SCATTER, STATED_STD = 0.15, 0.1
#: A mission of which the stated way covers less than this share is refused GO.
LEAST_SHARE = 0.5


@dataclass(frozen=True)
class Outcome:
    """Outcome of one mission.

    Attributes:
        left: Charge at the recovery position.
        early: Share of the legs that the charge brought home above the reserve would have lasted for.
        is_short: Whether the battery lasts for less than the planned legs.
        begins: Whether GO is accepted, by the way that a full battery is stated to last.
        possible: Whether the vehicle could come home above the reserve from its start.
    """

    left: float
    early: float
    is_short: bool
    begins: bool
    possible: bool


class Dive:
    """One vehicle, its battery, its path and the water.

    Attributes:
        planned: Number of legs.
        full_legs: Legs that a full battery lasts, without current.
        charge: Charge at the start.
        headings_rad: Heading of each leg, shape (planned,).
        start_m: Position of the start, shape (2,).
        home_m: The recovery position, shape (2,).
        scatter: Factor on the cost of each leg, shape (planned,).
        jumps: Error of the sensor's reading on each leg, shape (planned,).
        stated_m: Stated distance on a full battery.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.planned = int(rng.integers(40, 160))
        self.full_legs = self.planned * rng.uniform(0.7, 1.6)
        self.charge = rng.uniform(0.85, 1.0)
        self._keeps_ground_speed = bool(rng.random() < 0.5)
        self._current = rng.uniform(0.0, 0.2 if self._keeps_ground_speed else 0.3)  # of the vehicle's speed
        self._set_rad = rng.uniform(0.0, 2.0 * math.pi)
        self._turn_rad = rng.uniform(-1.0, 1.0) * math.radians(60.0) / self.planned  # of the current, per leg
        self._old = rng.uniform(0.0, 0.4)
        self.start_m = np.full(2, 75.0)
        self.home_m = rng.uniform(-OUTSIDE_M, SIDE_M, 2)
        self.headings_rad = self._lanes(rng) if rng.random() < 0.5 else self._wandering(rng)
        self.scatter = np.maximum(1.0 + SCATTER * rng.standard_normal(self.planned), 0.0)
        self.jumps = self._jumps(rng) if rng.random() < 0.5 else np.zeros(self.planned)
        self.stated_m = self.full_legs * LEG_M * math.exp(STATED_STD * rng.standard_normal())

    def _lanes(self, rng: np.random.Generator) -> Array:
        """Parallel lanes, back and forth over the same strip."""
        along_rad, length = rng.uniform(0.0, 2.0 * math.pi), int(rng.integers(4, 13))
        headings: list[float] = []
        for lane in range(self.planned):
            side = 1.0 if lane // 8 % 2 == 0 else -1.0
            headings += [along_rad + math.pi * (lane % 2)] * length + [along_rad + side * math.pi / 2.0]
        return np.array(headings[: self.planned])

    def _wandering(self, rng: np.random.Generator) -> Array:
        """Legs with the default turns inside the area."""
        at, heading, headings = self.start_m, rng.uniform(0.0, 2.0 * math.pi), []
        for _ in range(self.planned):
            turns = np.radians(rng.choice([-90.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 90.0], 20))
            inwards = math.atan2(SIDE_M / 2.0 - at[1], SIDE_M / 2.0 - at[0])
            ends = ((turned, at + LEG_M * direction(turned)) for turned in (*(heading + turns), inwards))
            heading, at = next((t, p) for t, p in ends if (p.min() >= 0.0 and p.max() <= SIDE_M) or t == inwards)
            headings.append(heading)
        return np.array(headings)

    def _jumps(self, rng: np.random.Generator) -> Array:
        jumps, leg = np.zeros(self.planned), 0
        while leg < self.planned:
            length = int(rng.integers(1, 3)) if rng.random() < 0.05 else 0
            jumps[leg : leg + length] = rng.uniform(-0.15, 0.15)
            leg += max(length, 1)
        return jumps

    def cost(self, heading_rad: float, leg: float, charge: float) -> float:
        """Average cost of a leg, as a share of the full charge."""
        off_rad = heading_rad - self._set_rad - self._turn_rad * leg
        fair, across = self._current * math.cos(off_rad), self._current * math.sin(off_rad)
        if self._keeps_ground_speed:  # the thrusters take the cube of the speed through the water
            share = 0.4 + 0.6 * math.hypot(1.0 - fair, across) ** 3
        else:  # the same power for longer
            share = 1.0 / (math.sqrt(1.0 - across**2) + fair)
        return share * (1.0 + self._old * (1.0 - charge)) / self.full_legs

    def way_home(self, at_m: Array, leg: float, charge: float) -> float:
        """Average cost of the way home."""
        way_m = self.home_m - at_m
        legs, heading_rad, left = float(np.hypot(*way_m)) / LEG_M, math.atan2(way_m[1], way_m[0]), charge
        for part in range(8):
            left -= legs / 8.0 * self.cost(heading_rad, leg + legs * part / 8.0, left)
        return charge - left


def direction(heading_rad: float) -> Array:
    """Unit vector (2,): north, east."""
    return np.array([math.cos(heading_rad), math.sin(heading_rad)])


def fly(rng: np.random.Generator, is_stated: bool, digits: int) -> Outcome:
    """One mission; the way home scatters as the legs do.

    Args:
        rng: Draws it.
        is_stated: Whether the way that a full battery lasts is stated.
        digits: Of the readings: 2 for whole percent.
    """
    dive = Dive(rng)
    use = BatteryUse(RESERVE, dive.stated_m if is_stated else None)
    at_m, charge, begun = dive.start_m, dive.charge, dive.charge
    possible = begun - dive.way_home(at_m, 0.0, begun) >= RESERVE
    is_short = turned = False
    for leg in range(dive.planned):
        for part in range(PARTS):
            shown = round(min(max(charge + dive.jumps[leg], 0.0), 1.0), digits)
            for reading in range(READINGS):
                along = leg + (part + reading / READINGS) / PARTS
                use.take(along * LEG_M, shown, along * LEG_M, *at_m)
            charge -= dive.cost(dive.headings_rad[leg], leg, charge) * dive.scatter[leg] / PARTS
            at_m = at_m + direction(dive.headings_rad[leg]) * LEG_M / PARTS
            is_short = is_short or charge - dive.way_home(at_m, leg, charge) < RESERVE
            turned = use.must_turn(tuple(dive.home_m - at_m))
            if turned:
                break
        if turned:
            break
    legs = float(np.hypot(*(dive.home_m - at_m))) / LEG_M
    left = charge - dive.way_home(at_m, leg, charge) * (
        1.0 + SCATTER * float(rng.standard_normal()) / math.sqrt(max(legs, 1.0))
    )
    surplus = max(left - RESERVE, 0.0)
    lasts = dive.stated_m / LEG_M * (begun - RESERVE)
    return Outcome(
        left=left,
        early=surplus / (surplus + begun - charge) if turned else 0.0,
        is_short=is_short or turned,
        begins=not is_stated or lasts >= LEAST_SHARE * dive.planned,
        possible=possible,
    )


def run(smoke: bool = False, missions: int = 300) -> list[Row]:
    """How many of the missions came home below the reserve, or turned too early."""
    rows = []
    for name, is_stated, digits in (("percent", True, 2), ("energy", True, 4), ("first dive", False, 2)):
        flown = [fly(np.random.default_rng(seed), is_stated, digits) for seed in range(10 if smoke else missions)]
        begun = [outcome for outcome in flown if outcome.possible and outcome.begins]
        below = sum(outcome.left < RESERVE for outcome in begun)
        early = [outcome.early for outcome in begun]
        rows += [
            row(f"{name}: of {len(flown)} missions, GO refused or no way home", len(flown) - len(begun)),
            row(f"{name}: battery does not last", sum(outcome.is_short for outcome in begun)),
            row(f"{name}: came home below the reserve", below, goal="0", holds=below == 0),
            row(f"{name}: least charge at home", 100.0 * min(outcome.left for outcome in begun), "%"),
            row(
                f"{name}: turned home more than 10 % early",
                sum(share > 0.1 for share in early),
                goal="0",
                holds=max(early) <= 0.1,
            ),
            row(f"{name}: legs lost: mean", 100.0 * float(np.mean(early)), "%"),
            row(f"{name}: legs lost: most", 100.0 * max(early), "%"),
        ]
    return rows
