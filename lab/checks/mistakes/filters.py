"""Mistakes of whole particle filters that have no limit in closed form: they are run.

Question answered: with which mistake in choosing, weighing or copying particles does a filter give these results?  A
mistaken filter of our own runs as often as the answer did, and a t-statistic of two samples says whether they differ:
on means, covariances and log-evidence, at every instant.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from lab.checks import recipes, reference
from lab.checks.recipes import log_gaussian, log_likelihood_with, normalised, select_ancestors
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array

Solver = Callable[..., Filtered]
FEW, RUNS = 15, 60  # of a mistaken filter, at first and at most
ALIKE = 5.0  # the largest of about 225 t-statistics between samples of one law is mostly below it


def _even(weights: Array) -> Array:
    return np.full(len(weights), 1 / len(weights))


def _start(model: Any, rng: np.random.Generator, P: int) -> Array:
    cloud = np.repeat(model.m0[:, np.newaxis], P, axis=1)
    cloud[2:] += np.linalg.cholesky(model.P0[2:, 2:]) @ rng.standard_normal((len(cloud) - 2, P))
    return cloud


def _prior(cloud: Array, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Array, Array]:
    model = problem.model
    noise = np.zeros(cloud.shape)
    noise[:2] = np.linalg.cholesky(model.Q[:2, :2]) @ rng.standard_normal((2, cloud.shape[1]))
    new = recipes.moved(cloud, noise, model)
    return new, log_likelihood_with()(problem.z[k], new, problem.H[k], problem.R[k])


def _turned_back(cloud: Array, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Array, Array]:
    """Move with F transposed."""
    model = replace(problem.model, F=problem.model.F.T)
    return _prior(cloud, k, replace(problem, model=model), rng)


def _likeliest(cloud: Array, weights: Array) -> tuple[Array, Array]:
    mean = cloud[:, np.argmax(weights)]
    d = cloud - mean[:, np.newaxis]
    return mean, (d * weights) @ d.T


def _optimal(weigh: Callable[..., Array]) -> Callable[..., tuple[Array, Array]]:
    """Draw the robot given parent and measurement; `weigh` gives the weight."""

    def propose(cloud: Array, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Array, Array]:
        model, (z, H, R) = problem.model, problem.seen(k)
        if not len(z):
            return _prior(cloud, k, problem, rng)[0], np.zeros(cloud.shape[1])
        Q, predicted = model.noise_cov[:2, :2], model.F @ cloud + model.B[:, np.newaxis]
        S = H[:, :2] @ Q @ H[:, :2].T + R
        K = np.linalg.solve(S, H[:, :2] @ Q).T
        nu, new = z[:, np.newaxis] - H @ predicted, predicted.copy()
        left = np.linalg.cholesky(Q - K @ H[:, :2] @ Q)
        new[:2] += K @ nu + left @ rng.standard_normal((2, cloud.shape[1]))
        return new, weigh(nu, z[:, np.newaxis] - H @ new, R, S)

    return propose


def _cloud_filter(
    *,
    propose: Callable[..., tuple[Array, Array]] = _prior,
    choose: Callable[..., Any] = select_ancestors,
    renew: Callable[..., tuple[Array, Array]] = recipes.resampled,
    combine: Callable[[Array, Array], Array] = normalised,
    carried: Callable[[Array], Array] = lambda weights: weights,
    summary: Callable[[Array, Array], tuple[Array, Array]] = reference.moments,
    threshold: float = 0.5,
) -> Solver:
    """Build a filter; `carried` gives the weights with which the log-evidence is averaged, `summary` its moments."""

    def solver(problem: Problem, rng: np.random.Generator, *, n_particles: int) -> Filtered:
        P = n_particles
        cloud, weights = _start(problem.model, rng, P), np.full(P, 1 / P)
        rows, evidence = [summary(cloud, weights)], [0.0]
        for k in range(1, problem.n_instants):
            if recipes.effective_sample_size(weights) <= threshold * P:
                points = (np.arange(P) + rng.random()) / P
                cloud, weights = renew(cloud, weights, choose(weights, points))
            cloud, logs = propose(cloud, k, problem, rng)
            evidence.append(evidence[-1] + reference.evidence_increment(carried(weights), logs))
            weights = combine(weights, logs)
            rows.append(summary(cloud, weights))
        means, covs = (np.array(column) for column in zip(*rows, strict=True))
        return Filtered(means, covs, np.array(evidence))

    return solver


def _rao_blackwell(
    *,
    step: Callable[..., Any] | None = None,
    weigh_with_R: bool = False,
    copy: str = "robots maps",
    reset: bool = True,
    choose: Callable[..., Any] = select_ancestors,
) -> Solver:
    """Build a Rao-Blackwellized filter; `copy` says what is chosen when it resamples."""
    step = step or recipes.rbpf_step_with()

    def solver(problem: Problem, rng: np.random.Generator, *, n_particles: int) -> Filtered:
        model, P = problem.model, n_particles
        robots, maps = (np.repeat(part[:, np.newaxis], P, axis=1) for part in (model.m0[:2], model.m0[2:]))
        cov, weights = model.P0[2:, 2:], np.full(P, 1 / P)
        rows, evidence = [reference.rbpf_moments(robots, maps, cov, weights)], [0.0]
        for k in range(1, problem.n_instants):
            if recipes.effective_sample_size(weights) <= P / 2:
                chosen = choose(weights, (np.arange(P) + rng.random()) / P)
                robots = robots[:, chosen] if "robots" in copy else robots
                maps = maps[:, chosen] if "maps" in copy else maps
                weights = _even(weights) if reset else weights
            noise = np.linalg.cholesky(model.Q[:2, :2]) @ rng.standard_normal((2, P))
            logs, (z, H, R) = np.zeros(P), problem.seen(k)
            if len(z):
                moved = model.F[:2, :2] @ robots + model.B[:2, np.newaxis] + noise
                spread = R if weigh_with_R else H[:, 2:] @ cov @ H[:, 2:].T + R
                logs = log_gaussian(z[:, np.newaxis] - H @ np.vstack([moved, maps]), spread)
            evidence.append(evidence[-1] + reference.evidence_increment(weights, logs))
            given = (robots, maps, cov, weights, noise, problem.z[k], problem.H[k], problem.R[k], model)
            robots, maps, cov, weights = step(*given)
            rows.append(reference.rbpf_moments(robots, maps, cov, weights))
        means, covs = (np.array(column) for column in zip(*rows, strict=True))
        return Filtered(means, covs, np.array(evidence))

    return solver


def _part_chosen(robots: bool) -> Callable[..., tuple[Array, Array]]:
    def renew(cloud: Array, weights: Array, ancestors: Any) -> tuple[Array, Array]:
        new = cloud.copy()
        part = slice(0, 2) if robots else slice(2, None)
        new[part] = cloud[part, ancestors]
        return new, _even(weights)

    return renew


def _in_any_order(weights: Array, points: Array) -> Any:
    """Choose as independent draws would: neighbours in the new cloud are strangers."""
    order = np.random.default_rng(int(1e9 * points[0])).permutation(len(points))
    return select_ancestors(weights, points)[order]


def _plain_mean(cloud: Array, weights: Array) -> tuple[Array, Array]:
    """Weigh the spread, but not the mean."""
    mean = cloud.mean(axis=1)
    d = cloud - mean[:, np.newaxis]
    return mean, (d * weights) @ d.T


def _plain_spread(divisor: int, about_mean: bool) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Weigh the mean, but not the spread, about it or about the plain mean."""

    def summary(cloud: Array, weights: Array) -> tuple[Array, Array]:
        mean = cloud @ weights
        d = cloud - (mean if about_mean else cloud.mean(axis=1))[:, np.newaxis]
        return mean, d @ d.T / (cloud.shape[1] - divisor)

    return summary


