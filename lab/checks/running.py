"""Running a particle filter that is not trusted.

Question answered: what came of a run, if everything that a run must not do is a verdict?  A run raises `Refused`, which
carries the verdict, when the filter raises, draws from a global generator, or returns what is no `Filtered`.
"""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from lab.checks import guard
from lab.checks.naming import by_message
from lab.checks.questions import Question
from lab.checks.verdict import Verdict
from lab.checks.words import in_words, ours
from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import check_filtered
from lab.validation import InputError

PARTICLES, FEW = 300, 20
SECONDS = 30.0  # for one run
NAMES = ("problem", "rng")


class Refused(Exception):
    """A run gave a verdict already."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__(verdict.reason)
        self.verdict = verdict


def run_filter(
    question: Question,
    solver: Callable[..., Any],
    problem: Problem,
    seed: Any,
    n_particles: int = PARTICLES,
    watch: Callable[[str, str], bool] | None = None,
    **options: Any,
) -> Filtered:
    """Run the filter once; everything that a run must not do is a verdict.

    Raises
    ------
    Refused
    """
    rng = np.random.default_rng(seed)
    made = guard.call(
        solver, (problem, rng), NAMES, {"n_particles": n_particles, **options}, seconds=SECONDS, watch=watch
    )
    key = question.key
    if isinstance(made.error, NotImplementedError):
        raise Refused(Verdict(key, False, "the stub still raises NotImplementedError", answered=False))
    if made.ours:
        raise Refused(ours(key, made.ours))
    if made.error is not None:
        named = by_message(key, guard.message(made.error))
        reason = f"With {n_particles} particles {guard.describe(made.error, made.line, SECONDS)}."
        if named:
            said, hint = in_words(named)
            raise Refused(Verdict(key, False, f"{reason} {said}", hint, " ".join(named)))
        raise Refused(Verdict(key, False, reason))
    if made.drew:
        raise Refused(
            Verdict(
                key,
                False,
                "random numbers are drawn from a global generator (numpy.random or random), not from rng.",
                "Every number comes from the argument rng, as rng.standard_normal(...) or rng.random(...).",
                "global-generator",
            )
        )
    if made.value is None:
        raise Refused(Verdict(key, False, "nothing comes back (None): is there a return at the end?"))
    try:
        return check_filtered(made.value, problem)
    except InputError as error:
        value = made.value
        if isinstance(value, Filtered) and np.shape(value.means)[:1] == (problem.n_instants - 1,):
            reason, hint = in_words(["time-0-missing"])
            raise Refused(Verdict(key, False, reason, hint, "time-0-missing")) from None
        if isinstance(value, Filtered) and np.isnan(np.asarray(value.means, dtype=float)).any():
            reason, hint = in_words(["nan-kept", "plain-exp"])
            raise Refused(Verdict(key, False, f"Means hold NaN. {reason}", hint, "nan-kept plain-exp")) from None
        raise Refused(Verdict(key, False, f"The result cannot be used: {error}")) from None


def run_alone(
    question: Question, solver: Callable[..., Any], problem: Problem, seed: int, options: dict[str, Any]
) -> Filtered | None:
    """Run the filter with one particle, if it can."""
    try:
        return run_filter(question, solver, problem, (seed, 300), 1, **options)
    except Refused:
        return None


def first_row_of_cloud(run: Filtered, problem: Problem) -> int:
    """Return the first row that holds the moments of a cloud: 1 where row 0 holds those of the prior itself, else 0."""
    model = problem.model
    exact = np.allclose(run.means[0], model.m0, atol=1e-9) and np.allclose(run.covs[0], model.P0, atol=1e-9)
    return int(exact and np.any(model.P0))


def require_randomness(question: Question, solver: Callable[..., Any], problem: Problem, seed: int) -> None:
    """Refuse what does not depend on rng alone.

    Raises
    ------
    Refused
    """
    one, again, other = (run_filter(question, solver, problem, (seed, s), 20) for s in (1, 1, 2))
    if not np.array_equal(one.means, again.means):
        reason = "the same rng gives other numbers at the second call: something else is random, or remembered."
        hint = "Make no generator of your own, and keep nothing between two calls."
        raise Refused(Verdict(question.key, False, reason, hint, "global-generator"))
    if np.array_equal(one.means, other.means):
        reason = "the result does not depend on rng: a particle filter draws, and draws from rng."
        raise Refused(Verdict(question.key, False, reason, "Which of your lines draw, and from what?", "not-random"))


def declared_jitter(solver: Callable[..., Any]) -> float:
    """Return the landmark noise that the filter declares as part of its model, by a keyword of that name."""
    parameters = inspect.signature(solver).parameters
    default = parameters["landmark_noise"].default if "landmark_noise" in parameters else 0.0
    return float(default) if isinstance(default, int | float) and default > 0 else 0.0
