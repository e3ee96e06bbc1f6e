"""The exact filter and smoother: FilterPy's predict and update over the rows that were seen, and Rauch-Tung-Striebel.

Question answered: what is p(x_k given z_1..z_k), exactly?  The H_k being given, the model is linear and Gaussian, so
the Kalman filter is the Bayes solution, and what every particle filter is compared with.  When nothing is seen the
update is skipped: a NaN would poison the state for ever.  Source: questions 1c and 1d of the handout.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, overload

import numpy as np

from lab import gaussian
from lab.problem import Problem, require_problem
from lab.result import Filtered, FilteredMap
from lab.solvers.structured import MapFilter
from lab.sparse import SparseProblem
from lab.validation import Array, InputError

STRUCTURED_FROM = 75  # landmarks; below, calls of numpy cost more than what structure saves
Method = Literal["auto", "dense", "structured"]


@overload
def kalman(problem: Problem | SparseProblem, *, method: Method = ..., keep: Literal["all"] = ...) -> Filtered: ...


@overload
def kalman(problem: Problem | SparseProblem, *, method: Method = ..., keep: Literal["blocks"]) -> FilteredMap: ...


def kalman(
    problem: Problem | SparseProblem, *, method: Method = "auto", keep: Literal["all", "blocks"] = "all"
) -> Filtered | FilteredMap:
    """Run the exact Kalman filter.

    Parameters
    ----------
    problem : Problem or SparseProblem
    method : {"auto", "dense", "structured"}
        "dense" is FilterPy with whole matrices, O(n^3) a step.  "structured" uses what the laboratory's matrices are
        made of, O(p n^2) for p numbers seen; a problem that is made otherwise (P0, Q or some R couples landmarks, say)
        takes the dense form.  "auto" is "structured" from 75 landmarks on.
    keep : {"all", "blocks"}
        "all" returns every covariance, N n^2 numbers.  "blocks" returns those of the robot and of each landmark, and
        the rows of the last covariance on demand: of M = 5000 landmarks a triangle of 0.4 GB is then in memory.

    Returns
    -------
    Filtered or FilteredMap
        By `keep`; a Filtered's `ess` and `survivors` are None.

    Raises
    ------
    InputError
        The innovation covariance S = H P H' + R is singular at some instant, or an option is unknown.
    """
    if method not in ("auto", "dense", "structured"):
        raise InputError(f'method must be "auto", "dense" or "structured", not {method!r}.')
    if keep not in ("all", "blocks"):
        raise InputError(f'keep must be "all" or "blocks", not {keep!r}.')
    steps = _structured(problem, method) or _dense(problem)
    N, n = problem.n_instants, 2 + 2 * problem.n_landmarks
    try:
        covs = np.empty((N, n, n) if keep == "all" else (N, n // 2, 2, 2))
    except MemoryError:
        size = f"{8e-9 * N * n**2:.0f} GB"
        raise InputError(f'{N} covariances of {n} components need {size}: ask for keep="blocks".') from None
    means, log_evidence = np.empty((N, n)), np.empty(N)
    for k, (moments, evidence) in enumerate(steps):
        means[k], log_evidence[k] = moments.mean, evidence
        covs[k] = moments.cov() if keep == "all" else moments.blocks()
    if keep == "all":
        return Filtered(means, covs, log_evidence)
    return FilteredMap(means, covs, log_evidence, moments.rows)


class Moments(Protocol):
    """What either form knows at an instant; of the structured one, until the next."""

    @property
    def mean(self) -> Array:
        """Mean (n,) [m]."""
        ...

    def cov(self) -> Array:
        """Return the covariance (n, n) [m^2]."""
        ...

    def blocks(self) -> Array:
        """Return its blocks (1 + M, 2, 2) of the robot and of each landmark."""
        ...

    def rows(self, components: Any) -> Array:
        """Return some of its rows (d, n)."""
        ...


@dataclass(frozen=True, eq=False)
class _Dense:
    """The moments of the dense form."""

    mean: Array
    whole: Array

    def cov(self) -> Array:
        """Return the covariance."""
        return self.whole

    def blocks(self) -> Array:
        """Return its blocks on the diagonal."""
        i = np.arange(len(self.mean) // 2)
        return self.whole.reshape(len(i), 2, len(i), 2)[i, :, i, :]

    def rows(self, components: Any) -> Array:
        """Return some of its rows."""
        return np.asarray(self.whole[components])


def _structured(problem: Problem | SparseProblem, method: Method) -> Iterator[tuple[Moments, float]] | None:
    """Return the steps of the structured form where it is wanted and the problem has the structure."""
    if not isinstance(problem, SparseProblem):
        require_problem(problem)
    if method == "dense" or (method == "auto" and problem.n_landmarks < STRUCTURED_FROM):
        return None
    try:
        return _structured_steps(problem if isinstance(problem, SparseProblem) else SparseProblem.of(problem))
    except InputError:  # says what couples
        return None


def _structured_steps(problem: SparseProblem) -> Iterator[tuple[Moments, float]]:
    state, log_evidence = MapFilter(problem), 0.0
    yield state, log_evidence
    for k in range(1, problem.n_instants):
        state.predict()
        log_evidence += state.update(k)
        yield state, log_evidence


def _dense(problem: Problem | SparseProblem) -> Iterator[tuple[Moments, float]]:
    """Run FilterPy's predict and update over whole matrices."""
    from filterpy.kalman import KalmanFilter  # brings scipy.stats, a second that no worker process needs

    problem = problem.dense() if isinstance(problem, SparseProblem) else problem
    model = problem.model
    n = len(model.m0)
    # dim_z only sizes FilterPy's defaults, which the H, R and z given at each update replace
    engine = KalmanFilter(dim_x=n, dim_z=2, dim_u=n)
    engine.x, engine.P = model.m0.copy(), model.P0.copy()
    engine.F, engine.Q, engine.B = model.F, model.noise_cov, np.eye(n)
    log_evidence = 0.0
    yield _Dense(engine.x, engine.P), log_evidence
    for k in range(1, problem.n_instants):
        engine.predict(u=model.B)
        z, H, R = problem.seen(k)
        if len(z):
            try:
                engine.update(z, R=R, H=H)
                # FilterPy's own log_likelihood drops small eigenvalues of S, and with them part of the constant
                log_evidence += float(gaussian.log_density(engine.y, engine.S))
            except np.linalg.LinAlgError:
                raise InputError(f"The innovation covariance H P H' + R is singular at k = {k}.") from None
        engine.P = (engine.P + engine.P.T) / 2
        yield _Dense(engine.x, engine.P), log_evidence


