"""A filter that never resamples, one part of its cloud after the other.

Question answered: who needs to know of whom, when particles only move and are weighed?  Nobody.  So a cloud is a
mixture of smaller ones, which stay in the processor's cache, and its moments follow from theirs,

    p_s = n_s L_s / sum_r n_r L_r,   L_s = its estimate of p(z_1..z_k),   mean = sum_s p_s mean_s,
    cov = sum_s p_s (cov_s + (mean_s - mean)(mean_s - mean)'),   1 / ESS = sum_s p_s^2 / ESS_s.

Each is told what those before it weigh, and leaves out what adds nothing to that: more than half of all moves, where
the weights collapse.  For a density has a maximum, so that a log-weight can rise by no more than the logarithm of it; a
particle that even so would stay far below the weight of others at all instants to come need not go on.
Called by `lab.solvers.compiled`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from lab.result import Filtered
from lab.validation import Array

PART = 16384  # particles
AT_ONCE = 1_000_000  # numbers of covariances
FAINT = 52.0  # as in `lab.fast.loop`: a million weights so far below the logarithm of all others change no digit


def run_apart(cloud: Callable[[int], Callable[[Array], Filtered]], n_particles: int, constants: Array) -> Filtered:
    """Run parts of a cloud, and return what they are together.

    Parameters
    ----------
    cloud : function
        Of n: gives the function that runs n particles.  Its argument is `least` of `lab.fast.loop.run`, and it may give
        the same arrays each time.
    n_particles : int
        N, of all parts together.
    constants : (T,) array
        By how much a log-weight can rise at each step.

    Returns
    -------
    Filtered

    Raises
    ------
    InputError
        A part has no weight at some instant.
    """
    rises = np.concatenate([[0.0], np.cumsum(constants)])
    log_total = np.full(len(rises), -np.inf)
    for first in range(0, n_particles, PART):
        n = min(PART, n_particles - first)
        part = cloud(n)(_least(log_total, rises, n))
        ess: Any = part.ess
        if first == 0:
            means, covs, inverse_ess = part.means.copy(), part.covs.copy(), 1 / ess
        log_part = part.log_evidence + np.log(n)
        log_total = np.logaddexp(log_total, log_part)
        share = np.exp(log_part - log_total)  # the first part's is 1: so far it is the mixture itself
        for some in np.array_split(np.flatnonzero(share), 1 + covs.size // AT_ONCE):
            p, off = share[some, np.newaxis, np.newaxis], part.means[some] - means[some]
            between = (1 - p) * off[:, :, np.newaxis] * off[:, np.newaxis]
            means[some] += p[:, 0] * off
            covs[some] += p * (part.covs[some] - covs[some] + between)
        inverse_ess = (1 - share) ** 2 * inverse_ess + share**2 / ess
    return Filtered(means, covs, log_total - log_total[0], 1 / inverse_ess, np.full(len(rises), n_particles))


def _least(log_total: Array, rises: Array, n: int) -> Array:
    """Return `least` for n particles of the weight 1 / n at time 0, when those before them add up to `log_total`.

    Less its rises, no log-weight ever grows, nor does their sum: it is least at the end.
    """
    for_moments = log_total - np.log(n)
    to_go_on = (log_total - rises)[-1] + rises
    least: Array = np.array([for_moments, to_go_on]) - np.log(n) - FAINT
    return least
