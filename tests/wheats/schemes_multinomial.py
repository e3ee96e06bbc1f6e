"""numpy's own choice, and ancestors in no order."""

import numpy as np


def resample(weights, rng):
    return rng.choice(len(weights), size=len(weights), p=weights)


def select_ancestors(weights, points):
    edges = np.concatenate([[0], np.cumsum(weights)])
    return np.random.default_rng(3).permutation(np.digitize(points, edges) - 1)
