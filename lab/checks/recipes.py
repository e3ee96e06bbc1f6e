"""The answers as recipes, each ingredient of which can be exchanged for a mistaken one.

Question answered: what does a right step return, and what one with a given mistake?  A builder such as
`kalman_step_with` returns the function of that name in the table of questions; called without arguments it builds the
right one, and with one ingredient exchanged a mutant.  So a mistake is a line in `lab.checks.mistakes`, and applies to
every question into which the ingredient goes.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from lab.validation import Array

Seen = tuple[Any, Any, Any]
Function = Callable[..., Any]


def seen(z: Array, H: Array, R: Array) -> Seen:
    """Return what is seen: rows of z and H, rows and columns of R."""
    rows = np.flatnonzero(~np.isnan(z))
    return z[rows], H[rows], R[np.ix_(rows, rows)]


def log_gaussian(deviation: Array, cov: Array) -> Array:
    """Return log N(deviation; 0, cov) for every column of `deviation` (p, P)."""
    quadratic = np.sum(deviation * np.linalg.solve(cov, deviation), axis=0)
    return np.asarray(-0.5 * (quadratic + np.linalg.slogdet(cov)[1] + len(cov) * np.log(2 * np.pi)))


def normalised(weights: Array, log_likelihoods: Array) -> Array:
    """Return weights times likelihoods, summing to 1, through log space."""
    with np.errstate(divide="ignore"):
        logs = np.log(weights) + log_likelihoods
    scaled = np.exp(logs - np.max(logs))
    return np.asarray(scaled / scaled.sum())


def effective_sample_size(weights: Array) -> float:
    """Return 1 / sum w^2."""
    return float(1 / np.sum(weights**2))


def kalman_step_with(
    *,
    select: Function = seen,
    predicted_mean: Function = lambda mean, model: model.F @ mean + model.B,
    predicted_cov: Function = lambda cov, model: model.F @ cov @ model.F.T + model.Q,
    innovation: Function = lambda z, H, predicted, mean: z - H @ predicted,
    spread: Function = lambda P, H, R: H @ P @ H.T + R,
    gain: Function = lambda P, H, S: np.linalg.solve(S, H @ P).T,
    new_mean: Function = lambda predicted, K, nu: predicted + K @ nu,
    new_cov: Function = lambda P, K, H, S, nu: P - K @ H @ P,
    finish: Function = lambda new, predicted, old: new,
) -> Function:
    """Build kalman_step(mean, cov, z, H, R, model)."""

    def kalman_step(mean: Array, cov: Array, z: Array, H: Array, R: Array, model: Any) -> tuple[Array, Array]:
        z, H, R = select(z, H, R)
        predicted, P = predicted_mean(mean, model), predicted_cov(cov, model)
        if not len(z):
            return finish((predicted, P), (predicted, P), (mean, cov))  # type: ignore[no-any-return]
        nu, S = innovation(z, H, predicted, mean), spread(P, H, R)
        K = gain(P, H, S)
        new = new_mean(predicted, K, nu), new_cov(P, K, H, S, nu)
        return finish(new, (predicted, P), (mean, cov))  # type: ignore[no-any-return]

    return kalman_step


def kalman_filter_with(
    step: Function | None = None,
    *,
    measured: Function = lambda problem, k: (problem.z[k], problem.H[k], problem.R[k]),
    start: Function = lambda model: (model.m0, model.P0),
    carry: Function = lambda new, start: new,
) -> Function:
    """Build kalman_filter(problem)."""
    step = step or kalman_step_with()

    def kalman_filter(problem: Any) -> tuple[Array, Array]:
        first = start(problem.model)
        rows, state = [first], first
        for k in range(1, problem.n_instants):
            new = step(*state, *measured(problem, k), problem.model)
            rows.append(new)
            state = carry(new, first)
        return np.array([mean for mean, _ in rows]), np.array([cov for _, cov in rows])

    return kalman_filter


def log_likelihood_with(
    *,
    select: Function = seen,
    innovation: Function = lambda z, H, particles: z[:, np.newaxis] - H @ particles,
    noise: Function = lambda R: R,
    density: Function = log_gaussian,
) -> Function:
    """Build log_likelihood(z, particles, H, R)."""

    def log_likelihood(z: Array, particles: Array, H: Array, R: Array) -> Array:
        z, H, R = select(z, H, R)
        if not len(z):
            return np.zeros(particles.shape[1])
        return np.asarray(density(innovation(z, H, particles), noise(R)))

    return log_likelihood


def moved(particles: Array, noise: Array, model: Any) -> Array:
    """Return F x + B + w for every particle."""
    return np.asarray(model.F @ particles + model.B[:, np.newaxis] + noise)


def sis_step_with(
    *,
    move: Function = moved,
    likelihood: Function | None = None,
    weighed: Function = lambda old, new: new,
    combine: Function = normalised,
    even_when_blind: bool = False,
) -> Function:
    """Build sis_step(particles, weights, noise, z, H, R, model); `weighed` picks the cloud whose likelihood counts."""
    likelihood = likelihood or log_likelihood_with()

    def sis_step(
        particles: Array, weights: Array, noise: Array, z: Array, H: Array, R: Array, model: Any
    ) -> tuple[Array, Array]:
        new = move(particles, noise, model)
        if even_when_blind and np.isnan(z).all():
            return new, np.full(len(weights), 1 / len(weights))
        return new, combine(weights, likelihood(z, weighed(particles, new), H, R))

    return sis_step


def jittered_step_with(
    step: Function | None = None,
    *,
    shift: Function = lambda jitter, z: jitter,
    after: bool = False,
) -> Function:
    """Build jittered_step(particles, weights, noise, jitter, z, H, R, model); `after` moves the landmarks too late."""
    step = step or sis_step_with()

    def jittered_step(
        particles: Array, weights: Array, noise: Array, jitter: Array, z: Array, H: Array, R: Array, model: Any
    ) -> tuple[Array, Array]:
        extra = np.vstack([np.zeros((2, particles.shape[1])), shift(jitter, z)])
        new, weights = step(particles, weights, noise if after else noise + extra, z, H, R, model)
        return (new + extra if after else new), weights

    return jittered_step


def select_ancestors(weights: Array, points: Array) -> Any:
    """Return the particles in whose share of [0, 1) the points fall."""
    cumulative = np.cumsum(weights / np.sum(weights))
    cumulative[np.flatnonzero(weights)[-1] :] = np.inf
    return np.searchsorted(cumulative, points, side="right")


def resampled(particles: Array, weights: Array, ancestors: Any) -> tuple[Array, Array]:
    """Return the chosen particles with even weights."""
    return particles[:, ancestors], np.full(len(weights), 1 / len(weights))


def sir_step_with(
    step: Function | None = None,
    *,
    due: Function = lambda weights, threshold: effective_sample_size(weights) <= threshold * len(weights),
    choose: Function = select_ancestors,
    replace: Function = resampled,
    last: bool = False,
) -> Function:
    """Build sir_step(particles, weights, noise, points, z, H, R, model, threshold); `last` resamples at the end."""
    step = step or sis_step_with()

    def sir_step(
        particles: Array,
        weights: Array,
        noise: Array,
        points: Array,
        z: Array,
        H: Array,
        R: Array,
        model: Any,
        threshold: float,
    ) -> tuple[Array, Array]:
        if last:
            particles, weights = step(particles, weights, noise, z, H, R, model)
        if due(weights, threshold):
            particles, weights = replace(particles, weights, choose(weights, points))
        if not last:
            particles, weights = step(particles, weights, noise, z, H, R, model)
        return particles, weights

    return sir_step


def rbpf_step_with(
    *,
    select: Function = seen,
    move: Function = lambda robots, noise, model: moved(robots, noise, _robot_of(model)),
    predicted_cov: Function = lambda cov, model: cov + model.Q[2:, 2:],
    innovation: Function = lambda z, H, robots, means: z[:, np.newaxis] - H[:, :2] @ robots - H[:, 2:] @ means,
    spread: Function = lambda cov, H, R: H[:, 2:] @ cov @ H[:, 2:].T + R,
    weight_spread: Function | None = None,
    gain: Function = lambda cov, H, S: np.linalg.solve(S, H[:, 2:] @ cov).T,
    new_means: Function = lambda means, K, nu, weights: means + K @ nu,
    new_cov: Function = lambda cov, K, H: cov - K @ H[:, 2:] @ cov,
    combine: Function = normalised,
    density: Function = log_gaussian,
    weigh_late: bool = False,
    old_robots: bool = False,
) -> Function:
    """Build rbpf_step(robots, means, cov, weights, noise, z, H, R, model)."""

    def rbpf_step(
        robots: Array,
        means: Array,
        cov: Array,
        weights: Array,
        noise: Array,
        z: Array,
        H: Array,
        R: Array,
        model: Any,
    ) -> tuple[Array, Array, Array, Array]:
        z, H, R = select(z, H, R)
        new, cov = move(robots, noise, model), predicted_cov(cov, model)
        if not len(z):
            return new, means, cov, combine(weights, np.zeros(len(weights)))
        used = robots if old_robots else new
        S = spread(cov, H, R)
        K = gain(cov, H, S)
        nu = innovation(z, H, used, means)
        later = new_means(means, K, nu, weights)
        weighing = innovation(z, H, used, later) if weigh_late else nu
        S = weight_spread(cov, H, R) if weight_spread else S
        weights = combine(weights, density(weighing, S))
        return new, later, new_cov(cov, K, H), weights

    return rbpf_step


class _robot_of:
    """The robot's part of a model, with the names of the whole."""

    def __init__(self, model: Any) -> None:
        self.F, self.B = model.F[:2, :2], model.B[:2]
