"""How the answers to a question are read and compared.

Question answered: which arrays, under which names, came of a case; may particles be one a row; is a constant free?  One
`Form` per question that is compared exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from lab.checks import guard, reading
from lab.checks.questions import BY_KEY
from lab.checks.reading import Reader, Unreadable
from lab.validation import Array

SECONDS = 10.0  # for one call


@dataclass(frozen=True, eq=False)
class Result:
    """What came of a case: arrays, or why there are none."""

    arrays: tuple[Array, ...] = ()
    kind: str = ""  # of failure: the type of the error and the numbers in its message, or the sentence of a reader
    sentence: str = ""


@dataclass(frozen=True, eq=False)
class Form:
    """How the answers to a question are read and compared.

    Attributes
    ----------
    read : Reader
    names : tuple of str
        Of the arrays that the reader returns.
    rows : tuple of int
        Arguments that may be turned to (P, n), if results are turned, too.
    turned : tuple of int
        The results that are.
    densities : bool
        Whether results are log-densities, right up to a constant.
    """

    read: Reader
    names: tuple[str, ...]
    rows: tuple[int, ...] = ()
    turned: tuple[int, ...] = ()
    densities: bool = False


def _plain(key: str, *sizes: Any) -> tuple[Reader, tuple[str, ...]]:
    question = BY_KEY[key]
    return reading.plain(question, *sizes), tuple(value.name for value in question.returns)


@cache
def forms() -> dict[str, Form]:
    """Return the form of every question that is compared exactly."""
    like, scalar = reading.like, reading.scalar
    square: Any = lambda args: (len(args[0]), len(args[0]))  # noqa: E731
    whole: Any = lambda args: (2 + len(args[1]),)  # noqa: E731
    whole_square: Any = lambda args: (2 + len(args[1]), 2 + len(args[1]))  # noqa: E731
    count: Any = lambda args: (args[1].shape[1],)  # noqa: E731
    dimension: Any = lambda args: (len(args[0]),)  # noqa: E731
    times: Any = lambda args: (args[0].n_instants, len(args[0].model.m0))  # noqa: E731
    times_square: Any = lambda args: (*times(args), len(args[0].model.m0))  # noqa: E731
    sized: Any = lambda *shape: lambda args: shape  # noqa: E731
    larger: Any = lambda args: (len(args[0]) + 2,)  # noqa: E731
    larger_square: Any = lambda args: 2 * larger(args)  # noqa: E731
    return {
        "q1d-step": Form(*_plain("q1d-step", like(0), like(1))),
        "q1d-filter": Form(*_plain("q1d-filter", times, times_square)),
        "q2a": Form(*_plain("q2a", scalar), densities=True),
        "q2b": Form(*_plain("q2b", scalar), densities=True),
        "q2c": Form(*_plain("q2c", count), rows=(1,), densities=True),
        "q3-jitter": Form(*_plain("q3-jitter", like(0), like(1)), rows=(0, 2, 3), turned=(0,)),
        "q4-step": Form(*_plain("q4-step", like(0), like(1)), rows=(0, 2), turned=(0,)),
        "q4-evidence": Form(*_plain("q4-evidence", scalar)),
        "q4a": Form(*_plain("q4a", dimension, square), rows=(0,)),
        "q4b-corridor": Form(reading.corridor(BY_KEY["q4b-corridor"]), ("lower", "upper")),
        "q4b-ellipse": Form(reading.ellipse, ("centre", "size and direction")),
        "q5": Form(*_plain("q5", scalar)),
        "q6-ancestors": Form(reading.sorted_ancestors(BY_KEY["q6-ancestors"]), ("ancestors",)),
        "q6-step": Form(*_plain("q6-step", like(0), like(1)), rows=(0, 2), turned=(0,)),
        "q7": Form(reading.closures, ("closures", "gains")),
        "q8-gap": Form(*_plain("q8-gap", scalar)),
        "q10-step": Form(*_plain("q10-step", like(0), like(1), like(2), like(3))),
        "q10-moments": Form(*_plain("q10-moments", whole, whole_square)),
        "q11-move": Form(*_plain("q11-move", like(0), sized(3, 3), sized(3, 2))),
        "q11-observe": Form(*_plain("q11-observe", sized(2), sized(2, 3), sized(2, 2))),
        "q11-invert": Form(*_plain("q11-invert", sized(2), sized(2, 3), sized(2, 2))),
        "q12-predict": Form(*_plain("q12-predict", like(0), like(1))),
        "q12-update": Form(*_plain("q12-update", like(0), like(1))),
        "q12-initialise": Form(*_plain("q12-initialise", larger, larger_square)),
        "q13-nees": Form(*_plain("q13-nees", scalar)),
        "q14-directions": Form(reading.directions, ("the space of the three columns",)),
        "q16-ray": Form(*_plain("q16-ray", sized(2), sized(2, 2))),
    }


def read_outcome(form: Form, made: guard.Outcome, args: Sequence[Any], turned: bool = False) -> Result:
    """Return the arrays of an outcome, or why there are none."""
    if made.error is not None:
        kind = f"{type(made.error).__name__} {' '.join(guard.numbers_in(guard.message(made.error)))}"
        return Result(kind=kind, sentence=guard.describe(made.error, made.line, SECONDS))
    value = made.value
    try:
        if turned and form.turned:
            parts = list(reading.several(value, form.names))
            value = tuple(np.asarray(part).T if i in form.turned else part for i, part in enumerate(parts))
        return Result(form.read(value, args))
    except Unreadable as error:
        return Result(kind=str(error), sentence=str(error))


def joined(form: Form, results: Sequence[Result], keep: bool = False) -> Result:
    """Return the results of the calls of a case as one; the first failure is that of the case."""
    failed = next((result for result in results if not result.arrays), None)
    if failed is not None or not form.densities:
        return failed or results[0]
    values = reading.log_densities([result.arrays[0] for result in results])
    return Result((values if keep else reading.relative(values),))
