"""Mistakes of the three events of EKF-SLAM: prediction, correction, initialisation."""

from typing import Any

import numpy as np

from lab.checks.ekf_recipes import (
    Function,
    correct_with,
    ekf_move,
    initialise_with,
    predict_with,
    wrapped_difference,
)
from lab.checks.mistakes.ekf_models import Mutants, inverts, moves, observes
from lab.validation import Array


def _noises(name: str) -> list[tuple[str, dict[str, Any]]]:
    """Return mistaken readings of a noise covariance Q or R."""
    return [
        ("deviation-as-variance", {name: lambda C: np.diag(np.sqrt(np.diag(C)))}),
        ("deviation-as-variance", {name: lambda C: np.sqrt(np.abs(C))}),
        ("deviation-as-variance", {name: np.linalg.cholesky}),
        ("variance-squared", {name: lambda C: C @ C}),
        ("variance-squared", {name: lambda C: C**2}),
        ("variance-squared", {name: lambda C: np.diag(np.diag(C) ** 2)}),
        ("diagonal-only", {name: lambda C: np.diag(np.diag(C))}),
        ("degrees", {name: lambda C: C * np.outer((1, np.pi / 180), (1, np.pi / 180))}),
    ]


def _unmapped(rows: tuple[int, int]) -> Function:
    """Return Q put where it stands into two rows of the pose."""

    def spread(R_n: Array, Q: Array) -> Array:
        noise = np.zeros((3, 3))
        noise[np.ix_(rows, rows)] = Q
        return noise

    return spread


def _split(R_n: Array, Q: Array) -> Array:
    return np.diag([Q[0, 0], Q[0, 0], Q[1, 1]])


def _everywhere(P: Array, R_n: Array, Q: Array) -> Array:
    return np.asarray(P + Q[0, 0] * np.diag(np.r_[np.zeros(3), np.ones(len(P) - 3)]))


def _kept_blocks(P_rr: Any, P_rm: Array) -> tuple[Array, Array]:
    return P_rm, P_rm.T


def predictions() -> Mutants:
    """Return mistaken ekf_predicts."""
    build = predict_with
    found: Mutants = [(key, build(move=move)) for key, move in moves()]
    found += [(key, build(**changes)) for key, changes in _noises("noise")]
    found += [
        ("noise-unmapped", build(spread=_unmapped((0, 2)))),
        ("noise-unmapped", build(spread=_unmapped((0, 1)))),
        ("noise-unmapped", build(spread=_split)),
        ("noise-omitted", build(spread=lambda R_n, Q: np.zeros((3, 3)))),
        ("noise-on-landmarks", build(place=_everywhere)),
        ("element-wise", build(own=lambda R_r, P: R_r * P * R_r.T)),
        ("jacobian-transposed", build(own=lambda R_r, P: R_r.T @ P @ R_r)),
        ("jacobian-transposed", build(move=_transposed)),
        ("jacobian-once", build(own=lambda R_r, P: R_r @ P)),
        ("jacobian-once", build(own=lambda R_r, P: R_r @ P @ R_r)),
        ("cross-not-predicted", build(cross=_kept_blocks)),
        ("cross-one-side", build(cross=lambda R_r, P_rm: (R_r @ P_rm, P_rm.T))),
        ("cross-one-side", build(cross=lambda R_r, P_rm: (P_rm, P_rm.T @ R_r.T))),
        ("cross-lost", build(cross=lambda R_r, P_rm: (0 * P_rm, 0 * P_rm.T))),
        ("covariance-not-predicted", build(finish=lambda new, old: (new[0], old[1]))),
        ("covariance-not-predicted", build(own=lambda R_r, P: P, cross=_kept_blocks)),
        ("covariance-not-predicted", build(own=lambda R_r, P: P)),
        ("mean-not-predicted", build(finish=lambda new, old: (old[0], new[1]))),
        ("prediction-lost", build(finish=lambda new, old: old)),
    ]
    return found


def _transposed(r: Array, u: Array) -> tuple[Array, Array, Array]:
    pose, R_r, R_n = ekf_move(r, u)
    return pose, R_r.T, R_n


def _joseph(P: Array, K: Array, H: Array, Z: Array, z: Array) -> Array:
    left = np.eye(len(P)) - K @ H
    return np.asarray(left @ P @ left.T + K @ (Z - H @ P @ H.T) @ K.T)


