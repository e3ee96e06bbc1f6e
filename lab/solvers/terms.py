"""Products of a small matrix with a wide one, entry by entry.

Question answered: what does a matrix with many zeros cost?  A pass over a row for each entry that is not 0, and no copy
of rows that lie apart; BLAS reads and writes every row, and multiplies by the zeros too.
Called by `lab.solvers.steps`, `lab.solvers.clones` and `lab.solvers.blocked`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.linalg.blas import daxpy

from lab.validation import Array

MANY = 10_000  # particles of a run, from which on a pass over a row is worth its call
Terms = Sequence[Sequence[tuple[int, float]]]  # of each row of a matrix the columns of its entries, and these


def terms_of(matrix: Array) -> Terms:
    """Return the entries of a matrix that are not 0."""
    return [[(int(column), float(row[column])) for column in np.flatnonzero(row)] for row in matrix]


def pay(terms: Terms, n_read: int, n_particles: int) -> bool:
    """Return whether entry by entry takes less time than BLAS, which copies the rows that it reads."""
    return n_particles >= MANY and sum(map(len, terms)) <= 2 * (len(terms) + n_read)


def combine(terms: Terms, read: Iterable[Array], out: Array) -> None:
    """Set each row of `out` to the sum of its terms: of rows that are read, and after these of `out` so far.

    Parameters
    ----------
    terms : sequence of sequence of (int, float)
        Of each row of `out` the places of other rows and their factors; the i-th row of `out` has place c + i.
    read : iterable of (N,) array
        c of them, contiguous.
    out : (rows, N) array
        With contiguous rows.
    """
    rows = [*read, *out]
    for row, parts in zip(out, terms, strict=True):
        if not parts:
            row[:] = 0
            continue
        (first, factor), *others = parts
        np.multiply(rows[first], factor, out=row)
        for place, factor in others:
            daxpy(rows[place], row, a=factor)  # in place, in half of numpy's time: one pass
