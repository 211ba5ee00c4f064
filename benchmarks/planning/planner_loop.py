"""A light mission loop for measuring planners: true ground, perfect tracking, packets that get lost; no navigation.

The full engine is `auv_lse_sim.engine.fleet`; this one leaves out what does not concern the choice of paths
(instruments, modem, currents), so that hundreds of missions can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import OnlineGp
from auv_lse_gp.map.quality_watch import QualityWatch
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_shore.judge.isobath import compare, trace

Array = NDArray[np.float64]

SLOT_S = 10
SAMPLES_PER_PACKET = 18


@dataclass(slots=True)
class _Boat:
    planner: VehiclePlanner
    gp: OnlineGp
    heading: float
    north: float
    east: float
    leg: Any = None
    queue: list[Any] = field(default_factory=list)
    plan: Any = None
    soundings: list[tuple[float, float, float, float]] = field(default_factory=list)
    unsent: list[tuple[float, float, float]] = field(default_factory=list)
    visited: list[tuple[float, float]] = field(default_factory=list)
    watch: QualityWatch | None = None

    def judge(self, now_s: float) -> None:
        """Judges the map for `mission.until`, if that is due."""
        if self.watch is not None and self.watch.begin_if_due(now_s, self.gp):
            while self.watch.is_judging:
                quality = self.watch.advance(now_s)
                if quality is not None:
                    self.planner.set_quality(now_s, quality)


@dataclass(slots=True, kw_only=True)
class Outcome:
    """The results of a mission; risks, and the true loss at the end, are means over a 5 m grid of the area."""

    risk_third: float
    risk_end: float
    true_loss: float
    f1: float
    isobath_m: float
    boats: list[Any]


def settings_for(
    method: str,
    vehicles: int,
    area: dict[str, Any] | None = None,
    planner: dict[str, Any] | None = None,
    **sections: Any,
) -> PlannerSettings:
    """Mission settings of a method. No vehicle surfaces: locations are exact, and all methods have equally many
    legs."""
    return PlannerSettings.from_parameters(
        {
            "area": area or {},
            "vehicle": {"surfacings": 0, **sections.pop("vehicle", {})},
            "mission": {"vehicles": vehicles, **sections.pop("mission", {})},
            "planner": {"method": method, **(planner or {})},
            **sections,
        },
        "benchmark",
    )


def light_mission(
    settings: PlannerSettings, ground: Any, seed: int, loss: float = 0.0, sounding_std_m: float = 0.2
) -> Outcome:
    """Flies one mission; all random draws derive from `seed`.

    Args:
        settings: Of all vehicles.
        ground: The ground.
        seed: Seed of all random draws.
        loss: Share of packets lost.
        sounding_std_m: Noise of a sounding.
    """
    vehicles = settings.mission.vehicles
    noise, channel = stream(seed, "soundings"), stream(seed, "channel")
    v, area = settings.vehicle, OperatingArea(settings.area)
    boats = [
        _Boat(
            VehiclePlanner(k, settings, stream(seed, "planner", k)),
            OnlineGp(settings.gp),
            v.start_heading_rad,
            v.start_north_m,
            v.start_east_m,
            watch=QualityWatch.of(settings.gp, settings.level_set, area, settings.mission.until),
        )
        for k in range(1, vehicles + 1)
    ]
    now = 0
    for boat in boats:
        boat.planner.odometry(0.0, boat.heading, boat.north, boat.east)
    limit = int(3.0 * settings.mission.steps * boats[0].planner.motion.leg_length_m / v.speed_mps) + 100
    while not all(b.planner.finished for b in boats) and now < limit:
        for boat in boats:
            if boat.leg is None:  # at the start until then
                boat.planner.odometry(float(now), boat.heading, boat.north, boat.east)
            if boat.planner.due(float(now)):
                boat.planner.set_centers(boat.gp.centers, float(now))
                decision = boat.planner.decide(float(now))
                boat.plan = decision.plan
                if boat.leg is None:
                    boat.leg = decision.leg
                else:
                    boat.queue.append(decision.leg)
        if now % SLOT_S == 0:
            _send(boats, (now // SLOT_S) % vehicles, float(now), loss, channel)
        now += 1
        for boat in boats:
            if boat.leg is None or boat.planner.finished:
                continue
            along = boat.leg.progress_m(boat.north, boat.east) + v.speed_mps
            if along > boat.leg.length_m and boat.queue:
                end = boat.leg.end_state
                boat.visited.append((float(end[1]), float(end[2])))
                along -= boat.leg.length_m
                boat.leg = boat.queue.pop(0)
            boat.heading, boat.north, boat.east = (float(x) for x in boat.leg.state_at(along))
            if now % 2 == 0:
                depth = float(ground.depth_m(boat.north, boat.east))
                if np.isfinite(depth):
                    depth = max(depth + sounding_std_m * float(noise.normal()), 0.1)
                    boat.gp.add(boat.north, boat.east, depth)
                    boat.soundings.append((float(now), boat.north, boat.east, depth))
                    boat.unsent.append((boat.north, boat.east, depth))
            boat.planner.odometry(float(now), boat.heading, boat.north, boat.east)
            boat.judge(float(now))
    return _evaluate(settings, ground, boats)


def _send(boats: list[_Boat], index: int, now_s: float, loss: float, channel: np.random.Generator) -> None:
    boat = boats[index]
    if boat.plan is None or len(boats) == 1:
        return
    every = max(1, -(-len(boat.unsent) // SAMPLES_PER_PACKET))
    samples = boat.unsent[::every][:SAMPLES_PER_PACKET]
    boat.unsent = []
    for other, receiver in enumerate(boats):
        if other == index or channel.random() < loss:
            continue
        receiver.planner.receive_plan(now_s, index + 1, boat.plan)
        for sample in samples:
            receiver.gp.add(*sample)


def judged_map(
    settings: PlannerSettings, ground: Any, rows: Sequence[tuple[float, float, float, float]], third_s: float
) -> dict[str, float]:
    """Figures of the map of all soundings, on a 5 m grid, as `Outcome` has them.

    Args:
        settings: Of the mission.
        ground: The true ground.
        rows: Soundings in order of time: time (s), north, east and depth (m).
        third_s: Time of a third of the mission.
    """
    grid = OperatingArea(settings.area).grid(5.0)
    locations = grid.locations_m
    truth = np.asarray(ground.depth_m(locations[:, 0], locations[:, 1]))
    known = np.isfinite(truth)
    gp = OnlineGp(settings.gp)
    risks = []
    level = LevelSet.of(settings.level_set)
    index = 0
    mean = std = np.zeros(len(locations))
    for until in (third_s, np.inf):
        while index < len(rows) and rows[index][0] <= until:
            gp.add(*rows[index][1:])
            index += 1
        mean, std = gp.predict(locations)
        risks.append(float(level.risk(mean, std)[known].mean()))
    called, is_safe = level.safe(mean, std)[known], truth[known] >= level.level_m
    hits = int(np.sum(called & is_safe))
    both = int(called.sum() + is_safe.sum())
    estimate = trace(grid.north_m, grid.east_m, grid.fill(mean), level.level_m)
    exact = trace(grid.north_m, grid.east_m, grid.fill(truth), level.level_m)
    wrong = np.where(called, level.cost_false_safe, level.cost_false_unsafe) * (called != is_safe)
    return {
        "risk_third": risks[0],
        "risk_end": risks[1],
        "true_loss": float(np.mean(wrong)),
        "f1": 2 * hits / both if both else float("nan"),
        "isobath_m": compare(estimate, exact).mean_m,
    }


def _evaluate(settings: PlannerSettings, ground: Any, boats: list[_Boat]) -> Outcome:
    leg_m = boats[0].planner.motion.leg_length_m
    rows = sorted(row for boat in boats for row in boat.soundings)
    third_s = settings.mission.steps / 3.0 * leg_m / settings.vehicle.speed_mps
    return Outcome(**judged_map(settings, ground, rows, third_s), boats=boats)
