"""The particle loop in numpy, block by block and with each static landmark once per ancestor.

Question answered: how fast can a filter of the laboratory be without a compiler?  The readable loop of
`lab.solvers.particle` draws the same random numbers in the same order and gives the same answers, but for rounding.
Here

    blocks      a step moves, draws and weighs some thousand particles at a time, which stay in the processor's cache
    in place    nobody keeps the cloud of the step before
    genealogy   static rows of the state (see `lab.solvers.plan`) are kept once per living ancestor of time 0; its
                descendants stay neighbours, so their weights are added by segments

For schemes whose ancestors come in ascending order.  Called by `lab.solvers.particle`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from lab import weights
from lab.problem import Problem
from lab.resampling import Resampler
from lab.result import Filtered
from lab.solvers.plan import Plan, plan
from lab.solvers.proposals import GaussianProposal
from lab.validation import Array, InputError

BLOCK = 4000  # particles; no power of two, since rows at such distances would share places in the cache
PAD = 8  # doubles, so that the rows of a whole cloud are not at such a distance, either
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


class _Cloud:
    """Particles and their ancestors of time 0.

    Attributes
    ----------
    x : (a, P) array
        Active rows.
    static : (s, G) array
        The other rows, once for each living ancestor.
    group : (P,) array of int
        Of each particle, its ancestor's column of `static`; ascending.
    starts : (G,) array of int
        The first particle of each group.
    """

    def __init__(self, laws: Plan, n_particles: int, rng: np.random.Generator) -> None:
        a = len(laws.B)
        self.x, self._other = _padded(a, n_particles), _padded(a, n_particles)
        normals = rng.standard_normal((laws.spread_0.shape[1], n_particles))
        for rows in _blocks(n_particles):
            np.matmul(laws.spread_0[:a], normals[:, rows], out=self.x[:, rows])
        self.x += laws.m0[:a, np.newaxis]
        self.static = laws.m0[a:, np.newaxis] + laws.spread_0[a:] @ normals
        self.group = self.starts = np.arange(n_particles)

    def resample(self, ancestors: Any) -> None:
        """Replace the particles by their ancestors, given in ascending order."""
        self.x, self._other = self._other, self.x
        for rows in _blocks(len(ancestors)):
            for new, old in zip(self.x, self._other, strict=True):
                np.take(old, ancestors[rows], out=new[rows], mode="clip")
        group = self.group[ancestors]
        begins = np.flatnonzero(group[1:] != group[:-1]) + 1
        self.starts = np.concatenate([[0], begins])
        self.static = self.static[:, group[self.starts]]
        self.group = np.zeros(len(group), np.intp)
        self.group[begins] = 1
        np.cumsum(self.group, out=self.group)

    def moments(self, w: Array) -> tuple[Array, Array]:
        """Return mean (n,) and covariance (n, n) of the particles with weights w (P,)."""
        rows = (self.x, self.static)
        if len(self.starts) == len(w) or not len(self.static):
            mean = np.concatenate([part @ w for part in rows if len(part)])
            return mean, _scatter([part for part in rows if len(part)], mean, w)
        a, n = len(self.x), len(self.x) + len(self.static)
        mean, cov, shares = np.empty(n), np.empty((n, n)), np.add.reduceat(w, self.starts)
        mean[:a], mean[a:] = self.x @ w, self.static @ shares
        cov[:a, :a] = _scatter([self.x], mean[:a], w)
        apart = self.static - mean[a:, np.newaxis]
        cov[a:, a:] = _scatter([self.static], mean[a:], shares)
        sums = np.stack(
            [np.add.reduceat(row * w, self.starts) - m * shares for row, m in zip(self.x, mean, strict=False)]
        )
        cov[:a, a:] = sums @ apart.T
        cov[a:, :a] = cov[:a, a:].T
        return mean, cov


def run(
    problem: Problem,
    rng: np.random.Generator,
    *,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    scheme: Resampler,
) -> Filtered:
    """Run a filter of `lab.solvers.particle`; arguments as there, checked already.

    Raises
    ------
    InputError
        Every weight is zero at some k, which is named, or a particle is not finite.
    """
    laws = plan(problem, proposal)
    steps = _steps(laws)
    N, n = problem.n_instants, len(laws.m0)
    means, covs = np.empty((N, n)), np.empty((N, n, n))
    log_evidence, ess = np.zeros(N), np.empty(N)
    survivors: Any = np.empty(N, dtype=np.int64)
    cloud = _Cloud(laws, n_particles, rng)
    even = np.full(n_particles, 1 / n_particles)
    w, logs = even, np.log(even)
    for k in range(N):
        if k:
            if ess[k - 1] <= ess_threshold * n_particles * (1 + ROUNDING):
                cloud.resample(scheme(w, rng))
                logs = np.log(even)
            _make(steps[k - 1], cloud, laws, logs, rng)
            try:
                w, log_total = weights.normalise(logs)
            except InputError as error:
                raise InputError(f"At k = {k}: {error}") from None
            logs -= log_total
            log_evidence[k] = log_evidence[k - 1] + log_total
        means[k], covs[k] = cloud.moments(w)
        if not np.isfinite(means[k]).all():
            raise InputError("A particle is NaN or infinite.")
        ess[k], survivors[k] = weights.ess(w), len(cloud.starts)
    back = np.argsort(laws.order)
    covs += laws.extra
    return Filtered(means[:, back], covs[:, back][:, :, back], log_evidence, ess, survivors)


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


def _make(step: _Step, cloud: _Cloud, laws: Plan, logs: Array, rng: np.random.Generator) -> None:
    """Move and draw the particles in place, and add the logarithms of their likelihoods to `logs` (P,)."""
    shift = laws.B[: laws.n_moving, np.newaxis]
    expected = step.z - step.of_static @ cloud.static  # but for the active rows, and per ancestor
    alone = len(cloud.starts) == len(logs)
    normals = rng.standard_normal((step.n_draws, len(logs)))
    for rows in _blocks(len(logs)):
        x = cloud.x[:, rows]
        x[: len(shift)] = step.move @ x[: step.move.shape[1]] + shift
        if laws.draw_first:
            _add(x, step.draw, normals[:, rows])
        y = expected[:, rows].copy() if alone else expected.take(cloud.group[rows], axis=1)
        _add(y, step.measure, x)
        logs[rows] += step.constant - np.einsum("ij,ij->j", y, y) / 2
        _add(x, step.correct, y)
        if not laws.draw_first:
            _add(x, step.draw, normals[:, rows])


def _blocks(n_particles: int) -> Sequence[slice]:
    return [slice(start, min(start + BLOCK, n_particles)) for start in range(0, n_particles, BLOCK)]


def _padded(n_rows: int, n_columns: int) -> Array:
    """Return room for rows whose distance is no multiple of 512 doubles."""
    width = n_columns + (PAD if n_columns % 512 < PAD else 0)
    return np.zeros((n_rows, width))[:, :n_columns]


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


def _add(target: Array, terms: Sequence[Term], source: Array) -> None:
    for rows, columns, matrix in terms:
        target[rows] += matrix @ source[columns]


def _scatter(parts: Sequence[Array], mean: Array, w: Array) -> Array:
    """Return the weighted covariance of the rows of all parts about a mean."""
    n, roots = len(mean), np.sqrt(w)
    cov = np.zeros((n, n))
    room = np.empty((n, BLOCK))
    for rows in _blocks(len(w)):
        centred, begin = room[:, : len(roots[rows])], 0
        for part in parts:
            end = begin + len(part)
            np.subtract(part[:, rows], mean[begin:end, np.newaxis], out=centred[begin:end])
            begin = end
        centred *= roots[rows]
        cov += centred @ centred.T
    return cov
