"""Likelihoods without their constants: the weights do not mind."""

import numpy as np

from lab.result import Filtered


def log_prior(x, model):
    d = x - model.m0
    free = np.diag(model.P0) > 0
    if np.any(np.abs(d[~free]) > 1e-9):
        return float("-inf")
    return -0.5 * d[free] @ np.linalg.solve(model.P0[np.ix_(free, free)], d[free])


def log_transition(x_next, x, model):
    d = x_next - (model.F @ x + model.B)
    free = np.diag(model.noise_cov) > 0
    if np.any(np.abs(d[~free]) > 1e-9):
        return float("-inf")
    return -0.5 * d[free] @ np.linalg.solve(model.Q[np.ix_(free, free)], d[free])


def log_likelihood(z, particles, H, R):
    ok = ~np.isnan(z)
    d = z[ok, None] - H[ok] @ particles
    return -0.5 * np.sum(d * np.linalg.solve(R[ok][:, ok], d), axis=0)


def sis(problem, rng, *, n_particles):
    model, P = problem.model, n_particles
    A = np.zeros_like(model.P0)
    A[2:, 2:] = np.linalg.cholesky(model.P0[2:, 2:])
    x = model.m0[:, None] + A @ rng.standard_normal((len(A), P))
    logs = np.full(P, -np.log(P))
    means, covs, evidence = [], [], [0.0]
    for k in range(problem.n_instants):
        if k:
            x = model.F @ x + model.B[:, None] + np.linalg.cholesky(model.Q) @ rng.standard_normal(x.shape)
            logs = logs + log_likelihood(problem.z[k], x, problem.H[k], problem.R[k])
            total = np.logaddexp.reduce(logs)
            evidence.append(evidence[-1] + total)
            logs = logs - total
        w = np.exp(logs)
        means.append(x @ w)
        covs.append(np.cov(x, aweights=w, ddof=0))
    return Filtered(np.array(means), np.array(covs), np.array(evidence))
