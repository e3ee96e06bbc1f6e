"""The inputs on which exact answers are tried, question by question.

Question answered: with which arguments is an answer called?  A case has a label, which ends the sentence "it is off
for ...", and one or several calls whose results are judged together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from lab.checks import ekf_inputs, worlds
from lab.checks.reference import kalman_filter
from lab.result import Filtered
from lab.validation import Array


@dataclass(frozen=True, eq=False)
class Case:
    """One set of inputs: its label, and the positional arguments of each call."""

    label: str
    calls: tuple[tuple[Any, ...], ...]


FAR = 12.0  # m: so far from every particle that the log-likelihoods are below -745
P = 17


def _kalman_steps() -> list[Case]:
    cases = []
    for i, moment in enumerate(worlds.moments()):
        mean, cov = worlds.belief(moment, i)
        cases.append(Case(moment.label, ((mean, cov, moment.z, moment.H, moment.R, moment.model),)))
    moment = worlds.moments()[0]
    model = moment.model
    cases.append(Case("the first step, from the prior", ((model.m0, model.P0, moment.z, moment.H, moment.R, model),)))
    moving = worlds.problems()["two landmarks, moving a little"]
    k = _instant(moving, 1)
    mean, cov = worlds.belief(worlds.Moment("", moving.z[k], moving.H[k], moving.R[k], moving.model), 77)
    cases.append(
        Case("landmarks that move a little", ((mean, cov, moving.z[k], moving.H[k], moving.R[k], moving.model),))
    )
    return cases


def _instant(problem: Any, landmarks: int) -> int:
    """Return the last instant at which so many landmarks are seen."""
    counts = (~np.isnan(problem.z)).sum(axis=1) // 2
    return int(np.flatnonzero(counts[1:] == landmarks)[-1]) + 1


def _problems() -> list[Case]:
    return [Case(label, ((problem,),)) for label, problem in worlds.problems().items()]


def _priors() -> list[Case]:
    rng = np.random.default_rng(11)
    cases = []
    for label in ("the handout's world", "three landmarks, all seen"):
        model = worlds.problems()[label].model
        states = [model.m0 + np.r_[0, 0, 0.6 * rng.standard_normal(len(model.m0) - 2)] for _ in range(4)]
        away = states[0] + np.r_[0.1, -0.05, np.zeros(len(model.m0) - 2)]
        label = label.removesuffix(", all seen")
        cases.append(Case(f"{label}, the robot where it is known to be", tuple((x, model) for x in states)))
        cases.append(Case(f"{label}, the robot elsewhere", tuple((x, model) for x in (*states[:2], away))))
    return cases


def uncertain_robot(key: str) -> Case:
    """Return the case of the older edition of the handout, whose robot is not known exactly at k = 0."""
    rng = np.random.default_rng(12)
    model = worlds.with_robot_prior(worlds.problems()["the handout's world"].model)
    states = [model.m0 + 0.4 * rng.standard_normal(len(model.m0)) for _ in range(4)]
    return Case("an uncertain robot", tuple((x, model) for x in states))


def _transitions() -> list[Case]:
    rng = np.random.default_rng(13)
    cases = []
    for label in ("the handout's world", "five landmarks, another centre and speed", "two landmarks, moving a little"):
        model = worlds.problems()[label].model
        n = len(model.m0)
        moving = label.endswith("a little")
        pairs = []
        for _ in range(4):
            x = model.m0 + 0.5 * rng.standard_normal(n)
            shift = np.r_[0.4 * rng.standard_normal(2), moving * 0.15 * rng.standard_normal(n - 2)]
            new = model.F @ x + model.B + shift
            new[2:] = x[2:] + shift[2:]  # to the digit
            pairs.append((new, x, model))
        slipped = pairs[0][0] + np.r_[14.0, -9.0, np.zeros(n - 2)]  # whose density underflows
        pairs.append((slipped, pairs[0][1], model))
        cases.append(Case(label, tuple(pairs)))
        if not moving:
            new, x, _ = pairs[0]
            jumped = new + np.r_[np.zeros(n - 1), 0.05]
            cases.append(Case(f"{label}, a landmark that moved", (*pairs[:2], (jumped, x, model))))
    return cases


def as_simulated(key: str) -> Case:
    """Return transitions whose landmarks move by the 1e-10 m of the original, which count as none."""
    (case,) = [case for case in cases(key) if case.label == "the handout's world"]
    rng = np.random.default_rng(14)
    moved = ((new + np.r_[0, 0, 1e-10 * rng.standard_normal(len(x) - 2)], x, model) for new, x, model in case.calls)
    return Case("landmarks that move by 1e-10 m", tuple(moved))


def _clouds(far: bool = True) -> list[tuple[str, worlds.Moment, Array, Array, Array]]:
    """Return label, moment, particles, weights and noise of single steps."""
    found = []
    for i, moment in enumerate(worlds.moments()):
        particles, weights, noise = worlds.cloud(moment, P, 20 + i)
        near = worlds.closer(moment, particles, noise)
        found.append((moment.label, near, particles, weights, noise))
    if far:
        moment = worlds.moments()[2]
        moment = next(m for m in worlds.moments() if m.label.startswith("five") and "3" in m.label)
        particles, weights, noise = worlds.cloud(moment, 23, 50)
        label = f"{moment.label}, all particles far away (log-likelihoods below -745)"
        found.append((label, worlds.closer(moment, particles, noise, FAR), particles, weights, noise))
    return found


def _likelihoods() -> list[Case]:
    cases = []
    for label, m, particles, _, noise in _clouds():
        moved = m.model.F @ particles + m.model.B[:, np.newaxis] + noise
        cases.append(Case(label, ((m.z, moved, m.H, m.R),)))
    return cases


def _sis_steps() -> list[Case]:
    return [Case(label, ((x, w, noise, m.z, m.H, m.R, m.model),)) for label, m, x, w, noise in _clouds()]


def _jittered_steps() -> list[Case]:
    cases = []
    for i, (label, m, x, w, noise) in enumerate(_clouds()):
        rng = np.random.default_rng(90 + i)
        jitter = 0.1 * rng.standard_normal((len(x) - 2, x.shape[1]))
        Q = m.model.Q + np.diag(np.r_[0, 0, np.full(len(x) - 2, 0.01)])
        cases.append(Case(label, ((x, w, noise, jitter, m.z, m.H, m.R, replace(m.model, Q=Q)),)))
    return cases


def _sir_steps() -> list[Case]:
    cases = []
    for i, (label, m, x, w, noise) in enumerate(_clouds()):
        ratio = float(1 / np.sum(w**2)) / len(w)
        rng = np.random.default_rng(60 + i)
        points = np.sort(rng.random(len(w))) if i % 2 else (np.arange(len(w)) + rng.random()) / len(w)
        for threshold, what in ((ratio + 0.15, "below the threshold"), (ratio - 0.15, "above the threshold")):
            if what.startswith("below") or i < 4:
                args = (x, w, noise, points, m.z, m.H, m.R, m.model, float(round(threshold, 3)))
                cases.append(Case(f"{label}, ESS {what}", (args,)))
    return cases


def equality(key: str) -> Case:
    """Return a cloud whose effective sample size is the threshold, to the digit."""
    moment = next(m for m in worlds.moments() if m.label.endswith("nothing seen"))
    x, _, noise = worlds.cloud(moment, 16, 81)
    points = (np.arange(16) + 0.5) / 16
    points[1:4] = points[0]  # so that the choice shows
    args = (x, np.full(16, 1 / 16), noise, np.sort(points), moment.z, moment.H, moment.R, moment.model, 1.0)
    return Case("the effective sample size at the threshold", (args,))


def _weights() -> list[Array]:
    rng = np.random.default_rng(31)
    uneven = rng.gamma(0.7, size=P)
    sparse = rng.gamma(0.7, size=23)
    sparse[[0, 3, 4, 22]] = 0
    return [uneven / uneven.sum(), sparse / sparse.sum()]


def _evidences() -> list[Case]:
    rng = np.random.default_rng(32)
    uneven, sparse = _weights()
    return [
        Case("uneven weights", ((uneven, rng.normal(-3, 2, P)),)),
        Case("weights with zeros", ((sparse, rng.normal(-2, 1, 23)),)),
        Case("log-likelihoods near -800", ((uneven, rng.normal(-800, 3, P)),)),
    ]


def _moments() -> list[Case]:
    rng = np.random.default_rng(33)
    uneven, sparse = _weights()
    return [
        Case("uneven weights", ((rng.normal(2, 1, (8, P)), uneven),)),
        Case("weights with zeros", ((rng.normal(-1, 3, (12, 23)), sparse),)),
        Case("even weights", ((rng.normal(0, 1, (6, 19)), np.full(19, 1 / 19)),)),
    ]


def _corridors() -> list[Case]:
    found = []
    for label in ("the handout's world", "three landmarks, all seen"):
        means, covs = kalman_filter(worlds.problems()[label])
        found.append(Case(label, ((means, covs),)))
    return found


def _ellipses() -> list[Case]:
    found = []
    for label, cov in (
        ("a positive correlation", [[0.5, 0.3], [0.3, 0.4]]),
        ("a negative correlation", [[0.2, -0.25], [-0.25, 0.9]]),
        ("axes along x and y", [[1.6, 0.0], [0.0, 0.3]]),
        ("almost a circle", [[0.2, 1e-12], [1e-12, 0.2]]),
    ):
        found.append(Case(label, ((np.array([-2.0, 4.0]), np.array(cov), 60),)))
    return found


def _ess() -> list[Case]:
    uneven, sparse = _weights()
    last = np.zeros(7)
    last[4] = 1
    return [
        Case("uneven weights", ((uneven,),)),
        Case("weights with zeros", ((sparse,),)),
        Case("even weights", ((np.full(10, 0.1),),)),
        Case("a single particle with weight", ((last,),)),
    ]


def _ancestors() -> list[Case]:
    rng = np.random.default_rng(34)
    uneven, sparse = _weights()
    return [
        Case("independent points", ((uneven, np.sort(rng.random(P))),)),
        Case("weights with zeros, equidistant points", ((sparse, (np.arange(23) + rng.random()) / 23),)),
        Case("one heavy particle", ((_heavy(19, 13), (np.arange(19) + rng.random()) / 19),)),
        Case("even weights", ((np.full(11, 1 / 11), (np.arange(11) + 0.5) / 11),)),
    ]


def edges(key: str) -> Case:
    """Return weights that sum to 1 but for rounding, none for the first particle, and points at both ends of [0, 1).

    They come once in 10^15 draws, so a function that fails here is not refused.
    """
    weights = np.r_[0.0, np.full(120, 1 / 120)]
    points = np.r_[0.0, np.sort(np.random.default_rng(35).random(119)), np.nextafter(1.0, 0)]
    return Case("points at both ends of [0, 1)", ((weights, points),))


def _heavy(n: int, which: int) -> Array:
    weights = np.full(n, 0.1 / (n - 1))
    weights[which] = 0.9
    return weights


def _closures() -> list[Case]:
    found = []
    for label in ("the handout's world", "five landmarks, another centre and speed", "four landmarks, none ever seen"):
        problem = worlds.problems()[label]
        found.append(Case(label, ((problem.z.copy(), kalman_filter(problem)[1]),)))
    return found


def _gaps() -> list[Case]:
    found = []
    for i, label in enumerate(("the handout's world", "three landmarks, all seen")):
        means, covs = kalman_filter(worlds.problems()[label])
        rng = np.random.default_rng(40 + i)
        zeros = np.zeros(len(means))
        near = means + 0.1 * rng.standard_normal(means.shape) + 0.03
        near[0] = means[0] + np.r_[0, 0, 0.05 * rng.standard_normal(means.shape[1] - 2)]
        own = covs * rng.uniform(0.3, 0.8, (len(covs), 1, 1))
        found.append(Case(label, ((Filtered(near, own, zeros), Filtered(means, covs, zeros)),)))
    return found


def _maps(m: worlds.Moment, particles: Array, i: int) -> Array:
    """Return a covariance (2M, 2M) of the landmarks, one block each."""
    return worlds.blocks(np.random.default_rng(70 + i), len(particles) // 2 - 1, 0.35)


def _rbpf_steps() -> list[Case]:
    found = []
    for i, (label, m, x, w, noise) in enumerate(_clouds()):
        cov = _maps(m, x, i)
        found.append(Case(label, ((x[:2].copy(), x[2:].copy(), cov, w, noise[:2].copy(), m.z, m.H, m.R, m.model),)))
    return found


def _rbpf_moments() -> list[Case]:
    return [
        Case(label, ((x[:2].copy(), x[2:].copy(), _maps(m, x, i), w),))
        for i, (label, m, x, w, _) in enumerate(_clouds(far=False)[::3])
    ]


MAKERS: dict[str, Callable[[], Sequence[Case]]] = {
    "q1d-step": _kalman_steps,
    "q1d-filter": _problems,
    "q2a": _priors,
    "q2b": _transitions,
    "q2c": _likelihoods,
    "q3-jitter": _jittered_steps,
    "q4-step": _sis_steps,
    "q4-evidence": _evidences,
    "q4a": _moments,
    "q4b-corridor": _corridors,
    "q4b-ellipse": _ellipses,
    "q5": _ess,
    "q6-ancestors": _ancestors,
    "q6-step": _sir_steps,
    "q7": _closures,
    "q8-gap": _gaps,
    "q10-step": _rbpf_steps,
    "q10-moments": _rbpf_moments,
}


def dead_favourite(key: str) -> Case:
    """Return a step whose likeliest particle has weight 0, so far ahead that all others underflow beside it."""
    if key == "q4-evidence":
        weights, likelihoods = np.full(P, 1 / (P - 1)), np.random.default_rng(36).normal(-800, 3, P)
        weights[0] = likelihoods[0] = 0
        args = [weights, likelihoods]
    else:
        args = list(next(case for case in cases(key) if case.label.endswith("1 landmark seen")).calls[0])
        which = 3 if key == "q10-step" else 1  # argument: the weights
        args[0], args[which] = args[0].copy(), args[which].copy()
        args[0][:2, 1:] += 40.0  # m
        args[which][0] = 0
        args[which] /= args[which].sum()
    return Case("a particle of weight 0 is by far the likeliest", (tuple(args),))


@cache
def cases(question: str) -> tuple[Case, ...]:
    """Return the cases of a question whose answers are compared exactly."""
    if question in ekf_inputs.MAKERS:
        return tuple(Case(label, calls) for label, calls in ekf_inputs.MAKERS[question]())
    return tuple(MAKERS[question]())
