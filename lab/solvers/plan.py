"""From a proposal's laws to the arrays that the fast loops run on.

Question answered: what of a filter does not depend on the particles?  Everything but the draws: the laws of all steps
follow from what is seen.  They are computed once for a problem, whitened,

    S = L L',   z~ = L^-1 z,   H~ = L^-1 H,   K~ = K L,   constant = -(p log 2 pi + log det S) / 2,

and the rows of the state are ordered: those that F moves, then the others, those first that some step touches for
longest; F touches what it reads.  After its last touch a row is static: all descendants of one particle share its value
from then on (landmarks of SIS and SIR from time 0 on, of the guided filter from their first sight on).
Called by `lab.solvers.blocked` and `lab.solvers.compiled`.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg

from lab import gaussian
from lab.problem import Problem
from lab.solvers.proposals import GaussianProposal
from lab.validation import Array

PATIENCE = 10  # rows are taken as static only where none follow for so many steps
RESIDUE = 1e-15  # of the largest entry: what rounding leaves of a gain that is 0


@dataclass(frozen=True, eq=False)
class Plan:
    """A filter's laws, rows of the state in `order`: n of them, of which a are not static from time 0 on.

    Attributes
    ----------
    order : (n,) array of int
    m0, spread_0 : (n,), (n, e_0) array
    F, B : (a, a), (a,) array
    n_moving : int
    sizes : (T, 3) array of int
        Of each step: measured components, normals drawn, rows that are not taken as static yet, if genealogies are to
        begin anew for those that become static later.
    z, H, K, spread, constants : (T, p), (T, p, n), (T, a, p), (T, a, e), (T,) array
        One row, which nothing reads, where T = 0.
    extra : (T + 1, n, n) array
    draw_first : bool
    """

    order: Any
    m0: Array
    spread_0: Array
    F: Array
    B: Array
    n_moving: int
    sizes: Any
    z: Array
    H: Array
    K: Array
    spread: Array
    constants: Array
    extra: Array
    draw_first: bool

    @cached_property
    def back(self) -> Any:
        """Where each row of the state is in `order`: (n,) array of int."""
        return np.argsort(self.order)


_plans: WeakKeyDictionary[Problem, dict[GaussianProposal, Plan]] = WeakKeyDictionary()  # problems never change


def plan(problem: Problem, proposal: GaussianProposal) -> Plan:
    """Return the plan of a filter, made at the first call for this problem.

    Raises
    ------
    InputError
        As `GaussianProposal.law`.
    """
    known = _plans.setdefault(problem, {})
    if proposal not in known:
        known[proposal] = _made(problem, proposal)
    return known[proposal]


def _made(problem: Problem, proposal: GaussianProposal) -> Plan:
    model, laws = problem.model, list(proposal.laws(problem))
    n, T = len(model.m0), len(laws)
    spread_0, left = gaussian.split(model.P0, proposal.sampled(problem, 0))
    p = max((len(law.z) for law in laws), default=0)
    e = max((law.spread.shape[1] for law in laws), default=0)
    sizes: Any = np.array([[len(law.z), law.spread.shape[1], n] for law in laws], dtype=np.int64).reshape(T, 3)
    rows = max(T, 1)
    z, H, K = np.zeros((rows, p)), np.zeros((rows, p, n)), np.zeros((rows, n, p))
    spread, constants = np.zeros((rows, n, e)), np.zeros(rows)
    extra = np.array([left, *(law.cov for law in laws)])
    for k, law in enumerate(laws):
        m, d, _ = sizes[k]
        L = np.linalg.cholesky(law.S)
        z[k, :m] = scipy.linalg.solve_triangular(L, law.z, lower=True) if m else law.z
        H[k, :m] = scipy.linalg.solve_triangular(L, law.H, lower=True) if m else law.H
        K[k, :, :m] = _without_residues(law.K @ L)
        spread[k, :, :d] = _without_residues(law.spread)
        constants[k] = -np.log(np.diag(L)).sum() - m * gaussian.LOG_2PI / 2
    moving = np.zeros(n, bool)
    moving[model.moving] = True
    until = _last_touched(K, spread)
    until[moving | (model.F[moving] != 0).any(axis=0)] = rows
    order = np.lexsort((-until, ~moving))
    a = order[: np.count_nonzero(until)]
    sizes[:, 2] = _active(until, T)
    return Plan(
        order,
        model.m0[order],
        np.ascontiguousarray(spread_0[order]),
        np.ascontiguousarray(model.F[np.ix_(a, a)]),
        model.B[a],
        int(moving.sum()),
        sizes,
        z,
        np.ascontiguousarray(H[:, :, order]),
        np.ascontiguousarray(K[:, a]),
        np.ascontiguousarray(spread[:, a]),
        constants,
        np.ascontiguousarray(extra[:, order][:, :, order]),
        not proposal.look_ahead,
    )


def _last_touched(K: Array, spread: Array) -> Any:
    """Return of each row (n,) the last k at which it is corrected or drawn, 0 for never."""
    touched = (K != 0).any(axis=2) | (spread != 0).any(axis=2)
    return (touched * np.arange(1, len(touched) + 1)[:, np.newaxis]).max(axis=0, initial=0)


def _active(until: Any, T: int) -> Any:
    """Return of each step (T,) how many rows particles have of their own, those that have become static left out.

    Each time that rows are taken as static, genealogies begin anew, and some resamplings must pass before anything is
    gained: so those wait which others follow soon, and those near the end.
    """
    active = np.array([np.count_nonzero(until >= k) for k in range(1, T + 1)], dtype=np.int64)
    for k in range(1, T):
        if not (active[k : k + PATIENCE] == active[k]).all() or k + PATIENCE > T:
            active[k] = active[k - 1]
    return active


def _without_residues(map_: Array) -> Array:
    """Return a map without what rounding has left where zeros should be, each of which would cost a pass."""
    return np.where(np.abs(map_) > RESIDUE * np.abs(map_).max(initial=0.0), map_, 0.0)
