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


def _length(case: Case) -> int:
    return int(getattr(case.calls[0][0], "n_instants", 0))


@cache
def of_mutant(key: str, number: int, case: int) -> Result:
    """Return the result of a mutant, by its number, on a case, by its number."""
    return of_ours(key, mutants(key)[number][1], cases(key)[case])


@cache
def right_results(key: str) -> tuple[tuple[Result, ...], ...]:
    """Return the results of the reference, and of the other right answers, on every case."""
    question = BY_KEY[key]
    answers = (getattr(reference, question.function), *forms()[key].others)
    return tuple(_results(key, answer) for answer in answers)


def _results(key: str, answer: Callable[..., Any]) -> tuple[Result, ...]:
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


def by_message(text: str) -> list[str]:
    """Return the mistake that a message of numpy or scipy gives away, if any."""
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
