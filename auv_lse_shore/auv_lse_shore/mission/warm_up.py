"""`python -m auv_lse_shore.mission.warm_up`: compiles the inner loops into numba's cache.

scripts/setup runs it after building, so that nodes start quickly.
"""

import sys

from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.reach import clip_to_reachable


def main() -> int:
    """Runs the first ticks of a short mission with each kind of search; one vehicle alone also plans routes."""
    for method, vehicles, steps in (("augmented", 2, 4), ("tour", 2, 4), ("tour", 1, 12)):
        overrides = {"mission.vehicles": vehicles, "mission.steps": steps, "planner.method": method}
        settings, _ = clip_to_reachable(Settings.load(None, {**overrides, "planner.iterations": 20}))
        fleet = Fleet(settings, ground_of(settings))
        for _ in range(25):
            fleet.tick()
        for cores in fleet.cores:
            cores.map.field()
    return 0


if __name__ == "__main__":
    sys.exit(main())
