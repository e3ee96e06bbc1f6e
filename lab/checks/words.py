"""Sentences that the checks share.

Question answered: how is it said?  Reason and hint of named mistakes, of what a function must not do, and of numbers
that are off.
"""

from collections.abc import Sequence

import numpy as np

from lab.checks.forms import Form, Result
from lab.checks.inputs import Case
from lab.checks.mistakes import CATALOGUE
from lab.checks.naming import ACCEPTED, close
from lab.checks.question import Question
from lab.checks.verdict import Verdict
from lab.validation import Array


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


def in_words(named: Sequence[str]) -> tuple[str, str]:
    """Return reason and hint for one or several mistakes."""
    mistakes = [CATALOGUE[key] for key in named]
    said = "; or ".join(mistake.says for mistake in mistakes[:3])
    lead = "Either " if len(mistakes) > 1 else ""
    return f"{upper(lead + said)}.", " ".join(dict.fromkeys(mistake.hint for mistake in mistakes[:3]))


def difference(form: Form, result: Result, right: Result) -> str:
    """Return half a sentence about how a result differs from the right one."""
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


def pattern(question: Question, tried: Sequence[Case], wrong: Sequence[int]) -> str:
    """Return a hint from which cases are wrong."""
    if len(wrong) == len(tried):
        given = {value.name for value in question.arguments}
        simplest = (
            "one landmark"
            if given & {"z", "landmark", "model", "problem"}
            else "two particles"
            if "weights" in given
            else ""
        )
        return f"It is off in every case: start with the simplest one, by hand{simplest and f', with {simplest}'}."
    fine = next(case.label for i, case in enumerate(tried) if i not in wrong)
    return f"It is right for {fine}: what is different there?"


def upper(text: str) -> str:
    """Return the text with a capital first letter."""
    return text[:1].upper() + text[1:]
