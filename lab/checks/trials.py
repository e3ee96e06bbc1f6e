"""An answer on the cases of its question.

Question answered: what comes of it?  The answer is called under guard (`lab.checks.guard`) and its outcome is read in
the form of the question (`lab.checks.forms`), with particles one a row where the answer wants them so.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import guard
from lab.checks.forms import SECONDS, Result, forms, joined, read_outcome
from lab.checks.inputs import Case
from lab.checks.questions import BY_KEY


def try_on(
    key: str, answer: Callable[..., Any], case: Case, turned: bool = False, keep: bool = False
) -> tuple[Result, list[guard.Outcome]]:
    """Call the answer on a case.

    Parameters
    ----------
    key : str
        Of the question.
    answer : function
    case : Case
    turned : bool
        Give it particles one a row.
    keep : bool
        Keep the constant of a log-density.

    Returns
    -------
    result : Result
    made : list of Outcome
        Of each call, up to the first that failed.
    """
    form, results, made = forms()[key], [], []
    for args in case.calls:
        given = _turn(args, form.rows) if turned else args
        outcome = guard.call(answer, given, _names(key), seconds=SECONDS)
        made.append(outcome)
        results.append(read_outcome(form, outcome, args, turned))
        if not results[-1].arrays:
            break
    return joined(form, results, keep), made


def orientation(
    key: str, answer: Callable[..., Any], case: Case, watch: Callable[[str, str], bool]
) -> tuple[bool, guard.Outcome]:
    """Return whether the answer takes particles one a row, and its first call, which is watched."""
    form, args = forms()[key], case.calls[0]
    made = guard.call(answer, args, _names(key), seconds=SECONDS, watch=watch)
    if not form.rows or isinstance(made.error, NotImplementedError) or read_outcome(form, made, args).arrays:
        return False, made
    other = guard.call(answer, _turn(args, form.rows), _names(key), seconds=SECONDS)
    return bool(read_outcome(form, other, args, turned=True).arrays), made


def _names(key: str) -> list[str]:
    return [value.name for value in BY_KEY[key].arguments]


def _turn(args: Sequence[Any], which: Sequence[int]) -> tuple[Any, ...]:
    return tuple(np.ascontiguousarray(arg.T) if i in which else arg for i, arg in enumerate(args))