def _best_half(weights: Array, points: Array) -> Any:
    best = np.argsort(-weights)[: (len(weights) + 1) // 2]
    return np.resize(best, len(weights))


@cache
def _solvers(question: str) -> tuple[tuple[str, Solver], ...]:
    overwritten = {"combine": lambda weights, logs: normalised(_even(weights), logs)}
    if question == "q4-filter":
        return (
            ("f-transposed", _cloud_filter(propose=_turned_back, threshold=0.0)),
            ("likeliest-particle", _cloud_filter(summary=_likeliest, threshold=0.0)),
            ("weights-ignored", _cloud_filter(summary=_plain_spread(1, False), threshold=0.0)),
        )
    if question == "q6-filter":
        return (
            ("f-transposed", _cloud_filter(propose=_turned_back)),
            ("likeliest-particle", _cloud_filter(summary=_likeliest)),
            ("weights-permuted", _cloud_filter(renew=lambda x, w, a: (x[:, a], w[a] / w[a].sum()))),
            ("weights-permuted", _cloud_filter(renew=lambda x, w, a: (x[:, a], w[a]))),
            ("evidence-summed", _cloud_filter(renew=lambda x, w, a: (x[:, a], np.ones(len(w))))),
            ("weights-ignored", _cloud_filter(summary=_plain_mean)),
            ("weights-ignored", _cloud_filter(summary=lambda x, w: (x.mean(axis=1), np.cov(x)))),
            ("weights-ignored", _cloud_filter(summary=_plain_spread(0, True))),
            ("weights-ignored", _cloud_filter(summary=_plain_spread(1, False))),
            ("weights-not-reset", _cloud_filter(renew=lambda x, w, a: (x[:, a], w))),
            ("weights-overwritten", _cloud_filter(**overwritten)),  # type: ignore[arg-type]
            ("robot-resampled-only", _cloud_filter(renew=_part_chosen(True))),
            ("landmarks-resampled-only", _cloud_filter(renew=_part_chosen(False))),
            ("robot-resampled-only", _cloud_filter(choose=_in_any_order, renew=_part_chosen(True))),
            ("landmarks-resampled-only", _cloud_filter(choose=_in_any_order, renew=_part_chosen(False))),
            ("particles-not-resampled", _cloud_filter(renew=lambda x, w, a: (x, _even(w)))),
            ("uniform-choice", _cloud_filter(renew=lambda x, w, a: (x, _even(w)))),
            ("ancestor-shifted", _cloud_filter(choose=lambda w, u: select_ancestors(w, u) - 1)),
            ("ancestor-shifted", _cloud_filter(choose=lambda w, u: (select_ancestors(w, u) + 1) % len(w))),
            ("resampling-biased", _cloud_filter(choose=_best_half)),
            ("evidence-not-carried", _cloud_filter(carried=_even)),
        )
    if question == "q9-filter":
        right = _optimal(lambda nu, after, R, S: log_gaussian(nu, S))
        R_only = _optimal(lambda nu, after, R, S: log_gaussian(nu, R))
        after = _optimal(lambda nu, after, R, S: log_gaussian(after, R))
        none = _optimal(lambda nu, after, R, S: np.zeros(nu.shape[1]))
        return (
            ("weights-overwritten", _cloud_filter(propose=right, **overwritten)),  # type: ignore[arg-type]
            ("ratio-dropped", _cloud_filter(propose=after)),
            ("parent-without-noise", _cloud_filter(propose=R_only)),
            ("weight-ignores-z", _cloud_filter(propose=none)),
        )
    if question == "q10-filter":
        no_cov = recipes.rbpf_step_with(new_cov=lambda cov, K, H: cov)
        no_means = recipes.rbpf_step_with(new_means=lambda means, K, nu, weights: means)
        R_step = recipes.rbpf_step_with(weight_spread=lambda cov, H, R: R)
        return (
            ("robot-resampled-only", _rao_blackwell(copy="robots")),
            ("landmarks-resampled-only", _rao_blackwell(copy="maps")),
            ("robot-resampled-only", _rao_blackwell(copy="robots", choose=_in_any_order)),
            ("landmarks-resampled-only", _rao_blackwell(copy="maps", choose=_in_any_order)),
            ("particles-not-resampled", _rao_blackwell(copy="")),
            ("weights-not-reset", _rao_blackwell(reset=False)),
            ("rb-without-landmarks", _rao_blackwell(step=R_step, weigh_with_R=True)),
            ("rb-without-landmarks", _rao_blackwell(step=R_step)),
            ("rb-without-landmarks", _rao_blackwell(weigh_with_R=True)),
            ("rb-cov-not-updated", _rao_blackwell(step=no_cov)),
            ("rb-means-not-updated", _rao_blackwell(step=no_means)),
        )
    return ()


def simulated(question: str, problem: Problem, runs: list[Filtered], n_particles: int) -> Iterator[str]:
    """Yield the mistakes whose filters, run as often, give the same averages as these runs."""
    answered = _flat(runs)
    for number, (key, solver) in enumerate(_solvers(question)):
        few, many = min(FEW, len(runs)), min(RUNS, len(runs))
        mistaken = _runs(solver, problem, n_particles, number, range(few))
        if _differ(answered, mistaken) > 2 * ALIKE:
            continue  # most do, at once
        mistaken += _runs(solver, problem, n_particles, number, range(few, many))
        if _differ(answered, mistaken) <= ALIKE:
            yield key


def _runs(solver: Solver, problem: Problem, n_particles: int, number: int, which: range) -> list[Filtered]:
    with np.errstate(all="ignore"):
        return [solver(problem, np.random.default_rng((91, number, run)), n_particles=n_particles) for run in which]


def _differ(answered: Array, runs: list[Filtered]) -> float:
    """Return the largest t-statistic between two samples."""
    mistaken = _flat(runs)
    gaps = np.abs(answered.mean(axis=0) - mistaken.mean(axis=0))
    errors = np.sqrt(answered.var(axis=0, ddof=1) / len(answered) + mistaken.var(axis=0, ddof=1) / len(mistaken))
    return float((gaps / np.maximum(errors, 1e-9)).max())


def _flat(runs: list[Filtered]) -> Array:
    """Return every number of each run (runs, numbers)."""
    return np.array([np.concatenate([run.means.ravel(), run.covs.ravel(), run.log_evidence]) for run in runs])
