"""How a particle filter will fare, before a particle is drawn: its degeneracy, and its Monte-Carlo error.

Question answered: how many particles would it take?  A proposal of `lab.solvers.proposals` moves and weighs its
particles by affine Gaussian maps, so the moments of its unnormalised weight W over all the particles that it could have
drawn are Gaussian integrals.  Observing every z_k c times gives log E[W^c]: c = 1 is the evidence, and

    lim ESS / N = E[W]^2 / E[W^2]   since the last resampling, N to infinity.

A finite cloud overstates its ESS once that falls near 1/N; the bias is governed by E[W^4] / E[W^2]^2.

The error of the bootstrap filter (prior proposal, multinomial resampling at every step) has a central limit theorem,

    N Var(mean_k) -> sum over s <= k of  integral p(x_s given z_0:k)^2 / p(x_s given z_0:s-1) D_s(x_s)^2 dx_s,
    D_s(x_s) = E[x_k given x_s, z_0:k] - E[x_k given z_0:k],

whose terms are Gaussian integrals of Kalman and smoother moments.  For systematic or ESS-triggered resampling the true
error is usually below it; that is an observation and no theorem.
Source: Chopin and Papaspiliopoulos, An Introduction to Sequential Monte Carlo (2020), chapter 11.
"""

import numpy as np

from lab import gaussian
from lab.problem import Problem
from lab.solvers.exact import kalman, smoother
from lab.solvers.proposals import GaussianProposal, StepLaw, delayed, optimal, prior, rbpf_optimal, rbpf_prior
from lab.validation import Array, InputError, whole_number

PROPOSALS = {
    "prior": prior,
    "optimal": optimal,
    "delayed": delayed,
    "rbpf-prior": rbpf_prior,
    "rbpf-optimal": rbpf_optimal,
}
ROUNDING = 1e-9
VALID_GAP = 0.3  # exact standard deviations: beyond it the central limit theorem says nothing about a real cloud


def log_weight_moment(problem: Problem, proposal: str | GaussianProposal, power: int) -> Array:
    """Return log E[W_k^power] for every instant, W_k the unnormalised weight of a particle never resampled.

    Parameters
    ----------
    problem : Problem
    proposal : str or GaussianProposal
        "prior", "optimal", "delayed", "rbpf-prior", "rbpf-optimal", or the object itself.
    power : int
        c, at least 1; 1 gives the log-evidence, 2 and 4 govern degeneracy.

    Returns
    -------
    (N,) array
        Natural logarithms; row 0 is 0.

    Raises
    ------
    InputError
        Unknown proposal, or z_k has no density under it.
    """
    law_of = _resolve(proposal)
    tilted, logs = law_of.start_law(problem), [0.0]
    for law in law_of.laws(problem):
        tilted, increment = _step(problem, law, tilted, power)
        logs.append(logs[-1] + increment)
    return np.array(logs)


def forecast(problem: Problem, proposal: str | GaussianProposal, *, ess_threshold: float = 0.0) -> Array:
    """Return log10 of the limiting ESS / N, before any resampling of that instant.

    Parameters
    ----------
    problem, proposal
        As `log_weight_moment`.
    ess_threshold : float
        Resample after every instant at which ESS / N is no more than this, from 0 (never) to 1 (always). The cloud then
        starts afresh from the law of a particle given z_1..z_k.

    Returns
    -------
    (N,) array
        Row 0 is 0.
    """
    if not 0 <= ess_threshold <= 1:
        raise InputError(f"ess_threshold must be between 0 and 1, not {ess_threshold}.")
    law_of = _resolve(proposal)
    once = twice = law_of.start_law(problem)
    ratio, ratios = 0.0, [0.0]
    for law in law_of.laws(problem):
        once, log_mean = _step(problem, law, once, 1)
        twice, log_square = _step(problem, law, twice, 2)
        ratio += 2 * log_mean - log_square
        ratios.append(ratio)
        if ess_threshold > 0 and ratio <= np.log(ess_threshold) + ROUNDING:
            twice, ratio = once, 0.0
    return np.asarray(np.minimum(np.array(ratios) / np.log(10), 0))  # rounding must not give more than N


