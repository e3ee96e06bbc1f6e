"""Check of a resampling scheme: any that gives particle i on average P w_i offspring.

Question answered: is the scheme unbiased?  Over thousands of calls the average offspring of every particle is within a
bound of P w_i that a right scheme breaks with a chance below 1e-5; small biases, as those of a wrong residual, take
that many calls to show.  A particle of weight zero must never be chosen, and the spread must not exceed the
multinomial's.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import stats

from lab.checks import guard
from lab.checks.questions import Question
from lab.checks.reading import Unreadable, like, plain
from lab.checks.verdict import Verdict
from lab.checks.words import edited, in_words, ours
from lab.validation import Array

CALLS, FEWEST, BUDGET = 20_000, 3_000, 8.0  # calls for each weights, and seconds for all
TAIL = 1e-9  # one-sided, of the average offspring of one particle; there are 30
NOISIER = 1.3  # times the multinomial's variance


def _weights() -> dict[str, Array]:
    rng = np.random.default_rng(51)
    uneven = rng.gamma(1.2, size=7)
    sparse = rng.gamma(0.8, size=9)
    sparse[[0, 4, 8]] = 0
    heavy = np.full(11, 0.02)
    heavy[6] = 0.8
    return {
        "uneven weights": uneven / uneven.sum(),
        "weights with zeros": sparse / sparse.sum(),
        "one heavy": heavy,
        "three particles": np.array([0.3, 0.6, 0.1]),  # so few that a wheel shows where it started
    }


def _expected(weights: Array) -> dict[str, Array]:
    """Return the average offspring under known mistakes."""
    P = len(weights)
    best = np.zeros(P)
    best[np.argmax(weights)] = P
    squared = weights**2 / np.sum(weights**2)
    rounded = np.round(P * weights)
    return {
        "uniform-choice": np.ones(P),
        "weights-squared": P * squared,
        "ancestor-shifted": P * np.roll(weights, 1),
        "not-cumulated": P * np.roll(weights, -1),
        "index-sorted": P * np.sort(weights),
        "resampling-biased": rounded,
        "weights-ignored": best,
    }


def examine(
    question: Question,
    scheme: Callable[..., Any],
    watch: Callable[[str, str], bool],
    seed: int = 0,
    calls: int = CALLS,
) -> Verdict:
    """Return the verdict on a resampling scheme."""
    key, read = question.key, plain(question, like(0), whole=(0,))
    tried = _weights()
    spent, named = 0.0, list[str]()
    for number, (label, weights) in enumerate(tried.items()):
        first = _first(question, scheme, weights, (seed, number), watch if not number else None, read)
        if isinstance(first, Verdict):
            return first
        start = time.perf_counter()
        share = (BUDGET - spent) / (len(tried) - number)
        counts = _counts(scheme, weights, np.random.default_rng((seed, number, 1)), calls, share, read)
        spent += time.perf_counter() - start
        if isinstance(counts, str):
            shifted = counts.startswith(("an ancestor is -1,", f"an ancestor is {len(weights)},"))
            if not shifted:
                return Verdict(key, False, f"for {label} {counts}.")
            reason, hint = in_words(["ancestor-shifted"])
            return Verdict(key, False, f"{reason} Found: {counts}, for {label}.", hint, "ancestor-shifted")
        if counts[:, weights == 0].any():
            reason = f"a particle of weight zero is chosen, for {label}."
            return Verdict(key, False, reason, "Its share of [0, 1) is empty. What happens at the edges of the shares?")
        bad = _off(counts, len(weights) * weights)
        if bad:
            means = counts.mean(axis=0)
            found = f"particle {bad[0]} gets {means[bad[0]]:.3f} offspring on average over {len(counts)} calls"
            found += f" instead of {len(weights) * weights[bad[0]]:.3f}, for {label}"
            named = [name for name, e in _expected(weights).items() if not _off(counts, e)] or ["resampling-biased"]
            reason, hint = in_words(named)
            return Verdict(key, False, f"{reason} Found: {found}.", hint, " ".join(named))
        multinomial = len(weights) * weights * (1 - weights)
        if counts.var(axis=0).sum() > NOISIER * multinomial.sum():
            reason = f"the offspring are right on average, but scatter more than independent draws would, for {label}."
            return Verdict(key, False, reason, "How many different points decide about the P ancestors?", "too-noisy")
    return Verdict(key, True, f"public checks passed ({len(tried)}/{len(tried)}).")


def _first(
    question: Question,
    scheme: Callable[..., Any],
    weights: Array,
    seed: Any,
    watch: Callable[[str, str], bool] | None,
    read: Any,
) -> Verdict | float:
    """Return the seconds of a call, or the verdict on one that is wrong in itself."""
    key, seconds = question.key, 0.0
    answers = []
    for _ in range(2):
        start = time.perf_counter()
        made = guard.call(scheme, (weights, np.random.default_rng(seed)), ("weights", "rng"), watch=watch)
        seconds = time.perf_counter() - start
        if isinstance(made.error, NotImplementedError):
            return Verdict(key, False, "the stub still raises NotImplementedError", answered=False)
        if made.ours:
            return ours(key, made.ours)
        if made.error is not None:
            return Verdict(key, False, f"{guard.describe(made.error, made.line)}.")
        if made.drew:
            reason = "random numbers are drawn from a global generator (numpy.random or random), not from rng."
            return Verdict(key, False, reason, "Every number comes from the argument rng.", "global-generator")
        if made.changed:
            return Verdict(key, False, *edited(made.changed), mistake="edits-arguments")
        try:
            answers.append(read(made.value, (weights,))[0])
        except Unreadable as error:
            return Verdict(key, False, f"{error}.")
    if not np.array_equal(answers[0], answers[1]):
        reason = "the same rng gives other ancestors at the second call: something else is random."
        return Verdict(key, False, reason, "Make no generator of your own.", "global-generator")
    return seconds


def _counts(
    scheme: Callable[..., Any], weights: Array, rng: np.random.Generator, calls: int, share: float, read: Any
) -> Array | str:
    """Return the offspring of every particle at every call (calls, P), or half a sentence about what went wrong.

    A slow scheme makes fewer calls: as many as its share of the time allows, though no fewer than `FEWEST`.
    """
    P = len(weights)

    def often() -> Array:
        counts = np.empty((calls, P))
        start = time.perf_counter()
        for i in range(calls):
            if i >= FEWEST and i % 100 == 0 and time.perf_counter() - start > share:
                return counts[:i]
            ancestors = np.asarray(scheme(weights.copy(), rng))
            if not i:
                read(ancestors, (weights,))
            if ancestors.min() < 0 or ancestors.max() >= P:
                outside = ancestors.min() if ancestors.min() < 0 else ancestors.max()
                raise IndexError(f"an ancestor is {outside}, while particles are numbered 0 to {P - 1}")
            counts[i] = np.bincount(ancestors, minlength=P)
        return counts

    made = guard.call(often, (), seconds=10 * BUDGET)
    if isinstance(made.error, IndexError) and str(made.error).startswith("an ancestor"):
        return str(made.error)
    if made.error is not None:
        return guard.describe(made.error, 0, 10 * BUDGET)
    return np.asarray(made.value)


def _off(counts: Array, expected: Array) -> list[int]:
    """Return the particles whose average offspring is not the expected one."""
    error = counts.std(axis=0, ddof=1) / np.sqrt(len(counts))
    gaps = np.abs(counts.mean(axis=0) - expected)
    bound = float(stats.norm.isf(TAIL)) * np.maximum(error, 1e-3 / np.sqrt(len(counts)))
    return [int(i) for i in np.flatnonzero(gaps > bound)]
