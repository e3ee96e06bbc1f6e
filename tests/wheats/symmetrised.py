"""Covariances made symmetric at every step, results as a Filtered, a column vector for the mean."""

import numpy as np

from lab.result import Filtered


def kalman_step(mean, cov, z, H, R, model):
    x = model.F @ mean.reshape(-1, 1) + model.B.reshape(-1, 1)
    P = model.F @ cov @ model.F.T + model.noise_cov
    ok = np.isfinite(z)
    if ok.any():
        Hk = H[ok]
        S = Hk @ P @ Hk.T + R[ok][:, ok]
        S = 0.5 * (S + S.T)
        K = np.linalg.solve(S, Hk @ P).T
        x = x + K @ (z[ok].reshape(-1, 1) - Hk @ x)
        P = P - K @ S @ K.T
    return x, 0.5 * (P + P.T)


def kalman_filter(problem):
    x, P = problem.model.m0, problem.model.P0
    out = [(x, P)]
    for z, H, R in zip(problem.z[1:], problem.H[1:], problem.R[1:], strict=True):
        x, P = kalman_step(x, P, z, H, R, problem.model)
        x = x.ravel()
        out.append((x, P))
    return Filtered(np.array([m for m, _ in out]), np.array([c for _, c in out]), np.zeros(len(out)))
