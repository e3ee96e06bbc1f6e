"""Whether a filter chooses its ancestors at random.

Question answered: do the particles of a filter get P w_i offspring on average, whatever the weights?  Moments over runs
do not tell: points of resampling that are the same every time are as good as random ones there.  Two particles do.
Landmarks y, y' stand still, so from the moments before and after a resampling

    m_0 = (y + y') / 2,   cov_0 = (y - y')(y - y')' / 4,   m_1 = w y + (1 - w) y',   m_2 = f y + (1 - f) y'

the weight w of the heavier and its share f of the offspring follow, with E[f | w] = w.  The runs are put in the order
of w, and the partial sums of f - w must stay as small as those of a random walk.
"""

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import worlds
from lab.checks.questions import Question
from lab.checks.running import Refused, first_row_of_cloud, run_filter
from lab.checks.verdict import Verdict
from lab.checks.words import in_words
from lab.result import Filtered

RUNS, MORE = 400, 1200  # at first, and where they leave a doubt
BUDGET = 20.0  # seconds for the latter, of a slow filter
OFTEN = 0.999  # threshold: even weights are left alone, whose shares end where fixed points may lie
DOUBTFUL, BOUND = 2.0, 6.0  # deviations of the walk; a right filter passes BOUND with a chance below 1e-8


def look_at_offspring(question: Question, solver: Callable[..., Any], seed: int) -> bool:
    """Refuse a filter whose offspring follow from the weights alone; return whether it could be looked at.

    Raises
    ------
    Refused
    """
    if "ess_threshold" not in inspect.signature(solver).parameters:
        return False
    problem = worlds.blinking("middle")

    def run(number: int) -> Filtered:
        return run_filter(question, solver, problem, (seed, 600, number), 2, ess_threshold=OFTEN)

    try:
        made = [run(number) for number in range(RUNS)]
        if first_row_of_cloud(made[0], problem):
            return False  # it does not say where the two began
        end = time.perf_counter() + BUDGET
        while stray(made) > DOUBTFUL and len(made) < RUNS + MORE and time.perf_counter() < end:
            made += [run(len(made) + number) for number in range(RUNS)]
    except Refused:
        return False  # it cannot run with two particles
    if stray(made) > BOUND:
        reason, hint = in_words(["resampling-fixed"])
        raise Refused(Verdict(question.key, False, reason, hint, "resampling-fixed"))
    return True


def stray(runs: Sequence[Filtered]) -> float:
    """Return how far the partial sums of f - w go, in deviations of their end.

    Parameters
    ----------
    runs : sequence of Filtered
        Of two particles that are resampled between the instants 1 and 2.
    """
    means = np.array([run.means[:3, 2:] for run in runs])
    size, direction = np.linalg.eigh(np.array([run.covs[0, 2:, 2:] for run in runs]))
    apart = 2 * np.sqrt(np.maximum(size[:, -1], np.finfo(float).tiny))
    shares = np.einsum("rki,ri->kr", means[:, 1:] - means[:, :1], direction[:, :, -1]) / apart
    weight, share = shares * np.where(shares[0] < 0, -1, 1)
    steps = (share - weight)[np.argsort(weight)]
    end = np.sqrt(np.sum(steps**2))
    return float(np.abs(np.cumsum(steps)).max() / end) if end > 1e-9 else 0.0
