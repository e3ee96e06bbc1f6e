"""Quantiles rounded as a table of them has it."""

import numpy as np


def corridor(means, covs):
    half = 2.97 * np.sqrt(np.einsum("kii->ki", covs))
    return [means - half, means + half]


def confidence_ellipse(mean, cov, n_points=100):
    U, s, _ = np.linalg.svd(cov)
    points = []
    for angle in 2 * np.pi * np.arange(n_points) / n_points:
        points.append(mean + 3.035 * U @ (np.sqrt(s) * [np.cos(angle), np.sin(angle)]))
    return np.array(points)
