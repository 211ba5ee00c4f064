"""What correcting places costs, after a whole mission of three vehicles that mow the lawn."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.places.placer import Placer
from auv_lse_gp.places.terrain import Terrain
from auv_lse_shore.judge.adjustment import adjust
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from benchmarks.rows import Row, row

SEED = 7400
#: What one call of the smoother may take (s), three vehicles and 100 legs.
ALLOWED_S = 0.1


def run(smoke: bool = False) -> list[Row]:
    """Measures the smoother, the map laid out anew, and the adjustment of a recorded mission."""
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
    placer = fleet.crews[0].placer
    assert placer is not None
    gp = placer.placed.map.gp
    terrain = Terrain(placer.book.pieces(), gp.kernel, gp.prior_mean, gp.config.noise_std_m)
    repeats = 3 if smoke else 10
    unknowns = len(placer.smoother.smooth(terrain).theta)
    what = f"{steps} legs, {len(placer.smoother.ranges)} ranges, {unknowns} unknowns"
    both = _time(lambda: placer.smoother.smooth(terrain), repeats)
    places = placer.book.booked_m.copy()
    return [
        _allowed(f"smoother, fixes and ranges: {what}", _time(placer.smoother.smooth, repeats)),
        _allowed(f"smoother, and {len(terrain.pieces)} pieces of track", both),
        row(
            f"map laid out anew: {len(placer.book)} soundings", 1e3 * _time(lambda: _laid_out(placer, places), 3), "ms"
        ),
        row("map told how uncertain places are", 1e3 * _time(lambda: _informed(placer), 3), "ms"),
        row("adjustment of the mission (scripts/adjust)", _time(lambda: adjust([run_data]), 1), "s"),
    ]


def _laid_out(placer: Placer, places: np.ndarray) -> None:
    placer.placed.lay_out(places)
    placer.placed.map.centers  # noqa: B018  # the last merges


def _informed(placer: Placer) -> None:
    assert placer.correction is not None
    placer.placed.inform(placer.correction)
    placer.placed.map.field()


def _allowed(name: str, seconds: float) -> Row:
    """A row of processor time against what a call may take."""
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