class Smoothed(NamedTuple):
    """What is known of every x_k given ALL measurements, and how each leans on the next.

    means : (N, n) E[x_k given z_1..z_{N-1}] [m];  covs : (N, n, n) [m^2];
    gains : (N - 1, n, n) with E[x_k given x_{k+1}, z] = means[k] + gains[k] (x_{k+1} - means[k+1]).
    """

    means: Array
    covs: Array
    gains: Array


def smoother(problem: Problem, filtered: Filtered | None = None) -> Smoothed:
    """Run the Rauch-Tung-Striebel smoother over the exact filter.

    Parameters
    ----------
    problem : Problem
    filtered : Filtered, optional
        `kalman` on the same problem, or its first rows; run here when it is not given.

    Returns
    -------
    Smoothed

    Raises
    ------
    InputError
        As `kalman`.

    Notes
    -----
    gains = P_k F' (F P_k F' + Q)^+; the pseudo-inverse because a prediction is singular where the robot is known.
    Source: Sarkka, Bayesian Filtering and Smoothing (2013), section 8.2.
    """
    filtered = kalman(problem) if filtered is None else filtered
    model = problem.model
    means, covs = filtered.means.copy(), filtered.covs.copy()
    gains = np.zeros((len(means) - 1, *covs.shape[1:]))
    for k in range(len(means) - 2, -1, -1):
        mean, cov = gaussian.predict(filtered.means[k], filtered.covs[k], model.F, model.B, model.noise_cov)
        gains[k] = gaussian.regression(filtered.covs[k] @ model.F.T, cov)
        means[k] += gains[k] @ (means[k + 1] - mean)
        smoothed = covs[k] + gains[k] @ (covs[k + 1] - cov) @ gains[k].T
        covs[k] = (smoothed + smoothed.T) / 2
    return Smoothed(means, covs, gains)
