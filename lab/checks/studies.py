"""Check of the study of question 8, by a solver that keeps a record of how it was called.

Question answered: does the study run each number of particles as often as asked, with different random numbers, and
report the mean gap and its standard error?  The solver that it is given returns noisy exact moments and remembers them,
so the right table follows from what was asked for, whatever the seeds were.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from lab.checks import guard, reading, reference, worlds
from lab.checks.mistakes import small
from lab.checks.naming import ACCEPTED, SAME, close
from lab.checks.questions import Question
from lab.checks.reading import Unreadable
from lab.checks.verdict import Verdict
from lab.checks.words import edited, in_words, ours
from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import kalman
from lab.validation import Array

SIZES, RUNS = [7, 19, 4], 5
SECONDS = 60.0


class Recorder:
    """A solver whose error is known: exact moments with noise of 1 / sqrt(P) deviations."""

    def __init__(self, exact_answer: Filtered) -> None:
        """Start with no calls."""
        self.exact = exact_answer
        self.calls: list[tuple[int, Filtered]] = []

    def __call__(self, problem: Problem, rng: np.random.Generator, *, n_particles: int) -> Filtered:
        """Return noisy exact moments."""
        noise = rng.standard_normal(self.exact.means.shape) * (0.5 + rng.random()) / np.sqrt(n_particles)
        covs = self.exact.covs * (1 - 0.5 / n_particles)
        found = Filtered(self.exact.means + noise * self.exact.stds, covs, self.exact.log_evidence)
        self.calls.append((n_particles, found))
        return found


def examine(question: Question, study: Callable[..., Any], watch: Callable[[str, str], bool]) -> Verdict:
    """Return the verdict on a study."""
    key, problem = question.key, worlds.problems()["five landmarks, another centre and speed"]
    right = kalman(problem)
    recorder = Recorder(right)

    def solver(problem: Problem, rng: np.random.Generator, *, n_particles: int) -> Filtered:
        return recorder(problem, rng, n_particles=n_particles)

    names = [value.name for value in question.arguments]
    made = guard.call(study, (problem, solver, list(SIZES), RUNS, 3), names, seconds=SECONDS, watch=watch)
    if isinstance(made.error, NotImplementedError):
        return Verdict(key, False, "the stub still raises NotImplementedError", answered=False)
    if made.ours:
        return ours(key, made.ours)
    if made.error is not None:
        return Verdict(key, False, f"{guard.describe(made.error, made.line, SECONDS)}.")
    if made.changed:
        return Verdict(key, False, *edited(made.changed), mistake="edits-arguments")
    try:
        (value,) = reading.several(made.value, ["table"])
        table = reading.shaped("table", reading.number_of("table", value), (len(SIZES), 3), "(len(sizes), 3)")
    except Unreadable as error:
        return Verdict(key, False, f"{error}.")
    verdict = _judge(key, table, recorder)
    if verdict.passed:
        again = guard.call(study, (problem, solver, list(SIZES), RUNS, 3), names, seconds=SECONDS)
        if again.error is not None or not close(
            np.asarray(again.value, dtype=np.float64), np.asarray(made.value), SAME
        ):
            reason, hint = in_words(["seed-ignored"])
            return Verdict(key, False, reason, hint, "seed-ignored")
    return verdict


def _judge(key: str, table: Array, recorder: Recorder) -> Verdict:
    if not np.array_equal(table[:, 0], SIZES):
        if not np.array_equal(np.sort(table[:, 0]), np.sort(SIZES)):
            return Verdict(key, False, f"the first column is {table[:, 0]}, not the sizes {SIZES}.")
        table = table[[int(np.flatnonzero(table[:, 0] == size)[0]) for size in SIZES]]
    by_size = {size: [found for n, found in recorder.calls if n == size] for size in SIZES}
    for size, found in by_size.items():
        if len(found) != RUNS:
            return Verdict(key, False, f"the solver ran {len(found)} times with P = {size}, not {RUNS} times.")
        if len({answer.means.tobytes() for answer in found}) < RUNS:
            reason, hint = in_words(["same-numbers"])
            return Verdict(key, False, f"{reason} Found: runs with P = {size} are equal.", hint, "same-numbers")
    gaps = np.array([[reference.mean_gap(found, recorder.exact) for found in by_size[size]] for size in SIZES])
    means, errors = gaps.mean(axis=1), gaps.std(axis=1, ddof=1) / np.sqrt(RUNS)
    biased = gaps.std(axis=1) / np.sqrt(RUNS)
    mean_right = close(table[:, 1], means, ACCEPTED)
    if mean_right and close(table[:, 2], errors, ACCEPTED):
        return Verdict(key, True, "public checks passed (3/3).")
    if mean_right and close(table[:, 2], biased, ACCEPTED):
        return Verdict(key, True, "public checks passed (3/3).", "With few runs divide by runs - 1: ddof=1.")
    if mean_right:
        deviations = (gaps.std(axis=1, ddof=1), gaps.std(axis=1), gaps.var(axis=1), gaps.var(axis=1, ddof=1))
        if any(close(table[:, 2], d, ACCEPTED) for d in deviations):
            reason, hint = in_words(["deviation-for-error"])
            return Verdict(key, False, reason, hint, "deviation-for-error")
        spread = np.column_stack([errors, biased])
        scaled = (spread / np.sqrt(RUNS), 1.959963984540054 * spread, 1.96 * spread, 2 * spread, spread**2)
        reason = "the mean gaps are right, their standard errors are not."
        if any(close(table[:, 2], e, ACCEPTED) for group in scaled for e in group.T):
            reason, hint = in_words(["error-scaled"])
            return Verdict(key, False, reason, hint, "error-scaled")
        return Verdict(key, False, reason, "A standard error is sd / sqrt(runs), the sd over the runs of one size.")
    named = []
    for mistake, wrong in small.gaps:
        values = np.array([[wrong(found, recorder.exact) for found in by_size[size]] for size in SIZES])
        if close(table[:, 1], values.mean(axis=1), 1e-8):
            named.append(mistake)
    if named:
        reason, hint = in_words(list(dict.fromkeys(named)))
        return Verdict(key, False, reason, hint, " ".join(dict.fromkeys(named)))
    hint = "Compare with mean_gap of question 8, averaged over the runs; the reference is the exact filter."
    return Verdict(key, False, "the mean gaps are not those of the runs that were made.", hint)
