"""A cloud of particles whose static rows are kept once per living ancestor.

Question answered: what do descendants of one particle share, and what does that save?  Rows of the state that no step
touches (see `lab.solvers.plan`) are equal for all descendants of one particle of time 0.  Ancestors are drawn in
ascending order, so descendants stay neighbours: a group, whose weights are added by segments.  Several runs are one
long cloud.  Called by `lab.solvers.blocked`.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from lab.solvers.plan import Plan
from lab.validation import Array

FEW = 300  # particles, up to which landmarks of one ancestor are not worth the search for them
BLOCK = 4000  # particles; no power of two, since rows at such distances would share places in the cache
PAD = 8  # doubles, so that the rows of a whole cloud are not at such a distance, either


class Clones:
    """The particles of all runs, one run after the other, and their ancestors of time 0.

    Parameters
    ----------
    laws : Plan
    n_particles : int
        P, of each run.
    rngs : sequence of Generator
        One for each run; the cloud of time 0 is drawn.

    Attributes
    ----------
    x : (a, runs P) array
        Active rows.
    static : (s, G) array
        The other rows, once for each living ancestor.
    product : function
        Of two matrices, the second with a column for each particle or ancestor.
    group : (runs P,) array of int
        Of each particle, its ancestor's column of `static`; ascending.
    starts : (G,) array of int
        The first particle of each group.
    """

    def __init__(self, laws: Plan, n_particles: int, rngs: Sequence[np.random.Generator]) -> None:
        a, n_columns = len(laws.B), n_particles * len(rngs)
        self.x, self._other = _padded(a, n_columns), _padded(a, n_columns)
        n_draws = laws.spread_0.shape[1]
        drawn = normals(n_draws, n_particles, rngs, np.empty((n_draws, n_columns)))
        # BLAS computes columns in groups, and a last digit may depend on a column's place
        self.product: Callable[[Array, Array], Array] = (
            partial(np.einsum, "ij,jk->ik") if n_particles <= FEW else np.dot
        )
        for rows in blocks(n_columns):
            self.x[:, rows] = self.product(laws.spread_0[:a], drawn[:, rows])
        self.x += laws.m0[:a, np.newaxis]
        self.static = laws.m0[a:, np.newaxis] + self.product(laws.spread_0[a:], drawn)
        self.group = self.starts = np.arange(n_columns)
        self._other_group = np.empty(n_columns, np.intp)

    @property
    def alone(self) -> bool:
        """Whether every particle is the only descendant of its ancestor."""
        return len(self.starts) == len(self.group)

    def resample(self, ancestors: Any) -> None:
        """Replace the particles by their ancestors, given in ascending order."""
        self.x, self._other = self._other, self.x
        for rows in blocks(len(ancestors)):
            for new, old in zip(self.x, self._other, strict=True):
                np.take(old, ancestors[rows], out=new[rows], mode="clip")
        self.group, self._other_group = self._other_group, self.group
        group = np.take(self._other_group, ancestors, out=self.group, mode="clip")
        begins = np.flatnonzero(group[1:] != group[:-1]) + 1
        self.starts = np.concatenate([[0], begins])
        self.static = self.static[:, group[self.starts]]
        group[:] = 0
        group[begins] = 1
        np.cumsum(group, out=group)

    def moments(self, w: Array, scratch: Array) -> tuple[Array, Array]:
        """Return means (runs, n) and covariances (runs, n, n) of the particles with weights w; all (runs, P)."""
        runs, P = w.shape
        if P <= FEW:
            static = self.static if self.alone else self.static.take(self.group, axis=1)
            x = np.concatenate([self.x, static]).reshape(-1, runs, P).transpose(1, 0, 2).copy()
            means = (x @ w[:, :, np.newaxis])[:, :, 0]
            x -= means[:, :, np.newaxis]
            x *= np.sqrt(w)[:, np.newaxis]
            return means, x @ x.transpose(0, 2, 1)
        each = [self._large_moments(w[run], slice(run * P, (run + 1) * P), scratch[run]) for run in range(runs)]
        return np.array([mean for mean, _ in each]), np.array([cov for _, cov in each])

    def _large_moments(self, w: Array, particles: slice, scratch: Array) -> tuple[Array, Array]:
        first, end = (int(place) for place in np.searchsorted(self.starts, (particles.start, particles.stop)))
        starts, static, x = self.starts[first:end] - particles.start, self.static[:, first:end], self.x[:, particles]
        if len(starts) == len(w) or not len(static):
            parts = [part for part in (x, static) if len(part)]
            mean = np.concatenate([part @ w for part in parts])
            return mean, _scatter(parts, mean, w)
        a, n = len(x), len(x) + len(static)
        mean, cov, shares = np.empty(n), np.empty((n, n)), np.add.reduceat(w, starts)
        mean[:a], mean[a:] = x @ w, static @ shares
        cov[:a, :a] = _scatter([x], mean[:a], w)
        cov[a:, a:] = _scatter([static], mean[a:], shares)
        sums = [
            np.add.reduceat(np.multiply(row, w, out=scratch), starts) - m * shares
            for row, m in zip(x, mean, strict=False)
        ]
        cov[:a, a:] = np.stack(sums) @ (static - mean[a:, np.newaxis]).T
        cov[a:, :a] = cov[:a, a:].T
        return mean, cov

    def survivors(self, runs: int) -> Any:
        """Return how many ancestors of time 0 each run has left."""
        return np.bincount(self.starts * runs // len(self.group), minlength=runs)


def normals(n_rows: int, n_particles: int, rngs: Sequence[np.random.Generator], room: Array) -> Array:
    """Return the draws (n_rows, runs P), those of a run from its own generator; `room` has as many columns."""
    if len(rngs) == 1:
        return rngs[0].standard_normal(out=room[:n_rows])
    return np.concatenate([rng.standard_normal((n_rows, n_particles)) for rng in rngs], axis=1, out=room[:n_rows])


def blocks(n_particles: int) -> Sequence[slice]:
    """Return the places of some thousand particles at a time."""
    return [slice(start, min(start + BLOCK, n_particles)) for start in range(0, n_particles, BLOCK)]


def _padded(n_rows: int, n_columns: int) -> Array:
    """Return room for rows whose distance is no multiple of 512 doubles."""
    width = n_columns + (PAD if n_columns % 512 < PAD else 0)
    return np.zeros((n_rows, width))[:, :n_columns]


def _scatter(parts: Sequence[Array], mean: Array, w: Array) -> Array:
    """Return the weighted covariance of the rows of all parts about a mean."""
    n = len(mean)
    cov = np.zeros((n, n))
    room = np.empty((n, BLOCK))
    for rows in blocks(len(w)):
        roots = np.sqrt(w[rows])
        centred, begin = room[:, : len(roots)], 0
        for part in parts:
            end = begin + len(part)
            np.subtract(part[:, rows], mean[begin:end, np.newaxis], out=centred[begin:end])
            begin = end
        centred *= roots
        cov += centred @ centred.T
    return cov
