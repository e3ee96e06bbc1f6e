"""What a particle filter tends to with more and more particles: the exact answer, or that of its mistake.

Question answered: with which mistake would a filter have these moments and this evidence?  A mistaken filter is most
often a right filter of another model: other noise, other measurements, another start.  Its moments are then those of a
Kalman filter for that model, and can be told from the right ones by statistics alone.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from lab.checks.mistakes.seeing import SELECT
from lab.checks.recipes import Function, log_gaussian, seen
from lab.checks.worlds import handout_model
from lab.problem import Problem
from lab.validation import Array


class Limit(NamedTuple):
    """Moments and cumulative log-evidence over time; the latter is None where the mistake leaves it undefined."""

    means: Array
    covs: Array
    log_evidence: Array | None


def limit(
    problem: Problem,
    *,
    F: Array | None = None,
    B: Array | None = None,
    Q: Array | None = None,
    P0: Array | None = None,
    select: Function = seen,
    shift: int = 0,
    forget: bool = False,
    steps_at_0: int = 0,
    power: float = 1.0,
    marginal_evidence: bool = False,
) -> Limit:
    """Return the exact answer for a changed model, or way of measuring.

    Parameters
    ----------
    problem : Problem
    F, B, Q, P0 : arrays, optional
        Instead of the model's.
    select : function
        What is taken to be seen.
    shift : int
        Instant of the measurements that are used, relative to k.
    forget : bool
        Whether every measurement but the last is forgotten, as by weights that are overwritten.
    steps_at_0 : int
        Steps made before row 0.
    power : float
        Exponent of the likelihood: 0 ignores it, 2 counts it twice.
    marginal_evidence : bool
        Whether each increment is that of the prior instead of what z_1..z_{k-1} have left of it.
    """
    model = problem.model
    F, B = model.F if F is None else F, model.B if B is None else B
    Q, P0 = model.noise_cov if Q is None else Q, model.P0 if P0 is None else P0
    mean, cov, evidence = model.m0, P0, 0.0
    for _ in range(steps_at_0):
        mean, cov = F @ mean + B, F @ cov @ F.T + Q
    prior = mean, cov
    rows = [(mean, cov, evidence)]
    for k in range(1, problem.n_instants):
        mean, cov = F @ mean + B, F @ cov @ F.T + Q
        prior = F @ prior[0] + B, F @ prior[1] @ F.T + Q
        used = min(max(k + shift, 0), problem.n_instants - 1)
        z, H, R = select(problem.z[used], problem.H[used], problem.R[used])
        if forget:
            mean, cov = prior
        before = prior if marginal_evidence else (mean, cov)
        if len(z) and power:
            R = R / power
            evidence += float(log_gaussian((z - H @ before[0])[:, np.newaxis], H @ before[1] @ H.T + R)[0])
            S = H @ cov @ H.T + R
            K = np.linalg.solve(S, H @ cov).T
            mean, cov = mean + K @ (z - H @ mean), cov - K @ H @ cov
        rows.append((mean, cov, evidence))
    means, covs, evidences = (np.array(column) for column in zip(*rows, strict=True))
    usual = not forget and power == 1.0
    return Limit(means, covs, evidences if usual else None)


def _lower(cov: Array) -> Array:
    return np.asarray(np.linalg.cholesky(cov))


def _landmarks(P0: Array, change: Callable[[Array], Array]) -> Array:
    changed = P0.copy()
    changed[2:, 2:] = change(P0[2:, 2:])
    return changed


def _robot(Q: Array, change: Callable[[Array], Array]) -> Array:
    changed = Q.copy()
    changed[:2, :2] = change(Q[:2, :2])
    return changed


def _power(A: Array) -> Array:
    return np.asarray(A @ A.T)


def mistaken(problem: Problem) -> Iterator[tuple[str, Limit]]:
    """Yield the limits of known mistakes, each with its key."""
    model = problem.model
    F, B, Q, P0 = model.F, model.B, model.noise_cov, model.P0
    typed = handout_model(problem.n_landmarks)
    centre = np.zeros(len(B))
    centre[:2] = np.linalg.solve(np.eye(2) - F[:2, :2], B[:2])
    for key, changes in (
        ("b-omitted", {"B": 0 * B}),
        ("wrong-b", {"B": 2 * B}),
        ("wrong-b", {"B": -B}),
        ("wrong-b", {"B": centre}),
        ("wrong-b", {"B": F @ B}),
        ("f-transposed", {"F": F.T}),
        ("f-omitted", {"F": np.eye(len(F))}),
        ("retyped", {"F": typed.F}),
        ("retyped", {"B": typed.B}),
        ("retyped", {"F": typed.F, "B": typed.B}),
        ("retyped", {"Q": _robot(Q, lambda A: 0.2**2 * np.eye(2))}),
        ("retyped", {"P0": _landmarks(P0, lambda A: 0.2 * np.eye(len(A)))}),
        ("noise-omitted", {"Q": 0 * Q}),
        ("variance-squared", {"Q": _robot(Q, _power)}),
        ("deviation-as-variance", {"Q": _robot(Q, _lower)}),
        ("deviation-as-variance", {"Q": _robot(Q, lambda A: np.diag(np.sqrt(np.diag(A))))}),
        ("variance-squared", {"Q": _robot(Q, lambda A: np.diag(np.diag(A) ** 2))}),
        ("diagonal-only", {"Q": _robot(Q, lambda A: np.diag(np.diag(A)))}),
        ("q-transposed", {"Q": _robot(Q, lambda A: _lower(A).T @ _lower(A))}),
        ("noise-shared", {"Q": _robot(Q, lambda A: np.full((2, 2), A[0, 0]))}),
        ("noise-shared", {"Q": _robot(Q, lambda A: np.outer(np.sqrt(np.diag(A)), np.sqrt(np.diag(A))))}),
        ("p0-omitted", {"P0": 0 * P0}),
        ("p0-transposed", {"P0": _landmarks(P0, lambda A: _lower(A).T @ _lower(A))}),
        ("variance-squared", {"P0": _landmarks(P0, _power)}),
        ("deviation-as-variance", {"P0": _landmarks(P0, lambda A: np.diag(np.sqrt(np.diag(A))))}),
        ("diagonal-only", {"P0": _landmarks(P0, lambda A: np.diag(np.diag(A)))}),
        ("variance-squared", {"P0": _landmarks(P0, lambda A: np.diag(np.diag(A) ** 2))}),
        ("variance-squared", {"P0": _landmarks(P0, lambda A: _power(np.diag(np.diag(A))))}),
        ("late", {"shift": -1}),
        ("early", {"shift": 1}),
        ("open-loop", {"power": 0.0}),
        ("half-missing", {"power": 2.0}),
        ("time-0-updated", {"steps_at_0": 1}),
        ("weights-overwritten", {"forget": True}),
        ("double-inverse", {"select": _inverse_R}),
        ("evidence-not-carried", {"marginal_evidence": True}),
    ):
        yield key, limit(problem, **changes)
    right, blind = limit(problem), limit(problem, power=0.0)
    yield "weights-unchanged", blind
    d = right.means - blind.means
    about = d[:, :, np.newaxis] * d[:, np.newaxis, :]
    yield "weights-ignored", Limit(blind.means, blind.covs, right.log_evidence)
    yield "weights-ignored", Limit(right.means, blind.covs + about, right.log_evidence)
    yield "weights-ignored", Limit(right.means, blind.covs, right.log_evidence)
    yield "weights-ignored", Limit(blind.means, right.covs + about, right.log_evidence)
    for key, select in SELECT:
        try:
            with np.errstate(all="ignore"):
                found = limit(problem, select=select)
        except (ValueError, np.linalg.LinAlgError):
            continue
        if np.isfinite(found.means).all():
            yield key, found


def _inverse_R(z: Array, H: Array, R: Array) -> Any:
    z, H, R = seen(z, H, R)
    return z, H, np.linalg.inv(R)
