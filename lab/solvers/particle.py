"""The one particle loop, and the filters that are settings of it.

Question answered: what do weighted samples say about p(x_k given z_1..z_k)?

    resample   when ESS <= threshold * P          (before the step, so that moments always come from the weighted cloud)
    move       x_k^i ~ q(. given x_{k-1}^i, z_k)
    weight     w_k^i proportional to w_{k-1}^i * increment_i
    evidence   log p(z_1..z_k) += log sum_i w_{k-1}^i increment_i

SIS never resamples, SIR does when the effective sample size has fallen.  ESS hides that the map degenerates, so each
step also counts the distinct ancestors of time 0 still alive.  Source: questions 3, 4 and 6 of the handout; Doucet and
Johansen (2009).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from lab import gaussian, resampling, weights
from lab.problem import Problem
from lab.resampling import Ancestors, Resampler
from lab.result import Filtered, Step, collect
from lab.solvers.proposals import Cloud, prior
from lab.solvers.protocol import Proposal
from lab.validation import InputError, real_array, whole_number

ROUNDING = 1e-9  # relative: equal weights may sum to an ESS just above P, and must still trigger at a threshold of 1


def particle_steps(
    problem: Problem,
    rng: np.random.Generator,
    *,
    proposal: Proposal,
    n_particles: int,
    ess_threshold: float,
    resample: str | Resampler,
) -> Iterator[Step]:
    """Yield one `Step` per instant, k = 0 included.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
        All randomness.
    proposal : Proposal
        Moves the cloud; `lab.solvers.prior`, or a student's own.
    n_particles : int
        P, at least 1.
    ess_threshold : float
        In [0, 1]: resample when ESS <= threshold * P; at 0 never, at 1 at every instant, k = 0 included.
    resample : str or Resampler
        A scheme's name, or a function (weights, rng) -> ancestors.

    Raises
    ------
    InputError
        An argument is out of range, or every weight is zero at some k, which is named.
    """
    n_particles = whole_number("n_particles", n_particles, at_least=1)
    ess_threshold = float(real_array("ess_threshold", ess_threshold, ()))
    if not 0 <= ess_threshold <= 1:
        raise InputError(f"ess_threshold must lie between 0 and 1, not {ess_threshold}.")
    scheme = resampling.resolve(resample)
    even = np.full(n_particles, 1 / n_particles)
    start = problem.model.m0[:, np.newaxis] + gaussian.sample(problem.model.P0, n_particles, rng)
    cloud, w = Cloud(start, np.log(even)), even
    lineage = np.arange(n_particles)  # of each particle, its ancestor at time 0
    survivors, log_evidence = n_particles, 0.0
    yield Step(*weights.moments(cloud.particles, w), log_evidence, weights.ess(w), survivors, cloud)
    for k in range(1, problem.n_instants):
        if weights.ess(w) <= ess_threshold * n_particles * (1 + ROUNDING):
            ancestors = _checked(scheme(w, rng), n_particles)
            cloud, lineage = Cloud(cloud.particles[:, ancestors], np.log(even)), lineage[ancestors]
            survivors = len(np.unique(lineage))
        cloud, increment = proposal(cloud, k, problem, rng)
        if np.shape(increment) != (n_particles,):
            raise InputError(
                f"The proposal must return {n_particles} log-weight increments, not {np.shape(increment)}."
            )
        log_weights = cloud.log_weights + increment
        try:
            w, log_total = weights.normalise(log_weights)
        except InputError as error:
            raise InputError(f"At k = {k}: {error}") from None
        log_evidence += log_total
        cloud = replace(cloud, log_weights=log_weights - log_total)
        yield Step(*weights.moments(cloud.particles, w), log_evidence, weights.ess(w), survivors, cloud)


def sis(problem: Problem, rng: np.random.Generator, *, n_particles: int = 1000) -> Filtered:
    """Run sequential importance sampling: prior dynamics as importance function, no resampling.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
    n_particles : int
        P, at least 1.

    Returns
    -------
    Filtered

    Raises
    ------
    InputError
        As `particle_steps`.

    Notes
    -----
    Source: questions 3 and 4 of the handout.
    """
    return sir(problem, rng, n_particles=n_particles, ess_threshold=0.0)


def sir(
    problem: Problem,
    rng: np.random.Generator,
    *,
    n_particles: int = 1000,
    ess_threshold: float = 0.5,
    resample: str | Resampler = "systematic",
) -> Filtered:
    """Run sampling importance resampling: `sis` that resamples when the effective sample size has fallen.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
    n_particles : int
        P, at least 1.
    ess_threshold : float
        In [0, 1]: resample when ESS <= threshold * P; 0 is SIS, 1 resamples at every instant.
    resample : str or Resampler
        "systematic", "stratified", "residual", "multinomial", or a function (weights, rng) -> ancestors.

    Returns
    -------
    Filtered

    Raises
    ------
    InputError
        As `particle_steps`.

    Notes
    -----
    Source: questions 6 and 7 of the handout; Gordon, Salmond and Smith (1993).
    """
    return collect(
        particle_steps(
            problem, rng, proposal=prior, n_particles=n_particles, ess_threshold=ess_threshold, resample=resample
        )
    )


def _checked(ancestors: Any, n_particles: int) -> Ancestors:
    """Refuse what numpy would index with all the same: a student's scheme comes through here, too."""
    array = np.asarray(ancestors)
    if array.shape != (n_particles,) or array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= n_particles:
        raise InputError(f"The resampling scheme must return {n_particles} indices between 0 and {n_particles - 1}.")
    return array
