"""When a filter resamples.

Question answered: does it resample when, and only when, the effective sample size has fallen?  On an experiment that
sees once, at k = 1, and then nothing, landmarks that stand still can change their moments by resampling only, and how
far the mean robot strays tells how many particles carry it.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import worlds
from lab.checks.questions import Question
from lab.checks.running import PARTICLES, Refused, first_row_of_cloud, run_alone, run_filter
from lab.checks.verdict import Verdict
from lab.checks.words import in_words
from lab.problem import Problem
from lab.result import Filtered

SPREAD = 4.0  # a resampled cloud has this much less noise than one that is not, at least (it is about 20)
SHARED = 0.2 * PARTICLES  # particles that share their noise stray P times as far as those that do not
SEVERAL = 12  # runs
STILL = 1e-6  # m


def look_at_resampling(question: Question, solver: Callable[..., Any], jitter: float, seed: int) -> list[str]:
    """Look when the filter resamples; return advice.

    Raises
    ------
    Refused
    """
    options: dict[str, Any] = {}
    if question.key == "q6-filter" and "ess_threshold" in inspect.signature(solver).parameters:
        options["ess_threshold"] = 0.5
    strong, weak = worlds.blinking("strong"), worlds.blinking("weak")
    still = [run_filter(question, solver, weak, (seed, 200 + run), **options) for run in range(SEVERAL)]
    if _noise(still, weak) > SHARED:
        found = "A mean of many particles strays as far as a single one."
        raise Refused(_named(question, "noise-shared", found))
    if not jitter:
        _require_still(question, solver, weak, seed, options)
        instants = _moving_instants(still, range(2, weak.n_instants))
        if instants:
            every = len(instants) == weak.n_instants - 2
            key = "always-resampled" if every or instants == [2] else "fixed-instants"
            ruined = [run_filter(question, solver, strong, (seed, 500 + run), **options) for run in range(SEVERAL)]
            if key == "always-resampled" and question.key == "q6-filter" and _noise(ruined, strong) >= SPREAD:
                key = "test-inverted"
            said_when = f"The landmarks' moments change at k = {', '.join(map(str, instants))}, when nothing is seen"
            raise Refused(_named(question, key, f"{said_when} and the weights are healthy (ESS about 0.9 P)."))
    clouds = [run_filter(question, solver, strong, (seed, 100 + run), **options) for run in range(SEVERAL)]
    resamples = _noise(clouds, strong) < SPREAD
    if question.key == "q4-filter" and resamples:
        raise Refused(_named(question, "always-resampled", "SIS never resamples, and this filter does."))
    if question.key == "q6-filter" and not resamples and _moving_instants(clouds, range(2, strong.n_instants)):
        found = "The cloud is resampled, and a step later its weights are as uneven as before."
        raise Refused(_named(question, "weights-not-reset", found))
    if question.key == "q6-filter" and not resamples:
        raise Refused(
            _named(question, "never-resampled", "After a measurement that ruins the weights they stay ruined.")
        )
    if options:
        never = [run_filter(question, solver, strong, (seed, 700 + run), ess_threshold=0.0) for run in range(SEVERAL)]
        if _noise(never, strong) < SPREAD:
            found = "With ess_threshold=0 the cloud is resampled all the same."
            raise Refused(_named(question, "threshold-typed", found))
    said = []
    if not jitter:
        instants = _moving_instants(clouds[:3], range(3, strong.n_instants))
        if instants:
            found = f"The landmarks' moments change at k = {instants[0]}, though the cloud was resampled before."
            raise Refused(_named(question, "weights-not-reset", found))
    if first_row_of_cloud(clouds[0], strong):
        said.append("Row 0 holds the moments of the prior itself; those of the cloud that was drawn belong there.")
    before = not jitter and not _moving_instants(clouds, [2])
    if question.key == "q6-filter" and (
        before or all(run.ess is not None and run.ess[1] > 0.999 * PARTICLES for run in clouds)
    ):
        what = "The moments are those" if before else "The effective sample size is that"
        said.append(
            f"{what} after resampling, which adds noise: take moments and size from the weighted cloud, before."
        )
    return said


def look_at_reset(question: Question, solver: Callable[..., Any], jitter: float, seed: int) -> None:
    """Refuse a filter that resamples, so that landmarks change their moments, and keeps uneven weights.

    Whether it resamples at all is left to an importance function, or to a Rao-Blackwellized filter.

    Raises
    ------
    Refused
    """
    if jitter:
        return
    ruined = worlds.blinking("robot")
    clouds = [run_filter(question, solver, ruined, (seed, 100 + run)) for run in range(SEVERAL)]
    if _noise(clouds, ruined) > 2 * SPREAD and _moving_instants(clouds, range(2, ruined.n_instants)):
        found = "The cloud is resampled, and later its weights are as uneven as before."
        raise Refused(_named(question, "weights-not-reset", found))


def _noise(runs: Sequence[Filtered], problem: Problem) -> float:
    """Return how much the mean robot strays when nothing is seen, relative to the mean of P equal particles.

    It is P over the number of particles that carry the mean.
    """
    model = problem.model
    strays = np.array([run.means[4, :2] - (model.F @ run.means[3] + model.B)[:2] for run in runs])
    return float(PARTICLES * np.mean(np.sum(strays * np.linalg.solve(model.Q[:2, :2], strays.T).T, axis=1)) / 2)


def _require_still(
    question: Question, solver: Callable[..., Any], weak: Problem, seed: int, options: dict[str, Any]
) -> None:
    """Refuse what one particle shows: landmarks that move, by resampling, too, or a cloud of another size.

    Raises
    ------
    Refused
    """
    tried = [options, {**options, "ess_threshold": 1.0}] if options else [options]
    for each in tried:
        alone = run_alone(question, solver, weak, seed, each)
        if alone is None:
            continue
        first = first_row_of_cloud(alone, weak)
        if np.abs(alone.covs[first:]).max() > STILL:
            raise Refused(_named(question, "size-ignored", "A cloud of one particle has a spread."))
        if np.abs(np.diff(alone.means[first:, 2:], axis=0)).max() > STILL:
            found = "A cloud of one particle has landmarks that move."
            raise Refused(_named(question, "jitter-undeclared", found))


def _moving_instants(runs: Sequence[Filtered], instants: Sequence[int]) -> list[int]:
    """Return the instants at which a landmark's mean or variance differs from the instant before."""
    return [
        k
        for k in instants
        if any(
            np.abs(run.means[k, 2:] - run.means[k - 1, 2:]).max() > 1e-7
            or np.abs(run.covs[k, 2:, 2:] - run.covs[k - 1, 2:, 2:]).max() > 1e-7
            for run in runs
        )
    ]


def _named(question: Question, key: str, found: str) -> Verdict:
    reason, hint = in_words([key])
    return Verdict(question.key, False, f"{reason} Found: {found}", hint, key)
