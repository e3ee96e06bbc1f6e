"""The one particle loop, and the filters that are settings of it.

Question answered: what do weighted samples say about p(x_k given z_1..z_k)?

    resample   when ESS <= threshold * P          (before the step, so that moments always come from the weighted cloud)
    move       x_k^i ~ q(. given x_{k-1}^i, z_k)
    weight     w_k^i proportional to w_{k-1}^i * increment_i
    evidence   log p(z_1..z_k) += log sum_i w_{k-1}^i increment_i

SIS never resamples, SIR does when the effective sample size has fallen.  ESS hides that the map degenerates, so each
step also counts the distinct ancestors of time 0 still alive.  `particle_steps` is this loop to be read, and to be run
with proposals and schemes of one's own; the filters below go through the same steps in `lab.solvers.blocked`, or
compiled in `lab.fast`.  Source: questions 3, 4 and 6 of the handout; Doucet and Johansen (2009).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from lab import resampling, weights
from lab.problem import Problem, require_problem
from lab.resampling import Ancestors, Resampler
from lab.result import Filtered, Step, collect
from lab.solvers import blocked, compiled
from lab.solvers.backends import is_compiled
from lab.solvers.proposals import Cloud, GaussianProposal, delayed, optimal, prior, rbpf_optimal, rbpf_prior
from lab.solvers.protocol import Proposal
from lab.validation import Array, InputError, real_array, require_generator, whole_number

GUIDED = {"delayed": delayed, "optimal": optimal}
RAO_BLACKWELLIZED = {"optimal": rbpf_optimal, "prior": rbpf_prior}
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
        Moves the cloud; one of `lab.solvers.proposals`, or a student's own. Where it has a method
        ``start(problem, n_particles, rng) -> Cloud``, the cloud of time 0 is its; otherwise all of x_0 is drawn.
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
    n_particles, ess_threshold, scheme = _checked_options(problem, rng, n_particles, ess_threshold, resample)
    even = np.full(n_particles, 1 / n_particles)
    log_even = np.log(even)
    cloud, w = getattr(proposal, "start", prior.start)(problem, n_particles, rng), even
    lineage = np.arange(n_particles)  # of each particle, its ancestor at time 0
    survivors, log_evidence = n_particles, 0.0
    yield _step(cloud, w, log_evidence, survivors)
    for k in range(1, problem.n_instants):
        if weights.ess(w) <= ess_threshold * n_particles * (1 + ROUNDING):
            ancestors = _checked(scheme(w, rng), n_particles)
            cloud = replace(cloud, particles=np.take(cloud.particles, ancestors, axis=1), log_weights=log_even)
            lineage = lineage[ancestors]
            survivors = int(np.count_nonzero(np.bincount(lineage)))
        cloud.particles.flags.writeable = False  # the step before holds them, too
        moved, increment = _checked_move(proposal(cloud, k, problem, rng), cloud)
        log_weights = cloud.log_weights + increment
        try:
            w, log_total = weights.normalise(log_weights)
        except InputError as error:
            raise InputError(f"At k = {k}: {error}") from None
        log_evidence += log_total
        cloud = replace(moved, log_weights=log_weights - log_total)
        yield _step(cloud, w, log_evidence, survivors)


def _step(cloud: Cloud, w: Array, log_evidence: float, survivors: int) -> Step:
    """Return the moments of the mixture of N(particle, cloud.cov), by the law of total covariance."""
    mean, cov = weights.moments(cloud.particles, w)
    if not np.isfinite(mean).all():
        raise InputError("A particle is NaN or infinite.")
    return Step(mean, cov + cloud.cov, log_evidence, weights.ess(w), survivors, cloud)


def sis(problem: Problem, rng: np.random.Generator, *, n_particles: int = 1000, backend: str = "numpy") -> Filtered:
    """Run sequential importance sampling: prior dynamics as importance function, no resampling.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
    n_particles : int
        P, at least 1.
    backend : str
        As in `sir`.

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
    return sir(problem, rng, n_particles=n_particles, ess_threshold=0.0, backend=backend)


