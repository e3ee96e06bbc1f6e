"""A cloud of particles whose static rows are kept once per living ancestor.

Question answered: what do descendants of one particle share, and what does that save?  Rows of the state that are
static from time 0 on (see `lab.solvers.plan`) are equal for all descendants of one particle of then.  Ancestors are
drawn in ascending order, so descendants stay neighbours: a group, whose weights are added by segments.  Several runs
are one long cloud.  Called by `lab.solvers.blocked`.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from lab.resampling import ancestors_of
from lab.solvers.plan import Plan
from lab.solvers.terms import combine, pay, terms_of
from lab.validation import Array

FEW = 300  # particles, up to which landmarks of one ancestor are not worth the search for them
BLOCK = 256_000  # numbers that are worked on at a time: two megabytes, which stay in the cache
SMALLEST, LARGEST = 1000, 25_000  # particles of a block: calls are not free either
LOST = 1e-4  # a variance below this part of the squared mean has lost too many digits
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
    n_particles : int
    noise, x : (e, runs P), (a, runs P) array
        The normals drawn last, and the active rows.
    both : (e + a, runs P) array
        One above the other: those two are parts of it.
    static : (s, G) array
        The other rows, once for each living ancestor.
    starts : (G,) array of int
        The first descendant of each ancestor.
    product : function
        Of two matrices, the second with a column for each particle or ancestor; keyword `out`.
    """

    def __init__(self, laws: Plan, n_particles: int, rngs: Sequence[np.random.Generator]) -> None:
        a, e = laws.spread.shape[1:]
        n_columns = n_particles * len(rngs)
        self._rngs, self.n_particles = rngs, n_particles
        # BLAS computes columns in groups, and a last digit may depend on a column's place
        self.product: Callable[..., Array] = partial(np.einsum, "ij,jk->ik") if n_particles <= FEW else np.dot
        drawn = _padded(laws.spread_0.shape[1], n_columns)
        self._draw(drawn)
        self._room = _padded(e + a + 1, n_columns)
        self._place(0, e)
        self.static = np.empty((len(laws.spread_0) - a, n_columns))
        for part, made in ((laws.spread_0[:a], self.x), (laws.spread_0[a:], self.static)):
            terms = terms_of(part)
            for rows in blocks(n_columns, len(drawn)):
                if pay(terms, len(drawn), n_particles):
                    combine(terms, drawn[:, rows], made[:, rows])
                else:
                    made[:, rows] = self.product(part, drawn[:, rows])
        if n_particles <= FEW:  # einsum adds in the order of memory, which is this one after any run has resampled
            self.static = np.asfortranarray(self.static)
        self.starts, self._ancestors = np.arange(n_columns), np.empty(n_columns, np.intp)

    def _place(self, first: int, n_drawn: int) -> None:
        """Let the noise and the active rows begin at row 0 or 1 of a room for one more: two rooms exceed the cache."""
        self._first, self.both = first, self._room[first : len(self._room) - 1 + first]
        self.noise, self.x = self.both[:n_drawn], self.both[n_drawn:]

    def draw(self, n_rows: int) -> None:
        """Draw the last rows of the noise, those of a run from its own generator."""
        self._draw(self.noise[len(self.noise) - n_rows :])

    def _draw(self, room: Array) -> None:
        for run, rng in enumerate(self._rngs):
            for row in room[:, run * self.n_particles : (run + 1) * self.n_particles]:
                rng.standard_normal(out=row)

    def spread_out(self, columns: Array) -> Array:
        """Return for each particle the column of its ancestor: (.., runs P) from (.., G)."""
        n_columns = self.x.shape[1]
        if columns.shape[1] == n_columns:  # every particle is the only descendant of its ancestor
            return columns
        return np.repeat(columns, np.diff(self.starts, append=n_columns), axis=1)

    def add(self, target: Array, columns: Array, rows: slice) -> None:
        """Add to the particles of a block, in `target`, a column: the only one, or of each particle or its ancestor."""
        n_columns = self.x.shape[1]
        if columns.shape[1] in (1, n_columns):
            target += columns[:, rows] if columns.shape[1] > 1 else columns
            return
        starts = [*self.starts.tolist(), n_columns]
        group = bisect_right(starts, rows.start) - 1
        while starts[group] < rows.stop:
            begin, end = max(starts[group] - rows.start, 0), starts[group + 1] - rows.start
            target[:, begin:end] += columns[:, group : group + 1]
            group += 1

    def resample(self, ends: Any) -> None:
        """Replace the particles by their offspring; `ends` (runs P,) counts that of each and of those before it."""
        e, ancestors = len(self.noise), ancestors_of(ends, self._ancestors)
        before, up = self.x, self._first == 0
        self._place(int(up), e)
        for row in reversed(range(len(before))) if up else range(len(before)):
            np.take(before[row], ancestors, out=self.x[row], mode="clip")
        starts = np.concatenate([[0], ends[self.starts[1:] - 1]])
        alive = np.diff(starts, append=len(ends)) > 0
        self.starts, self.static = starts[alive], self.static[:, alive]

    def moments(self, w: Array, totals: Array, differing: Sequence[slice], *, near: bool) -> tuple[Array, Array]:
        """Return means (runs, n) and covariances (runs, n, n) of the particles; weights (runs, P) and sums (runs,).

        If no rows are static, those that are not `differing` are 0; `near` as `_moments`.
        """
        runs, P = w.shape
        if P <= FEW:
            w = w / totals[:, np.newaxis]
            x = np.concatenate([self.x, self.spread_out(self.static)]).reshape(-1, runs, P).transpose(1, 0, 2).copy()
            means = (x @ w[:, :, np.newaxis])[:, :, 0]
            x -= means[:, :, np.newaxis]
            x *= np.sqrt(w)[:, np.newaxis]
            return means, x @ x.transpose(0, 2, 1)
        each = [self._large_moments(w[i], totals[i], slice(i * P, (i + 1) * P), differing, near) for i in range(runs)]
        return np.array([mean for mean, _ in each]), np.array([cov for _, cov in each])

    def _large_moments(
        self, w: Array, total: float, particles: slice, differing: Sequence[slice], near: bool
    ) -> tuple[Array, Array]:
        first, end = (int(place) for place in np.searchsorted(self.starts, (particles.start, particles.stop)))
        starts, static, x = self.starts[first:end] - particles.start, self.static[:, first:end], self.x[:, particles]
        a, n = len(x), len(x) + len(static)
        mean, cov = np.zeros(n), np.zeros((n, n))
        if not len(static):
            rows = np.r_[tuple(differing)]
            mean[rows], cov[np.ix_(rows, rows)] = _moments([x[part] for part in differing], w, total, near=near)
            return mean, cov
        if len(starts) == len(w):
            return _moments([x, static], w, total)
        sums = np.zeros((a, len(starts)))
        mean[:a], cov[:a, :a] = _moments([x], w, total, starts, sums)
        mean[a:], cov[a:, a:] = _moments([static], np.add.reduceat(w, starts), total)
        cov[:a, a:] = sums @ (static - mean[a:, np.newaxis]).T / total
        cov[a:, :a] = cov[:a, a:].T
        return mean, cov

    def survivors(self, runs: int) -> Any:
        """Return how many ancestors of time 0 each run has left."""
        if runs == 1:
            return len(self.starts)
        return np.bincount(self.starts * runs // self.x.shape[1], minlength=runs)


def blocks(n_particles: int, n_rows: int) -> Sequence[slice]:
    """Return the places of some thousand particles at a time, of which so many rows are worked on."""
    size = block_size(n_rows)
    return [slice(start, min(start + size, n_particles)) for start in range(0, n_particles, size)]


def block_size(n_rows: int) -> int:
    """Return how many particles are worked on at a time, of which so many rows are."""
    return min(max(BLOCK // max(n_rows, 1), SMALLEST), LARGEST)


def _padded(n_rows: int, n_columns: int) -> Array:
    """Return room for rows whose distance is no multiple of 512 doubles."""
    width = n_columns + (PAD if n_columns % 512 < PAD else 0)
    return np.zeros((n_rows, width))[:, :n_columns]


def _moments(
    parts: Sequence[Array], w: Array, total: float, starts: Any = None, sums: Array | None = None, *, near: bool = False
) -> tuple[Array, Array]:
    """Return the weighted mean and covariance of the rows of all parts, which are read once.

    The heaviest particle is the origin: however small a covariance is, its distance from the mean cannot drown it.  The
    rows' weighted sums over the groups that begin at `starts` (G,), as seen from there, are added to `sums` (n, G).
    Where `near` says that means are not far from 0, that is the origin, if the sums do not say otherwise.
    """
    heaviest = np.argmax(w)
    origin = np.concatenate([part[:, heaviest] for part in parts])[:, np.newaxis] * (not near)
    n = len(origin)
    first, second, room = np.zeros(n), np.zeros((n, n)), np.empty((n, min(block_size(n), len(w))))
    for rows in blocks(len(w), n):
        begin, centred = 0, room[:, : rows.stop - rows.start]
        roots: Any = np.sqrt(w[rows]) if sums is None else None  # which sums of groups do not need
        for part in parts:
            end = begin + len(part)
            if near:
                np.multiply(part[:, rows], roots, out=centred[begin:end])
            else:
                np.subtract(part[:, rows], origin[begin:end], out=centred[begin:end])
            begin = end
        if sums is None:
            if not near:
                centred *= roots
            first += centred @ roots
            second += centred @ centred.T  # of a matrix and itself, for which BLAS takes less time
        else:
            weighted = centred * w[rows]
            if n == 2:  # BLAS takes twice as long for a product of matrices with so few rows
                cross = weighted[0] @ centred[1]
                second += [[weighted[0] @ centred[0], cross], [cross, weighted[1] @ centred[1]]]
            else:
                second += weighted @ centred.T
            from_group, to_group = np.searchsorted(starts, [rows.start, rows.stop - 1], side="right") - [1, 0]
            places = np.maximum(starts[from_group:to_group] - rows.start, 0)
            sums[:, from_group:to_group] += np.add.reduceat(weighted, places, axis=1)
    first = (first if sums is None else sums.sum(axis=1)) / total
    cov = second / total - np.outer(first, first)
    if near and (cov.diagonal() < LOST * first**2).any():
        return _moments(parts, w, total)
    return origin[:, 0] + first, (cov + cov.T) / 2  # rounding differs across the diagonal
