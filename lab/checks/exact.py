"""Answers that are compared number by number.

Question answered: does the answer return what it should?  On every case the outcome of the answer (arrays, or an
error) is held against the reference, to 1e-6 of the largest entry; if one differs, `lab.checks.naming` looks for the
mistake.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import guard, reference
from lab.checks.forms import SECONDS, Form, Result, forms, joined, read_outcome
from lab.checks.inputs import Case, as_simulated, cases, edges, equality, uncertain_robot
from lab.checks.mistakes.densities import with_motion_noise
from lab.checks.naming import ACCEPTED, by_message, by_pattern, global_data, name, right_results, same
from lab.checks.questions import Question
from lab.checks.verdict import Verdict
from lab.checks.words import difference, edited, in_words, ours, pattern, upper


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
    right = right_results(key)
    wrong = [i for i, result in enumerate(results) if not same(result, right[i], ACCEPTED)]
    if wrong:
        return _explain(question, answer, results, wrong, right)
    changed = next((call.changed for call in calls if call.changed), ())
    if changed:
        return Verdict(key, False, *edited(changed), mistake="edits-arguments")
    if key == "q2c" and _one_when_blind(question, answer, turned):
        reason, hint = in_words(["blind-density"])
        found = "log density is 1, for the handout's world, nothing seen"
        return Verdict(key, False, f"{reason} Found: {found}.", hint, "blind-density")
    if key == "q2a" and (found := _off_where_uncertain(question, answer)):
        named = ["q-in-prior"] if _off_where_uncertain(question, answer, with_motion_noise) == "" else []
        reason, hint = in_words(named) if named else (f"{upper(found)}.", "Which components of x_0 have a variance?")
        return Verdict(key, False, f"{reason} Found: {found}." if named else reason, hint, " ".join(named))
    return Verdict(key, True, f"public checks passed ({len(tried)}/{len(tried)}).", advice(question, answer, calls))


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
    if question.key == "q2b":
        form, case = forms()["q2b"], as_simulated()
        expected = _run(form, reference.log_transition, case, question, False)[0]
        if not same(_run(form, answer, case, question, False)[0], expected, ACCEPTED):
            said.append(
                "The landmarks of the simulator move by 1e-10 m, which count as none; your function takes such a move"
                " for one, and so finds impossible what is simulated."
            )
    if question.key == "q6-ancestors":
        form, case = forms()["q6-ancestors"], edges()
        expected = _run(form, reference.select_ancestors, case, question, False)[0]
        if not same(_run(form, answer, case, question, False)[0], expected, ACCEPTED):
            said.append(
                "At the ends of [0, 1) it can choose a particle without weight, or one that does not exist: through"
                " rounding, the cumulative weights may end a little below 1."
            )
    if question.key == "q6-step" and not _at_equality(question, answer):
        said.append("The table says <=: with the threshold at 1, even weights are to be resampled, too.")
    if any(call.drew for call in calls):
        said.append("The function touches numpy's global random generator; nothing random is needed here.")
    if any(call.printed for call in calls):
        said.append("The function prints; remove that before it runs in a loop.")
    return " ".join(said)


def _off_where_uncertain(
    question: Question, answer: Callable[..., Any], right: Callable[..., Any] = reference.log_prior
) -> str:
    """Return how a prior density differs where the robot is uncertain, too; nothing when it takes it to be known."""
    form, case = forms()["q2a"], uncertain_robot()
    result, expected = _run(form, answer, case, question, False)[0], _run(form, right, case, question, False)[0]
    if not result.arrays or same(result, expected, ACCEPTED) or np.isneginf(result.arrays[0]).all():
        return ""
    return f"{difference(form, result, expected)}, for {case.label}"


def _at_equality(question: Question, answer: Callable[..., Any]) -> bool:
    """Whether the cloud is resampled when the effective sample size is exactly the threshold."""
    form, case = forms()["q6-step"], equality()
    expected = _run(form, reference.sir_step, case, question, False)[0]
    return any(same(_run(form, answer, case, question, turned)[0], expected, ACCEPTED) for turned in (False, True))


def _one_when_blind(question: Question, answer: Callable[..., Any], turned: bool) -> bool:
    """Whether a log-density is 1 when nothing is seen: no constant, but the density in place of its logarithm."""
    case = next(case for case in cases("q2c") if case.label.endswith("nothing seen"))
    (value,) = _run(forms()["q2c"], answer, case, question, turned, keep=True)[0].arrays
    return bool((value == 1).all())


def _orientation(
    form: Form, answer: Callable[..., Any], case: Case, question: Question, watch: Callable[[str, str], bool]
) -> tuple[bool, guard.Outcome]:
    """Return whether the answer takes particles one a row, and its first call."""
    args = case.calls[0]
    made = guard.call(answer, args, _names(question), seconds=SECONDS, watch=watch)
    if not form.rows or isinstance(made.error, NotImplementedError) or read_outcome(form, made, args).arrays:
        return False, made
    other = guard.call(answer, _turn(args, form.rows), _names(question), seconds=SECONDS)
    return bool(read_outcome(form, other, args, turned=True).arrays), made


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
        results.append(read_outcome(form, outcome, args, turned))
        if not results[-1].arrays:
            break
    return joined(form, results, keep), made


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
    found = f"{difference(forms()[key], first, right[wrong[0]])}, for {tried[wrong[0]].label}"
    passed = f"({len(tried) - len(wrong)}/{len(tried)} public checks passed)"
    named = named or global_data(answer) or by_pattern(key, results, wrong)
    named = named or by_message(key, first.sentence if first.kind else "")
    if named:
        reason, hint = in_words(named)
        return Verdict(key, False, f"{reason} Found: {found} {passed}.", hint, " ".join(named))
    hint = "" if first.kind else pattern(question, tried, wrong)
    return Verdict(key, False, f"{upper(found)} {passed}.", hint)