def sir(
    problem: Problem,
    rng: np.random.Generator,
    *,
    n_particles: int = 1000,
    ess_threshold: float = 0.5,
    resample: str | Resampler = "systematic",
    backend: str = "numpy",
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
    backend : str
        "numpy"; "numba", the compiled loop of `lab.fast`, for named schemes; "auto" for the compiled one where it pays.
        Results per seed are the same within a backend and equal in distribution across them.

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
    return _filter(problem, rng, prior, n_particles, ess_threshold, resample, backend)


def guided(
    problem: Problem,
    rng: np.random.Generator,
    *,
    n_particles: int = 1000,
    proposal: str = "delayed",
    ess_threshold: float = 0.5,
    resample: str | Resampler = "systematic",
    backend: str = "numpy",
) -> Filtered:
    """Run a particle filter whose importance function looks at the measurement.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
    n_particles : int
        P, at least 1.
    proposal : str
        "delayed" leaves a landmark unsampled until it is first seen, "optimal" samples everything from the start.
    ess_threshold, resample, backend
        As in `sir`.

    Returns
    -------
    Filtered

    Raises
    ------
    InputError
        As `particle_steps`, or an unknown proposal.

    Notes
    -----
    Source: question 9 of the handout; Doucet, Godsill and Andrieu (2000).
    """
    return _filter(problem, rng, _named(proposal, GUIDED), n_particles, ess_threshold, resample, backend)


def rbpf(
    problem: Problem,
    rng: np.random.Generator,
    *,
    n_particles: int = 1000,
    proposal: str = "optimal",
    ess_threshold: float = 0.5,
    resample: str | Resampler = "systematic",
    backend: str = "numpy",
) -> Filtered:
    """Run the Rao-Blackwellized filter: the robot by particles, the landmarks by conditional Gaussians.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
    n_particles : int
        P, at least 1.
    proposal : str
        "optimal" draws the robot from p(r_k given r_0..r_{k-1}, z_1..z_k), "prior" from its dynamics.
    ess_threshold, resample, backend
        As in `sir`.

    Returns
    -------
    Filtered
        Covariances by the law of total covariance, cross terms of robot and landmarks included.

    Raises
    ------
    InputError
        As `particle_steps`, or an unknown proposal.

    Notes
    -----
    Source: question 10 of the handout; Montemerlo, Thrun, Koller and Wegbreit (2002); Murphy (1999).
    """
    return _filter(problem, rng, _named(proposal, RAO_BLACKWELLIZED), n_particles, ess_threshold, resample, backend)


def _filter(
    problem: Problem,
    rng: np.random.Generator,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    resample: str | Resampler,
    backend: str,
) -> Filtered:
    if is_compiled(backend, n_particles, resample):
        n_particles, ess_threshold, _ = _checked_options(problem, rng, n_particles, ess_threshold, resample)
        settings: dict[str, Any] = {"n_particles": n_particles, "ess_threshold": ess_threshold, "resample": resample}
        return compiled.run(problem, rng, proposal=proposal, **settings)
    if resample in blocked.ASCENDING:
        n_particles, ess_threshold, _ = _checked_options(problem, rng, n_particles, ess_threshold, resample)
        settings = {"n_particles": n_particles, "ess_threshold": ess_threshold, "resample": resample}
        return blocked.run(problem, [rng], proposal=proposal, **settings)[0]
    steps = particle_steps(
        problem, rng, proposal=proposal, n_particles=n_particles, ess_threshold=ess_threshold, resample=resample
    )
    return collect(steps)


def _checked_options(
    problem: Any, rng: Any, n_particles: Any, ess_threshold: Any, resample: Any
) -> tuple[int, float, Resampler]:
    """Return the options of a filter when they can be used, the resampling scheme as a function."""
    require_problem(problem)
    require_generator(rng)
    n_particles = whole_number("n_particles", n_particles, at_least=1)
    ess_threshold = float(real_array("ess_threshold", ess_threshold, ()))
    if not 0 <= ess_threshold <= 1:
        raise InputError(f"ess_threshold must lie between 0 and 1, not {ess_threshold}.")
    return n_particles, ess_threshold, resampling.resolve(resample)


def _named(name: str, proposals: dict[str, GaussianProposal]) -> GaussianProposal:
    if not isinstance(name, str) or name not in proposals:
        raise InputError(f"Unknown proposal {name!r}; known are {', '.join(proposals)}.")
    return proposals[name]


def _checked_move(answer: Any, cloud: Cloud) -> tuple[Cloud, Array]:
    """Refuse what a student's proposal must not return."""
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[0], Cloud):
        raise InputError("The proposal must return the moved Cloud and its log-weight increments.")
    moved, increment = answer
    for name, have, want in (
        ("particles", np.shape(moved.particles), cloud.particles.shape),
        ("log-weight increments", np.shape(increment), cloud.log_weights.shape),
    ):
        if have != want:
            raise InputError(f"The proposal must return {name} of shape {want}, not {have}.")
    return moved, increment


def _checked(ancestors: Any, n_particles: int) -> Ancestors:
    """Refuse what numpy would index with all the same: a student's scheme comes through here, too."""
    array = np.asarray(ancestors)
    if array.shape != (n_particles,) or array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= n_particles:
        raise InputError(f"The resampling scheme must return {n_particles} indices between 0 and {n_particles - 1}.")
    return array
