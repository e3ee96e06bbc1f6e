"""Everything in loops over particles and components."""

import math

import numpy as np


def log_likelihood(z, particles, H, R):
    values = []
    rows = [i for i in range(len(z)) if not math.isnan(z[i])]
    Rk = np.array([[R[i, j] for j in rows] for i in rows]).reshape(len(rows), len(rows))
    for p in range(particles.shape[1]):
        if not rows:
            values.append(0.0)
            continue
        d = np.array([z[i] - sum(H[i, j] * particles[j, p] for j in range(len(particles))) for i in rows])
        q = float(d @ np.linalg.solve(Rk, d))
        values.append(-0.5 * q - 0.5 * math.log(np.linalg.det(Rk)) - len(rows) / 2 * math.log(2 * math.pi))
    return values


def sis_step(particles, weights, noise, z, H, R, model):
    n, P = particles.shape
    new = np.zeros((n, P))
    for p in range(P):
        new[:, p] = model.F @ particles[:, p] + model.B + noise[:, p]
    logs = log_likelihood(z, new, H, R)
    top = max(value for value, w in zip(logs, weights, strict=True) if w > 0)
    w = [old * math.exp(value - top) for old, value in zip(weights, logs, strict=True)]
    return new, [value / sum(w) for value in w]


def moments(particles, weights):
    n, P = particles.shape
    mean = np.zeros(n)
    for p in range(P):
        mean += weights[p] * particles[:, p]
    cov = np.zeros((n, n))
    for p in range(P):
        d = particles[:, p] - mean
        cov += weights[p] * np.outer(d, d)
    return mean, cov


def effective_sample_size(weights):
    total = 0.0
    for w in weights:
        total += w * w
    return 1.0 / total


def select_ancestors(weights, points):
    ancestors, i, c = [], 0, weights[0]
    for u in points:
        while u > c and i < len(weights) - 1:
            i += 1
            c += weights[i]
        ancestors.append(i)
    return ancestors


def resample(weights, rng):
    ancestors = []
    for _ in weights:
        u, c = rng.random(), 0.0
        for i, w in enumerate(weights):
            c += w
            if u < c:
                ancestors.append(i)
                break
        else:
            ancestors.append(int(np.argmax(weights)))
    return ancestors


def evidence_increment(weights, log_likelihoods):
    top = max(log_likelihoods)
    return math.log(sum(w * math.exp(v - top) for w, v in zip(weights, log_likelihoods, strict=True))) + top


def corridor(means, covs):
    lower, upper = means.copy(), means.copy()
    for k in range(len(means)):
        for i in range(means.shape[1]):
            half = 3 * math.sqrt(covs[k, i, i])
            lower[k, i] -= half
            upper[k, i] += half
    return lower, upper


def confidence_ellipse(mean, cov, n_points=100):
    values, vectors = np.linalg.eigh(cov)
    points = []
    for i in range(n_points):
        t = 2 * math.pi * i / n_points
        a = math.sqrt(9.21034037197618 * values[0]) * math.cos(t)
        b = math.sqrt(9.21034037197618 * values[1]) * math.sin(t)
        points.append(mean + a * vectors[:, 0] + b * vectors[:, 1])
    return points


def mean_gap(filtered, exact):
    total, count = 0.0, 0
    for k in range(1, len(exact.means)):
        for i in range(exact.means.shape[1]):
            total += (filtered.means[k, i] - exact.means[k, i]) ** 2 / exact.covs[k, i, i]
            count += 1
    return math.sqrt(total / count)
