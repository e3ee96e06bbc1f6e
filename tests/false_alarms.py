"""How often a right answer is refused by the random checks: many verdicts on batches of right code.

A check of a filter makes dozens of short runs, thousands of verdicts are hundreds of thousands of runs.  So right
filters are written here for whole batches, all runs of a verdict at once, and their moments go through the statistic
of the check itself.  A refusal takes two stages with independent runs, so its rate is the product of two rates that
can be measured. The schemes and the importance function are batched likewise.  Read by ``bank.py``.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import stats

from lab.checks import filters, importance, running, schemes, unbiased, worlds
from lab.checks.limits import limit


class Stage(NamedTuple):
    """Verdicts of one stage of a check on right code: how many, how many exceed its bound, and the largest of them."""

    question: str
    what: str
    stage: int
    verdicts: int
    exceeding: int
    largest: float

    def upper(self, level: float) -> float:
        """Return the upper confidence bound of the rate (Clopper-Pearson)."""
        return float(stats.beta.ppf(level, self.exceeding + 1, self.verdicts - self.exceeding))


def batch(problem, rng, runs: int, P: int, kind: str):
    """Run a right filter `runs` times at once; kind is sis, sir, guided or rbpf."""
    model = problem.model
    n, N = len(model.m0), problem.n_instants
    F, B, root_Q = model.F[:2, :2], model.B[:2, np.newaxis], np.linalg.cholesky(model.Q[:2, :2])
    x = np.empty((runs, n, P))
    x[:] = model.m0[:, np.newaxis]
    inner = np.zeros((n, n))
    if kind == "rbpf":
        inner[2:, 2:] = model.P0[2:, 2:]
    else:
        x[:, 2:] += np.linalg.cholesky(model.P0[2:, 2:]) @ rng.standard_normal((runs, n - 2, P))
    w = np.full((runs, P), 1 / P)
    means, covs, logs = np.empty((runs, N, n)), np.empty((runs, N, n, n)), np.zeros((runs, N))
    for k in range(N):
        if k:
            if kind != "sis":
                _resample(x, w, rng, "systematic" if kind != "guided" else "multinomial")
            z, H, R = problem.seen(k)
            x[:, :2] = F @ x[:, :2] + B
            draws = rng.standard_normal((runs, 2, P))
            increments = np.zeros((runs, P))
            if kind == "guided" and len(z):
                d = z[:, np.newaxis] - H @ x
                S = H[:, :2] @ model.Q[:2, :2] @ H[:, :2].T + R
                K = np.linalg.solve(S, H[:, :2] @ model.Q[:2, :2]).T
                increments = _log_density(d, S)
                x[:, :2] += K @ d + np.linalg.cholesky(model.Q[:2, :2] - K @ S @ K.T) @ draws
            else:
                x[:, :2] += root_Q @ draws
                if len(z):
                    d = z[:, np.newaxis] - H @ x
                    S = H @ inner @ H.T + R
                    increments = _log_density(d, S)
                    if kind == "rbpf":
                        K = np.linalg.solve(S, H @ inner).T
                        x += K @ d
                        inner = inner - K @ S @ K.T
            top = increments.max(axis=1, keepdims=True)
            w = w * np.exp(increments - top)
            total = w.sum(axis=1, keepdims=True)
            w /= total
            logs[:, k] = logs[:, k - 1] + (np.log(total) + top)[:, 0]
        means[:, k] = (x @ w[..., np.newaxis])[..., 0]
        outer = means[:, k, :, np.newaxis] * means[:, k, np.newaxis]
        covs[:, k] = (x * w[:, np.newaxis]) @ x.swapaxes(1, 2) - outer + inner
    return unbiased.Runs(means, covs, logs)


def _log_density(d, S):
    factor = np.linalg.inv(np.linalg.cholesky(S))
    return -0.5 * (np.sum((factor @ d) ** 2, axis=1) + np.linalg.slogdet(2 * np.pi * S)[1])


def _resample(x, w, rng, scheme):
    P = w.shape[1]
    for i in np.flatnonzero(1 / np.sum(w**2, axis=1) <= 0.5 * P):
        points = (np.arange(P) + rng.random()) / P if scheme == "systematic" else rng.random(P)
        x[i] = x[i][:, np.minimum(np.searchsorted(np.cumsum(w[i]), points), P - 1)]
        w[i] = 1 / P


def of_filter(kind: str, question: str, stage: int, verdicts: int, seed: int) -> Stage:
    """Count how often a right filter exceeds the bound of a stage."""
    problem = worlds.lively() if kind == "rbpf" else worlds.quiet()
    rng, right = np.random.default_rng((seed, stage)), limit(problem)
    runs = filters.RUNS if stage == 1 else filters.MORE
    scores = [unbiased.score(batch(problem, rng, runs, running.PARTICLES, kind), right)[0] for _ in range(verdicts)]
    return _stage(question, kind, stage, scores, unbiased.DOUBTFUL if stage == 1 else unbiased.BOUND)


def of_scheme(kind: str, verdicts: int, seed: int) -> Stage:
    """Count refusals of a right resampling scheme, by the law of its counts over all the calls of a verdict."""
    rng = np.random.default_rng((seed, 2))
    worst = np.zeros(verdicts)
    for weights in schemes._weights().values():
        law = _systematic if kind == "systematic" else _multinomial
        means, deviations = law(weights, rng, schemes.CALLS, verdicts)
        gaps = np.abs(means - len(weights) * weights)
        bound = stats.norm.isf(schemes.TAIL) * np.maximum(deviations, 1e-3) / np.sqrt(schemes.CALLS)
        worst = np.maximum(worst, (gaps / bound).max(axis=1))
    return _stage("q6-resample", kind, 1, worst, 1.0)


def _systematic(weights, rng, calls, verdicts):
    """Count how often u falls between the points where the offspring change: a multinomial law."""
    P = len(weights)
    edges = P * np.append(0, np.cumsum(weights))
    edges[-1] = P
    cuts = np.unique(np.concatenate([[0, 1], edges % 1]))
    offspring = np.diff(np.ceil(edges - (cuts[:-1] + np.diff(cuts) / 2)[:, np.newaxis]), axis=1)
    times = rng.multinomial(calls, np.diff(cuts), verdicts)
    means = times @ offspring / calls
    squares = times @ offspring**2 / calls
    return means, np.sqrt(np.maximum(squares - means**2, 0) * calls / (calls - 1))


def _multinomial(weights, rng, calls, verdicts):
    """Draw the totals; the sample deviation of so many calls is the true one to a percent, which is used."""
    P = len(weights)
    means = rng.multinomial(calls * P, weights, verdicts) / calls
    return means, np.broadcast_to(np.sqrt(P * weights * (1 - weights)), means.shape)


def of_importance(stage: int, verdicts: int, seed: int) -> Stage:
    """Count how often an inflated optimal importance function, whose weights vary, exceeds the bound of a stage."""
    rng = np.random.default_rng((seed, 3, stage))
    tried = [setting for setting in importance.settings() if not setting.label.startswith("landmarks that move")]
    prepared = [(setting, *_prepared(setting)) for setting in tried]
    size = importance.BATCHES if stage == 1 else importance.MORE
    scores = []
    for _ in range(verdicts):
        scores.append(max(importance.score(setting, _inflated(rng, size, *rest))[0] for setting, *rest in prepared))
    return _stage("q9", "inflated", stage, scores, importance.DOUBTFUL if stage == 1 else importance.BOUND)


def _prepared(setting):
    """Return where the cloud is predicted, and what an inflated draw of the robot needs."""
    model, (z, H, R) = setting.problem.model, setting.problem.seen(setting.k)
    predicted = model.F @ np.repeat(setting.parents, importance.CHILDREN, axis=1) + model.B[:, np.newaxis]
    Q = model.Q[:2, :2]
    if not len(z):
        return predicted, Q, None, None, None, None
    S = H[:, :2] @ Q @ H[:, :2].T + R
    K = np.linalg.solve(S, H[:, :2] @ Q).T
    innovation = z[:, np.newaxis] - H @ predicted
    return predicted, Q, 1.5 * (Q - K @ S @ K.T), H[:, :2], R, (innovation, K @ innovation)


def _inflated(rng, size, predicted, Q, spread, H, R, middle):
    step = rng.standard_normal((size, 2, predicted.shape[1]))
    moved = np.repeat(predicted[np.newaxis], size, axis=0)
    if spread is None:
        moved[:, :2] += np.linalg.cholesky(Q) @ step
        return list(zip(moved, np.zeros((len(moved), predicted.shape[1])), strict=True))
    innovation, shift = middle
    step = shift + np.linalg.cholesky(spread) @ step
    moved[:, :2] += step
    logs = _log_density(innovation - H @ step, R) + _log_density(step, Q) - _log_density(step - shift, spread)
    return list(zip(moved, logs, strict=True))


def _stage(question, what, stage, scores, bound) -> Stage:
    scores = np.array(scores) / bound
    return Stage(question, what, stage, len(scores), int((scores > 1).sum()), float(scores.max()))


FILTERS = (("sis", "q4-filter"), ("sir", "q6-filter"), ("guided", "q9-filter"), ("rbpf", "q10-filter"))
PIECES = 4


def jobs(first: int, second: int, schemes_: int) -> list[tuple[Callable[..., Stage], tuple]]:
    """Return what is measured, as functions and arguments, in pieces."""
    found = []
    for seed in range(PIECES):
        for stage, verdicts in ((1, first // PIECES), (2, second // PIECES)):
            found += [(of_filter, (kind, question, stage, verdicts, seed)) for kind, question in FILTERS]
            found.append((of_importance, (stage, verdicts, seed)))
        found += [(of_scheme, (kind, schemes_ // PIECES, seed)) for kind in ("systematic", "multinomial")]
    return found


def merged(stages: list[Stage]) -> list[Stage]:
    """Return one entry per question, right code and stage."""
    groups: dict[tuple[str, str, int], list[Stage]] = {}
    for stage in stages:
        groups.setdefault(stage[:3], []).append(stage)
    return [
        Stage(*key, sum(s.verdicts for s in g), sum(s.exceeding for s in g), max(s.largest for s in g))
        for key, g in groups.items()
    ]


def bounds(stages: list[Stage]) -> dict[tuple[str, str], float]:
    """Return the 95 % bound of the rate of refusals: a refusal takes both stages, whose runs are independent.

    The bound of the product is the product of bounds, each at 97.5 %.
    """
    found: dict[tuple[str, str], float] = {}
    kinds = {(stage.question, stage.what) for stage in stages}
    for key in sorted(kinds):
        of_kind = [stage for stage in stages if (stage.question, stage.what) == key]
        level = 0.95 if len(of_kind) == 1 else 0.975
        found[key] = float(np.prod([stage.upper(level) for stage in of_kind]))
    return found
