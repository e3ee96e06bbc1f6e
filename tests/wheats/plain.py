"""Every question, in the plainest way."""

import numpy as np
from scipy.stats import chi2

from lab.result import Filtered


def visible(z, H, R):
    rows = ~np.isnan(z)
    return z[rows], H[rows], R[rows][:, rows]


def kalman_step(mean, cov, z, H, R, model):
    mean = model.F @ mean + model.B
    cov = model.F @ cov @ model.F.T + model.Q
    z, H, R = visible(z, H, R)
    if len(z) > 0:
        S = H @ cov @ H.T + R
        K = cov @ H.T @ np.linalg.inv(S)
        mean = mean + K @ (z - H @ mean)
        cov = (np.eye(len(mean)) - K @ H) @ cov
    return mean, cov


def kalman_filter(problem):
    mean, cov = problem.model.m0, problem.model.P0
    means, covs = [mean], [cov]
    for k in range(1, problem.n_instants):
        mean, cov = kalman_step(mean, cov, problem.z[k], problem.H[k], problem.R[k], problem.model)
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs)


def gaussian(d, cov):
    return -0.5 * (d @ np.linalg.inv(cov) @ d + np.log(np.linalg.det(2 * np.pi * cov)))


def log_prior(x, model):
    known = np.diag(model.P0) == 0
    if not np.allclose(x[known], model.m0[known]):
        return -np.inf
    free = ~known
    return gaussian(x[free] - model.m0[free], model.P0[free][:, free])


def log_transition(x_next, x, model):
    d = x_next - model.F @ x - model.B
    still = np.sqrt(np.diag(model.Q)) < 1e-8
    if not np.allclose(d[still], 0):
        return -np.inf
    return gaussian(d[~still], model.Q[~still][:, ~still])


def log_likelihood(z, particles, H, R):
    z, H, R = visible(z, H, R)
    if len(z) == 0:
        return np.zeros(particles.shape[1])
    d = z[:, None] - H @ particles
    return -0.5 * (np.sum(d * (np.linalg.inv(R) @ d), axis=0) + np.log(np.linalg.det(2 * np.pi * R)))


def weigh(weights, log_likelihoods):
    with np.errstate(divide="ignore"):
        logs = np.log(weights) + log_likelihoods
    new = np.exp(logs - logs.max())
    return new / new.sum()


def sis_step(particles, weights, noise, z, H, R, model):
    particles = model.F @ particles + model.B[:, None] + noise
    return particles, weigh(weights, log_likelihood(z, particles, H, R))


def jittered_step(particles, weights, noise, jitter, z, H, R, model):
    noise = noise.copy()
    noise[2:] += jitter
    return sis_step(particles, weights, noise, z, H, R, model)


def evidence_increment(weights, log_likelihoods):
    top = log_likelihoods.max()
    return top + np.log(np.sum(weights * np.exp(log_likelihoods - top)))


def moments(particles, weights):
    mean = np.sum(weights * particles, axis=1)
    d = particles - mean[:, None]
    return mean, (weights * d) @ d.T


def corridor(means, covs):
    std = np.sqrt(np.array([np.diag(cov) for cov in covs]))
    return means - 3 * std, means + 3 * std


def confidence_ellipse(mean, cov, n_points=100):
    t = np.linspace(0, 2 * np.pi, n_points)
    circle = np.array([np.cos(t), np.sin(t)])
    return mean[:, None] + np.sqrt(chi2.ppf(0.99, 2)) * np.linalg.cholesky(cov) @ circle


def effective_sample_size(weights):
    return 1 / np.sum(weights**2)


def select_ancestors(weights, points):
    return np.minimum(np.searchsorted(np.cumsum(weights), points), len(weights) - 1)


def resample(weights, rng):
    P = len(weights)
    return select_ancestors(weights, (np.arange(P) + rng.random()) / P)


def sir_step(particles, weights, noise, points, z, H, R, model, threshold):
    P = len(weights)
    if effective_sample_size(weights) <= threshold * P:
        particles = particles[:, select_ancestors(weights, points)]
        weights = np.ones(P) / P
    return sis_step(particles, weights, noise, z, H, R, model)


def start(model, rng, P):
    n = len(model.m0)
    x = np.zeros((n, P))
    x[:2] = model.m0[:2, None]
    x[2:] = model.m0[2:, None] + np.linalg.cholesky(model.P0[2:, 2:]) @ rng.standard_normal((n - 2, P))
    return x, np.ones(P) / P


def run(problem, rng, P, threshold):
    model = problem.model
    x, w = start(model, rng, P)
    mean, cov = moments(x, w)
    means, covs, evidence, ess = [mean], [cov], [0.0], [P]
    for k in range(1, problem.n_instants):
        if effective_sample_size(w) <= threshold * P:
            x, w = x[:, resample(w, rng)], np.ones(P) / P
        noise = np.linalg.cholesky(model.Q) @ rng.standard_normal(x.shape)
        x = model.F @ x + model.B[:, None] + noise
        logs = log_likelihood(problem.z[k], x, problem.H[k], problem.R[k])
        evidence.append(evidence[-1] + evidence_increment(w, logs))
        w = weigh(w, logs)
        mean, cov = moments(x, w)
        means.append(mean)
        covs.append(cov)
        ess.append(effective_sample_size(w))
    return Filtered(np.array(means), np.array(covs), np.array(evidence), np.array(ess))


def sis(problem, rng, *, n_particles):
    return run(problem, rng, n_particles, 0)


