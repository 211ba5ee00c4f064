"""What correcting positions costs, after a whole mission of three vehicles that mow the lawn."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_gp.positions.terrain_matching import Terrain
from auv_lse_shore.positions.adjustment import adjust
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from benchmarks.rows import Row, row

SEED = 7400
#: What one call of the smoother may take (s), three vehicles and 100 legs.
ALLOWED_S = 0.1


def run(smoke: bool = False) -> list[Row]:
    """Measures the smoother, the rebuilt map, and the adjustment of a recorded mission."""
    steps = 8 if smoke else 100
    overrides = {
        "mission.seed": SEED,
        "mission.steps": steps,
        "planner.method": "lawnmower",
        "sim.gps.surface_every_s": 60.0 if smoke else 1200.0,
        "vehicle.surfacings": 0,
    }
    settings = Settings.load(None, overrides)
    ground = ground_of(settings)
    settings, _ = fit_to_ground(settings, ground)
    fleet = Fleet(settings, ground)
    run_data = fleet.run()
    corrector = fleet.cores[0].corrector
    assert corrector is not None
    gp = corrector.corrected_map.map.gp
    terrain = Terrain(corrector.log.segments(), gp.kernel, gp.prior_mean, gp.config.noise_std_m)
    repeats = 3 if smoke else 10
    unknowns = len(corrector.smoother.smooth(terrain).theta)
    what = f"{steps} legs, {len(corrector.smoother.ranges)} ranges, {unknowns} unknowns"
    both = _time(lambda: corrector.smoother.smooth(terrain), repeats)
    positions = corrector.log.mapped_m.copy()
    return [
        _allowed(f"smoother, fixes and ranges: {what}", _time(corrector.smoother.smooth, repeats)),
        _allowed(f"smoother, and {len(terrain.segments)} pieces of track", both),
        row(
            f"map laid out anew: {len(corrector.log)} soundings",
            1e3 * _time(lambda: _laid_out(corrector, positions), 3),
            "ms",
        ),
        row("map told how uncertain positions are", 1e3 * _time(lambda: _informed(corrector), 3), "ms"),
        row("adjustment of the mission (auv_lse adjust)", _time(lambda: adjust([run_data]), 1), "s"),
    ]


def _laid_out(corrector: PositionCorrector, positions: np.ndarray) -> None:
    corrector.corrected_map.rebuild(positions)
    corrector.corrected_map.map.centers  # noqa: B018  # the last merges


def _informed(corrector: PositionCorrector) -> None:
    assert corrector.correction is not None
    corrector.corrected_map.set_uncertainty(corrector.correction)
    corrector.corrected_map.map.field()


def _allowed(name: str, seconds: float) -> Row:
    """A row that compares processor time with the limit for a call."""
    goal = f"<= {1e3 * ALLOWED_S:g} ms"
    return row(name, 1e3 * seconds, "ms", "allowed", ALLOWED_S / seconds, goal, seconds <= ALLOWED_S)


def _time(call: Callable[[], object], repeats: int) -> float:
    """Processor time (s) of one call, the median of some."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return float(np.median(times))
