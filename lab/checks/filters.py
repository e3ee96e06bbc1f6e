"""Checks of whole particle filters, whose answers are random.

Question answered: does a filter estimate what it should?  Not by comparing one long run with the exact moments, which a
right SIR fails, but through what is unbiased for EVERY number of particles: with Z^ the estimated evidence,

    E[W] = 1,   E[W d] = 0,   E[W (cov^ + d d' - cov)] = 0,   with W = Z^ / Z and d = mean^ - mean at every instant

for SIS, for SIR under any unbiased scheme, for any proper importance function, and for Rao-Blackwellized clouds.  Some
short runs on a quiet experiment give a t-statistic for every component; where the largest is doubtful, many more runs
decide.  The bounds leave a right answer a chance below 1e-4 of being refused (measured by ``make bank``).  Resampling
shows on an experiment that sees once and then nothing, where landmarks can move by resampling only.
"""

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lab.checks import exact, guard, limits, worlds
from lab.checks.limits import Limit, limit
from lab.checks.mistakes.densities import likelihoods
from lab.checks.questions import Question
from lab.checks.recipes import log_likelihood_with
from lab.checks.verdict import Verdict
from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import check_filtered
from lab.validation import Array, InputError

RUNS, MORE, PARTICLES = 24, 150, 300
FEWEST = 16  # runs, of a slow filter
# The largest of about 225 t-statistics of a right filter is below DOUBTFUL nearly always; weights with long tails make
# larger ones likelier than Student's law says, so that fresh runs are asked before anything is refused.
DOUBTFUL, HOPELESS, BOUND = 4.5, 20.0, 7.0
SECONDS, BUDGET = 30.0, 15.0  # for one run, and for all
EXACT = 1e-8  # m: rounding
SPREAD = 4.0  # a resampled cloud has this much less noise than one that is not, at least (it is about 20)
STILL = 1e-6  # m
SLACK = 0.15  # of the log-evidence of k = 1, whose standard error is about 0.01
HEALTHY = 0.3  # of the runs must carry weight, when they are compared with a mistake
NAMES = ("problem", "rng")


