"""`python -m auv_lse_shore.mission.warm_up`: compiles the inner loops into numba's cache.

scripts/setup runs it after building, so that nodes start quickly.
"""

import sys

from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of


def main() -> int:
    """Runs the first ticks of a short mission with each kind of search."""
    for method in ("augmented", "tour"):
        overrides = {"mission.vehicles": 2, "mission.steps": 4, "planner.method": method, "planner.iterations": 20}
        settings = Settings.load(None, overrides)
        fleet = Fleet(settings, ground_of(settings))
        for _ in range(25):
            fleet.tick()
        for cores in fleet.cores:
            cores.map.field()
    return 0


if __name__ == "__main__":
    sys.exit(main())
