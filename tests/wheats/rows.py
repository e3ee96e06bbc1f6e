"""Particles one a row."""

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal


def log_likelihood(z, particles, H, R):
    ok = ~np.isnan(z)
    if not ok.any():
        return np.zeros(len(particles))
    return multivariate_normal.logpdf(z[ok] - particles @ H[ok].T, cov=R[ok][:, ok])


def sis_step(particles, weights, noise, z, H, R, model):
    assert particles.shape[0] == len(weights)
    particles = particles @ model.F.T + model.B + noise
    with np.errstate(divide="ignore"):
        logs = np.log(weights) + log_likelihood(z, particles, H, R)
    return particles, np.exp(logs - logsumexp(logs))


def jittered_step(particles, weights, noise, jitter, z, H, R, model):
    return sis_step(particles, weights, noise + np.hstack([np.zeros((len(weights), 2)), jitter]), z, H, R, model)


def sir_step(particles, weights, noise, points, z, H, R, model, threshold):
    if 1 / np.sum(weights**2) / len(weights) <= threshold:
        chosen = np.searchsorted(np.cumsum(weights), points)
        particles, weights = particles[chosen], np.full(len(weights), 1 / len(weights))
    return sis_step(particles, weights, noise, z, H, R, model)


def moments(particles, weights):
    assert particles.shape[0] == len(weights)
    mean = np.average(particles, axis=0, weights=weights)
    return mean, np.cov(particles.T, aweights=weights, ddof=0)


def propose(particles, k, problem, rng):
    model, (z, H, R) = problem.model, problem.seen(k)
    Q = model.noise_cov
    predicted = particles @ model.F.T + model.B
    if len(z) == 0:
        return predicted + rng.multivariate_normal(np.zeros(len(Q)), Q, len(particles)), np.zeros(len(particles))
    S = H @ Q @ H.T + R
    K = Q @ H.T @ np.linalg.inv(S)
    left = (np.eye(len(Q)) - K @ H) @ Q
    draws = rng.multivariate_normal(np.zeros(len(Q)), (left + left.T) / 2, len(particles))
    return predicted + (z - predicted @ H.T) @ K.T + draws, multivariate_normal.logpdf(z - predicted @ H.T, cov=S)
