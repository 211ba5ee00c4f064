"""The textbook's Gaussian process by dense solves on the full matrix, in plain NumPy: what the fast code is held to."""

from __future__ import annotations

import numpy as np


def covariance(kernel, a_m, b_m):
    """k(a, b) by the formula."""
    return kernel.of_scaled_numpy(kernel.scale(a_m), kernel.scale(b_m))


def dense(kernel, prior_mean, centers, planned_m, planned_noise_m2, locations_m):
    """Mean given the data; covariance given the data; covariance given data and planned locations, of positions (P,
    2)."""
    n, count = len(centers), len(centers) + len(planned_m)
    known_m = np.concatenate([centers.locations_m, planned_m])
    noise = np.concatenate([centers.noise_std_m**2, np.full(len(planned_m), planned_noise_m2)])
    matrix = covariance(kernel, known_m, known_m) + np.diag(noise)
    cross = covariance(kernel, known_m, locations_m)
    own = covariance(kernel, locations_m, locations_m)
    mean = np.array(prior_mean(locations_m), dtype=float)
    given_data = given_both = own
    if n:
        residuals = centers.depths_m - prior_mean(centers.locations_m)
        mean = mean + cross[:n].T @ np.linalg.solve(matrix[:n, :n], residuals)
        given_data = own - cross[:n].T @ np.linalg.solve(matrix[:n, :n], cross[:n])
    if count:
        given_both = own - cross.T @ np.linalg.solve(matrix, cross)
    return mean, given_data, given_both
