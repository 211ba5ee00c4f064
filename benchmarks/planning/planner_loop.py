"""A light mission loop for measuring planners: true ground, perfect tracking, lost packets; no navigation.

The full engine is `auv_lse_sim.engine.fleet`; this one leaves out what does not concern the choice of paths
(instruments, modem, currents), so that hundreds of missions can be compared.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.map.online import OnlineGp
from auv_lse_gp.map.quality_watch import QualityWatch
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

SLOT_S = 10
SAMPLES_PER_PACKET = 18
#: Noise of a sounding.
SOUNDING_STD_M = 0.2


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
    watch: QualityWatch | None = None

    def judge(self, now_s: float) -> None:
        """Judges the map for `mission.until`, if that is due."""
        if self.watch is not None and self.watch.begin_if_due(now_s, self.gp):
            while self.watch.is_judging:
                quality = self.watch.advance(now_s)
                if quality is not None:
                    self.planner.set_quality(now_s, quality)


def light_mission(
    settings: PlannerSettings, ground: Any, seed: int, loss: float
) -> list[tuple[float, float, float, float]]:
    """Flies one mission; its soundings in order of time: time (s), north, east and depth (m).

    Args:
        settings: Of all vehicles.
        seed: Seed of all random draws.
        loss: Share of packets lost.
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
                along -= boat.leg.length_m
                boat.leg = boat.queue.pop(0)
            boat.heading, boat.north, boat.east = (float(x) for x in boat.leg.state_at(along))
            if now % 2 == 0:
                depth = float(ground.depth_m(boat.north, boat.east))
                if np.isfinite(depth):
                    depth = max(depth + SOUNDING_STD_M * float(noise.normal()), 0.1)
                    boat.gp.add(boat.north, boat.east, depth)
                    boat.soundings.append((float(now), boat.north, boat.east, depth))
                    boat.unsent.append((boat.north, boat.east, depth))
            boat.planner.odometry(float(now), boat.heading, boat.north, boat.east)
            boat.judge(float(now))
    return sorted(row for boat in boats for row in boat.soundings)


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
