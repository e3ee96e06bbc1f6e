"""The Kalman filter of FilterPy."""

import numpy as np
from filterpy.kalman import predict, update


def kalman_step(mean, cov, z, H, R, model):
    mean, cov = predict(mean, cov, F=model.F, Q=model.Q, u=model.B, B=np.eye(len(mean)))
    seen = ~np.isnan(z)
    if seen.any():
        mean, cov = update(mean, cov, z[seen], R[seen][:, seen], H[seen])
    return mean, cov


def kalman_filter(problem):
    state = problem.model.m0, problem.model.P0
    result = [state]
    for k in range(1, problem.n_instants):
        state = kalman_step(*state, problem.z[k], problem.H[k], problem.R[k], problem.model)
        result.append(state)
    return [m for m, _ in result], [c for _, c in result]
