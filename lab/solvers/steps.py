"""The steps of a plan as products of matrices, for the particle loop in numpy.

Question answered: what does a step do to all particles at once?  It reads some rows, and one product makes of them the
rows that it changes and what the measurement has beyond what each particle expects.  Particles are counted from the
path of one without noise, so that near 0 nothing need be added.
Called by `lab.solvers.blocked`.
"""

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from lab.solvers.plan import Plan
from lab.solvers.terms import Terms, terms_of
from lab.validation import Array

ROOT_HALF = np.sqrt(0.5)  # goes into y, so that its square needs no factor


class Step(NamedTuple):
    """A step of a plan as one product that reads the particles before the step.

    y is what the measurement has beyond what a particle expects, whitened, times the root of a half.

    Attributes
    ----------
    map : (u + p, c) array
        From what is read to the u rows that the step changes, and to y.
    terms : sequence of sequence of (int, float)
        The same entry by entry; y is made of the changed rows where it reads no others.
    shift : (u, 1) array
        What is added to those rows: where no measurement ever corrects them, else 0.
    reads, writes : list of slice
        The c rows of noise and active rows, one above the other; the u active rows.
    expected, of_static : (p, 1), (p, s) array
        The parts of y that need no active row.
    gain : (u, p) array
        What y does to the rows that change: `map` has it but for the static rows.
    constant : float
    n_draws : int
    path : (n,) array
        Where particles are counted from after the step.
    differing : list of slice
        The active rows that are not 0 for all particles after the step, if none are static.
    """

    map: Array
    terms: Terms
    shift: Array
    reads: list[slice]
    writes: list[slice]
    expected: Array
    of_static: Array
    gain: Array
    constant: float
    n_draws: int
    path: Array
    differing: list[slice]


_prepared: WeakKeyDictionary[Plan, list[Step]] = WeakKeyDictionary()  # plans never change


def steps_of(laws: Plan) -> list[Step]:
    """Return the steps of a plan, made at the first call."""
    if laws not in _prepared:
        a, m, most = len(laws.B), laws.n_moving, laws.spread.shape[2]
        moved = np.vstack([laws.F[:m], np.eye(a)[m:]])
        path, differing = laws.m0, laws.spread_0[:a].any(axis=1)
        free = loose(laws)
        _prepared[laws] = []
        for step, (p, e, _) in enumerate(laws.sizes):
            z, H = laws.z[step, :p] * ROOT_HALF, laws.H[step, :p] * ROOT_HALF
            drawn, K = laws.spread[step, :, :e], laws.K[step, :, :p] / ROOT_HALF
            to_y = -H[:, :a] @ np.hstack([drawn * laws.draw_first, moved])
            to_rows = np.hstack([drawn, moved]) + K @ to_y
            changed = np.flatnonzero((np.arange(a) < m) | drawn.any(axis=1) | K.any(axis=1))
            whole = np.vstack([to_rows[changed], to_y])
            read = np.flatnonzero(whole.any(axis=0))
            path = np.concatenate([moved @ path[:a] + laws.B, path[a:]])
            expected = z - H @ path
            path[:a] += K @ expected
            shift = np.where(free, path[:a], 0.0)
            path[:a] -= shift
            differing = to_rows[:, :e].any(axis=1) | ((to_rows[:, e:] != 0) @ differing) | (shift != 0)
            terms = terms_of(whole[:, read])
            if laws.draw_first and not K.any() and not np.delete(H[:, :a], changed, axis=1).any():
                terms = [*terms[: len(changed)], *terms_of(np.hstack([np.zeros((p, len(read))), -H[:, changed]]))]
            _prepared[laws].append(
                Step(
                    np.ascontiguousarray(whole[:, read]),
                    terms,
                    shift[changed, np.newaxis],
                    neighbours(most - e + read),  # what is drawn stands last
                    neighbours(changed),
                    expected[:, np.newaxis],
                    -H[:, a:],
                    K[changed],
                    float(laws.constants[step]),
                    int(e),
                    path,
                    neighbours(np.flatnonzero(differing)),
                )
            )
    return _prepared[laws]


def loose(laws: Plan) -> Any:
    """Return which active rows (a,) are moved or drawn, but never corrected by what is measured."""
    changes = (np.arange(len(laws.B)) < laws.n_moving) | laws.spread.any(axis=(0, 2))
    return changes & ~laws.K.any(axis=(0, 2))


def neighbours(rows: Any) -> list[slice]:
    """Return ascending whole numbers as slices of those that follow one another; an empty one where there are none."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return [slice(int(run[0]), int(run[-1]) + 1) if len(run) else slice(0, 0) for run in runs]
