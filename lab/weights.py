"""Importance weights: from log-weights to normalised weights, effective sample size and moments.

Question answered: what does a weighted cloud say?

    w_i = exp(l_i) / sum_j exp(l_j),   ESS = 1 / sum_i w_i^2
    mean = sum_i w_i x_i,              cov = sum_i w_i (x_i - mean)(x_i - mean)'

Weights live in log space until here: a step of the handout's problem has log-likelihoods near -800, whose plain
exponential is zero.  Called by the particle loop, and by students.
"""

import numpy as np

from lab.validation import Array, InputError

BLOCK = 4096  # particles: what is computed of so many stays in the processor's cache


def normalise(log_weights: Array) -> tuple[Array, float]:
    """Return normalised weights and the logarithm of the sum that they were divided by.

    Parameters
    ----------
    log_weights : (P,) array
        Known up to a constant; -inf is a weight of zero.

    Returns
    -------
    weights : (P,) array
        Sum to 1.
    log_total : float
        log sum_i exp(log_weights_i): with normalised weights carried over and log-likelihoods added, the increment of
        the log-evidence.

    Raises
    ------
    InputError
        Every weight is zero, or one is NaN or infinite: there is nothing to normalise.
    """
    log_weights = np.asarray(log_weights)
    if not log_weights.size:
        raise InputError("The weights cannot be normalised: there are none.")
    largest = np.max(log_weights)
    if not np.isfinite(largest):
        what = "every weight is zero" if largest == -np.inf else "a log-weight is NaN or infinite"
        raise InputError(f"The weights cannot be normalised: {what}.")
    scaled = np.exp(log_weights - largest)
    total = scaled.sum()
    return scaled / total, float(largest + np.log(total))


def ess(weights: Array) -> float:
    """Return the effective sample size 1 / sum w^2, between 1 and P.

    Parameters
    ----------
    weights : (P,) array
        Sum to 1.

    Notes
    -----
    Source: question 5 of the handout; Kong, Liu and Wong (1994).
    """
    return float(1 / np.sum(np.square(weights)))


def moments(particles: Array, weights: Array) -> tuple[Array, Array]:
    """Return mean and covariance of a weighted cloud.

    Parameters
    ----------
    particles : (n, P) array
        Dimension first.
    weights : (P,) array
        Sum to 1.

    Returns
    -------
    mean : (n,) array
    cov : (n, n) array
        The covariance of the weighted point masses themselves: no correction for the number of particles.
    """
    mean = particles @ weights
    cov = np.zeros((len(mean), len(mean)))
    for start in range(0, len(weights), BLOCK):
        block = slice(start, start + BLOCK)
        centred = particles[:, block] - mean[:, np.newaxis]
        cov += (centred * weights[block]) @ centred.T
    return mean, (cov + cov.T) / 2
