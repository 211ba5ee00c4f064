"""A public planner's path, or its covering paths; runs in the environment that `benchmarks.planning.peer` makes.

    ENVIRONMENT/bin/python peer_path.py < request.json > path.json

sgptools 2.0.7: inducing points joined by a travelling salesman's path, then `ContinuousSGP` with `IPPTransform`, which
shifts them to explain the area best within the length allowed. A request with variances gets a path of `GCBCover` for
each: locations chosen greedily until one measurement each brings the variance everywhere to at most that.
"""

import contextlib
import json
import os
import sys

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def planned(request):
    """Waypoints (n, 2), north and east (m), of a request: area, start, kernel, length, number of waypoints, seed."""
    import gpflow
    import numpy as np
    import tensorflow as tf
    from sgptools.core.transformations import IPPTransform
    from sgptools.methods import ContinuousSGP
    from sgptools.utils.misc import get_inducing_pts
    from sgptools.utils.tsp import run_tsp

    seed = request["seed"]
    np.random.seed(seed)  # noqa: NPY002 - the peer draws from it
    tf.random.set_seed(seed)
    (south, west), (north, east) = request["low_m"], request["high_m"]
    grid = np.meshgrid(np.arange(south, north + 1, 20.0), np.arange(west, east + 1, 20.0), indexing="ij")
    locations = np.stack(grid, -1).reshape(-1, 2)
    kernel = gpflow.kernels.Matern52(variance=request["std_m"] ** 2, lengthscales=request["length_scale_m"])
    start = np.array([request["start_m"]])
    first, _ = run_tsp(
        get_inducing_pts(locations, request["waypoints"], seed=seed), start_nodes=start, time_limit=request["tsp_s"]
    )
    first = np.asarray(first[0])
    transform = IPPTransform(
        sampling_rate=9,
        distance_budget=request["length_m"],
        num_robots=1,
        Xu_fixed=first[None, :1],
        aggregate_fov=False,  # the slower and better one
        constraint_weight=100.0,
    )
    model = ContinuousSGP(len(first), locations, kernel, request["noise_std_m"] ** 2, transform, X_init=first)
    return np.asarray(model.optimize(max_steps=500))[0].tolist()


def covering(request):
    """Waypoints (n, 2), north and east (m), for each variance of a request: area, start, kernel, variances."""
    import gpflow
    import numpy as np
    from sgptools.methods import GCBCover

    (south, west), (north, east) = request["low_m"], request["high_m"]
    grid = np.meshgrid(np.arange(south, north + 1, 20.0), np.arange(west, east + 1, 20.0), indexing="ij")
    kernel = gpflow.kernels.Matern52(variance=request["std_m"] ** 2, lengthscales=request["length_scale_m"])
    locations = np.stack(grid, -1).reshape(-1, 2)
    start, paths = np.array([request["start_m"]]), []
    for variance in request["variances_m2"]:
        model = GCBCover(len(locations), locations, kernel=kernel, noise_variance=request["noise_std_m"] ** 2)
        paths.append(np.asarray(model.optimize(post_var_threshold=variance, start_nodes=start))[0].tolist())
    return paths


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):  # the libraries' own words must not get into the answer
        asked = json.load(sys.stdin)
        found = covering(asked) if "variances_m2" in asked else planned(asked)
    print(json.dumps(found))
