"""The statistic that judges a particle filter: what is unbiased for every number of particles.

Question answered: do a few runs agree with an exact answer?  With Z^ the estimated evidence, at every instant

    E[W] = 1,   E[W d] = 0,   E[W (cov^ + d d' - cov)] = 0,   with W = Z^ / Z and d = mean^ - mean

for SIS, for SIR under any unbiased scheme, for any proper importance function, and for Rao-Blackwellized clouds.  The
largest of the t-statistics decides.  The same statistic asks whether runs agree with the limit of a mistake.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.checks.limits import Limit
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array

# The largest of about 225 t-statistics of a right filter is mostly below DOUBTFUL.  Weights with long tails make larger
# ones likelier than Student's law says, so nothing is refused before fresh runs, many more, have exceeded BOUND.
DOUBTFUL, BOUND = 4.5, 7.0
EXACT = 1e-8  # m: rounding
SLACK = 0.15  # of the log-evidence of k = 1, whose standard error is about 0.01
HEALTHY = 0.3  # of the runs must carry weight, when they are compared with a mistake


class Runs(NamedTuple):
    """Several runs of a filter, stacked: means (runs, N, n), covs (runs, N, n, n), log_evidence (runs, N)."""

    means: Array
    covs: Array
    log_evidence: Array


def stacked(runs: Sequence[Filtered]) -> Runs:
    """Return runs as arrays."""
    return Runs(*(np.array([getattr(run, name) for run in runs]) for name in Runs._fields))


def score(runs: Runs, target: Limit, weigh: bool = True) -> tuple[float, str]:
    """Return the largest t-statistic, and where it is.

    Parameters
    ----------
    runs : Runs
    target : Limit
        What the filter should tend to.
    weigh : bool
        Whether runs count by their evidence, which makes the statistics unbiased.
    """
    ratio = np.ones(runs.means.shape[:2])
    if weigh and target.log_evidence is not None:
        ratio = np.exp(np.clip(runs.log_evidence - target.log_evidence, -700, 300))
    d = runs.means - target.means
    second = runs.covs + d[..., :, np.newaxis] * d[..., np.newaxis, :] - target.covs
    worst, where = 0.0, ""
    for name, values in (
        ("means", ratio[..., np.newaxis] * d),
        ("covs", ratio[..., np.newaxis, np.newaxis] * second),
        ("log_evidence", ratio - 1),
    ):
        average, deviation = values.mean(axis=0), values.std(axis=0, ddof=1)
        t = np.abs(average) / np.maximum(deviation / np.sqrt(len(values)), EXACT)
        if t.max() > worst:
            worst = float(t.max())
            where = f"{name}[{', '.join(map(str, np.unravel_index(np.argmax(t), t.shape)))}]"
    return worst, where


def doubtful(runs: Runs, right: Limit) -> bool:
    """Whether the first runs are not clearly right."""
    return score(runs, right)[0] > DOUBTFUL


def refused(runs: Runs, right: Limit) -> bool:
    """Whether the runs that decide speak against the filter."""
    return score(runs, right)[0] > BOUND


def fits(runs: Runs, target: Limit) -> bool:
    """Whether the runs agree with the limit of a mistake, on enough of them for that to mean anything."""
    if target.log_evidence is not None:
        logs = runs.log_evidence[:, -1] - target.log_evidence[-1]
        ratio = np.exp(logs - logs.max())
        if ratio.sum() ** 2 / np.sum(ratio**2) < HEALTHY * len(ratio):
            return False
    return score(runs, target)[0] <= BOUND


def constants(problem: Problem) -> dict[str, Array]:
    """Return what the log-evidence lacks when the likelihood lacks a constant, cumulative (N,)."""
    found = {}
    for name, pi, det in (("the constants", 1, 1), ("2 pi", 1, 0), ("det R", 0, 1)):
        parts = [0.0]
        for k in range(1, problem.n_instants):
            _, _, R = problem.seen(k)
            parts.append(0.5 * (pi * len(R) * np.log(2 * np.pi) + det * (np.linalg.slogdet(R)[1] if len(R) else 0)))
        found[name] = np.cumsum(parts)
    return found


def lacking_constant(runs: Runs, right: Limit, problem: Problem) -> Array:
    """Return the constant that the log-evidence lacks (N,); zeros when none explains it."""
    average = first_gap(runs, right)
    for lacking in constants(problem).values():
        if abs(average - lacking[1]) < SLACK < abs(lacking[1]):
            return lacking
    return np.zeros(len(right.means))


def first_gap(runs: Runs, right: Limit) -> float:
    """Return by how much the log-evidence of k = 1 is off, averaged over the runs."""
    assert right.log_evidence is not None
    return float(np.log(np.mean(np.exp(np.clip(runs.log_evidence[:, 1] - right.log_evidence[1], -300, 300)))))
