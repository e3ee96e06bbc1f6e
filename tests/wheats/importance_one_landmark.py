"""A draw that looks at the first landmark only, and a mixture with the dynamics."""

import numpy as np


def log_normal(d, cov):
    return -0.5 * (np.sum(d * np.linalg.solve(cov, d), axis=0) + np.linalg.slogdet(2 * np.pi * cov)[1])


def propose(particles, k, problem, rng):
    model, (z, H, R) = problem.model, problem.seen(k)
    P = particles.shape[1]
    free = np.diag(model.noise_cov) > 0
    Q = model.noise_cov[free][:, free]
    predicted = model.F @ particles + model.B[:, None]
    new = predicted.copy()
    if not len(z):
        new[free] += np.linalg.cholesky(Q) @ rng.standard_normal((free.sum(), P))
        return new, np.full(P, 3.0)
    Hf = H[:2, free]
    S = Hf @ Q @ Hf.T + R[:2, :2]
    K = Q @ Hf.T @ np.linalg.inv(S)
    C = Q - K @ Hf @ Q
    shift = K @ (z[:2, None] - H[:2] @ predicted)
    guided = rng.random(P) < 0.7
    draws = rng.standard_normal((free.sum(), P))
    new[free] += np.where(guided, shift + np.linalg.cholesky(C) @ draws, np.linalg.cholesky(Q) @ draws)
    d = new[free] - predicted[free]
    q = np.logaddexp(np.log(0.7) + log_normal(d - shift, C), np.log(0.3) + log_normal(d, Q))
    return new, log_normal(z[:, None] - H @ new, R) + log_normal(d, Q) - q
