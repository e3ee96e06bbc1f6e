"""Landmarks jittered by a noise that the filter declares."""

import numpy as np

from lab.result import Filtered


def run(problem, rng, P, threshold, std):
    model = problem.with_landmark_noise(std).model if not model_moves(problem) else problem.model
    n = len(model.m0)
    x = rng.multivariate_normal(model.m0, model.P0, P, check_valid="ignore").T
    w = np.full(P, 1 / P)
    means, covs, evidence, ess = [x @ w], [np.cov(x, aweights=w, ddof=0)], [0.0], [float(P)]
    for k in range(1, problem.n_instants):
        if 1 / np.sum(w**2) < threshold * P:
            x, w = x[:, rng.choice(P, P, p=w)], np.full(P, 1 / P)
        x = model.F @ x + model.B[:, None] + rng.multivariate_normal(np.zeros(n), model.Q, P).T
        z, H, R = problem.seen(k)
        g = np.ones(P)
        if len(z):
            d = z[:, None] - H @ x
            g = np.exp(-0.5 * np.sum(d * np.linalg.solve(R, d), axis=0)) / np.sqrt(np.linalg.det(2 * np.pi * R))
        evidence.append(evidence[-1] + np.log(np.sum(w * g)))
        w = w * g / np.sum(w * g)
        means.append(x @ w)
        covs.append(np.cov(x, aweights=w, ddof=0))
        ess.append(1 / np.sum(w**2))
    return Filtered(np.array(means), np.array(covs), np.array(evidence), np.array(ess))


def model_moves(problem):
    return problem.model.Q[2, 2] > 1e-16


def sis(problem, rng, *, n_particles, landmark_noise=0.02):
    return run(problem, rng, n_particles, 0.0, landmark_noise)


def sir(problem, rng, *, n_particles, landmark_noise=0.02):
    return run(problem, rng, n_particles, 0.7, landmark_noise)
