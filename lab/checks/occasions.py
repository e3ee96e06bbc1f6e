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
from lab.checks.running import PARTICLES, Refused, run_alone, run_filter
from lab.checks.verdict import Verdict
from lab.checks.words import in_words
from lab.result import Filtered

SPREAD = 4.0  # a resampled cloud has this much less noise than one that is not, at least (it is about 20)
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
    clouds = [run_filter(question, solver, strong, (seed, 100 + run), **options) for run in range(12)]
    # after k = 1 nothing is seen: how much the mean robot strays tells how many particles carry it
    model = strong.model
    strays = np.array([run.means[4, :2] - (model.F @ run.means[3] + model.B)[:2] for run in clouds])
    noise = PARTICLES * np.mean(np.sum(strays * np.linalg.solve(model.Q[:2, :2], strays.T).T, axis=1)) / 2
    resamples = noise < SPREAD
    if question.key == "q4-filter" and resamples:
        raise Refused(_named(question, "always-resampled", "SIS never resamples, and this filter does."))
    if question.key == "q6-filter" and not resamples and _moving_instants(clouds, range(2, strong.n_instants)):
        found = "The cloud is resampled, and a step later its weights are as uneven as before."
        raise Refused(_named(question, "weights-not-reset", found))
    if question.key == "q6-filter" and not resamples:
        raise Refused(
            _named(question, "never-resampled", "After a measurement that ruins the weights they stay ruined.")
        )
    said = []
    if not jitter:
        alone = run_alone(question, solver, weak, seed, options)
        if alone is not None and np.abs(np.diff(alone.means[:, 2:], axis=0)).max() > STILL:
            found = "A cloud of one particle has landmarks that move."
            raise Refused(_named(question, "jitter-undeclared", found))
        still = [run_filter(question, solver, weak, (seed, 200 + run), **options) for run in range(3)]
        instants = _moving_instants(still, range(2, weak.n_instants))
        if instants:
            every = len(instants) == weak.n_instants - 2
            key = "always-resampled" if every or instants == [2] else "fixed-instants"
            said_when = f"The landmarks' moments change at k = {', '.join(map(str, instants))}, when nothing is seen"
            raise Refused(_named(question, key, f"{said_when} and the weights are healthy (ESS about 0.9 P)."))
        instants = _moving_instants(clouds[:3], range(3, strong.n_instants))
        if instants:
            found = f"The landmarks' moments change at k = {instants[0]}, though the cloud was resampled before."
            raise Refused(_named(question, "weights-not-reset", found))
    if question.key == "q6-filter" and all(run.ess is not None and run.ess[1] > 0.999 * PARTICLES for run in clouds):
        said.append(
            "The moments come after resampling, which adds noise to them: take them from the weighted cloud, before."
        )
    return said


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
