"""The mistake that explains a wrong answer.

Question answered: which known mistake returns the same?  The results of an answer are held against those of every
mutant of `lab.checks.mistakes`, to 1e-8 of the largest entry, on ALL cases: so two mistakes that agree on one are told
apart by another, and those that never differ are both named.
"""

import re
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from lab.checks import guard, reference
from lab.checks.forms import Result, forms, joined, read_outcome
from lab.checks.inputs import Case, cases
from lab.checks.mistakes import mutants
from lab.checks.questions import BY_KEY
from lab.checks.reading import common_factor
from lab.validation import Array

ACCEPTED, SAME = 1e-6, 1e-8  # of the largest entry


def name(key: str, results: Sequence[Result], wrong: Sequence[int]) -> list[str]:
    """Return the keys of the mistakes that give the same results on every case.

    Most mutants differ on the first case that is tried: a wrong and a short one.
    """
    order = sorted(range(len(results)), key=lambda i: (i not in wrong, _length(cases(key)[i])))
    matching = [
        mistake
        for number, (mistake, _) in enumerate(mutants(key))
        if all(same(results[i], of_mutant(key, number, i), SAME) for i in order)
    ]
    return list(dict.fromkeys(matching))


def by_pattern(key: str, results: Sequence[Result], wrong: Sequence[int]) -> list[str]:
    """Return the mistake that shows in how the results differ, whatever the numbers are."""
    right = right_results(key)
    if all(results[i].kind.startswith("IndexError") for i in wrong) and 0 not in wrong:
        return ["retyped"]  # as many landmarks, or instants, as the handout has
    if any(results[i].kind for i in wrong):
        return []
    pairs = [(results[i].arrays, right[i].arrays) for i in wrong]
    if key in ("q4b-corridor", "q4b-ellipse") and all(_another_size(key, *pair) for pair in pairs):
        return ["wrong-level"]
    if key == "q4b-ellipse" and all(close(a[1], b[1], ACCEPTED) and np.abs(a[0]).max() < ACCEPTED for a, b in pairs):
        return ["not-shifted"]
    if key in ("q3-jitter", "q4-step", "q6-step", "q10-step") and all(_unnormalised(*pair) for pair in pairs):
        return ["not-normalised"]
    if key == "q1d-filter" and all(_unfilled(*pair) for pair in pairs):
        return ["rows-not-filled"]
    return []


def _another_size(key: str, found: Sequence[Array], right: Sequence[Array]) -> bool:
    """Whether a region has the right centre and shape, and another size."""
    if key == "q4b-ellipse":
        return close(found[0], right[0], ACCEPTED) and common_factor(found[1], right[1]) > 0
    centred = close(found[0] + found[1], right[0] + right[1], ACCEPTED)
    return centred and common_factor(found[1] - found[0], right[1] - right[0]) > 0


def _unnormalised(found: Sequence[Array], right: Sequence[Array]) -> bool:
    """Whether all is right but the sum of the weights, which come last, or a factor of each."""
    fine = all(close(a, b, ACCEPTED) for a, b in zip(found[:-1], right[:-1], strict=True))
    underflown = float(np.abs(found[-1]).sum()) < 1e-200
    return fine and (underflown or common_factor(found[-1], right[-1]) > 0)


def _unfilled(found: Sequence[Array], right: Sequence[Array]) -> bool:
    """Whether the rows that are wrong hold zeros."""
    off = [
        ~np.isclose(a, b, rtol=0, atol=1e-6).reshape(len(a), -1).all(axis=1) for a, b in zip(found, right, strict=True)
    ]
    return all(not a[rows].any() for a, rows in zip(found, off, strict=True))


def _length(case: Case) -> int:
    return int(getattr(case.calls[0][0], "n_instants", 0))


@cache
def of_mutant(key: str, number: int, case: int) -> Result:
    """Return the result of a mutant, by its number, on a case, by its number."""
    return of_ours(key, mutants(key)[number][1], cases(key)[case])


@cache
def right_results(key: str) -> tuple[Result, ...]:
    """Return the results of the reference on every case."""
    answer = getattr(reference, BY_KEY[key].function)
    return tuple(of_ours(key, answer, case) for case in cases(key))


def of_ours(key: str, answer: Callable[..., Any], case: Case) -> Result:
    """Call a function of ours on a case: it needs no guard."""
    form, made = forms()[key], []
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for args in case.calls:
            try:
                outcome = guard.Outcome(answer(*args))
            except Exception as error:
                outcome = guard.Outcome(error=error)
            made.append(read_outcome(form, outcome, args))
    return joined(form, made)


def same(one: Result, other: Result, tolerance: float) -> bool:
    """Whether two results agree, errors included."""
    if one.kind or other.kind:
        return one.kind == other.kind
    return all(close(a, b, tolerance) for a, b in zip(one.arrays, other.arrays, strict=True))


def close(a: Array, b: Array, tolerance: float) -> bool:
    """Whether two arrays agree to `tolerance` of the largest entry of the second; NaN and inf must be in place."""
    if a.shape != b.shape:
        return False
    finite = np.isfinite(b)
    if not np.array_equal(a[~finite], b[~finite], equal_nan=True) or not np.isfinite(a[finite]).all():
        return False
    if not finite.any():
        return True
    return bool(np.abs(a[finite] - b[finite]).max() <= tolerance * np.abs(b[finite]).max() + 1e-300)


def by_message(key: str, text: str) -> list[str]:
    """Return the mistake that a message of numpy or scipy gives away, if any, where R is an argument."""
    if not any(value.name in ("R", "problem") for value in BY_KEY[key].arguments):
        return []
    if "infs or NaNs" in text:
        return ["nan-kept"]
    if "must be square" in text:
        return ["r-rows-only"]
    shapes = re.search(r"together with shapes \((\d+),(\d+)\) \((\d+),(\d+)\)", text)
    if shapes and len(set(shapes.groups()[::2])) + len(set(shapes.groups()[1::2])) == 3:
        return ["r-rows-only"]
    if "core dimension" in text and "(n?),(n?,m?)" in text.replace("(n?,k),(k,m?)", ""):
        return ["mask-flattens"]
    return []


def global_data(answer: Callable[..., Any]) -> list[str]:
    """Return the mistake of reading the notebook's variables, if the answer does."""
    names = guard.data_names(answer)
    if not names:
        return []
    truth = {"truth", "x", "x_true", "xtrue", "true_state", "experiment", "simulation", "states"}
    return ["true-state" if {name.lower() for name in names} & truth else "global-data"]