def _step(problem: Problem, law: StepLaw, tilted: tuple[Array, Array], power: int) -> tuple[tuple[Array, Array], float]:
    """Move the law of a particle tilted by W^power over one instant, and return what log E[W^power] gains."""
    model, (mean, cov) = problem.model, tilted
    mean, cov = model.F @ mean + model.B, model.F @ cov @ model.F.T
    noise = law.spread @ law.spread.T
    if law.draw_first:
        cov = cov + noise
    # N(z; H x, S)^c is N(z; H x, S / c) times a constant
    p = len(law.z)
    _, log_determinant = np.linalg.slogdet(law.S)
    constant = -0.5 * ((power - 1) * (p * gaussian.LOG_2PI + log_determinant) + p * np.log(power))
    mean, cov, log_evidence = gaussian.update(mean, cov, law.z, law.H, law.S / power)
    after = np.eye(len(mean)) - law.K @ law.H  # of the particle's own update
    mean, cov = after @ mean + law.K @ law.z, after @ cov @ after.T
    if not law.draw_first:
        cov = cov + noise
    return (mean, cov), float(log_evidence) + float(constant)


def particles_needed(problem: Problem, proposal: str | GaussianProposal, ess: float = 10) -> Array:
    """Return log10 of the N at which the limiting ESS is `ess`, for every instant, (N,).

    Raises
    ------
    InputError
        `ess` is not at least 1.
    """
    if not ess >= 1:
        raise InputError(f"ess must be at least 1, not {ess}.")
    return np.asarray(np.log10(ess) - forecast(problem, proposal))


def reach(problem: Problem, proposal: str | GaussianProposal, n_particles: int, ess: float = 10) -> int:
    """Return the last instant up to which N particles keep a limiting ESS of at least `ess` without resampling."""
    size = whole_number("n_particles", n_particles, at_least=1)
    short = particles_needed(problem, proposal, ess) > np.log10(size)
    return int(np.argmax(short)) - 1 if short.any() else len(short) - 1


def predicted_error(problem: Problem, n_particles: int) -> tuple[Array, Array]:
    """Return the standard deviation of the bootstrap filter's mean, and the N that it takes to predict it.

    Parameters
    ----------
    problem : Problem
    n_particles : int
        N, at least 1.

    Returns
    -------
    stds : (N, n) array
        Of each component of the mean [m]; NaN where it would exceed 0.3 exact standard deviations, where a central
        limit theorem says nothing about a real cloud.
    needed : (N,) array
        The number of particles from which no component of instant k exceeds that; infinite where it overflows.
    """
    size = whole_number("n_particles", n_particles, at_least=1)
    ratios = relative_log_variance(problem)
    valid = ratios - np.log(size) <= 2 * np.log(VALID_GAP)
    stds = np.full(ratios.shape, np.nan)
    stds[valid] = (np.exp((ratios - np.log(size)) / 2) * kalman(problem).stds)[valid]
    return stds, particles_for_validity(ratios)


def particles_for_validity(ratios: Array) -> Array:
    """Return the N (N,) from which the prediction holds for all components, given their `relative_log_variance`."""
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(ratios.max(axis=1)) / VALID_GAP**2)


