"""Densities by scipy, singular ones included."""

import numpy as np
from scipy.stats import chi2, multivariate_normal, norm


def log_prior(x, model):
    return multivariate_normal(model.m0, model.P0, allow_singular=True).logpdf(x)


def log_transition(x_next, x, model):
    return multivariate_normal.logpdf(x_next, model.F @ x + model.B, model.noise_cov, allow_singular=True)


def log_likelihood(z, particles, H, R):
    rows = np.flatnonzero(~np.isnan(z))
    if rows.size == 0:
        return np.zeros(particles.shape[1])
    law = multivariate_normal(np.zeros(rows.size), R[np.ix_(rows, rows)])
    return np.array([law.logpdf(z[rows] - H[rows] @ x) for x in particles.T])


def corridor(means, covs):
    half = norm.ppf(0.9985) * np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    return means - half, means + half


def confidence_ellipse(mean, cov, n_points=100):
    u, s, _ = np.linalg.svd(cov)
    t = np.linspace(np.pi, -np.pi, n_points)
    return (mean[:, None] + u @ np.diag(np.sqrt(chi2.ppf(0.99, df=2) * s)) @ np.vstack((np.cos(t), np.sin(t)))).T


def effective_sample_size(weights):
    P = len(weights)
    return P / (1 + np.var(P * np.asarray(weights)))


def rbpf_moments(robots, means, cov, weights):
    x = np.vstack([robots, means])
    total = np.cov(x, aweights=weights, ddof=0) + np.pad(cov, ((2, 0), (2, 0)))
    return np.average(x, axis=1, weights=weights), total
