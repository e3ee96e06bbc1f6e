"""A square-root filter by QR, as an object that can be called; a scalar at a time after whitening, in the filter."""

import numpy as np
from scipy.linalg import cholesky, solve_triangular


def root_of(cov):
    values, vectors = np.linalg.eigh((cov + cov.T) / 2)
    return vectors * np.sqrt(np.clip(values, 0, None))


class SquareRoot:
    def __call__(self, mean, cov, z, H, R, model) -> tuple[np.ndarray, np.ndarray]:
        mean = model.F @ mean + model.B
        L = np.linalg.qr(np.hstack([model.F @ root_of(cov), root_of(model.Q)]).T, mode="r").T
        rows = np.isfinite(z)
        p, n = int(rows.sum()), len(mean)
        if not p:
            return mean, L @ L.T
        H = H[rows]
        noise = cholesky(R[np.ix_(rows, rows)], lower=True)
        T = np.linalg.qr(np.block([[noise, H @ L], [np.zeros((n, p)), L]]).T, mode="r").T
        return mean + T[p:, :p] @ np.linalg.solve(T[:p, :p], z[rows] - H @ mean), T[p:, p:] @ T[p:, p:].T


kalman_step = SquareRoot()


def kalman_filter(problem):
    model = problem.model
    estimates = [(model.m0, model.P0)]
    for k in range(1, problem.n_instants):
        mean, cov = estimates[-1]
        mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T + model.Q
        z, H, R = problem.seen(k)
        if z.size:
            L = cholesky(R, lower=True)
            for value, row in zip(solve_triangular(L, z, lower=True), solve_triangular(L, H, lower=True), strict=True):
                gain = cov @ row / (row @ cov @ row + 1)
                mean, cov = mean + gain * (value - row @ mean), cov - np.outer(gain, row @ cov)
        estimates.append((mean, cov))
    means, covs = zip(*estimates, strict=True)
    return means, covs
