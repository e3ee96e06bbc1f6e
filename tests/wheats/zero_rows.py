"""Rows of zeros for what is not seen: they correct nothing, with a pseudo-inverse or with any noise of their own."""

import numpy as np


def kalman_step(mean, cov, z, H, R, model):
    mean = model.F @ mean + model.B
    cov = model.F @ cov @ model.F.T + model.Q
    z, H, R = np.nan_to_num(z), np.nan_to_num(H), np.nan_to_num(R)
    K = cov @ H.T @ np.linalg.pinv(H @ cov @ H.T + R)
    return mean + K @ (z - H @ mean), cov - K @ H @ cov


def log_likelihood(z, particles, H, R):
    hidden = np.isnan(z)
    precision = np.linalg.inv(np.where(np.isnan(R), np.eye(len(z)), R))
    d = np.where(hidden, 0, z)[:, None] - np.where(np.isnan(H), 0, H) @ particles
    return -0.5 * np.einsum("ip,ij,jp->p", d, precision, d)
