"""One check: from a question and a function to a verdict.

Question answered: is this an answer at all, and which kind of check is it for?  Exact ones are in `lab.checks.exact`,
those of random functions in `lab.checks.statistical`.
"""

import inspect
from dataclasses import replace
from typing import Any

import numpy as np

from lab.checks import exact, filters, guard, importance, schemes, studies
from lab.checks.forms import forms
from lab.checks.questions import CODE, Question, question_named
from lab.checks.verdict import Verdict
from lab.checks.words import ours, upper
from lab.validation import InputError


def check(question: str, answer: Any) -> Verdict:
    """Check one answer.

    Parameters
    ----------
    question : str
        Key, as in the table of ``solutions/README.md``.
    answer : function
        As that table describes it.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        There is no such question, or it asks for a text.
    """
    asked = question_named(question)
    if asked.kind != CODE:
        raise InputError(f"{question} asks for a text, which a person reads and marks; there is no check.")
    replaced = guard.replaced_in_numpy()
    verdict = _at_first_sight(asked, answer)
    if verdict is None:
        with np.errstate(all="ignore"):
            verdict = _examine(asked, answer)
    replaced += guard.replaced_in_numpy()
    if replaced and verdict.passed:
        reason = f"functions of numpy have been replaced ({', '.join(sorted(set(replaced))[:3])}): nothing can be told."
        verdict = Verdict(asked.key, False, reason, "Give your own functions names of their own, without np in front.")
    if not verdict.passed:
        verdict = replace(verdict, reason=upper(verdict.reason))
    return replace(verdict, notes=(*verdict.notes, *guard.limits()))


def _examine(asked: Question, answer: Any) -> Verdict:
    ours = guard.is_ours
    if asked.key == "q8-study":  # lab.compare is a way to do it
        ours = _of_the_reference
    if asked.key == "q9-filter":  # one's own importance function in the laboratory's loop
        ours = _proposes

    def watch(module: str, function: str) -> bool:
        return function == asked.function if module == guard.STAND_INS else ours(module, function)

    if asked.key in forms():
        return exact.examine(asked, answer, watch)
    if asked.key == "q6-resample":
        return schemes.examine(asked, answer, watch)
    if asked.key == "q9":
        return importance.examine(asked, answer, watch)
    if asked.key == "q8-study":
        return studies.examine(asked, answer, watch)
    return filters.examine(asked, answer, watch)


def _of_the_reference(module: str, function: str) -> bool:
    """Whether a call uses the right answers themselves."""
    return module == "lab.checks.reference"


def _proposes(module: str, function: str) -> bool:
    """Whether a call uses an importance function, or a whole filter, of the laboratory."""
    whole = {"sis", "sir", "guided", "rbpf", "kalman"}
    ours = function in whole or function.endswith((".law", ".__call__"))
    theirs = module.startswith(("lab.checks", "lab.gaussian", "lab.theory"))
    return theirs or (ours and module.startswith("lab.solvers"))


def _at_first_sight(asked: Question, answer: Any) -> Verdict | None:
    """Return the verdict on what cannot even be called."""
    if answer is None or answer is Ellipsis:
        return Verdict(asked.key, False, f"there is no function {asked.function} yet", answered=False)
    if not callable(answer) or isinstance(answer, type):
        called = f"check({asked.key!r}, {asked.function})"
        reason = f"the answer is {exact_kind(answer)}, not a function."
        return Verdict(asked.key, False, reason, f"Give the function itself, without calling it: {called}.")
    name = guard.of_the_laboratory(answer)
    if name:
        return ours(asked.key, name)
    try:
        signature = inspect.signature(answer)
    except (TypeError, ValueError):
        return None  # a builtin keeps its arguments to itself
    keywords = {"n_particles": 1} if "n_particles" in asked.call else {}
    wanted = [value.name for value in asked.arguments if value.name not in ("n_particles", "ess_threshold")]
    try:
        signature.bind(*[None] * len(wanted), **keywords)
    except TypeError as error:
        return Verdict(
            asked.key,
            False,
            f"the function takes {signature}, but is called as {asked.call}: {error}.",
            "Compare the first line of your function with the table of questions.",
        )
    return None


def exact_kind(answer: Any) -> str:
    """Return what something is, with its article."""
    kind = type(answer).__name__
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
