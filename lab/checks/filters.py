"""Checks of whole particle filters, whose answers are random.

Question answered: does a filter estimate what it should?  Not by comparing one long run with the exact moments, which a
right SIR fails: some short runs on a quiet experiment go through the statistic of `lab.checks.unbiased`; where that is
doubtful, many more runs decide.  The bounds leave a right answer a chance below 1e-4 of being refused (measured by
``make bank``).  Then `lab.checks.occasions` looks when it resamples.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks import limits, worlds
from lab.checks.limits import Limit, limit
from lab.checks.mistakes.densities import likelihoods
from lab.checks.mistakes.filters import simulated
from lab.checks.naming import global_data
from lab.checks.occasions import look_at_resampling, look_at_reset
from lab.checks.offspring import look_at_offspring
from lab.checks.questions import Question
from lab.checks.recipes import log_likelihood_with
from lab.checks.running import (
    PARTICLES,
    Refused,
    declared_jitter,
    first_row_of_cloud,
    require_randomness,
    run_filter,
)
from lab.checks.unbiased import BOUND, SLACK, doubtful, first_gap, fits, lacking_constant, refused, score, stacked
from lab.checks.verdict import Verdict
from lab.checks.words import in_words
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array

RUNS, MORE = 24, 150  # at first, and where they leave a doubt
FEWEST, BUDGET = 16, 15.0  # runs of a slow filter, and seconds for them


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
        jitter = declared_jitter(solver)
        problem = (worlds.lively() if question.key == "q10-filter" else worlds.quiet()).with_landmark_noise(jitter)
        seconds = _first_run(question, solver, problem, watch, seed)
        require_randomness(question, solver, problem, seed)
        runs = _runs(question, solver, problem, seed, seconds)
        if doubtful(stacked(runs), limit(problem)):
            runs = _runs(question, solver, problem, (seed, 1), seconds, MORE)
        passed = ["moments and evidence on a short experiment"]
        verdict = _judge(question, solver, problem, runs)
        if verdict is not None:
            return verdict
        said = []
        _require_cloud(question, runs, problem)
        if question.key in ("q4-filter", "q6-filter"):
            said += look_at_resampling(question, solver, jitter, seed)
            passed += ["when it resamples", "that nothing else moves the landmarks"]
            if question.key == "q6-filter" and not jitter and look_at_offspring(question, solver, seed):
                passed.append("that offspring are drawn")
        else:
            look_at_reset(question, solver, jitter, seed)
            passed.append("even weights after resampling")
        if question.key == "q9-filter":
            _looks(question, solver, problem, seed)
            passed.append("that the draw looks at the measurement")
        if question.key == "q10-filter":
            _rao_blackwellized(question, runs, problem)
            passed.append("landmarks are not sampled")
        if said_constant := _constant(runs, limit(problem)):
            said.append(said_constant)
    except Refused as refusal:
        return refusal.verdict
    return Verdict(question.key, True, f"public checks passed ({len(passed)}/{len(passed)}).", " ".join(said))


def _first_run(
    question: Question, solver: Callable[..., Any], problem: Problem, watch: Callable[[str, str], bool], seed: int
) -> float:
    run_filter(question, solver, problem, (seed, 0), 20, watch)
    start = time.perf_counter()
    run_filter(question, solver, problem, (seed, 0))
    return time.perf_counter() - start


def _runs(
    question: Question, solver: Callable[..., Any], problem: Problem, seed: Any, seconds: float, most: int = RUNS
) -> list[Filtered]:
    runs = int(np.clip(BUDGET / max(seconds, 1e-9), FEWEST, most))
    return [run_filter(question, solver, problem, (*np.ravel(seed).tolist(), 10 + run)) for run in range(runs)]


def _judge(
    question: Question, solver: Callable[..., Any], problem: Problem, filtered: Sequence[Filtered]
) -> Verdict | None:
    """Return None when the runs agree with the exact answer, else the verdict."""
    right, runs, key = limit(problem), stacked(filtered), question.key
    worst, where = score(runs, right)
    if not refused(runs, right):
        return None
    lacking = lacking_constant(runs, right, problem)
    if lacking.any():
        runs = runs._replace(log_evidence=runs.log_evidence - lacking)
        if not refused(runs, right):
            return None
    named = _by_one_particle(question, solver, problem)
    named = named or [mistake for mistake, found in limits.mistaken(problem) if fits(runs, found)]
    named = named or _by_blocks(question, filtered)
    moments_fine = score(runs, right, weigh=False)[0] <= 1.5 * BOUND
    summed = runs._replace(log_evidence=np.cumsum(runs.log_evidence, axis=1))
    if not named and moments_fine and not refused(summed, right):
        named = ["evidence-increments"]
    if moments_fine and not np.any(runs.log_evidence):
        named = ["evidence-missing"]
    named = list(dict.fromkeys(named)) or global_data(solver)
    if not named:
        alike = list(dict.fromkeys(simulated(key, problem, list(filtered), PARTICLES)))
        if moments_fine:
            alike = [mistake for mistake in alike if mistake.startswith("evidence")] or alike
        named = alike if len(alike) <= 3 else []  # more than that is a lack of evidence
    far = f"{worst:.0f}" if worst < 1000 else "more than 1000"
    found = f"{where} is {far} standard errors off over {len(filtered)} runs"
    if named:
        reason, hint = in_words(named)
        return Verdict(key, False, f"{reason} Found: {found}.", hint, " ".join(named))
    if moments_fine:
        reason = f"Means and covariances agree with the exact ones, but log_evidence does not: {found}."
        hint = "Entry k is log p(z_1..z_k): what step k adds comes from the carried weights and all likelihoods."
        return Verdict(key, False, reason, hint)
    hint = "Check your step by itself first; then the start, the order of the steps, and the row in which you store."
    return Verdict(key, False, f"The filter does not estimate the exact moments: {found}.", hint)


def _require_cloud(question: Question, runs: Sequence[Filtered], problem: Problem) -> None:
    """Refuse particles that start at one and the same point, and effective sample sizes that cannot be.

    A cloud whose particles share their random numbers is unbiased, too: only its spread gives it away.

    Raises
    ------
    Refused
    """
    k = first_row_of_cloud(runs[0], problem)
    spread = np.mean([np.trace(run.covs[k]) for run in runs]) / np.trace(limit(problem).covs[k])
    if spread < 0.5:
        reason, hint = in_words(["noise-shared"])
        found = f"the covariances at k = {k} are far too small"
        raise Refused(Verdict(question.key, False, f"{reason} Found: {found}.", hint, "noise-shared"))
    sizes = [np.asarray(run.ess, dtype=np.float64)[1:] for run in runs if run.ess is not None]
    if not sizes:
        return
    key = "ess-of-filter"
    low, high = float(np.min(sizes)), float(np.max(sizes))
    if low < 1 - 1e-6 or high > PARTICLES * (1 + 1e-6):
        reason, hint = in_words([key])
        found = f"with {PARTICLES} particles ess goes from {low:.3g} to {high:.3g}"
        raise Refused(Verdict(question.key, False, f"{reason} Found: {found}.", hint, key))


def _looks(question: Question, solver: Callable[..., Any], problem: Problem, seed: int) -> None:
    """Refuse a draw that does not depend on the measurement: the mean of one particle is where it went.

    Raises
    ------
    Refused
    """
    z = problem.z.copy()
    z[1] += 0.4
    other = Problem(problem.model, z, problem.H, problem.R)
    try:
        one, two = (run_filter(question, solver, given, (seed, 400), 1) for given in (problem, other))
    except Refused:
        return  # it cannot run with one particle
    if np.abs(one.means[1] - two.means[1]).max() < 1e-9:
        reason, hint = in_words(["z-ignored-in-draw"])
        raise Refused(Verdict(question.key, False, reason, hint, "z-ignored-in-draw"))


def _constant(runs: Sequence[Filtered], right: Limit) -> str:
    if abs(first_gap(stacked(runs), right)) < SLACK:
        return ""
    return "Your likelihood lacks its constants: moments do not mind, but log_evidence is off by them."


def _by_blocks(question: Question, runs: Sequence[Filtered]) -> list[str]:
    """Return the mistakes that leave a block of the covariances at zero."""
    covs = np.array([run.covs for run in runs])
    if question.key == "q10-filter" and np.abs(covs[:, 0, 2:, 2:]).max() < 1e-12:
        return ["rb-conditional-dropped"]
    if np.abs(covs[:, :, :2, 2:]).max() < 1e-12 < np.abs(covs[:, 1:, :2, :2]).max():
        return ["rb-cross-dropped" if question.key == "q10-filter" else "cross-terms-dropped"]
    return []


def _by_one_particle(question: Question, solver: Callable[..., Any], problem: Problem) -> list[str]:
    """Return the mistakes of the likelihood, read off clouds of one particle.

    Its weight is 1 and the mean is the particle, so the increments of the log-evidence are the log-likelihoods.
    """
    if question.key not in ("q4-filter", "q6-filter"):
        return []
    try:
        runs = [run_filter(question, solver, problem, (7, run), 1) for run in range(6)]
    except Refused:
        return []
    instants = [k for k in range(1, problem.n_instants) if not np.isnan(problem.z[k]).all()]
    increments = np.array([np.diff(run.log_evidence)[[k - 1 for k in instants]] for run in runs])
    if np.ptp(increments, axis=0).max() < 1e-9:
        return []  # they do not depend on the particle, and say nothing
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
