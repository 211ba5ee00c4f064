"""The constants of a mission that the page needs: area, vehicles, slots, scales, the true isobath."""

import math

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_data import origin_of
from auv_lse_shore.judge.isobath import trace
from auv_lse_shore.judge.quantity_names import COST_PER_LOCATION, EXPECTED_LOSS, MAP_LAYERS
from auv_lse_shore.live.sources.map_layers import scales_of
from auv_lse_shore.live.sources.plan_lines import POINTS_PER_LEG, decimetres
from auv_lse_shore.live.sources.timeline import Event
from auv_lse_sim.ground.ground_source import ground_of

#: Largest number of points along a side of the grid on which the true isobath is traced.
_TRUTH_POINTS = 250


def mission_facts(settings: Settings, *, name: str, simulated: bool) -> Event:
    """The first event of a mission's timeline.

    Args:
        name: Its title on the page: the run folder's name.
        simulated: Whether the true ground is that of the mission file (`sim`).
    """
    area = OperatingArea(settings.area)
    tdma, level_set = settings.tdma, settings.level_set
    scales = scales_of(level_set.level_m, level_set.largest_risk)
    return {
        "kind": "mission",
        "name": name,
        "vehicles": [{"number": k, "depth_m": own.vehicle.depth_m} for k, own in enumerate(settings.vehicles, 1)],
        "steps": settings.mission.steps,
        "seed": settings.mission.seed,
        "method": settings.common.planner.method,
        # What the planners count as reward: of their paths, so that it adds up over the team, or of the whole map.
        "reward_of": settings.common.planner.family.bound_of,
        "level_m": level_set.level_m,
        "costs": [level_set.cost_false_safe, level_set.cost_false_unsafe],
        "largest_risk": level_set.largest_risk,
        "origin_deg": origin_of(settings.to_patterns()),
        "extent_m": list(area.extent_m),
        "area": decimetres(area.polygon),
        "holes": [decimetres(hole) for hole in area.no_go.values()],
        "points_per_leg": POINTS_PER_LEG,
        "simulated": simulated,
        "leg_s": _leg_s(settings),
        "tdma": {
            "order": list(tdma.order) or list(range(1, settings.mission.vehicles + 1)),
            "slot_s": tdma.slot_s,
            "epoch_s": tdma.epoch_s,
            "guard_s": tdma.guard_s,
            "send_s": tdma.send_duration_s,
            "sound_mps": tdma.sound_speed_mps,
        },
        "layers": [{"name": key, "low": s.low, "step": s.step, "unit": s.unit} for key, s in scales.items()],
        "names": {
            "expected_loss": EXPECTED_LOSS.capitalize(),
            "cost_per_position": COST_PER_LOCATION,
            "layers": {key: name[0].upper() + name[1:] for key, name in MAP_LAYERS.items()},
        },
        "true_isobath": _true_isobath(settings, area) if simulated else [],
    }


def _leg_s(settings: Settings) -> float:
    leg_m = math.radians(settings.motion.theta_max_deg) * settings.motion.turn_radius_m
    return leg_m / settings.vehicles[0].vehicle.speed_mps


def _true_isobath(settings: Settings, area: OperatingArea) -> list[list[int]]:
    """The isobath of the simulated ground; empty if its file is missing."""
    try:
        ground = ground_of(settings)
    except (OSError, ValueError):
        return []
    south, north_end, west, east_end = area.extent_m
    step_m = max(2.5, max(north_end - south, east_end - west) / _TRUTH_POINTS)
    grid = area.grid(step_m)
    north, east = np.meshgrid(grid.north_m, grid.east_m, indexing="ij")
    depth = np.asarray(ground.depth_m(north.ravel(), east.ravel()), dtype=float).reshape(north.shape)
    lines = trace(grid.north_m, grid.east_m, np.where(grid.inside, depth, np.nan), settings.level_set.level_m)
    return [decimetres(line) for line in lines]
