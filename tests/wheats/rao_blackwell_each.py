"""A Rao-Blackwellized filter with a Kalman filter for every particle, and the robot's optimal importance function."""

import numpy as np

from lab.result import Filtered


def rbpf_step(robots, means, cov, weights, noise, z, H, R, model):
    P = robots.shape[1]
    new_robots, new_means, logs = np.zeros((2, P)), np.zeros_like(means), np.zeros(P)
    seen = np.flatnonzero(~np.isnan(z))
    L, Rk = H[seen, 2:], R[np.ix_(seen, seen)]
    new_cov = cov
    for i in range(P):
        new_robots[:, i] = model.F[:2, :2] @ robots[:, i] + model.B[:2] + noise[:, i]
        new_means[:, i] = means[:, i]
        if len(seen):
            S = L @ cov @ L.T + Rk
            K = cov @ L.T @ np.linalg.inv(S)
            d = z[seen] - H[seen, :2] @ new_robots[:, i] - L @ means[:, i]
            new_means[:, i] += K @ d
            new_cov = cov - K @ L @ cov
            logs[i] = -0.5 * d @ np.linalg.solve(S, d)
    w = weights * np.exp(logs - logs[weights > 0].max())
    return new_robots, new_means, new_cov, w / w.sum()


def rbpf_moments(robots, means, cov, weights):
    n = 2 + len(means)
    mean, total = np.zeros(n), np.zeros((n, n))
    for i, w in enumerate(weights):
        mean += w * np.append(robots[:, i], means[:, i])
    for i, w in enumerate(weights):
        d = np.append(robots[:, i], means[:, i]) - mean
        inner = np.zeros((n, n))
        inner[2:, 2:] = cov
        total += w * (np.outer(d, d) + inner)
    return mean, total


def rbpf(problem, rng, *, n_particles):
    model, P = problem.model, n_particles
    F, B, Q = model.F[:2, :2], model.B[:2, None], model.Q[:2, :2]
    r = np.tile(model.m0[:2, None], (1, P))
    m, C, w, evidence = np.tile(model.m0[2:, None], (1, P)), model.P0[2:, 2:], np.full(P, 1 / P), 0.0
    rows = []
    for k in range(problem.n_instants):
        if k:
            if 1 / np.sum(w**2) < 0.6 * P:
                a = rng.choice(P, P, p=w)
                r, m, w = r[:, a], m[:, a], np.full(P, 1 / P)
            z, H, R = problem.seen(k)
            C = C + model.noise_cov[2:, 2:]
            predicted = F @ r + B
            if len(z):
                V = H[:, 2:] @ C @ H[:, 2:].T + R
                T = H[:, :2] @ Q @ H[:, :2].T + V
                d = z[:, None] - H[:, :2] @ predicted - H[:, 2:] @ m
                G = Q @ H[:, :2].T @ np.linalg.inv(T)
                r = predicted + G @ d + np.linalg.cholesky(Q - G @ T @ G.T) @ rng.standard_normal((2, P))
                logs = -0.5 * (np.sum(d * np.linalg.solve(T, d), axis=0) + np.linalg.slogdet(2 * np.pi * T)[1])
                K = C @ H[:, 2:].T @ np.linalg.inv(V)
                m = m + K @ (z[:, None] - H[:, :2] @ r - H[:, 2:] @ m)
                C = C - K @ V @ K.T
                top = logs.max()
                w = w * np.exp(logs - top)
                evidence += np.log(w.sum()) + top
                w = w / w.sum()
            else:
                r = predicted + np.linalg.cholesky(Q) @ rng.standard_normal((2, P))
        mean, total = rbpf_moments(r, m, C, w)
        rows.append((mean, total, evidence))
    return Filtered(*(np.array(column) for column in zip(*rows, strict=True)))