# the same right update written in several ways, which differ once something before is wrong
STYLES: tuple[dict[str, Function], ...] = (
    {},
    {"new_cov": lambda P, K, H, Z, z: P - K @ H @ P},
    {"new_cov": _joseph},
    {"finish": lambda new, old: (new[0], (new[1] + new[1].T) / 2)},
)
HARMLESS = ("bearing-not-wrapped", "wrapped-once", "wrapped-to-turn")  # where the innovation is wrapped


def _only(part: str) -> Function:
    """Return a correction that leaves all but a part of the state as it was."""

    def ekf_correct(x: Array, P: Array, y: Array, i: int, R: Array) -> tuple[Array, Array]:
        mean, cov = correct_with()(x, P, y, i, R)
        rows = {
            "landmark": np.r_[3 + 2 * i : 5 + 2 * i],
            "robot": np.r_[0:3],
            "pair": np.r_[0:3, 3 + 2 * i : 5 + 2 * i],
        }[part]
        new, later = x.copy(), P.copy()
        new[rows] = mean[rows]
        later[np.ix_(rows, rows)] = cov[np.ix_(rows, rows)]
        return new, later

    return ekf_correct


def _rows_only(part: str) -> Function:
    """Return a gain that is zero outside a part of the state."""

    def gain(P: Array, H: Array, Z: Array) -> Array:
        touched, of_robot = (H != 0).any(axis=0), np.arange(len(P)) < 3
        keep: Any = {"pair": touched, "robot": of_robot, "landmark": touched & ~of_robot}[part]
        return np.asarray((P @ H.T @ np.linalg.inv(Z)) * keep[:, np.newaxis])

    return gain


def _uncorrelated(P: Array, rows: Array) -> Array:
    block: Array = P[np.ix_(rows, rows)].copy()
    block[:3, 3:] = block[3:, :3] = 0
    return block


def _own(P: Array, rows: Array, part: slice) -> Array:
    block = np.zeros((5, 5))
    block[part, part] = P[np.ix_(rows, rows)][part, part]
    return block


def corrections() -> Mutants:
    """Return mistaken ekf_corrects, in every style of the update that the mistake leaves open."""
    found: Mutants = []
    for style in STYLES:
        found += _corrections(style)
    build = correct_with  # what follows is the same in all styles
    for key, observe in observes():
        if key in HARMLESS:
            found.append(("innovation-not-wrapped", build(observe=observe, difference=lambda y, e: y - e)))
        else:
            found.append((key, build(observe=observe)))
    found += [(key, build(**changes)) for key, changes in _noises("noise")]
    return found


