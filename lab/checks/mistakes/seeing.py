"""Mistakes with what is seen: rows, columns, masks, blocks.  They go into every step that uses z, H and R.

Each takes the arrays with NaN and returns what a mistaken answer computes with.
"""

from typing import Any

import numpy as np

from lab.checks.recipes import Seen, seen
from lab.validation import Array

HANDOUT_R = 0.15**2


def _full_H(H: Array) -> Array:
    M = len(H) // 2
    full: Array = np.hstack([np.kron(np.ones((M, 1)), -np.eye(2)), np.eye(2 * M)])
    return full


def _rows(z: Array) -> Any:
    return np.flatnonzero(~np.isnan(z))


def _nan_kept(z: Array, H: Array, R: Array) -> Seen:
    return z, H, R


def _nan_kept_unless_blind(z: Array, H: Array, R: Array) -> Seen:
    return (z, H, R) if len(_rows(z)) else (z[:0], H[:0], R[:0, :0])


def _r_rows_only(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R[rows]


def _r_columns_only(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R[:, rows]


def _r_rows_full(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R if len(rows) else R[:0, :0]


def _flat_H(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[~np.isnan(H)], R[np.ix_(rows, rows)]


def _flat_R(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R[~np.isnan(R)]


def _zeros(z: Array, H: Array, R: Array) -> Seen:
    return np.nan_to_num(z), np.nan_to_num(H), np.nan_to_num(R)


def _zeros_measured(fill: float) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        hidden = np.isnan(z)
        R = np.nan_to_num(R)
        R[hidden, hidden] = fill
        return np.nan_to_num(z), _full_H(H), R

    return select


def _zeros_measured_alike(z: Array, H: Array, R: Array) -> Seen:
    """Give the hidden landmarks the mean variance of those seen."""
    rows = _rows(z)
    return _zeros_measured(float(np.mean(np.diag(R)[rows])) if len(rows) else HANDOUT_R)(z, H, R)  # type: ignore[no-any-return]


def _first_landmarks(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], _full_H(H)[: len(rows)], R[np.ix_(rows, rows)]


def _shifted(by: int) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        z, H, R = seen(z, H, R)
        return z, np.hstack([H[:, :2], np.roll(H[:, 2:], by, axis=1)]), R

    return select


def _rolled(by: int) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        z, H, R = seen(z, H, R)
        return z, np.roll(H, by, axis=1), R

    return select


def _without_offset(z: Array, H: Array, R: Array) -> Seen:
    """Look for landmark i at columns 2i, as if the robot were not in the state."""
    z, H, R = seen(z, H, R)
    wrong = np.zeros_like(H)
    wrong[:, :-2] = H[:, 2:]
    wrong[:, :2] += H[:, :2]
    return z, wrong, R


def _reversed(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z[::-1], H, R


def _swapped_axes(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z.reshape(-1, 2)[:, ::-1].ravel(), H, R


def _r_top_left(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R[: len(rows), : len(rows)]


def _r_linear(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], np.diag(R.ravel()[rows])


def _r_broadcast(z: Array, H: Array, R: Array) -> Seen:
    rows = _rows(z)
    return z[rows], H[rows], R[rows, rows]


def _r_changed(change: Any) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        z, H, R = seen(z, H, R)
        return z, H, change(R) if len(z) else R

    return select


def _one_block(which: int) -> Any:
    def change(R: Array) -> Array:
        p = len(R)
        block = R[:2, :2] if which == 0 else R[p - 2 :, p - 2 :]
        return np.asarray(np.kron(np.eye(p // 2), block), dtype=np.float64)

    return change


def _at_most(count: int, *, else_nothing: bool) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        z, H, R = seen(z, H, R)
        p = 2 * count if len(z) <= 2 * count or not else_nothing else 0
        return z[:p], H[:p], R[:p, :p]

    return select


def _at_least(count: int) -> Any:
    def select(z: Array, H: Array, R: Array) -> Seen:
        z, H, R = seen(z, H, R)
        p = len(z) if len(z) >= 2 * count else 0
        return z[:p], H[:p], R[:p, :p]

    return select


def _last_only(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z[-2:], H[-2:], R[-2:, -2:]


def _first_components(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z[::2], H[::2], R[::2, ::2]


def _without(first: bool) -> Any:
    """Leave out the first or the last landmark of the map."""

    def select(z: Array, H: Array, R: Array) -> Seen:
        z = z.copy()
        z[:2] = np.nan if first else z[:2]
        z[-2:] = z[-2:] if first else np.nan
        return seen(z, H, R)

    return select


def _first_of_map(z: Array, H: Array, R: Array) -> Seen:
    return seen(np.where(np.arange(len(z)) < 2, z, np.nan), H, R)


def _positive(z: Array, H: Array, R: Array) -> Seen:
    return seen(np.where(z > 0, z, np.nan), H, R)


def _all_or_nothing(z: Array, H: Array, R: Array) -> Seen:
    return seen(z if not np.isnan(z).any() else np.full_like(z, np.nan), H, R)


def _r_top_left_zeros(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = _r_top_left(z, H, R)
    return z, H, np.nan_to_num(R)


def _robot_ignored(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z, np.hstack([0 * H[:, :2], H[:, 2:]]), R


def _both_positive(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z, np.abs(H), R


def _both_negative(z: Array, H: Array, R: Array) -> Seen:
    z, H, R = seen(z, H, R)
    return z, -H, R


SELECT: tuple[tuple[str, Any], ...] = (
    ("nan-kept", _nan_kept),
    ("nan-kept", _nan_kept_unless_blind),
    ("r-rows-only", _r_rows_only),
    ("r-rows-only", _r_columns_only),
    ("r-rows-only", _r_rows_full),
    ("mask-flattens", _flat_H),
    ("mask-flattens", _flat_R),
    ("hidden-as-zero", _zeros),
    ("hidden-as-zero", _zeros_measured(0.0)),
    ("hidden-as-zero", _zeros_measured(1.0)),
    ("hidden-as-zero", _zeros_measured(HANDOUT_R)),
    ("hidden-as-zero", _zeros_measured_alike),
    ("wrong-block", _first_landmarks),
    ("wrong-block", _shifted(2)),
    ("wrong-block", _shifted(-2)),
    ("wrong-block", _without_offset),
    ("wrong-block", _rolled(2)),
    ("wrong-block", _rolled(-2)),
    ("wrong-block", _reversed),
    ("wrong-block", _swapped_axes),
    ("r-linear-index", _r_top_left),
    ("r-linear-index", _r_linear),
    ("mask-flattens", _r_broadcast),
    ("r-one-block", _r_changed(_one_block(0))),
    ("r-one-block", _r_changed(_one_block(-1))),
    ("r-diagonal", _r_changed(lambda R: np.diag(np.diag(R)))),
    ("deviation-as-variance", _r_changed(np.sqrt)),
    ("deviation-as-variance", _r_changed(lambda R: np.diag(np.sqrt(np.diag(R))))),
    ("deviation-as-variance", _r_changed(np.linalg.cholesky)),
    ("variance-squared", _r_changed(lambda R: R**2)),
    ("variance-squared", _r_changed(lambda R: R @ R)),
    ("retyped", _r_changed(lambda R: HANDOUT_R * np.eye(len(R)))),
    ("cases-by-hand", _at_most(1, else_nothing=False)),
    ("cases-by-hand", _at_most(1, else_nothing=True)),
    ("cases-by-hand", _at_most(2, else_nothing=False)),
    ("cases-by-hand", _at_most(2, else_nothing=True)),
    ("cases-by-hand", _at_least(2)),
    ("cases-by-hand", _last_only),
    ("cases-by-hand", _first_components),
    ("cases-by-hand", _all_or_nothing),
    ("r-linear-index", _r_top_left_zeros),
    ("landmark-missed", _without(True)),
    ("landmark-missed", _without(False)),
    ("return-in-loop", _first_of_map),
    ("seen-by-sign", _positive),
    ("robot-ignored", _robot_ignored),
    ("relative-sign", _both_positive),
    ("relative-sign", _both_negative),
)
