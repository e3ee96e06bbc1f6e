"""The optimal law with more spread, and the whole ratio of densities in the weight."""

import numpy as np
from scipy.stats import multivariate_normal as normal


def propose(particles, k, problem, rng):
    model, (z, H, R) = problem.model, problem.seen(k)
    free = np.diag(model.noise_cov) > 0
    Q = model.noise_cov[np.ix_(free, free)]
    predicted = model.F @ particles + model.B[:, None]
    new = predicted.copy()
    if len(z) == 0:
        new[free] += np.linalg.cholesky(Q) @ rng.standard_normal((free.sum(), particles.shape[1]))
        return new, np.zeros(particles.shape[1])
    Hf = H[:, free]
    S = Hf @ Q @ Hf.T + R
    K = Q @ Hf.T @ np.linalg.inv(S)
    spread = 1.5 * (Q - K @ S @ K.T)
    middle = predicted[free] + K @ (z[:, None] - H @ predicted)
    new[free] = middle + np.linalg.cholesky(spread) @ rng.standard_normal(middle.shape)
    zero = np.zeros(free.sum())
    logs = normal.logpdf((z[:, None] - H @ new).T, np.zeros(len(z)), R)
    logs = logs + normal.logpdf((new - predicted)[free].T, zero, Q)
    return new, logs - normal.logpdf((new[free] - middle).T, zero, spread)
