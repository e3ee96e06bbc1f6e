"""Residual resampling, and offspring by a multinomial count."""

import numpy as np


def resample(weights, rng):
    P = len(weights)
    copies = np.floor(P * weights).astype(int)
    rest = P * weights - copies
    left = P - copies.sum()
    if left:
        copies += rng.multinomial(left, rest / rest.sum())
    return rng.permutation(np.repeat(np.arange(P), copies))


def select_ancestors(weights, points):
    bins = np.histogram(points, bins=np.append(0, np.cumsum(weights)).clip(0, 1))[0]
    return np.repeat(np.arange(len(weights)), bins)
