"""Answers that are compared number by number.

Question answered: does the answer return what it should?  On every case the outcome of the answer (arrays, or an
error) is held against the reference, to 1e-6 of the largest entry; if one differs, `lab.checks.naming` looks for the
mistake.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import guard, reference
from lab.checks.advice import advice
from lab.checks.forms import Result, forms
from lab.checks.inputs import cases, uncertain_robot
from lab.checks.mistakes.densities import with_motion_noise
from lab.checks.naming import ACCEPTED, by_message, by_pattern, global_data, name, of_ours, right_results, same
from lab.checks.questions import Question
from lab.checks.trials import orientation, try_on
from lab.checks.verdict import Verdict
from lab.checks.words import difference, edited, in_words, ours, pattern, upper


def examine(question: Question, answer: Callable[..., Any], watch: Callable[[str, str], bool]) -> Verdict:
    """Return the verdict on an answer that is compared exactly."""
    key, tried = question.key, cases(question.key)
    turned, first = orientation(key, answer, tried[0], watch)
    outcomes: list[tuple[Result, list[guard.Outcome]]] = []
    for case in tried:
        hangs = outcomes and outcomes[-1][0].kind.startswith(guard.TimeUp.__name__)
        outcomes.append(outcomes[-1] if hangs else try_on(key, answer, case, turned))
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
    if key == "q2c" and _one_when_blind(answer, turned):
        reason, hint = in_words(["blind-density"])
        found = "log density is 1, for the handout's world, nothing seen"
        return Verdict(key, False, f"{reason} Found: {found}.", hint, "blind-density")
    if key == "q2a" and (found := _off_where_uncertain(answer)):
        named = ["q-in-prior"] if _off_where_uncertain(answer, with_motion_noise) == "" else []
        reason, hint = in_words(named) if named else (f"{upper(found)}.", "Which components of x_0 have a variance?")
        return Verdict(key, False, f"{reason} Found: {found}." if named else reason, hint, " ".join(named))
    return Verdict(key, True, f"public checks passed ({len(tried)}/{len(tried)}).", advice(key, answer, turned, calls))


def _off_where_uncertain(answer: Callable[..., Any], right: Callable[..., Any] = reference.log_prior) -> str:
    """Return how a prior density differs where the robot is uncertain, too; nothing when it takes it to be known."""
    case = uncertain_robot("q2a")
    result, expected = try_on("q2a", answer, case)[0], of_ours("q2a", right, case)
    if not result.arrays or same(result, expected, ACCEPTED) or np.isneginf(result.arrays[0]).all():
        return ""
    return f"{difference(forms()['q2a'], result, expected)}, for {case.label}"


def _one_when_blind(answer: Callable[..., Any], turned: bool) -> bool:
    """Whether a log-density is 1 when nothing is seen: no constant, but the density in place of its logarithm."""
    case = next(case for case in cases("q2c") if case.label.endswith("nothing seen"))
    (value,) = try_on("q2c", answer, case, turned, keep=True)[0].arrays
    return bool((value == 1).all())


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
