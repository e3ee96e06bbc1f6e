"""Check of an importance function: any that is properly weighted, and that looks at the measurement.

Question answered: with increments W = p(z given x') p(x' given x) / q(x' given x, z), is

    E[W] = c p(z given x),   E[W d] = 0,   E[W (d d' - C)] = 0,   d = x' - E[x' given x, z],   C = Cov[x' given x, z]

for every parent x, with one constant c?  That is what properly weighted means, whatever q is.  Each of a few parents
has many children; their averages over independent batches give t-statistics.  Which mistake it is, the increments say
themselves: given where the children are, every wrong formula gives other numbers.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from lab.checks import guard, reading, worlds
from lab.checks.questions import Question
from lab.checks.reading import Unreadable
from lab.checks.recipes import log_gaussian
from lab.checks.running import Refused
from lab.checks.verdict import Verdict
from lab.checks.words import edited, in_words, ours
from lab.problem import Problem
from lab.validation import Array

PARENTS, CHILDREN, BATCHES = 5, 100, 40
FEWER, SLOW = 25, 4.0  # children where the batches of one setting would take so many seconds: a loop over particles
MORE = 160  # batches, where the first are doubtful
DOUBTFUL, BOUND = 5.0, 7.0  # t-statistics, the largest of about 130 a case, as in lab.checks.unbiased
STILL = 1e-6  # m
SECONDS = 20.0
TOLERANCE = 1e-6  # of the range of the increments


class Setting(NamedTuple):
    """One instant of one problem, and the parents."""

    label: str
    problem: Problem
    k: int
    parents: Array


def settings() -> list[Setting]:
    """Return the cases: several landmarks seen, one, none, and landmarks that move."""
    quiet = worlds.quiet()
    moving = quiet.with_landmark_noise(0.1)
    cases = (("two landmarks seen", quiet, 1), ("one landmark seen", quiet, 2), ("nothing seen", quiet, 3))
    found = []
    for label, problem, k in (*cases, ("landmarks that move a little", moving, 1)):
        rng = np.random.default_rng(61 + k)
        model = problem.model
        parents = np.repeat(model.m0[:, np.newaxis], PARENTS, axis=1) + 0.3 * rng.standard_normal((8, PARENTS))
        z, H, _ = problem.seen(k)
        if len(z):  # parents that expect about what is seen, so that weights stay moderate
            predicted = model.F @ parents + model.B[:, np.newaxis]
            gap = z[:, np.newaxis] - H @ predicted
            rows = np.flatnonzero((H[:, 2:] != 0).any(axis=0)) + 2
            parents[rows] += H[:, rows].T @ (gap + 0.35 * rng.standard_normal(gap.shape))
        found.append(Setting(label, problem, k, parents))
    return found


def examine(
    question: Question, propose: Callable[..., Any], watch: Callable[[str, str], bool], seed: int = 0
) -> Verdict:
    """Return the verdict on an importance function."""
    key, tried = question.key, settings()
    try:
        turned = _orientation(question, propose, tried[0], watch)
        for number, setting in enumerate(tried):
            verdict = _properly_weighted(question, propose, setting, turned, (seed, number))
            if verdict is not None:
                return verdict
        _looks(question, propose, tried[0], turned)
        _far(question, propose, tried[0], turned)
    except Refused as refusal:
        return refusal.verdict
    return Verdict(key, True, f"public checks passed ({len(tried) + 2}/{len(tried) + 2}).")


def _call(
    question: Question,
    propose: Callable[..., Any],
    setting: Setting,
    particles: Array,
    turned: bool,
    seed: Any,
    watch: Callable[[str, str], bool] | None = None,
    read_only: bool = False,
) -> tuple[Array, Array]:
    """Return children and increments of one call.

    Raises
    ------
    Refused
    """
    key = question.key
    given = np.ascontiguousarray(particles.T) if turned else particles
    rng = np.random.default_rng(seed)
    names = ("particles", "k", "problem", "rng")
    made = guard.call(propose, (given, setting.k, setting.problem, rng), names, seconds=SECONDS, watch=watch)
    if isinstance(made.error, NotImplementedError):
        raise Refused(Verdict(key, False, "the stub still raises NotImplementedError", answered=False))
    if made.ours:
        raise Refused(ours(key, made.ours))
    if made.error is not None:
        sentence = guard.describe(made.error, made.line, SECONDS)
        raise Refused(Verdict(key, False, f"For {setting.label} {sentence}."))
    if made.drew:
        reason = "random numbers are drawn from a global generator (numpy.random or random), not from rng."
        raise Refused(Verdict(key, False, reason, "Every number comes from the argument rng.", "global-generator"))
    if made.changed:
        raise Refused(Verdict(key, False, *edited(made.changed), mistake="edits-arguments"))
    try:
        children, increments = reading.several(made.value, ["particles", "log_increments"])
        moved = reading.number_of("particles", children)
        moved = reading.shaped("particles", moved.T if turned else moved, particles.shape, "(n, P)")
        logs = reading.number_of("log_increments", increments)
        logs = reading.shaped("log_increments", logs, particles.shape[1:], "(P,)")
    except Unreadable as error:
        raise Refused(Verdict(key, False, f"{error}.")) from None
    if not np.isfinite(moved).all() or np.isnan(logs).any():
        what = "particles" if not np.isfinite(moved).all() else "log_increments"
        reason = f"{what} hold NaN or infinite values, for {setting.label}."
        raise Refused(Verdict(key, False, reason, "Which rows of z are NaN at this instant?"))
    return moved, logs


def _orientation(
    question: Question, propose: Callable[..., Any], setting: Setting, watch: Callable[[str, str], bool]
) -> bool:
    """Return whether the answer takes particles one a row."""
    cloud = np.repeat(setting.parents, 3, axis=1)
    try:
        _call(question, propose, setting, cloud, False, 0, watch)
    except Refused as refusal:
        if not refusal.verdict.answered or refusal.verdict.mistake:
            raise
        try:
            _call(question, propose, setting, cloud, True, 0)
        except Refused:
            raise refusal from None
        return True
    return False


def _properly_weighted(
    question: Question, propose: Callable[..., Any], setting: Setting, turned: bool, seed: Any
) -> Verdict | None:
    model = setting.problem.model
    start = time.perf_counter()
    small = np.repeat(setting.parents, FEWER, axis=1)
    _call(question, propose, setting, small, turned, (*seed, BATCHES))
    slow = BATCHES * (time.perf_counter() - start) > SLOW * FEWER / CHILDREN
    cloud = small if slow else np.repeat(setting.parents, CHILDREN, axis=1)
    batches = [_call(question, propose, setting, cloud, turned, (*seed, batch)) for batch in range(BATCHES)]
    if np.array_equal(batches[0][0], batches[1][0]) and np.ptp(batches[0][0] - cloud, axis=1).max() > STILL:
        reason = "the children do not depend on rng: every call draws the same."
        return Verdict(question.key, False, reason, "Which of your lines draw, and from what?", "not-random")
    still = np.flatnonzero(np.diag(model.noise_cov) == 0)
    strayed = max(np.abs(moved[still] - cloud[still]).max(initial=0) for moved, _ in batches)
    if strayed > STILL:
        reason = f"landmarks move by up to {strayed:.2g} m, although the model has no noise for them."
        hint = "Which components does the dynamics leave alone? A state that cannot be reached has no weight."
        return Verdict(question.key, False, reason, hint, "support-ignored")
    free = np.setdiff1d(np.arange(len(cloud)), still)
    moved = batches[0][0][free].reshape(len(free), PARENTS, -1)
    if np.ptp(moved, axis=2).max() < STILL:
        reason, hint = in_words(["noise-shared"])
        return Verdict(
            question.key, False, f"{reason} Found: the children of a parent are equal.", hint, "noise-shared"
        )
    unmoved = np.ptp(moved, axis=2).max(axis=1) < STILL
    if unmoved[free >= 2].any():
        reason, hint = in_words(["landmark-noise-ignored"])
        found = f"landmarks stand still, for {setting.label}"
        return Verdict(question.key, False, f"{reason} Found: {found}.", hint, "landmark-noise-ignored")
    if not any(np.isfinite(logs).any() for _, logs in batches):
        return Verdict(question.key, False, f"all log_increments are -inf, for {setting.label}.")
    worst, _ = score(setting, batches)
    if worst <= DOUBTFUL:
        return None
    more = [_call(question, propose, setting, cloud, turned, (*seed, 1, batch)) for batch in range(MORE)]
    worst, where = score(setting, more)
    if worst <= BOUND:
        return None
    named = _named(setting, cloud, batches[0]) or _by_draws(setting, cloud, batches)
    far = f"{worst:.0f}" if worst < 1000 else "more than 1000"
    found = f"{where} is {far} standard errors off, for {setting.label}"
    if named:
        reason, hint = in_words(named)
        return Verdict(question.key, False, f"{reason} Found: {found}.", hint, " ".join(named))
    hint = "The weight is likelihood times transition density over the density you drew from, all at the new particle."
    return Verdict(question.key, False, f"The particles are not properly weighted: {found}.", hint)


def _exact(setting: Setting) -> tuple[Array, Array, Array]:
    """Return log p(z given x), E[x' given x, z] and Cov[x' given x, z] of every parent."""
    model, (z, H, R) = setting.problem.model, setting.problem.seen(setting.k)
    predicted = model.F @ setting.parents + model.B[:, np.newaxis]
    if not len(z):
        return np.zeros(PARENTS), predicted, model.noise_cov
    S = H @ model.noise_cov @ H.T + R
    K = np.linalg.solve(S, H @ model.noise_cov).T
    nu = z[:, np.newaxis] - H @ predicted
    return log_gaussian(nu, S), predicted + K @ nu, model.noise_cov - K @ H @ model.noise_cov


def score(setting: Setting, batches: list[tuple[Array, Array]]) -> tuple[float, str]:
    """Return the largest t-statistic over the batches, and what it is about."""
    logs, means, cov = _exact(setting)
    moving = np.flatnonzero(np.diag(setting.problem.model.noise_cov) > 0)
    share = np.exp(logs - logs.max())
    share /= share.sum()
    increments = np.array([increments for _, increments in batches]).reshape(len(batches), PARENTS, -1)
    W = np.exp(increments - increments.max())
    moved = np.array([moved[moving] for moved, _ in batches]).reshape(len(W), len(moving), PARENTS, -1)
    d = moved - means[moving, :, np.newaxis]
    averages = W.mean(axis=2)
    totals = averages - averages.sum(axis=1, keepdims=True) * share
    weighted = W[:, np.newaxis] * d
    firsts = weighted.mean(axis=3)
    spreads = cov[np.ix_(moving, moving)][:, :, np.newaxis] * averages[:, np.newaxis, np.newaxis]
    seconds = np.einsum("biqc,bjqc->bijq", weighted, d) / W.shape[2] - spreads
    size = float(W.mean())
    found = []
    for name, values in (
        ("the average weight", totals),
        ("the weighted mean", firsts),
        ("the weighted covariance", seconds),
    ):
        error = np.maximum(values.std(axis=0, ddof=1) / np.sqrt(len(batches)), 1e-7 * size)
        found.append((float((np.abs(values.mean(axis=0)) / error).max()), name))
    return max(found)


def _wrong(setting: Setting, parents: Array, children: Array) -> Iterator[tuple[str, Array]]:
    """Yield the increments that known mistakes give to these children, each with its key."""
    model, (z, H, R) = setting.problem.model, setting.problem.seen(setting.k)
    Q = model.noise_cov
    predicted = model.F @ parents + model.B[:, np.newaxis]
    free = np.flatnonzero(np.diag(Q) > 0)

    def seen(x: Array, cov: Array) -> Array:
        return log_gaussian(z[:, np.newaxis] - H @ x, cov)

    S = H @ Q @ H.T + R
    K = np.linalg.solve(S, H @ Q).T
    left = (Q - K @ H @ Q)[np.ix_(free, free)]
    middle = predicted + K @ (z[:, np.newaxis] - H @ predicted)
    transition = log_gaussian((children - predicted)[free], Q[np.ix_(free, free)])
    drawn = log_gaussian((children - middle)[free], left)
    likelihood = seen(children, R)
    yield "weight-ignores-z", np.zeros(children.shape[1])
    yield "ratio-dropped", likelihood
    yield "wrong-point", seen(parents, R)
    yield "wrong-point", seen(parents, S)
    yield "wrong-point", seen(children, S)
    yield "wrong-point", seen(middle, R)
    yield "wrong-point", seen(middle, S)
    yield "parent-without-noise", seen(predicted, R)
    with np.errstate(all="ignore"):
        yield "proposal-dropped", likelihood + transition
        yield "likelihood-dropped", transition - drawn
        yield "likelihood-dropped", transition
        yield "transition-dropped", likelihood - drawn
        yield "ratio-inverted", likelihood + drawn - transition
        yield "exponent-sign", -seen(predicted, S)
        yield "exponent-sign", -likelihood
        yield "wrong-point", likelihood + transition - log_gaussian((parents - middle)[free], left)
        yield "wrong-point", likelihood + log_gaussian((children - parents)[free], Q[np.ix_(free, free)]) - drawn
        yield "wrong-point", likelihood + log_gaussian((parents - predicted)[free], Q[np.ix_(free, free)]) - drawn
        yield "wrong-point", likelihood + transition - log_gaussian((children - predicted)[free], left)
        yield "wrong-point", seen(parents, R) + transition - drawn
        yield "linear-not-log", np.exp(seen(predicted, S))
        yield "linear-not-log", np.exp(likelihood + transition - drawn)
        yield "linear-not-log", np.exp(seen(predicted, S) - seen(predicted, S).max())
        weights = np.exp(seen(predicted, S) - seen(predicted, S).max())
        yield "linear-not-log", weights / weights.sum()
        yield "half-missing", 2 * seen(predicted, S)
        yield "r-diagonal", seen(predicted, H @ Q @ H.T + np.diag(np.diag(R)))
        if np.linalg.matrix_rank(H @ Q @ H.T) == len(z):
            yield "parent-without-measurement", seen(predicted, H @ Q @ H.T)


def _named(setting: Setting, cloud: Array, batch: tuple[Array, Array]) -> list[str]:
    """Return the mistakes whose increments, up to a constant, are those of the answer."""
    children, increments = batch
    if not len(setting.problem.seen(setting.k)[0]) or not np.isfinite(increments).all():
        return []
    found = []
    for key, wrong in _wrong(setting, cloud, children):
        gaps = (increments - increments.mean()) - (wrong - wrong.mean())
        if np.abs(gaps).max() <= TOLERANCE * max(np.ptp(wrong), 1.0):
            found.append(key)
    return list(dict.fromkeys(found))


def _by_draws(setting: Setting, cloud: Array, batches: list[tuple[Array, Array]]) -> list[str]:
    """Return the mistakes that show in where the optimal draw puts the children, and how they scatter."""
    model, (z, H, R) = setting.problem.model, setting.problem.seen(setting.k)
    if not len(z):
        return []
    Q, parents = model.noise_cov, setting.parents
    predicted = model.F @ parents + model.B[:, np.newaxis]
    K = np.linalg.solve(H @ Q @ H.T + R, H @ Q).T
    left = Q - K @ H @ Q

    def centre(at: Array, sign: float = 1.0) -> Array:
        return at + sign * K @ (z[:, np.newaxis] - H @ at)

    moved = np.array([children for children, _ in batches])
    by_parent = moved.reshape(len(batches), *parents.shape, -1).transpose(1, 2, 0, 3).reshape(*parents.shape, -1)
    means, covs = by_parent.mean(axis=2), [np.cov(by_parent[:2, i]) for i in range(parents.shape[1])]
    error = by_parent.std(axis=2) / np.sqrt(by_parent.shape[2]) + 1e-9
    right, right_cov = centre(predicted), left[:2, :2]
    for key, middle in (
        ("", right),
        ("innovation-sign", centre(predicted, -1.0)),
        ("b-omitted", centre(model.F @ parents)),
        ("f-omitted", centre(parents)),
        ("f-transposed", centre(model.F.T @ parents + model.B[:, np.newaxis])),
        ("innovation-before-prediction", predicted + K @ (z[:, np.newaxis] - H @ parents)),
    ):
        if (np.abs(means - middle) < 5 * error).all():
            if key:
                return [key]
            root = np.linalg.cholesky(right_cov)
            for name, cov in (
                ("drawn-with-prior", Q[:2, :2]),
                ("variance-squared", right_cov @ right_cov),
                ("q-transposed", root.T @ root),
                ("diagonal-only", np.diag(np.diag(right_cov))),
            ):
                if all(np.abs(found - cov).max() < 0.1 * np.abs(cov).max() for found in covs):
                    far = np.abs(cov - right_cov).max() > 0.2 * np.abs(right_cov).max()
                    return [name] if far else []
    return []


def _looks(question: Question, propose: Callable[..., Any], setting: Setting, turned: bool) -> None:
    """Refuse a draw that does not depend on the measurement.

    Raises
    ------
    Refused
    """
    problem = setting.problem
    z = problem.z.copy()
    z[setting.k] += 0.4
    other = setting._replace(problem=Problem(problem.model, z, problem.H, problem.R))
    cloud = np.repeat(setting.parents, 4, axis=1)
    one, _ = _call(question, propose, setting, cloud, turned, 5)
    two, _ = _call(question, propose, other, cloud, turned, 5)
    if np.abs(one - two).max() < 1e-9:
        reason, hint = in_words(["z-ignored-in-draw"])
        raise Refused(Verdict(question.key, False, reason, hint, "z-ignored-in-draw"))


def _far(question: Question, propose: Callable[..., Any], setting: Setting, turned: bool) -> None:
    """Refuse increments that underflow when every particle is far from what is seen.

    Raises
    ------
    Refused
    """
    problem = setting.problem
    z = problem.z.copy()
    z[setting.k] += 80.0
    far = setting._replace(problem=Problem(problem.model, z, problem.H, problem.R), label="particles far away")
    _, increments = _call(question, propose, far, setting.parents, turned, 5)
    if not np.isfinite(increments).all():
        reason, hint = in_words(["plain-exp"])
        raise Refused(Verdict(question.key, False, f"{reason} Found: log_increments are -inf.", hint, "plain-exp"))
