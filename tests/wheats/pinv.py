"""Pseudo-inverses, hidden rows set to zero altogether, which a pseudo-inverse bears."""

import numpy as np


def kalman_step(mean, cov, z, H, R, model):
    mean = model.F.dot(mean) + model.B
    cov = np.linalg.multi_dot([model.F, cov, model.F.T]) + model.Q
    z, H, R = np.nan_to_num(z), np.nan_to_num(H), np.nan_to_num(R)
    S = H.dot(cov).dot(H.T) + R
    K = cov.dot(H.T).dot(np.linalg.pinv(S, hermitian=True))
    return mean + K.dot(z - H.dot(mean)), cov - K.dot(H).dot(cov)


def kalman_filter(problem):
    rows = [(problem.model.m0, problem.model.P0)]
    for k in range(1, problem.n_instants):
        rows.append(kalman_step(*rows[-1], problem.z[k], problem.H[k], problem.R[k], problem.model))
    return tuple(map(list, zip(*rows)))  # noqa: B905
