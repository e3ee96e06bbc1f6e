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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.validation import Array, InputError

Ancestors = NDArray[np.intp]
UNSURE = 1e-6  # far above the rounding of N c, for every N that fits in memory
BLOCK = 4000  # particles that are looked at while they are in the cache
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


def of_strata(weights: Array, shifts: Array, room: tuple[Array, Ancestors] | None = None) -> Ancestors:
    """Resample several clouds of N particles at once, each at one point in each of the intervals [j / N, (j + 1) / N].

    What `_inverse` finds by a search is counted here, block by block: how many points are below each cumulative weight.
    The marks that these numbers leave are summed.

    Parameters
    ----------
    weights : (runs, N) array
        Normalised.
    shifts : (runs, N) or (runs, 1) array
        Where in its interval each point lies, from 0 to 1.
    room : (runs, N) array and (runs, N + 1) array of int, optional
        To work in; the second holds what is returned.

    Returns
    -------
    (runs, N) array of int
        Ancestors, each row in ascending order.
    """
    runs, n = weights.shape
    cumulative, marks = room or (np.empty((runs, n)), np.empty((runs, n + 1), np.intp))
    _cumulative(weights, cumulative)
    marks[:] = 0
    flat = marks.reshape(-1)  # ascends with the numbers of points, N + 1 further in each run
    everything = [(slice(0, runs), slice(0, n))]
    parts = [(slice(i, i + 1), slice(start, start + BLOCK)) for i in range(runs) for start in range(0, n, BLOCK)]
    for rows, columns in everything if n <= BLOCK else parts:
        below = _below(cumulative[rows, columns], shifts[rows], n)
        below += (n + 1) * np.arange(rows.start, rows.stop)[:, np.newaxis]
        first = below[0, 0]
        flat[first : below[-1, -1] + 1] += np.bincount(below.ravel() - first)
    np.cumsum(marks, axis=1, out=marks)
    return np.asarray(marks[:, :n])


def _below(cumulative: Array, shifts: Array, n: int) -> Ancestors:
    """Return how many of the points (j + shift_j) / N are below each cumulative weight c.

    The whole part w of N c says it of all points but the w-th, which is compared; where rounding may have changed w,
    its neighbours are compared, too.
    """
    scaled = cumulative * n
    whole = np.minimum(np.floor(scaled), n - 1)
    below = (whole + _is_below(whole, cumulative, shifts, n)).astype(np.intp)
    scaled -= whole
    scaled -= 0.5
    np.abs(scaled, out=scaled)
    unsure = np.nonzero((scaled > 0.5 - UNSURE) & (scaled < 1))  # beyond 1 where c is infinite
    if len(unsure[0]):
        w, c = whole[unsure], cumulative[unsure]
        count = w - 1
        for j in (w - 1, w, w + 1):
            column = np.clip(j, 0, n - 1).astype(np.intp) if shifts.shape[1] > 1 else 0
            count += (j + shifts[unsure[0], column]) / n < c
        below[unsure] = np.clip(count, 0, n)
    return np.asarray(below)


def _is_below(j: Array, cumulative: Array, shifts: Array, n: int) -> Any:
    if shifts.shape[1] > 1:
        shifts = np.take_along_axis(shifts, np.clip(j, 0, n - 1).astype(np.intp), axis=1)
    return (j + shifts) / n < cumulative


def _cumulative(weights: Array, out: Array | None = None) -> Array:
    """Return the cumulative sum of rows relative to its end, infinite from the last positive weight on."""
    cumulative = np.cumsum(weights, axis=-1, out=out)
    cumulative /= cumulative[..., -1:].copy()
    n = weights.shape[-1]
    for row, given in zip(cumulative.reshape(-1, n), weights.reshape(-1, n), strict=True):
        row[n - 1 - np.argmax(given[::-1] > 0) :] = np.inf
    return cumulative
