"""The particle loop in numpy, block by block and with each static landmark once per ancestor.

Question answered: how fast can a filter of the laboratory be without a compiler?  The readable loop of
`lab.solvers.particle` draws the same random numbers in the same order and gives the same answers, but for rounding.
Here

    blocks      a step moves, draws and weighs some thousand particles at a time, which stay in the processor's cache
    in place    nobody keeps the cloud of the step before
    genealogy   static rows of the state (see `lab.solvers.plan`) are kept once per living ancestor of time 0; its
                descendants stay neighbours, so their weights are added by segments
    together    several runs with few particles are one long cloud to all steps but resampling and moments, each with
                its own generator: what numpy costs per call is shared

For schemes whose ancestors come in ascending order.  Called by `lab.solvers.particle`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from lab import weights
from lab.problem import Problem
from lab.resampling import of_strata
from lab.result import Filtered
from lab.solvers.clones import Clones, blocks, normals
from lab.solvers.plan import Plan, plan
from lab.solvers.proposals import GaussianProposal
from lab.validation import Array, InputError

ASCENDING = ("systematic", "stratified")  # schemes whose ancestors come in ascending order
ROUNDING = 1e-9  # as in the readable loop: equal weights must trigger at a threshold of 1

Term = tuple[slice, slice, Array]  # target rows += matrix @ source rows


class _Step(NamedTuple):
    """A step of a plan without its zeros.

    Attributes
    ----------
    move : (n_moving, r) array
        Of the first r rows.
    measure, correct, draw : list of Term
        -H of the active rows, K, and the spread.
    z, of_static : (p, 1), (p, s) array
        The measurement, and H of the static rows.
    constant : float
    n_draws : int
    """

    move: Array
    measure: list[Term]
    correct: list[Term]
    draw: list[Term]
    z: Array
    of_static: Array
    constant: float
    n_draws: int


_prepared: WeakKeyDictionary[Plan, list[_Step]] = WeakKeyDictionary()  # plans never change


def run(
    problem: Problem,
    rngs: Sequence[np.random.Generator],
    *,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    resample: str,
) -> list[Filtered]:
    """Run a filter of `lab.solvers.particle` once for each generator; arguments as there, checked already.

    Returns
    -------
    list of Filtered
        The numbers of each do not depend on the others.

    Raises
    ------
    InputError
        In one of the runs every weight is zero at some k, which is named, or a particle is not finite.
    """
    laws, runs, P = plan(problem, proposal), len(rngs), n_particles
    steps, N, n = _steps(laws), problem.n_instants, len(laws.m0)
    means, covs = np.empty((N, runs, n)), np.empty((N, runs, n, n))
    log_evidence, ess = np.zeros((N, runs)), np.empty((N, runs))
    survivors: Any = np.empty((N, runs), dtype=np.int64)
    cloud = Clones(laws, P, rngs)
    w, even = np.full((runs, P), 1 / P), np.log(1 / P)
    logs = np.full((runs, P), even)
    # a large array is dear the first time that it is written to, so these are written to again and again
    scratch, marks = np.empty((runs, P)), np.empty((runs, P + 1), np.intp)
    drawn = np.empty((max((step.n_draws for step in steps), default=0), runs * P))
    for k in range(N):
        if k:
            tired: Any = np.flatnonzero(ess[k - 1] <= ess_threshold * P * (1 + ROUNDING))
            if len(tired):
                shifts = np.array([rngs[i].random(P if resample == "stratified" else 1) for i in tired])
                if runs == 1:
                    w /= w.sum()
                    cloud.resample(of_strata(w, shifts, (scratch, marks))[0])
                else:
                    ancestors = np.arange(runs * P).reshape(runs, P)
                    totals = w[tired].sum(axis=1, keepdims=True)
                    ancestors[tired] = of_strata(w[tired] / totals, shifts) + P * tired[:, np.newaxis]
                    cloud.resample(ancestors.ravel())
                logs[tired] = even
            step = steps[k - 1]
            _make(step, cloud, laws, logs.ravel(), normals(step.n_draws, P, rngs, drawn))
            log_totals = _normalise(logs, w, k)
            logs -= log_totals[:, np.newaxis]
            log_evidence[k] = log_evidence[k - 1] + log_totals
        means[k], covs[k] = cloud.moments(w, scratch)
        if not np.isfinite(means[k]).all():
            raise InputError("A particle is NaN or infinite.")
        ess[k], survivors[k] = 1 / np.sum(np.square(w, out=scratch), axis=1), cloud.survivors(runs)
    back = np.argsort(laws.order)
    covs += laws.extra[:, np.newaxis]
    means, covs = means[..., back], covs[..., back][..., back, :]
    return [Filtered(means[:, i], covs[:, i], log_evidence[:, i], ess[:, i], survivors[:, i]) for i in range(runs)]


def _normalise(logs: Array, w: Array, k: int) -> Array:
    """Set each row of w to the weights, and return the log-totals, as `lab.weights.normalise` has them."""
    largest = logs.max(axis=1)
    if not np.isfinite(largest).all():
        try:
            weights.normalise(logs[np.flatnonzero(~np.isfinite(largest))[0]])
        except InputError as error:
            raise InputError(f"At k = {k}: {error}") from None
    np.subtract(logs, largest[:, np.newaxis], out=w)
    np.exp(w, out=w)
    total = w.sum(axis=1)
    w /= total[:, np.newaxis]
    return np.asarray(largest + np.log(total))


def _steps(laws: Plan) -> list[_Step]:
    """Return the steps of a plan, made at the first call."""
    if laws not in _prepared:
        a, move = len(laws.B), laws.F[: laws.n_moving]
        used = np.flatnonzero(move.any(axis=0))
        move = np.ascontiguousarray(move[:, : used[-1] + 1 if len(used) else 0])
        _prepared[laws] = [
            _Step(
                move,
                _terms(-laws.H[step, :p, :a]),
                _terms(laws.K[step, :, :p]),
                _terms(laws.spread[step, :, :e]),
                laws.z[step, :p, np.newaxis],
                laws.H[step, :p, a:],
                float(laws.constants[step]),
                int(e),
            )
            for step, (p, e) in enumerate(laws.sizes)
        ]
    return _prepared[laws]


def _make(step: _Step, cloud: Clones, laws: Plan, logs: Array, drawn: Array) -> None:
    """Move and draw the particles in place, and add the logarithms of their likelihoods to `logs` (runs P,)."""
    shift = laws.B[: laws.n_moving, np.newaxis]
    expected = step.z - cloud.product(step.of_static, cloud.static)  # but for the active rows, and per ancestor
    alone = cloud.alone
    for rows in blocks(len(logs)):
        x = cloud.x[:, rows]
        x[: len(shift)] = cloud.product(step.move, x[: step.move.shape[1]]) + shift
        if laws.draw_first:
            _add(cloud, x, step.draw, drawn[:, rows])
        y = expected[:, rows].copy() if alone else expected.take(cloud.group[rows], axis=1)
        _add(cloud, y, step.measure, x)
        logs[rows] += step.constant - np.einsum("ij,ij->j", y, y) / 2
        _add(cloud, x, step.correct, y)
        if not laws.draw_first:
            _add(cloud, x, step.draw, drawn[:, rows])


def _terms(matrix: Array) -> list[Term]:
    """Return the blocks of a matrix that are not zero: neighbouring rows, and columns from first to last."""
    found, used = [], np.flatnonzero(matrix.any(axis=1))
    for rows in np.split(used, np.flatnonzero(np.diff(used) > 1) + 1) if len(used) else []:
        target = slice(int(rows[0]), int(rows[-1]) + 1)
        columns = np.flatnonzero(matrix[target].any(axis=0))
        for run in np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1):
            source = slice(int(run[0]), int(run[-1]) + 1)
            found.append((target, source, np.ascontiguousarray(matrix[target, source])))
    return found


def _add(cloud: Clones, target: Array, terms: Sequence[Term], source: Array) -> None:
    for rows, columns, matrix in terms:
        target[rows] += cloud.product(matrix, source[columns])