def sir(problem, rng, *, n_particles, ess_threshold=0.5):
    return run(problem, rng, n_particles, ess_threshold)


def loop_closures(z, covs):
    seen = ~np.isnan(z[:, 0::2])
    found, gains = [], []
    for k in range(1, len(z)):
        for m in range(seen.shape[1]):
            if seen[k, m] and not seen[k - 1, m] and seen[:k, m].any():
                found.append((k, m))
                gain = []
                for i in range(seen.shape[1]):
                    block = slice(2 + 2 * i, 4 + 2 * i)
                    gain.append(1 - np.trace(covs[k][block, block]) / np.trace(covs[k - 1][block, block]))
                gains.append(gain)
    return found, gains


def mean_gap(filtered, exact):
    return np.sqrt(np.mean(((filtered.means[1:] - exact.means[1:]) / exact.stds[1:]) ** 2))


def study(problem, solver, sizes, runs, seed):
    means, covs = kalman_filter(problem)
    exact = Filtered(means, covs, np.zeros(len(means)))
    rng = np.random.default_rng(seed)
    table = []
    for size in sizes:
        gaps = [mean_gap(solver(problem, rng, n_particles=size), exact) for _ in range(runs)]
        table.append([size, np.mean(gaps), np.std(gaps, ddof=1) / np.sqrt(runs)])
    return table


def propose(particles, k, problem, rng):
    """Draw the robot from its optimal law, and leave the landmarks, unless the model moves them."""
    model, (z, H, R) = problem.model, problem.seen(k)
    Q = model.Q
    predicted = model.F @ particles + model.B[:, None]
    if len(z) == 0:
        return predicted + np.linalg.cholesky(Q) @ rng.standard_normal(predicted.shape), np.zeros(predicted.shape[1])
    S = H @ Q @ H.T + R
    d = z[:, None] - H @ predicted
    K = Q @ H.T @ np.linalg.inv(S)
    left = Q - K @ S @ K.T
    draws = np.linalg.cholesky(left + 1e-20 * np.eye(len(Q))) @ rng.standard_normal(predicted.shape)
    increments = -0.5 * (np.sum(d * np.linalg.solve(S, d), axis=0) + np.log(np.linalg.det(2 * np.pi * S)))
    return predicted + K @ d + draws, increments


def guided(problem, rng, *, n_particles):
    x, w = start(problem.model, rng, n_particles)
    mean, cov = moments(x, w)
    means, covs, evidence = [mean], [cov], [0.0]
    for k in range(1, problem.n_instants):
        if effective_sample_size(w) < n_particles / 2:
            x, w = x[:, resample(w, rng)], np.ones(n_particles) / n_particles
        x, logs = propose(x, k, problem, rng)
        evidence.append(evidence[-1] + evidence_increment(w, logs))
        w = weigh(w, logs)
        mean, cov = moments(x, w)
        means.append(mean)
        covs.append(cov)
    return Filtered(np.array(means), np.array(covs), np.array(evidence))


def rbpf_step(robots, means, cov, weights, noise, z, H, R, model):
    robots = model.F[:2, :2] @ robots + model.B[:2, None] + noise
    z, H, R = visible(z, H, R)
    if len(z) == 0:
        return robots, means, cov, weights
    L = H[:, 2:]
    d = z[:, None] - H[:, :2] @ robots - L @ means
    S = L @ cov @ L.T + R
    K = cov @ L.T @ np.linalg.inv(S)
    logs = -0.5 * np.sum(d * np.linalg.solve(S, d), axis=0)
    return robots, means + K @ d, cov - K @ S @ K.T, weigh(weights, logs)


def rbpf_moments(robots, means, cov, weights):
    mean, total = moments(np.vstack([robots, means]), weights)
    total[2:, 2:] += cov
    return mean, total


def rbpf(problem, rng, *, n_particles):
    model, P = problem.model, n_particles
    M2 = len(model.m0) - 2
    robots = np.repeat(model.m0[:2, None], P, axis=1)
    maps = np.repeat(model.m0[2:, None], P, axis=1)
    cov, w = model.P0[2:, 2:].copy(), np.ones(P) / P
    mean, total = rbpf_moments(robots, maps, cov, w)
    means, covs, evidence = [mean], [total], [0.0]
    for k in range(1, problem.n_instants):
        if effective_sample_size(w) < 0.5 * P:
            chosen = resample(w, rng)
            robots, maps, w = robots[:, chosen], maps[:, chosen], np.ones(P) / P
        noise = np.linalg.cholesky(model.Q[:2, :2]) @ rng.standard_normal((2, P))
        z, H, R = problem.seen(k)
        moved = model.F[:2, :2] @ robots + model.B[:2, None] + noise
        logs = np.zeros(P)
        if len(z):
            S = H[:, 2:] @ (cov + model.noise_cov[2:, 2:]) @ H[:, 2:].T + R
            d = z[:, None] - H[:, :2] @ moved - H[:, 2:] @ maps
            logs = -0.5 * (np.sum(d * np.linalg.solve(S, d), axis=0) + np.log(np.linalg.det(2 * np.pi * S)))
        evidence.append(evidence[-1] + evidence_increment(w, logs))
        robots, maps, cov, w = rbpf_step(robots, maps, cov, w, noise, problem.z[k], problem.H[k], problem.R[k], model)
        mean, total = rbpf_moments(robots, maps, cov, w)
        means.append(mean)
        covs.append(total)
    assert maps.shape[0] == M2
    return Filtered(np.array(means), np.array(covs), np.array(evidence))
