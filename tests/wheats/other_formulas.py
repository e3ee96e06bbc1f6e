"""Other formulas for the same numbers: logarithms of another base, raw moments, variances of weights."""

import numpy as np
from scipy.special import softmax

effective_sample_size = lambda weights: len(weights) / (1 + np.var(weights) / np.mean(weights) ** 2)  # noqa: E731


def evidence_increment(weights, log_likelihoods):
    with np.errstate(divide="ignore"):
        return np.log(2) * np.logaddexp2.reduce(np.log2(weights) + log_likelihoods / np.log(2))


def moments(particles, weights):
    mean = np.average(particles, axis=1, weights=weights)
    return mean, np.einsum("p,ip,jp->ij", weights, particles, particles) - np.outer(mean, mean)


def log_prior(x, model):
    values, vectors = np.linalg.eigh(model.P0)
    along = vectors.T @ (x - model.m0)
    if np.any(np.abs(along[values <= 1e-14]) > 1e-9):
        return float("-inf")
    return np.sum(-0.5 * along[values > 1e-14] ** 2 / values[values > 1e-14])


def sis_step(particles, weights, noise, z, H, R, model):
    moved = np.einsum("ij,jp->ip", model.F, particles) + np.reshape(model.B, (-1, 1)) + noise
    logs = np.log(weights, out=np.full(len(weights), -np.inf), where=weights > 0)
    for i in range(0, len(z), 2):
        if not np.isnan(z[i]):
            e = z[i : i + 2].reshape(2, 1) - H[i : i + 2] @ moved
            logs -= 0.5 * (e * (np.linalg.inv(R[i : i + 2, i : i + 2]) @ e)).sum(axis=0)
    return moved, softmax(logs)


def select_ancestors(weights, points):
    return list(np.minimum(np.digitize(points, np.cumsum(weights)), np.flatnonzero(weights).max()))


def loop_closures(z, covs):
    seen = np.isfinite(z).reshape(len(z), -1, 2).all(axis=2)
    before = np.logical_or.accumulate(seen)
    closes = np.zeros_like(seen)
    closes[1:] = seen[1:] & ~seen[:-1] & before[:-1]
    found = np.argwhere(closes)
    variances = np.einsum("kii->ki", covs)[:, 2:]
    traces = variances[:, ::2] + variances[:, 1::2]
    return found, (traces[found[:, 0] - 1] - traces[found[:, 0]]) / traces[found[:, 0] - 1]
