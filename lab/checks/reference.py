"""A right answer to every question with code, under its name in the table.

Question answered: what is a student's answer compared with, and what stands in for one that is missing while the others
are graded?  Steps come from `lab.checks.recipes`, the particle filters from `lab.solvers`; the tests hold each against
something independent.
"""

from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from lab import resampling, solvers
from lab.checks import ekf_reference, recipes
from lab.checks.ekf_reference import *  # noqa: F403 - its names are listed there
from lab.checks.recipes import effective_sample_size, log_gaussian, select_ancestors
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array

RADIUS = float(np.sqrt(stats.chi2.ppf(0.99, 2)))  # of the 99 % ellipse in deviations
MARGIN = 1e-9  # m: rounding, where a component is known exactly

kalman_step = recipes.kalman_step_with()
kalman_filter = recipes.kalman_filter_with()
log_likelihood = recipes.log_likelihood_with()
sis_step = recipes.sis_step_with()
jittered_step = recipes.jittered_step_with()
sir_step = recipes.sir_step_with()
rbpf_step = recipes.rbpf_step_with()


def log_prior(x: Array, model: Any) -> float:
    """Return log p(x_0) of the components that have a variance."""
    return _singular(np.asarray(x) - model.m0, model.P0)


def log_transition(x_next: Array, x: Array, model: Any) -> float:
    """Return log p(x_next given x) of the components that have noise."""
    return _singular(np.asarray(x_next) - model.F @ x - model.B, model.noise_cov)


def _singular(deviation: Array, cov: Array) -> float:
    """Return the log-density of a Gaussian on the components with a variance, -inf off its support."""
    free = np.diag(cov) > 0
    if np.abs(deviation[~free]).max(initial=0) > MARGIN:
        return -np.inf
    return float(log_gaussian(deviation[free, np.newaxis], cov[np.ix_(free, free)])[0])


def evidence_increment(weights: Array, log_likelihoods: Array) -> float:
    """Return log sum_i w_i exp(l_i)."""
    top = np.max(log_likelihoods[weights > 0])
    with np.errstate(over="ignore"):  # a particle without weight may have any likelihood
        return float(top + np.log(np.sum(weights[weights > 0] * np.exp(log_likelihoods[weights > 0] - top))))


def moments(particles: Array, weights: Array) -> tuple[Array, Array]:
    """Return mean and covariance of a weighted cloud."""
    mean = particles @ weights
    centred = particles - mean[:, np.newaxis]
    return mean, (weights * centred) @ centred.T


def corridor(means: Array, covs: Array) -> tuple[Array, Array]:
    """Return means -+ 3 deviations."""
    reach = 3 * np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    return means - reach, means + reach


def confidence_ellipse(mean: Array, cov: Array, n_points: int = 100) -> Array:
    """Return points on the boundary of the 99 % ellipse."""
    angles = np.linspace(0, 2 * np.pi, n_points)
    values, vectors = np.linalg.eigh(cov)
    circle = np.array([np.cos(angles), np.sin(angles)])
    return np.asarray(mean[:, np.newaxis] + RADIUS * vectors @ (np.sqrt(values)[:, np.newaxis] * circle))


def resample(weights: Array, rng: np.random.Generator) -> Any:
    """Return ancestors, systematic."""
    return resampling.systematic(weights, rng)


def loop_closures(z: Array, covs: Array) -> tuple[Any, Array]:
    """Return (k, landmark) of every loop closure, and what it does to each landmark's variance."""
    seen = ~np.isnan(z[:, ::2])
    before = np.cumsum(seen, axis=0) > 0
    closing = [
        (k, m)
        for k in range(2, len(z))
        for m in range(seen.shape[1])
        if seen[k, m] and not seen[k - 1, m] and before[k - 1, m]
    ]
    closures = np.array(closing, dtype=int).reshape(-1, 2)
    variances = np.diagonal(covs, axis1=1, axis2=2)[:, 2:]
    traces = variances[:, ::2] + variances[:, 1::2]
    return closures, 1 - traces[closures[:, 0]] / traces[closures[:, 0] - 1]


def mean_gap(filtered: Filtered, exact: Filtered) -> float:
    """Return the root mean square gap in exact deviations, over k >= 1."""
    stds = np.sqrt(np.diagonal(exact.covs, axis1=1, axis2=2))
    return float(np.sqrt(np.mean(((filtered.means - exact.means)[1:] / stds[1:]) ** 2)))


def study(problem: Problem, solver: Any, sizes: Any, runs: int, seed: int) -> Array:
    """Return a row per size: P, mean gap, its standard error."""
    exact = solvers.kalman(problem)
    rows = []
    for size in sizes:
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence((seed, size)).spawn(runs)]
        gaps = [mean_gap(solver(problem, rng, n_particles=size), exact) for rng in streams]
        rows.append((size, np.mean(gaps), np.std(gaps, ddof=1) / np.sqrt(runs)))
    return np.array(rows)


def propose(particles: Array, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw from p(x_k given x_{k-1}, z_k)."""
    model, (z, H, R) = problem.model, problem.seen(k)
    predicted = model.F @ particles + model.B[:, np.newaxis]
    nu, S = z[:, np.newaxis] - H @ predicted, H @ model.noise_cov @ H.T + R
    K = np.linalg.solve(S, H @ model.noise_cov).T
    left = model.noise_cov - K @ H @ model.noise_cov
    values, vectors = np.linalg.eigh((left + left.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0))
    increments = log_gaussian(nu, S) if len(z) else np.zeros(particles.shape[1])
    return predicted + K @ nu + root @ rng.standard_normal(particles.shape), increments


def rbpf_moments(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """Return the moments of the mixture by the law of total covariance."""
    mean, total = moments(np.vstack([robots, means]), weights)
    total[2:, 2:] += cov
    return mean, total


sis = solvers.sis
sir = solvers.sir
guided = partial(solvers.guided, proposal="optimal")
rbpf = solvers.rbpf

__all__ = [
    *ekf_reference.__all__,
    "confidence_ellipse",
    "corridor",
    "effective_sample_size",
    "evidence_increment",
    "guided",
    "jittered_step",
    "kalman_filter",
    "kalman_step",
    "log_likelihood",
    "log_prior",
    "log_transition",
    "loop_closures",
    "mean_gap",
    "moments",
    "propose",
    "rbpf",
    "rbpf_moments",
    "rbpf_step",
    "resample",
    "select_ancestors",
    "sir",
    "sir_step",
    "sis",
    "sis_step",
    "study",
]
