"""What is worth knowing about an answer that passes.

Question answered: what could still go wrong with it?  Some inputs are too rare, or too much a matter of convention, to
refuse an answer for; what it does there is said.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from lab.checks import guard, reference
from lab.checks.inputs import Case, as_simulated, cases, dead_favourite, edges, equality, uncertain_robot
from lab.checks.naming import ACCEPTED, of_ours, same
from lab.checks.questions import BY_KEY
from lab.checks.trials import try_on

_RARE: Mapping[str, tuple[Callable[[str], Case], str]] = {  # by question: a case, and what is said where it is missed
    "q2a": (
        uncertain_robot,
        "This is right where the robot starts at a known point, which it does not in the older edition.",
    ),
    "q2b": (
        as_simulated,
        "The landmarks of the simulator move by 1e-10 m, which count as none; your function takes such a move for one,"
        " and so finds impossible what is simulated.",
    ),
    "q6-ancestors": (
        edges,
        "At the ends of [0, 1) it can choose a particle without weight, or one that does not exist: through rounding,"
        " the cumulative weights may end a little below 1.",
    ),
    "q6-step": (equality, "The table says <=: with the threshold at 1, even weights are to be resampled, too."),
} | {
    key: (
        dead_favourite,
        "Beside a particle of weight 0 that is by far the likeliest, all others underflow: take the maximum that you"
        " shift by of log w + log-likelihood, not of the log-likelihoods alone.",
    )
    for key in ("q3-jitter", "q4-evidence", "q4-step", "q10-step")
}


def advice(key: str, answer: Callable[..., Any], turned: bool, calls: Sequence[guard.Outcome]) -> str:
    """Return what is worth knowing about an answer that has passed.

    Parameters
    ----------
    key : str
        Of the question.
    answer : function
    turned : bool
        Whether it takes particles one a row.
    calls : sequence of Outcome
        What it did in the checks.
    """
    said = []
    if key == "q2c" and _lacks_constant(answer, turned):
        said.append(
            "Your density lacks its constant, or has another one. Weights do not mind, but the log-evidence will:"
            " it needs the whole density."
        )
    if key in _RARE:
        make, words = _RARE[key]
        case = make(key)
        expected = of_ours(key, getattr(reference, BY_KEY[key].function), case)
        if not same(try_on(key, answer, case, turned)[0], expected, ACCEPTED):
            said.append(words)
    if any(call.drew for call in calls):
        said.append("The function touches numpy's global random generator; nothing random is needed here.")
    if any(call.printed for call in calls):
        said.append("The function prints; remove that before it runs in a loop.")
    return " ".join(said)


def _lacks_constant(answer: Callable[..., Any], turned: bool) -> bool:
    case = next(case for case in cases("q2c") if case.label.endswith("1 landmark seen"))
    found, expected = (
        try_on("q2c", function, case, rows, keep=True)[0]
        for function, rows in ((answer, turned), (reference.log_likelihood, False))
    )
    return not same(found, expected, ACCEPTED)
