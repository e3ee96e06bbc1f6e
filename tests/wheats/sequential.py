"""One landmark after the other: R couples none of them."""

import numpy as np


def kalman_step(mean, cov, z, H, R, model):
    mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    for i in range(0, len(z), 2):
        if np.isnan(z[i]):
            continue
        Hi = np.zeros((2, len(mean)))
        Hi[:, :2], Hi[:, i + 2 : i + 4] = -np.eye(2), np.eye(2)
        S = Hi @ cov @ Hi.T + R[i : i + 2, i : i + 2]
        K = cov @ Hi.T @ np.linalg.inv(S)
        mean = mean + K @ (z[i : i + 2] - (mean[i + 2 : i + 4] - mean[:2]))
        cov = cov - K @ Hi @ cov
    return mean, cov


def log_likelihood(z, particles, H, R):
    total = np.zeros(particles.shape[1])
    for i in range(0, len(z), 2):
        if not np.isnan(z[i]):
            d = z[i : i + 2, None] - (particles[i + 2 : i + 4] - particles[:2])
            block = R[i : i + 2, i : i + 2]
            total += -0.5 * np.einsum("ip,ij,jp->p", d, np.linalg.inv(block), d)
            total -= 0.5 * np.log(np.linalg.det(block)) + np.log(2 * np.pi)
    return total


def rbpf_step(robots, means, cov, weights, noise, z, H, R, model):
    """Every landmark has a filter of its own."""
    robots = model.F[:2, :2] @ robots + model.B[:2].reshape(2, 1) + noise
    means, cov, logs = means.copy(), cov.copy(), np.log(np.maximum(weights, 1e-300))
    logs[weights == 0] = -np.inf
    for i in range(0, len(z), 2):
        if np.isnan(z[i]):
            continue
        s = slice(i, i + 2)
        S = cov[s, s] + R[s, s]
        K = cov[s, s] @ np.linalg.inv(S)
        d = (z[s, None] + robots) - means[s]
        logs += -0.5 * np.sum(d * (np.linalg.inv(S) @ d), axis=0) - 0.5 * np.linalg.slogdet(S)[1]
        means[s] += K @ d
        cov[s, s] = (np.eye(2) - K) @ cov[s, s]
    w = np.exp(logs - logs.max())
    return robots, means, cov, w / w.sum()
