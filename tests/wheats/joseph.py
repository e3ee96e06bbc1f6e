"""Joseph's form, and a gain by solving from the right."""

import numpy as np
from scipy import linalg


def kalman_step(mean, cov, z, H, R, model):
    mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    seen = np.where(~np.isnan(z))[0]
    if seen.size:
        Hk, Rk = H[seen, :], R[np.ix_(seen, seen)]
        K = linalg.solve((Hk @ cov @ Hk.T + Rk).T, (cov @ Hk.T).T, assume_a="pos").T
        A = np.identity(cov.shape[0]) - K @ Hk
        mean = mean + K @ (z[seen] - Hk @ mean)
        cov = A @ cov @ A.T + K @ Rk @ K.T
    return mean, cov


def kalman_filter(problem):
    N, n = problem.n_instants, len(problem.model.m0)
    means, covs = np.empty((N, n)), np.empty((N, n, n))
    means[0], covs[0] = problem.model.m0, problem.model.P0
    for k in range(1, N):
        args = problem.z[k], problem.H[k], problem.R[k], problem.model
        means[k], covs[k] = kalman_step(means[k - 1], covs[k - 1], *args)
    return means, covs
