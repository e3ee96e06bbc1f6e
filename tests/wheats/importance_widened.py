"""A proposal pulled half way to the measurement and too wide, with its whole weight, over the densities of scipy."""

import numpy as np
from scipy.stats import multivariate_normal as normal


def propose(particles, k, problem, rng):
    model, (z, H, R) = problem.model, problem.seen(k)
    new = model.F @ particles + model.B[:, None]
    noise = np.sqrt(np.diag(model.noise_cov)[2:])
    new[2:] += noise[:, None] * rng.standard_normal(new[2:].shape)
    predicted, Q = new[:2].copy(), model.Q[:2, :2]
    if len(z):
        S = H[:, :2] @ Q @ H[:, :2].T + R
        new[:2] += 0.5 * Q @ H[:, :2].T @ np.linalg.solve(S, z[:, None] - H @ new)
    draw = np.linalg.cholesky(1.3 * Q) @ rng.standard_normal(predicted.shape)
    new[:2] += draw
    logs = normal.logpdf((new[:2] - predicted).T, cov=Q) - normal.logpdf(draw.T, cov=1.3 * Q)
    return new, logs + (normal.logpdf((z[:, None] - H @ new).T, cov=R) if len(z) else 0)
