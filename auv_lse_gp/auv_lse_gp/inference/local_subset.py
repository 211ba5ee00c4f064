"""Prediction from the local subset: the centers within d_eps (paper, section "Online GP")."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior, checked_locations

Array = NDArray[np.float64]


def predict_locally(prior: Posterior, centers: Centers, locations_m: ArrayLike) -> tuple[Array, Array]:
    """Mean and variance, (P,) each, at locations (P, 2), each from its nearby centers.

    Locations in one square tile of side d_eps / 4 (in the kernel's axes) share a subset: all centers within d_eps of
    the tile.

    Args:
        prior: A posterior without data.
    """
    locations = checked_locations(locations_m)
    mean = np.array(prior.prior_mean(locations), dtype=float)
    variance = np.array(prior.kernel.variance(locations))
    if not len(centers):
        return mean, variance
    radius = prior.kernel.local_radius
    side = radius / 4.0
    scaled, scaled_centers = prior.kernel.scale(locations), prior.kernel.scale(centers.locations_m)
    tiles, group = np.unique(np.floor(scaled / side), axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    bounds = np.searchsorted(group.ravel()[order], np.arange(len(tiles) + 1))
    for number, tile in enumerate(tiles):
        members = order[bounds[number] : bounds[number + 1]]
        gap = np.maximum(np.abs(scaled_centers - (tile + 0.5) * side) - 0.5 * side, 0.0)
        near = np.flatnonzero(np.einsum("nd,nd->n", gap, gap) <= radius**2)
        if len(near):
            local = prior.blank()
            local.extend(Centers(centers.locations_m[near], centers.depths_m[near], centers.noise_std_m[near]))
            mean[members], variance[members] = local.moments(locations[members])
    return mean, variance
