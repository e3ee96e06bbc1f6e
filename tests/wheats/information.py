"""The information form, and a prior whose robot is not inverted."""

import numpy as np


def kalman_step(mean, cov, z, H, R, model):
    mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
    use = ~np.isnan(z)
    if not use.any():
        return mean, cov
    C = H[use].T @ np.linalg.inv(R[use][:, use])
    Y = np.linalg.inv(cov) + C @ H[use]
    y = np.linalg.solve(cov, mean) + C @ z[use]
    return np.linalg.solve(Y, y), np.linalg.inv(Y)


def kalman_filter(problem):
    model = problem.model
    mean, cov = model.m0.copy(), model.P0.copy()
    means, covs = [mean], [cov]
    k = 1
    while k < problem.n_instants:
        mean, cov = kalman_step(mean, cov, problem.z[k], problem.H[k], problem.R[k], model)
        means += [mean]
        covs += [cov]
        k += 1
    return np.stack(means), np.stack(covs)
