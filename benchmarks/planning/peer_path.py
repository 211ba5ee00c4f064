"""Paths of a public planner; runs in the environment that `benchmarks.planning.peer_environment` makes.

    ENVIRONMENT/bin/python peer_path.py < request.json > paths.json

sgptools 2.0.7: inducing points joined by a travelling salesman's path, then `ContinuousSGP` with `IPPTransform`, which
shifts them to explain the area best within the length allowed. A request with a variance gets a path of `GCBCover`:
locations chosen greedily, by the ground covered for each metre travelled. A location is covered if one measurement
brings its variance to at most that. The answer has a path for each vehicle.
"""

import contextlib
import json
import os
import sys
from typing import Any

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def area(request: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Locations (P, 2) of a request, the kernel, and a start (1, 2) for each vehicle."""
    import gpflow
    import numpy as np

    kernel = gpflow.kernels.Matern52(variance=request["std_m"] ** 2, lengthscales=request["length_scale_m"])
    starts = np.repeat([request["start_m"]], request["vehicles"], axis=0)
    return np.array(request["locations_m"], dtype=float), kernel, starts


def planned(request: dict[str, Any]) -> Any:
    """Waypoints (K, n, 2), north and east (m), of a request: area, start, kernel, length, number of waypoints, seed."""
    import numpy as np
    import tensorflow as tf
    from sgptools.core.transformations import IPPTransform
    from sgptools.methods import ContinuousSGP
    from sgptools.utils.misc import get_inducing_pts
    from sgptools.utils.tsp import run_tsp

    seed = request["seed"]
    np.random.seed(seed)  # noqa: NPY002 - the peer draws from it
    tf.random.set_seed(seed)
    locations, kernel, starts = area(request)
    vehicles, each = len(starts), request["waypoints"]
    # a team shares the points, within the length of each, as in the peer's examples
    team = {"num_vehicles": vehicles, "max_dist": request["length_m"], "resample": each} if vehicles > 1 else {}
    first, _ = run_tsp(
        get_inducing_pts(locations, each * vehicles, seed=seed), start_nodes=starts, time_limit=request["tsp_s"], **team
    )
    first = np.asarray(first)
    transform = IPPTransform(
        sampling_rate=9,
        distance_budget=request["length_m"],
        num_robots=vehicles,
        Xu_fixed=first[:, :1],
        aggregate_fov=False,  # the slower and better one
        constraint_weight=100.0,
    )
    model = ContinuousSGP(
        first.shape[1], locations, kernel, request["noise_std_m"] ** 2, transform, vehicles, X_init=first.reshape(-1, 2)
    )
    return np.asarray(model.optimize(max_steps=500)).tolist()


def covering(request: dict[str, Any]) -> Any:
    """Waypoints (n, 2) of each vehicle, north and east (m), of a request: area, start, kernel, length, variance."""
    import numpy as np
    import shapely
    from sgptools.methods import GCBCover
    from sgptools.utils.tsp import run_tsp

    locations, kernel, starts = area(request)
    vehicles = len(starts)
    model = GCBCover(len(locations), locations, kernel=kernel, noise_variance=request["noise_std_m"] ** 2)
    model.pbounds = shapely.MultiPoint(locations).buffer(15.0)  # its argument allows no holes
    path = np.asarray(
        model.optimize(
            post_var_threshold=request["variance_m2"],
            distance_budget=vehicles * request["length_m"],
            start_nodes=starts[:1],
        )
    )[0]
    if vehicles == 1:
        return [path.tolist()]
    shared, _ = run_tsp(
        path[1:], vehicles, max_dist=request["length_m"], start_nodes=starts, time_limit=request["tsp_s"]
    )
    return [np.asarray(share).tolist() for share in shared]


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):  # the libraries' own output must not get into the answer
        asked = json.load(sys.stdin)
        found = covering(asked) if "variance_m2" in asked else planned(asked)
    print(json.dumps(found))
