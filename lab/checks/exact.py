"""Answers that are compared number by number, and the mistake that explains a wrong one.

Question answered: does the answer return what it should, and if not, which known mistake returns the same?  On every
case the outcome of the answer (arrays, or an error) is held against the reference, to 1e-6 of the largest entry; if one
differs, against every mutant of `lab.checks.mistakes`, to 1e-8, on ALL cases: so two mistakes that agree on one are
told apart by another, and those that never differ are both named.
"""

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from lab.checks import guard, reading, reference
from lab.checks.inputs import Case, cases, uncertain_robot
from lab.checks.mistakes import CATALOGUE, mutants
from lab.checks.questions import BY_KEY, Question
from lab.checks.reading import Reader, Unreadable
from lab.checks.verdict import Verdict
from lab.validation import Array

ACCEPTED, SAME = 1e-6, 1e-8  # of the largest entry
SECONDS = 10.0


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
    others : tuple of functions
        Further right answers, where the question leaves a choice.
    densities : bool
        Whether results are log-densities, right up to a constant.
    """

    read: Reader
    names: tuple[str, ...]
    rows: tuple[int, ...] = ()
    turned: tuple[int, ...] = ()
    others: tuple[Callable[..., Any], ...] = ()
    densities: bool = False


def _corridor_by_quantile(means: Array, covs: Array) -> tuple[Array, Array]:
    reach = 2.9677379253417944 * np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    return means - reach, means + reach


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
        "q4b-corridor": Form(*_plain("q4b-corridor", like(0), like(0)), others=(_corridor_by_quantile,)),
        "q4b-ellipse": Form(reading.ellipse, ("centre", "size and direction")),
        "q5": Form(*_plain("q5", scalar)),
        "q6-ancestors": Form(reading.sorted_ancestors(BY_KEY["q6-ancestors"]), ("ancestors",)),
        "q6-step": Form(*_plain("q6-step", like(0), like(1)), rows=(0, 2), turned=(0,)),
        "q7": Form(reading.closures, ("closures", "gains")),
        "q8-gap": Form(*_plain("q8-gap", scalar)),
        "q10-step": Form(*_plain("q10-step", like(0), like(1), like(2), like(3))),
        "q10-moments": Form(*_plain("q10-moments", whole, whole_square)),
    }


def examine(question: Question, answer: Callable[..., Any], watch: Callable[[str, str], bool]) -> Verdict:
    """Return the verdict on an answer that is compared exactly."""
    key, form, tried = question.key, forms()[question.key], cases(question.key)
    turned, first = _orientation(form, answer, tried[0], question, watch)
    outcomes: list[tuple[Result, list[guard.Outcome]]] = []
    for case in tried:
        hangs = outcomes and outcomes[-1][0].kind.startswith(guard.TimeUp.__name__)
        outcomes.append(outcomes[-1] if hangs else _run(form, answer, case, question, turned))
    calls = [first, *(call for _, made in outcomes for call in made)]
    if any(isinstance(call.error, NotImplementedError) for call in calls):
        return Verdict(key, False, "the stub still raises NotImplementedError", answered=False)
    used = next((call.ours for call in calls if call.ours), "")
    if used:
        return ours(key, used)
    results = [result for result, _ in outcomes]
    right = _right(key)
    wrong = [i for i, result in enumerate(results) if not any(same(result, r[i], ACCEPTED) for r in right)]
    if wrong:
        return _explain(question, answer, results, wrong, right[0])
    changed = next((call.changed for call in calls if call.changed), ())
    if changed:
        return Verdict(key, False, *edited(changed), mistake="edits-arguments")
    return Verdict(key, True, f"public checks passed ({len(tried)}/{len(tried)}).", advice(question, answer, calls))


def ours(key: str, function: str) -> Verdict:
    """Return the verdict on an answer that leaves the work to the laboratory."""
    return Verdict(
        key,
        False,
        f"the answer calls {function}: that is the laboratory's own, while the question asks for yours.",
        "Write the computation itself; numpy and scipy are welcome.",
        "calls-the-lab",
    )


def edited(changed: Sequence[str]) -> tuple[str, str]:
    """Return reason and hint about arguments that were changed."""
    names = " and ".join(changed)
    return (
        f"the function edits its argument {names} in place; whoever called it finds other numbers there.",
        "Which of your statements write into an array that was given (=, +=, [...] =)? Work on a new one.",
    )


def advice(question: Question, answer: Callable[..., Any], calls: Sequence[guard.Outcome]) -> str:
    """Return what is worth knowing though the checks have passed."""
    said = []
    if question.key == "q2c":
        (case,) = [case for case in cases("q2c") if case.label.endswith("1 landmark seen")][:1]
        value = _run(forms()["q2c"], answer, case, question, False, keep=True)[0].arrays
        if value and not same(Result(value), Result((reference.log_likelihood(*case.calls[0]),)), ACCEPTED):
            said.append(
                "Your density lacks its constant, or has another one. Weights do not mind, but the log-evidence will:"
                " it needs the whole density."
            )
    if question.key == "q2a":
        form, case = forms()["q2a"], uncertain_robot()
        expected = _run(form, reference.log_prior, case, question, False)[0]
        if not same(_run(form, answer, case, question, False)[0], expected, ACCEPTED):
            said.append(
                "This is right where the robot starts at a known point, which it does not in the older edition."
            )
    if any(call.drew for call in calls):
        said.append("The function touches numpy's global random generator; nothing random is needed here.")
    if any(call.printed for call in calls):
        said.append("The function prints; remove that before it runs in a loop.")
    return " ".join(said)


def _orientation(
    form: Form, answer: Callable[..., Any], case: Case, question: Question, watch: Callable[[str, str], bool]
) -> tuple[bool, guard.Outcome]:
    """Return whether the answer takes particles one a row, and its first call."""
    args = case.calls[0]
    made = guard.call(answer, args, _names(question), seconds=SECONDS, watch=watch)
    if not form.rows or isinstance(made.error, NotImplementedError) or _read(form, made, args).arrays:
        return False, made
    other = guard.call(answer, _turn(args, form.rows), _names(question), seconds=SECONDS)
    return bool(_read(form, other, args, turned=True).arrays), made


def _names(question: Question) -> list[str]:
    return [value.name for value in question.arguments]


def _turn(args: Sequence[Any], which: Sequence[int]) -> tuple[Any, ...]:
    return tuple(np.ascontiguousarray(arg.T) if i in which else arg for i, arg in enumerate(args))


def _run(
    form: Form, answer: Callable[..., Any], case: Case, question: Question, turned: bool, keep: bool = False
) -> tuple[Result, list[guard.Outcome]]:
    """Call the answer on a case; `keep` keeps the constant of a log-density."""
    results, made = [], []
    for args in case.calls:
        given = _turn(args, form.rows) if turned else args
        outcome = guard.call(answer, given, _names(question), seconds=SECONDS)
        made.append(outcome)
        results.append(_read(form, outcome, args, turned))
        if not results[-1].arrays:
            break
    return _joined(form, results, keep), made


def _joined(form: Form, results: Sequence[Result], keep: bool = False) -> Result:
    """Return the results of the calls of a case as one; the first failure is that of the case."""
    failed = next((result for result in results if not result.arrays), None)
    if failed is not None or not form.densities:
        return failed or results[0]
    values = reading.log_densities([result.arrays[0] for result in results])
    return Result((values if keep else reading.relative(values),))


def _read(form: Form, made: guard.Outcome, args: Sequence[Any], turned: bool = False) -> Result:
    if made.error is not None:
        kind = f"{type(made.error).__name__} {' '.join(guard.numbers_in(str(made.error)))}"
        return Result(kind=kind, sentence=guard.describe(made.error, made.line, SECONDS))
    value = made.value
    try:
        if turned and form.turned:
            parts = list(reading.several(value, form.names))
            value = tuple(np.asarray(part).T if i in form.turned else part for i, part in enumerate(parts))
        return Result(form.read(value, args))
    except Unreadable as error:
        return Result(kind=str(error), sentence=str(error))


@cache
def _right(key: str) -> tuple[tuple[Result, ...], ...]:
    """Return the results of the reference, and of the other right answers, on every case."""
    question = BY_KEY[key]
    answers = (getattr(reference, question.function), *forms()[key].others)
    return tuple(_results(key, answer) for answer in answers)


def _results(key: str, answer: Callable[..., Any]) -> tuple[Result, ...]:
    return tuple(_of_ours(key, answer, case) for case in cases(key))


def _of_ours(key: str, answer: Callable[..., Any], case: Case) -> Result:
    """Call a function of ours on a case: it needs no guard."""
    form, made = forms()[key], []
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for args in case.calls:
            try:
                outcome = guard.Outcome(answer(*args))
            except Exception as error:
                outcome = guard.Outcome(error=error)
            made.append(_read(form, outcome, args))
    return _joined(form, made)


@cache
def _of_mutant(key: str, number: int, case: int) -> Result:
    return _of_ours(key, mutants(key)[number][1], cases(key)[case])


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


def name(key: str, results: Sequence[Result], wrong: Sequence[int]) -> list[str]:
    """Return the keys of the mistakes that give the same results on every case.

    Most mutants differ on the first case that is tried: a wrong and a short one.
    """
    order = sorted(range(len(results)), key=lambda i: (i not in wrong, _length(cases(key)[i])))
    matching = [
        mistake
        for number, (mistake, _) in enumerate(mutants(key))
        if all(same(results[i], _of_mutant(key, number, i), SAME) for i in order)
    ]
    return list(dict.fromkeys(matching))


def _length(case: Case) -> int:
    return int(getattr(case.calls[0][0], "n_instants", 0))


def _explain(
    question: Question,
    answer: Callable[..., Any],
    results: Sequence[Result],
    wrong: Sequence[int],
    right: Sequence[Result],
) -> Verdict:
    """Return the verdict on a wrong answer."""
    key, tried = question.key, cases(question.key)
    named = name(key, results, wrong)
    first = results[wrong[0]]
    found = f"{_difference(forms()[key], first, right[wrong[0]])}, for {tried[wrong[0]].label}"
    passed = f"({len(tried) - len(wrong)}/{len(tried)} public checks passed)"
    named = named or global_data(answer) or by_message(first.sentence if first.kind else "")
    if named:
        reason, hint = in_words(named)
        return Verdict(key, False, f"{reason} Found: {found} {passed}.", hint, " ".join(named))
    hint = "" if first.kind else _pattern(tried, wrong)
    return Verdict(key, False, f"{_upper(found)} {passed}.", hint)


def global_data(answer: Callable[..., Any]) -> list[str]:
    """Return the mistake of reading the notebook's variables, if the answer does."""
    names = guard.data_names(answer)
    if not names:
        return []
    truth = {"truth", "x", "x_true", "xtrue", "true_state", "experiment", "simulation", "states"}
    return ["true-state" if {name.lower() for name in names} & truth else "global-data"]


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


