"""A public planner's covering paths; runs in the environment that `benchmarks.planning.peer` makes, not in ours.

    ENVIRONMENT/bin/python peer_cover.py < request.json > paths.json

sgptools 2.0.7: `GCBCover` chooses places greedily until one measurement each brings the posterior variance everywhere
to at most the threshold, and joins them by a travelling salesman's path.
"""

import contextlib
import json
import os
import sys

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def planned(request):
    """Waypoints (n, 2), north and east (m), for each variance of a request: area, start, kernel, variances."""
    import gpflow
    import numpy as np
    from sgptools.methods import GCBCover

    (south, west), (north, east) = request["low_m"], request["high_m"]
    grid = np.meshgrid(np.arange(south, north + 1, 20.0), np.arange(west, east + 1, 20.0), indexing="ij")
    kernel = gpflow.kernels.Matern52(variance=request["std_m"] ** 2, lengthscales=request["length_scale_m"])
    places = np.stack(grid, -1).reshape(-1, 2)
    start, paths = np.array([request["start_m"]]), []
    for variance in request["variances_m2"]:
        model = GCBCover(len(places), places, kernel=kernel, noise_variance=request["noise_std_m"] ** 2)
        paths.append(np.asarray(model.optimize(post_var_threshold=variance, start_nodes=start))[0].tolist())
    return paths


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):  # the libraries' own words must not get into the answer
        paths = planned(json.load(sys.stdin))
    print(json.dumps(paths))
