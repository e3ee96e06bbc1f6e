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
TINY = np.finfo(float).tiny  # at a total of N times this and less, N over it may be infinite
BLOCK = 25_000  # particles that are looked at while they are in the cache
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

    Parameters
    ----------
    weights : (runs, N) array
        Non-negative, no row all zero.
    shifts : (runs, N) or (runs, 1) array
        Where in its interval each point lies, from 0 to 1.

    Returns
    -------
    (runs, N) array of int
        Ancestors, each row in ascending order.
    """
    return np.stack([ancestors_of(ends) for ends in ends_of_strata(weights, shifts)])


def ancestors_of(ends: Ancestors, out: Ancestors | None = None) -> Ancestors:
    """Return for each offspring how many particles end before it: its ancestor; `ends` (N,) as in `ends_of_strata`."""
    return np.cumsum(np.bincount(ends, minlength=len(ends) + 1)[:-1], out=out)


def ends_of_strata(weights: Array, shifts: Array, room: tuple[Array, Ancestors] | None = None) -> Ancestors:
    """Return for each particle how many offspring it and those before it have; other arguments as `of_strata`.

    What `_inverse` finds by a search is counted here, block by block: how many points are below each cumulative weight.

    Parameters
    ----------
    room : (runs, N) array and (runs, N) array of int, optional
        To work in; the second holds what is returned.

    Returns
    -------
    (runs, N) array of int
    """
    runs, n = weights.shape
    cumulative, ends = room or (np.empty((runs, n)), np.empty((runs, n), np.intp))
    np.cumsum(weights, axis=1, out=cumulative)
    totals = cumulative[:, -1:].copy()
    everything = [(slice(0, runs), slice(0, n))]
    parts = [(slice(i, i + 1), slice(start, start + BLOCK)) for i in range(runs) for start in range(0, n, BLOCK)]
    for rows, columns in everything if n <= BLOCK else parts:
        ends[rows, columns] = _below(cumulative[rows, columns], totals[rows], shifts[rows], n)
    for row, given in zip(ends, weights, strict=True):
        row[_last(given) :] = n
    return ends


def _below(cumulative: Array, totals: Array, shifts: Array, n: int) -> Array:
    """Return how many of the points (j + shift_j) / N are below each cumulative weight c, relative to the total.

    N c says it; but where rounding may have the last word, the points in question are compared.
    """
    scaled = cumulative * (n / totals) if totals.min() > n * TINY else cumulative / totals * n
    if shifts.shape[1] == 1:
        scaled -= shifts
        below = np.ceil(scaled)
        rest = np.subtract(below, scaled, out=scaled)
        unsure = (rest < UNSURE) | (rest > 1 - UNSURE) if rest.min() < UNSURE or rest.max() > 1 - UNSURE else None
    else:
        whole = np.minimum(np.floor(scaled), n - 1)
        point = whole + np.take_along_axis(shifts, whole.astype(np.intp), axis=1)
        below = whole + (point < scaled)
        unsure = np.minimum(np.abs(point - scaled), np.abs(scaled - np.rint(scaled))) < UNSURE
    if unsure is not None:
        run, place = np.nonzero(unsure)
        nearest, c = below[run, place], cumulative[run, place] / totals[run, 0]
        count = nearest - 2
        for j in (nearest - 2, nearest - 1, nearest, nearest + 1):
            column = np.clip(j, 0, n - 1).astype(np.intp) if shifts.shape[1] > 1 else 0
            count += (j + shifts[run, column]) / n < c
        below[run, place] = np.clip(count, 0, n)
    return np.asarray(below)


def _cumulative(weights: Array) -> Array:
    """Return the cumulative sum relative to its end, infinite from the last positive weight on."""
    cumulative = np.cumsum(weights)
    cumulative /= cumulative[-1]
    cumulative[_last(weights) :] = np.inf
    return cumulative


def _last(weights: Array) -> int:
    """Return the place of the last positive weight."""
    return len(weights) - 1 if weights[-1] > 0 else int(np.flatnonzero(weights)[-1])
