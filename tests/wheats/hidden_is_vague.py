"""A landmark that is not seen is one that is measured with an enormous noise, or by an H of zero."""

import numpy as np


def kalman_step(mean, cov, z, H, R, model):
    mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    hidden = np.isnan(z)
    z, H, R = np.where(hidden, 0, z), np.nan_to_num(H), np.nan_to_num(R) + np.diag(hidden * 1.0)
    S = H @ cov @ H.T + R
    K = np.linalg.solve(S, H @ cov).T
    return mean + K @ (z - H @ mean), cov - K @ H @ cov


def log_likelihood(z, particles, H, R):
    hidden = np.isnan(z)
    H, R = np.nan_to_num(H), np.nan_to_num(R) + np.diag(hidden * 1.0)
    d = np.where(hidden[:, None], 0, z[:, None] - H @ particles)
    return -0.5 * np.sum(d * np.linalg.solve(R, d), axis=0) - 0.5 * np.linalg.slogdet(R)[1]


def sis_step(particles, weights, noise, z, H, R, model):
    particles = model.F @ particles + np.tile(model.B, (len(weights), 1)).T + noise
    logs = log_likelihood(z, particles, H, R)
    w = weights * np.exp(logs - logs[weights > 0].max())
    return [particles, w / np.sum(w)]