def _corrections(style: dict[str, Function]) -> Mutants:
    def build(**changes: Any) -> Function:
        return correct_with(**{**style, **changes})

    found: Mutants = [
        ("innovation-not-wrapped", build(difference=lambda y, e: y - e)),
        ("heading-not-wrapped", build(wrap_state=lambda x: x)),
        ("innovation-not-wrapped", build(difference=lambda y, e: y - e, wrap_state=lambda x: x)),
        ("innovation-sign", build(difference=lambda y, e: -wrapped_difference(y, e))),
        ("innovation-sign", build(new_mean=lambda x, K, z: x - K @ z)),
        ("jacobians-late", build(late=True)),
        ("wrong-slot", build(where=_slot(lambda i: 3 + i))),
        ("wrong-slot", build(where=_slot(lambda i: 2 + 2 * i))),
        ("wrong-slot", build(where=_slot(lambda i: 2 * i))),
        ("wrong-slot", build(where=_slot(lambda i: 3 + 2 * (i + 1)))),
        ("wrong-slot", build(where=_slot(lambda i: 3 + 2 * (i - 1)))),
        ("cross-terms-dropped", build(block=_uncorrelated)),
        ("s-without-state", build(block=lambda P, rows: 0 * P[np.ix_(rows, rows)])),
        ("landmark-known", build(block=lambda P, rows: _own(P, rows, slice(0, 3)))),
        ("robot-known", build(block=lambda P, rows: _own(P, rows, slice(3, 5)))),
        ("s-without-noise", build(spread=lambda E, R: E)),
        ("double-inverse", build(gain=lambda P, H, Z: P @ H.T @ Z)),
        ("double-inverse", build(gain=lambda P, H, Z: P @ H.T)),
        ("element-wise", build(gain=lambda P, H, Z: P @ H.T / np.diag(Z))),
        ("gain-transposed", build(gain=lambda P, H, Z: H.T @ np.linalg.inv(Z))),
        ("only-seen-corrected", build(gain=_rows_only("pair"))),
        ("robot-only", build(gain=_rows_only("robot"))),
        ("landmark-only", build(gain=_rows_only("landmark"))),
        ("only-seen-corrected", _only("pair")),
        ("robot-only", _only("robot")),
        ("landmark-only", _only("landmark")),
        ("covariance-order", build(new_cov=lambda P, K, H, Z, z: P @ (np.eye(len(P)) - K @ H))),
        ("covariance-order", build(new_cov=lambda P, K, H, Z, z: P @ K @ H)),
        ("covariance-sign", build(new_cov=lambda P, K, H, Z, z: P + K @ Z @ K.T)),
        ("covariance-with-innovation", build(new_cov=lambda P, K, H, Z, z: P - np.outer(K @ z, K @ z))),
        ("covariance-with-noise-only", build(new_cov=lambda P, K, H, Z, z: P - K @ (Z - H @ P @ H.T) @ K.T)),
        ("covariance-uninverted", build(new_cov=lambda P, K, H, Z, z: P - K @ np.linalg.inv(Z) @ K.T)),
        ("one-for-identity", build(new_cov=lambda P, K, H, Z, z: (1 - K @ H) @ P)),
        ("joseph-incomplete", build(new_cov=lambda P, K, H, Z, z: _half_joseph(P, K, H))),
        ("mean-not-stored", build(finish=lambda new, old: (old[0], new[1]))),
        ("mean-not-stored", build(new_mean=lambda x, K, z: x)),
        ("covariance-not-stored", build(finish=lambda new, old: (new[0], old[1]))),
        ("prediction-lost", build(finish=lambda new, old: old)),
    ]
    return found


def _half_joseph(P: Array, K: Array, H: Array) -> Array:
    left = np.eye(len(P)) - K @ H
    return np.asarray(left @ P @ left.T)


def _slot(first: Function) -> Function:
    """Return the rows of the robot and of two components that begin at a wrong one."""
    return lambda i, n: np.array([0, 1, 2, first(i), first(i) + 1])


def initialisations() -> Mutants:
    """Return mistaken ekf_initialises."""
    build = initialise_with
    found: Mutants = [(key, build(invert=invert)) for key, invert in inverts()]
    found += [(key, build(**changes)) for key, changes in _noises("noise")]
    found += [
        ("cross-left-out", build(cross=lambda L_r, L_y, P: np.zeros((2, len(P))))),
        ("cross-robot-only", build(cross=_with_robot_only)),
        ("cross-wrong-jacobian", build(cross=lambda L_r, L_y, P: L_y @ P[:2])),
        ("cross-wrong-jacobian", build(cross=lambda L_r, L_y, P: P[:2].copy())),
        ("cross-wrong-jacobian", build(cross=lambda L_r, L_y, P: L_r[:, :2] @ P[:2])),
        ("cross-wrong-jacobian", build(cross=lambda L_r, L_y, P: L_y @ P[1:3])),
        ("cross-sign", build(cross=lambda L_r, L_y, P: -L_r @ P[:3])),
        ("cross-one-side", build(both=False)),
        ("landmark-without-robot", build(own=lambda L_r, P: np.zeros((2, 2)))),
        (
            "landmark-without-robot",
            build(own=lambda L_r, P: np.zeros((2, 2)), cross=lambda L_r, L_y, P: np.zeros((2, len(P)))),
        ),
        ("landmark-without-noise", build(spread=lambda L_y, R: np.zeros((2, 2)))),
        ("landmark-without-heading", build(own=lambda L_r, P: P[:2, :2])),
        ("noise-unmapped", build(spread=lambda L_y, R: R)),
        ("jacobian-transposed", build(spread=lambda L_y, R: L_y.T @ R @ L_y)),
        ("jacobian-once", build(spread=lambda L_y, R: L_y @ R)),
        ("landmark-first", build(first=True)),
    ]
    return found


def _with_robot_only(L_r: Array, L_y: Array, P: Array) -> Array:
    cross = np.zeros((2, len(P)))
    cross[:, :3] = L_r @ P[:3, :3]
    return cross
