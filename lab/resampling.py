"""Resampling schemes: from weights to ancestors, one signature for all four.

Question answered: which particles have offspring?  Every scheme is unbiased, E[offspring of i] = N w_i, and draws by
inverting the cumulative weights c at N points of [0, 1): particle i is taken for the points in [c_{i-1}, c_i).

    systematic    u_j = (j + u) / N,    one u for all              offspring is floor or ceil of N w
    stratified    u_j = (j + u_j) / N,  one u_j per stratum
    multinomial   u_j independent
    residual      floor(N w_i) copies of i, the rest multinomial on what remains

The weights are divided by their sum first, and the cumulative sum counts as infinite from the last positive weight on:
rounding leaves it short of 1, and a point can round to exactly 1.  So an index never lies outside and a particle of
weight zero is never taken.  Source: question 6 of the handout; Douc, Cappe and Moulines (2005).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lab.validation import Array, InputError

Ancestors = NDArray[np.intp]
UNSURE = 1e-6  # far above the rounding of N c, for every N that fits in memory
Resampler = Callable[[Array, np.random.Generator], Ancestors]


def systematic(weights: Array, rng: np.random.Generator) -> Ancestors:
    """Resample with one uniform number for all points.

    Parameters
    ----------
    weights : (N,) array
        Non-negative, not all zero; need not sum to 1.
    rng : numpy.random.Generator

    Returns
    -------
    (N,) array of int
        Ancestors, in ascending order.

    Raises
    ------
    InputError
        Weights negative, NaN, infinite or all zero.
    """
    return np.asarray(of_strata(_normalised(weights)[np.newaxis], np.array([[rng.random()]]))[0])


def stratified(weights: Array, rng: np.random.Generator) -> Ancestors:
    """Resample with one uniform number per stratum; arguments, result and errors as `systematic`."""
    return np.asarray(of_strata(_normalised(weights)[np.newaxis], rng.random(len(weights))[np.newaxis])[0])


def multinomial(weights: Array, rng: np.random.Generator) -> Ancestors:
    """Resample with independent uniform numbers, in no order; arguments, result and errors as `systematic`."""
    return _inverse(rng.random(len(weights)), _normalised(weights))


def residual(weights: Array, rng: np.random.Generator) -> Ancestors:
    """Keep floor(N w) copies, draw the rest multinomially; arguments, result and errors as `systematic`."""
    n = len(weights)
    expected = _normalised(weights) * n
    # N * (1 / N) may round to just below 1, and even weights must keep every particle
    copies = np.floor(expected * (1 + 4 * n * np.finfo(float).eps)).astype(np.intp)
    kept = np.repeat(np.arange(n), copies)
    if len(kept) >= n:
        return kept[:n]
    return np.concatenate([kept, _inverse(rng.random(n - len(kept)), np.maximum(expected - copies, 0))])


RESAMPLERS: dict[str, Resampler] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def resolve(resample: str | Resampler) -> Resampler:
    """Return the scheme of this name; a function is returned as it is.

    Raises
    ------
    InputError
        No scheme has this name.
    """
    if callable(resample):
        return resample
    if not isinstance(resample, str) or resample not in RESAMPLERS:
        raise InputError(f"Unknown resampling scheme {resample!r}; known are {', '.join(RESAMPLERS)}.")
    return RESAMPLERS[resample]


def _normalised(weights: Array) -> Array:
    if np.ndim(weights) != 1:
        raise InputError(f"Resampling needs a vector of weights, not an array of shape {np.shape(weights)}.")
    total = np.sum(weights)
    if not np.isfinite(total) or total <= 0 or np.min(weights) < 0:
        raise InputError("Resampling needs non-negative, finite weights that are not all zero.")
    return np.asarray(weights / total)


def _inverse(points: Array, weights: Array) -> Ancestors:
    """Invert the cumulative weights; `weights` may sum to anything positive, the points lie in [0, 1]."""
    return np.searchsorted(_cumulative(weights), points, side="right")


def of_strata(weights: Array, shifts: Array) -> Ancestors:
    """Resample several clouds of N particles at once, each at one point in each of the intervals [j / N, (j + 1) / N].

    What `_inverse` finds by a search is counted here: of the points below c, all but one follow from the whole part of
    N c, and the marks that they leave are summed. Where N c is too near a whole number to tell, the search decides.

    Parameters
    ----------
    weights : (runs, N) array
        Normalised.
    shifts : (runs, N) or (runs, 1) array
        Where in its interval each point lies, from 0 to 1.

    Returns
    -------
    (runs, N) array of int
        Ancestors, each row in ascending order.
    """
    runs, n = weights.shape
    points = (np.arange(n) + shifts) / n
    cumulative = _cumulative(weights)
    scaled = np.minimum(cumulative * n, n)
    whole = np.minimum(scaled.astype(np.intp), n - 1)
    below = whole + (np.take_along_axis(points, whole, axis=1) < cumulative)
    unsure = (np.abs(scaled - np.rint(scaled)) < UNSURE) & (scaled < n)
    for run in np.flatnonzero(unsure.any(axis=1)):
        where = np.flatnonzero(unsure[run])
        below[run, where] = np.searchsorted(points[run], cumulative[run, where])
    below += (n + 1) * np.arange(runs)[:, np.newaxis]
    marks = np.bincount(below.ravel(), minlength=runs * (n + 1)).reshape(runs, n + 1)
    return np.asarray(np.cumsum(marks[:, :n], axis=1))


def _cumulative(weights: Array) -> Array:
    """Return the cumulative sum of rows relative to its end, infinite from the last positive weight on."""
    cumulative = np.cumsum(weights, axis=-1)
    cumulative /= cumulative[..., -1:]
    n = weights.shape[-1]
    last = n - 1 - np.argmax(weights[..., ::-1] > 0, axis=-1)
    cumulative[np.arange(n) >= last[..., np.newaxis]] = np.inf
    return cumulative
