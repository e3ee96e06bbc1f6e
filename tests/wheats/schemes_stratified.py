"""Stratified resampling."""

import numpy as np


def resample(weights, rng):
    P = len(weights)
    cumulative = np.cumsum(weights)
    cumulative[-1] = 1.0
    return np.searchsorted(cumulative, (np.arange(P) + rng.random(P)) / P, side="right")


def select_ancestors(weights, points):
    c = np.cumsum(weights)
    return np.array([np.argmax(c > u) for u in points])
