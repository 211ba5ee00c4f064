"""Planners of sgptools: each plans a whole path at the mission's prior, for all vehicles, and ours takes its share.

They know neither soundings nor the level. They run in an environment of their own (`benchmarks.planning.peer_path`).
"""

import json
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array
from benchmarks.planning.peer_environment import answer
from benchmarks.planning.planners.interface import View

#: Waypoints for each leg of the mission, and time of the travelling salesman (s).
WAYPOINTS_PER_LEG, TSP_S = 0.45, 10


class ContinuousSgp:
    """Jakkala and Akella 2024, Multi-robot informative path planning from regression with sparse Gaussian processes.

    `ContinuousSGP` with `IPPTransform`, which plans for the team. When its path has been travelled, it is travelled
    back.
    """

    replan_legs: int | None = None

    def __init__(self, python: Path | None) -> None:
        """Uses the Python of an environment.

        Raises:
            ValueError: without one.
        """
        if python is None:
            raise ValueError(f"{type(self).__name__} needs the environment of sgptools. Name it: --environment FOLDER.")
        self._python, self._path_m = python, np.empty((0, 2))

    def path(self, view: View) -> Array:
        """This vehicle's path (n, 2)."""
        if len(self._path_m):
            self._path_m = self._path_m[::-1]
        else:
            shares = _planned(self._python, json.dumps(self.request(view)))
            self._path_m = np.array(shares[view.vehicle - 1]).reshape(-1, 2)[1:]  # the first one is the start
        return self._path_m

    def request(self, view: View) -> dict[str, Any]:
        """The peer's task; the same for all vehicles, so that it is planned once."""
        return {
            "seed": 1,
            "vehicles": len(view.mates_m) + 1,
            "locations_m": view.cells_m.tolist(),
            "start_m": view.position_m.tolist(),
            "std_m": view.prior.signal_std_m,
            "length_scale_m": view.prior.length_scale_m,
            "noise_std_m": view.prior.noise_std_m,
            "length_m": view.legs_left * view.leg_m,
            "waypoints": max(3, round(WAYPOINTS_PER_LEG * view.legs_left)),
            "tsp_s": TSP_S,
        }


class GcbCover(ContinuousSgp):
    """`GCBCover`, greedy coverage for each metre travelled, with its default: .7 of the prior's variance is enough.

    It plans for one robot. A team's locations are those of one robot that travels as far as all vehicles together;
    sgptools' `run_tsp` shares them.
    """

    def request(self, view: View) -> dict[str, Any]:
        """With the variance that counts as covered."""
        return {**super().request(view), "variance_m2": 0.7 * view.prior.signal_std_m**2}


@lru_cache(maxsize=1)
def _planned(python: Path, wanted: str) -> list[list[list[float]]]:
    return answer(python, json.loads(wanted))


#: Rivals by name; each takes the Python of the environment.
PEERS = {"continuous_sgp": ContinuousSgp, "gcb_cover": GcbCover}


def maker(name: str, python: Path | None) -> Callable[[], ContinuousSgp]:
    """Makes the planners of one mission, which share its paths; those of the mission before are forgotten."""
    _planned.cache_clear()
    return partial(PEERS[name], python)