class Refused(Exception):
    """A run gave a verdict already."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__(verdict.reason)
        self.verdict = verdict


def examine(
    question: Question, solver: Callable[..., Any], watch: Callable[[str, str], bool], seed: int = 0
) -> Verdict:
    """Return the verdict on a particle filter.

    Parameters
    ----------
    question : Question
    solver : function
        solver(problem, rng, *, n_particles) -> Filtered.
    watch : function
        Which calls leave the answer to the laboratory.
    seed : int
        Of the runs; the bank varies it.
    """
    try:
        jitter = _declared_jitter(solver)
        problem = (worlds.lively() if question.key == "q10-filter" else worlds.quiet()).with_landmark_noise(jitter)
        seconds = _first_run(question, solver, problem, watch, seed)
        _is_random(question, solver, problem, seed)
        runs = _runs(question, solver, problem, seed, seconds)
        if doubtful(stacked(runs), limit(problem)):
            runs = _runs(question, solver, problem, (seed, 1), seconds, MORE)
        passed = ["moments and evidence on a short experiment"]
        verdict = _judge(question, solver, problem, runs)
        if verdict is not None:
            return verdict
        said = []
        if question.key in ("q4-filter", "q6-filter"):
            said += _resampling(question, solver, jitter, seed)
            passed += ["when it resamples", "that nothing else moves the landmarks"]
        if question.key == "q10-filter":
            _rao_blackwellized(question, runs, problem)
            passed.append("landmarks are not sampled")
        if said_constant := _constant(runs, limit(problem)):
            said.append(said_constant)
    except Refused as refusal:
        return refusal.verdict
    return Verdict(question.key, True, f"public checks passed ({len(passed)}/{len(passed)}).", " ".join(said))


def _declared_jitter(solver: Callable[..., Any]) -> float:
    """Return the landmark noise that the filter declares as part of its model, by a keyword of that name."""
    parameters = inspect.signature(solver).parameters
    default = parameters["landmark_noise"].default if "landmark_noise" in parameters else 0.0
    return float(default) if isinstance(default, int | float) and default > 0 else 0.0


def _run(
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
        raise Refused(exact.ours(key, made.ours))
    if made.error is not None:
        text = str(made.error)
        named = exact.by_message(text)
        reason = f"With {n_particles} particles {guard.describe(made.error, made.line, SECONDS)}."
        if named:
            said, hint = exact.in_words(named)
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
            reason, hint = exact.in_words(["time-0-missing"])
            raise Refused(Verdict(key, False, reason, hint, "time-0-missing")) from None
        if isinstance(value, Filtered) and np.isnan(np.asarray(value.means, dtype=float)).any():
            reason, hint = exact.in_words(["nan-kept", "plain-exp"])
            raise Refused(Verdict(key, False, f"Means hold NaN. {reason}", hint, "nan-kept plain-exp")) from None
        raise Refused(Verdict(key, False, f"The result cannot be used: {error}")) from None


def _first_run(
    question: Question, solver: Callable[..., Any], problem: Problem, watch: Callable[[str, str], bool], seed: int
) -> float:
    _run(question, solver, problem, (seed, 0), 20, watch)
    start = time.perf_counter()
    _run(question, solver, problem, (seed, 0))
    return time.perf_counter() - start


def _is_random(question: Question, solver: Callable[..., Any], problem: Problem, seed: int) -> None:
    """Refuse what does not depend on rng alone.

    Raises
    ------
    Refused
    """
    one, again, other = (_run(question, solver, problem, (seed, s), 20) for s in (1, 1, 2))
    if not np.array_equal(one.means, again.means):
        reason = "the same rng gives other numbers at the second call: something else is random, or remembered."
        hint = "Make no generator of your own, and keep nothing between two calls."
        raise Refused(Verdict(question.key, False, reason, hint, "global-generator"))
    if np.array_equal(one.means, other.means):
        reason = "the result does not depend on rng: a particle filter draws, and draws from rng."
        raise Refused(Verdict(question.key, False, reason, "Which of your lines draw, and from what?", "not-random"))


def _runs(
    question: Question, solver: Callable[..., Any], problem: Problem, seed: Any, seconds: float, most: int = RUNS
) -> list[Filtered]:
    runs = int(np.clip(BUDGET / max(seconds, 1e-9), FEWEST, most))
    return [_run(question, solver, problem, (*np.ravel(seed).tolist(), 10 + run)) for run in range(runs)]


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
    """Whether the first runs are neither clearly right nor hopeless."""
    return DOUBTFUL < score(runs, right)[0] < HOPELESS


def refused(runs: Runs, right: Limit) -> bool:
    """Whether the runs that decide speak against the filter."""
    return score(runs, right)[0] > BOUND


def _fits(runs: Runs, target: Limit) -> bool:
    """Whether the runs agree with the limit of a mistake, on enough of them for that to mean anything."""
    if target.log_evidence is not None:
        logs = runs.log_evidence[:, -1] - target.log_evidence[-1]
        ratio = np.exp(logs - logs.max())
        if ratio.sum() ** 2 / np.sum(ratio**2) < HEALTHY * len(ratio):
            return False
    return score(runs, target)[0] <= BOUND


def _constants(problem: Problem) -> dict[str, Array]:
    """Return what the log-evidence lacks when the likelihood lacks a constant, cumulative (N,)."""
    found = {}
    for name, pi, det in (("the constants", 1, 1), ("2 pi", 1, 0), ("det R", 0, 1)):
        parts = [0.0]
        for k in range(1, problem.n_instants):
            _, _, R = problem.seen(k)
            parts.append(0.5 * (pi * len(R) * np.log(2 * np.pi) + det * (np.linalg.slogdet(R)[1] if len(R) else 0)))
        found[name] = np.cumsum(parts)
    return found


def _lacking(runs: Runs, right: Limit, problem: Problem) -> Array:
    """Return the constant that the log-evidence lacks (N,); zeros when none explains it."""
    average = _first_gap(runs, right)
    for lacking in _constants(problem).values():
        if abs(average - lacking[1]) < SLACK < abs(lacking[1]):
            return lacking
    return np.zeros(len(right.means))


def _first_gap(runs: Runs, right: Limit) -> float:
    """Return by how much the log-evidence of k = 1 is off, averaged over the runs."""
    assert right.log_evidence is not None
    return float(np.log(np.mean(np.exp(np.clip(runs.log_evidence[:, 1] - right.log_evidence[1], -300, 300)))))


def _constant(runs: Sequence[Filtered], right: Limit) -> str:
    if abs(_first_gap(stacked(runs), right)) < SLACK:
        return ""
    return "Your likelihood lacks its constants: moments do not mind, but log_evidence is off by them."


def _judge(
    question: Question, solver: Callable[..., Any], problem: Problem, filtered: Sequence[Filtered]
) -> Verdict | None:
    """Return None when the runs agree with the exact answer, else the verdict."""
    right, runs, key = limit(problem), stacked(filtered), question.key
    worst, where = score(runs, right)
    if not refused(runs, right):
        return None
    lacking = _lacking(runs, right, problem)
    if lacking.any():
        runs = runs._replace(log_evidence=runs.log_evidence - lacking)
        if not refused(runs, right):
            return None
    named = _by_one_particle(question, solver, problem)
    named = named or [mistake for mistake, found in limits.mistaken(problem) if _fits(runs, found)]
    moments_fine = score(runs, right, weigh=False)[0] <= 1.5 * BOUND
    summed = runs._replace(log_evidence=np.cumsum(runs.log_evidence, axis=1))
    if not named and moments_fine and not refused(summed, right):
        named = ["evidence-increments"]
    named = list(dict.fromkeys(named)) or exact.global_data(solver)
    far = f"{worst:.0f}" if worst < 1000 else "more than 1000"
    found = f"{where} is {far} standard errors off over {len(filtered)} runs"
    if named:
        reason, hint = exact.in_words(named)
        return Verdict(key, False, f"{reason} Found: {found}.", hint, " ".join(named))
    if moments_fine:
        reason = f"Means and covariances agree with the exact ones, but log_evidence does not: {found}."
        hint = "Entry k is log p(z_1..z_k): what step k adds comes from the carried weights and all likelihoods."
        return Verdict(key, False, reason, hint)
    hint = "Check your step by itself first; then the start, the order of the steps, and the row in which you store."
    return Verdict(key, False, f"The filter does not estimate the exact moments: {found}.", hint)


def _by_one_particle(question: Question, solver: Callable[..., Any], problem: Problem) -> list[str]:
    """Return the mistakes of the likelihood, read off clouds of one particle.

    Its weight is 1 and the mean is the particle, so the increments of the log-evidence are the log-likelihoods.
    """
    if question.key not in ("q4-filter", "q6-filter"):
        return []
    try:
        runs = [_run(question, solver, problem, (7, run), 1) for run in range(6)]
    except Refused:
        return []
    instants = [k for k in range(1, problem.n_instants) if not np.isnan(problem.z[k]).all()]
    increments = np.array([np.diff(run.log_evidence)[[k - 1 for k in instants]] for run in runs])
    found = []
    for key, likelihood in [("", log_likelihood_with()), *likelihoods()]:
        for shift in (0, -1):
            try:
                with np.errstate(all="ignore"):
                    expected = np.array([_likelihoods(likelihood, problem, run.means, instants, shift) for run in runs])
            except (ValueError, IndexError, np.linalg.LinAlgError):
                continue
            gaps = (increments - increments.mean(axis=0)) - (expected - expected.mean(axis=0))
            if np.abs(gaps).max() <= 1e-7 * max(1.0, np.abs(expected).max()):
                found.append("late" if shift else key)
    return [] if "" in found else list(dict.fromkeys(found))


def _likelihoods(likelihood: Any, problem: Problem, means: Array, instants: Sequence[int], shift: int) -> list[float]:
    """Return log p(z_k given the particle) at several instants, with z_{k + shift} for z_k."""
    return [
        float(likelihood(problem.z[k + shift], means[k][:, np.newaxis], problem.H[k + shift], problem.R[k + shift])[0])
        for k in instants
    ]


def _resampling(question: Question, solver: Callable[..., Any], jitter: float, seed: int) -> list[str]:
    """Look when the filter resamples; return advice.

    Raises
    ------
    Refused
    """
    options: dict[str, Any] = {}
    if question.key == "q6-filter" and "ess_threshold" in inspect.signature(solver).parameters:
        options["ess_threshold"] = 0.5
    strong, weak = worlds.blinking("strong"), worlds.blinking("weak")
    clouds = [_run(question, solver, strong, (seed, 100 + run), **options) for run in range(12)]
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
        alone = _alone(question, solver, weak, seed, options)
        if alone is not None and np.abs(np.diff(alone.means[:, 2:], axis=0)).max() > STILL:
            found = "A cloud of one particle has landmarks that move."
            raise Refused(_named(question, "jitter-undeclared", found))
        still = [_run(question, solver, weak, (seed, 200 + run), **options) for run in range(3)]
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


def _alone(
    question: Question, solver: Callable[..., Any], problem: Problem, seed: int, options: dict[str, Any]
) -> Filtered | None:
    """Run the filter with one particle, if it can."""
    try:
        return _run(question, solver, problem, (seed, 300), 1, **options)
    except Refused:
        return None


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
    reason, hint = exact.in_words([key])
    return Verdict(question.key, False, f"{reason} Found: {found}", hint, key)


def _rao_blackwellized(question: Question, runs: Sequence[Filtered], problem: Problem) -> None:
    """Refuse a filter that samples landmarks: at k = 0 their moments would not be exact.

    Raises
    ------
    Refused
    """
    model = problem.model
    for run in runs:
        if np.abs(run.means[0, 2:] - model.m0[2:]).max() > 1e-6 or np.abs(run.covs[0] - model.P0).max() > 1e-6:
            reason = "the landmarks are sampled: their moments at k = 0 are not exactly those of the prior."
            hint = "Given the robot's path, which law do the landmarks have? Only the robot needs particles."
            raise Refused(Verdict(question.key, False, reason, hint, "not-rao-blackwellized"))
