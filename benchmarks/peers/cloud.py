"""The data of the particle filters, and what several peers share; needs numpy alone, in any version."""

import sys
from types import SimpleNamespace

import numpy as np


def load():
    """Return the model, what was seen, P particles, the file for the answer, and what is left of the command line."""
    data, answer, particles, *rest = sys.argv[1:]
    with np.load(data) as file:
        given = SimpleNamespace(**dict(file))
    given.N, given.n, given.P, given.answer, given.rest = len(given.z), len(given.m0), int(particles), answer, rest
    given.seen = []  # z (p,), H (p, n), R (p, p) at each instant; p may be 0
    for z, H, R in zip(given.z, given.H, given.R):  # noqa: B905 (also for old Pythons)
        rows = np.flatnonzero(~np.isnan(z))
        given.seen.append((z[rows], H[rows], R[np.ix_(rows, rows)]))
    given.root_P0, given.root_Q = root(given.P0), root(given.Q)
    return given


def root(cov):
    """Return L (n, d) with L L' = cov, semidefinite."""
    values, vectors = np.linalg.eigh(cov)
    kept = values > 1e-14 * values.max()
    return vectors[:, kept] * np.sqrt(values[kept])


def whitening(R):
    """Return W with W R W' = I, and the log of the density's constant."""
    factor = np.linalg.cholesky(R)
    return np.linalg.inv(factor), -np.log(np.diag(factor)).sum() - len(R) / 2 * np.log(2 * np.pi)


def moments(x, w):
    """Return mean (n,) and covariance (n, n) of particles (P, n)."""
    mean = w @ x
    centred = x - mean
    return mean, (w[:, None] * centred).T @ centred


def stacked(pairs):
    """Return the answer that the driver compares."""
    means, covs = zip(*pairs)  # noqa: B905
    return {"means": np.array(means), "covs": np.array(covs)}


def systematic(w, rng):
    """Return ancestors (P,) by systematic resampling, as one writes it in numpy."""
    total = np.cumsum(w)
    return np.minimum(np.searchsorted(total / total[-1], (rng.random() + np.arange(len(w))) / len(w)), len(w) - 1)