def predicted_gap(ratios: Array, n_particles: Array) -> tuple[Array, float]:
    """Return the bootstrap filter's predicted gap of the mean over k >= 1, and the N that it takes to predict it.

    The gap is the root mean square, over instants and uncertain components, averaged over data sets.  The squares are
    expected ones, so the mean of the runs' own gaps lies a little below.

    Parameters
    ----------
    ratios : (D, N, n) array
        `relative_log_variance` of D data sets.
    n_particles : (S,) array
        Numbers of particles.

    Returns
    -------
    gaps : (S,) array
        [exact std]; NaN where some component of some instant would exceed 0.3.
    log10_needed : float
        log10 of the number of particles from which none does; -inf where nothing is uncertain.
    """
    from scipy.special import logsumexp

    later = ratios[:, 1:]
    squares = logsumexp(later, axis=(1, 2)) - np.log(np.maximum(np.isfinite(later).sum(axis=(1, 2)), 1))
    log10_needed = float((later.max() - 2 * np.log(VALID_GAP)) / np.log(10))
    log_sizes = np.log(n_particles)
    gaps = np.full(len(log_sizes), np.nan)
    holds = log_sizes / np.log(10) >= log10_needed - ROUNDING
    gaps[holds] = np.exp((squares - log_sizes[holds, np.newaxis]) / 2).mean(axis=1)
    return gaps, log10_needed


def relative_log_variance(problem: Problem) -> Array:
    """Return log lim N Var(mean_k) / exact variance of the bootstrap filter, (N, n); -inf for a known component."""
    exact = kalman(problem)
    model, logs = problem.model, np.full(exact.means.shape, -np.inf)
    predictions = [(model.m0, model.P0)]
    for k in range(len(exact.means) - 1):
        predictions.append(gaussian.predict(exact.means[k], exact.covs[k], model.F, model.B, model.noise_cov))
    # what does not depend on the last instant seen is found once
    directions = [
        np.asarray(np.linalg.pinv(gaussian.split(cov, np.arange(len(cov)))[0]), float) for _, cov in predictions
    ]
    gains = smoother(problem, exact).gains
    for k in range(len(exact.means)):
        mean, cov = exact.means[k], exact.covs[k]  # of x_s given z_0:k, smoothed back from s = k
        lean = cov  # Cov(x_k, x_s given z_0:k)
        for s in range(k, -1, -1):
            if s < k:
                next_mean, next_cov = predictions[s + 1]
                mean = exact.means[s] + gains[s] @ (mean - next_mean)
                cov = exact.covs[s] + gains[s] @ (cov - next_cov) @ gains[s].T
                cov, lean = (cov + cov.T) / 2, lean @ gains[s].T
            logs[k] = np.logaddexp(logs[k], _log_term(directions[s], mean - predictions[s][0], cov, lean))
    with np.errstate(divide="ignore"):
        return np.where(exact.uncertain, logs - 2 * np.log(np.maximum(exact.stds, 1e-300)), -np.inf)


def _log_term(directions: Array, shift: Array, cov: Array, lean: Array) -> Array:
    """Return the logarithms (n,) of one instant's term, in directions that the prediction leaves uncertain.

    y = directions (x - predicted mean) is N(0, I) under the prediction; `shift` is the smoothed minus predicted mean.
    """
    y_mean, y_cov = directions @ shift, directions @ cov @ directions.T
    # p^2 / q, N(y; m, C)^2 / N(y; 0, I), is a constant times N(y; tilted_mean, tilted_cov)
    precision = np.linalg.inv(y_cov)
    tilted_cov = np.linalg.inv(2 * precision - np.eye(len(y_mean)))
    tilted_mean = tilted_cov @ (2 * precision @ y_mean)
    log_constant = 0.5 * (np.linalg.slogdet(tilted_cov)[1] - 2 * np.linalg.slogdet(y_cov)[1])
    log_constant += 0.5 * tilted_mean @ (2 * precision @ y_mean) - y_mean @ precision @ y_mean
    regression = lean @ directions.T @ precision
    offset = regression @ (tilted_mean - y_mean)
    variances = np.einsum("ij,jk,ik->i", regression, tilted_cov, regression) + offset**2
    with np.errstate(divide="ignore"):
        return np.asarray(log_constant + np.log(np.maximum(variances, 0)))


def _resolve(proposal: str | GaussianProposal) -> GaussianProposal:
    if isinstance(proposal, GaussianProposal):
        return proposal
    if proposal not in PROPOSALS:
        raise InputError(f"Unknown proposal {proposal!r}; known are {', '.join(PROPOSALS)}.")
    return PROPOSALS[proposal]