def in_words(named: Sequence[str]) -> tuple[str, str]:
    """Return reason and hint for one or several mistakes."""
    mistakes = [CATALOGUE[key] for key in named]
    said = "; or ".join(mistake.says for mistake in mistakes[:3])
    lead = "Either " if len(mistakes) > 1 else ""
    return f"{_upper(lead + said)}.", " ".join(dict.fromkeys(mistake.hint for mistake in mistakes[:3]))


def _difference(form: Form, result: Result, right: Result) -> str:
    if result.kind:
        return result.sentence
    said = []
    for label, a, b in zip(form.names, result.arrays, right.arrays, strict=True):
        if a.shape != b.shape:
            said.append(f"{label} has {len(a)} rows where there should be {len(b)}")
        elif np.isnan(a).any():
            said.append(f"{label} holds NaN")
        elif not close(a, b, ACCEPTED):
            said.append(f"{label} is off{_by_how_much(a, b)}")
        elif len(form.names) > 1:
            said.append(f"{label} is right")
    return ", ".join(said)


def _by_how_much(a: Array, b: Array) -> str:
    with np.errstate(invalid="ignore"):
        gaps = np.where(a == b, 0, np.abs(a - b))
    where = np.unravel_index(np.argmax(np.where(np.isnan(gaps), np.inf, gaps)), a.shape)
    at = f" at [{', '.join(map(str, where))}]" if a.ndim else ""
    gap = gaps[where]
    return f", most{at}" if not np.isfinite(gap) else f" by up to {gap:.3g}{at}"


def _pattern(tried: Sequence[Case], wrong: Sequence[int]) -> str:
    if len(wrong) == len(tried):
        return "It is off in every case: start with the simplest one, by hand, with one landmark."
    fine = next(case.label for i, case in enumerate(tried) if i not in wrong)
    return f"It is right for {fine}: what is different there?"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
