"""The answers of notebook 06 as recipes, each ingredient of which can be exchanged for a mistaken one.

Question answered: what does a right event of EKF-SLAM return, and what one with a given mistake?  The models are those
of `lab.ekfslam`; the events are written out here on whole matrices, in the dense form of the guide's equations, so that
each mistake is a line in `lab.checks.mistakes.ekf_models` or `lab.checks.mistakes.ekf_events`.
Source: J. Solà (2014), eqs. 14-17 (prediction), 26-30 (correction), 31-38 (initialisation).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from lab.ekfslam import inverse_depth, motion
from lab.ekfslam.frames import J, wrap
from lab.ekfslam.sensor import Sensor
from lab.ekfslam.sensor import inv_observe as inv_observe_with_sensor
from lab.ekfslam.sensor import observe as observe_with_sensor
from lab.validation import Array

Function = Callable[..., Any]
SENSOR = Sensor()  # range and bearing from the robot's own frame


def ekf_move(r: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return the pose after a control, and its Jacobians."""
    return motion.move(r, u)


def ekf_observe(r: Array, l: Array) -> tuple[Array, Array, Array]:  # noqa: E741 - the guide's letter
    """Return what is measured of a landmark, and the Jacobians."""
    y, Y_r, Y_l = observe_with_sensor(r, l, SENSOR)
    return np.array([y[0], wrap(y[1])]), Y_r, Y_l


def ekf_invert(r: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return the landmark that gave a measurement, and the Jacobians."""
    return inv_observe_with_sensor(r, y, SENSOR)


def wrapped_difference(y: Array, e: Array) -> Array:
    """Return y - e with the bearing wrapped."""
    return np.array([y[0] - e[0], wrap(y[1] - e[1])])


def wrapped_heading(x: Array) -> Array:
    """Return the state with its heading wrapped."""
    x = x.copy()
    x[2] = wrap(x[2])
    return x


def predict_with(
    *,
    move: Function = ekf_move,
    noise: Function = lambda Q: Q,
    spread: Function = lambda R_n, Q: R_n @ Q @ R_n.T,
    place: Function | None = None,
    cross: Function = lambda R_r, P_rm: (R_r @ P_rm, P_rm.T @ R_r.T),
    own: Function = lambda R_r, P_rr: R_r @ P_rr @ R_r.T,
    finish: Function = lambda new, old: new,
) -> Function:
    """Build ekf_predict(x, P, u, Q); `place` may put the noise elsewhere in P."""

    def ekf_predict(x: Array, P: Array, u: Array, Q: Array) -> tuple[Array, Array]:
        new, later = x.copy(), P.copy()
        new[:3], R_r, R_n = move(x[:3], u)
        later[:3, :3] = own(R_r, P[:3, :3]) + spread(R_n, noise(Q))
        later[:3, 3:], later[3:, :3] = cross(R_r, P[:3, 3:])
        if place is not None:
            later = place(later, R_n, Q)
        return finish((new, later), (x, P))  # type: ignore[no-any-return]

    return ekf_predict


def correct_with(
    *,
    where: Function = lambda i, n: np.array([0, 1, 2, 3 + 2 * i, 4 + 2 * i]),
    observe: Function = ekf_observe,
    difference: Function = wrapped_difference,
    noise: Function = lambda R: R,
    block: Function | None = None,
    spread: Function = lambda E, R: E + R,
    gain: Function = lambda P, H, Z: P @ H.T @ np.linalg.inv(Z),
    new_mean: Function = lambda x, K, z: x + K @ z,
    new_cov: Function = lambda P, K, H, Z, z: P - K @ Z @ K.T,
    wrap_state: Function = wrapped_heading,
    late: bool = False,
    finish: Function = lambda new, old: new,
) -> Function:
    """Build ekf_correct(x, P, y, i, R).

    `block` reads the five rows of P that the innovation depends on; `late` takes the covariance's Jacobians at the
    corrected mean.
    """

    def ekf_correct(x: Array, P: Array, y: Array, i: int, R: Array) -> tuple[Array, Array]:
        rows, R = where(i, len(x)), noise(R)

        def linearised(at: Array) -> tuple[Array, Array, Array, Array]:
            e, Y_r, Y_l = observe(at[:3], at[rows[3:]])
            H = np.zeros((2, len(x)))
            H[:, rows] = np.hstack([Y_r, Y_l])
            E = H @ P @ H.T if block is None else H[:, rows] @ block(P, rows) @ H[:, rows].T
            Z = spread(E, R)
            return e, H, Z, gain(P, H, Z)

        e, H, Z, K = linearised(x)
        z = difference(y, e)
        mean = wrap_state(new_mean(x, K, z))
        if late:
            _, H, Z, K = linearised(mean)
        return finish((mean, new_cov(P, K, H, Z, z)), (x, P))  # type: ignore[no-any-return]

    return ekf_correct


def initialise_with(
    *,
    invert: Function = ekf_invert,
    noise: Function = lambda R: R,
    spread: Function = lambda L_y, R: L_y @ R @ L_y.T,
    own: Function = lambda L_r, P_rr: L_r @ P_rr @ L_r.T,
    cross: Function = lambda L_r, L_y, P: L_r @ P[:3],
    both: bool = True,
    first: bool = False,
) -> Function:
    """Build ekf_initialise(x, P, y, R); without `both` the new columns stay zero, `first` puts it before the others."""

    def ekf_initialise(x: Array, P: Array, y: Array, R: Array) -> tuple[Array, Array]:
        n = len(x)
        l, L_r, L_y = invert(x[:3], y)  # noqa: E741
        larger = np.zeros((n + 2, n + 2))
        larger[:n, :n] = P
        larger[n:, :n] = cross(L_r, L_y, P)
        if both:
            larger[:n, n:] = larger[n:, :n].T
        larger[n:, n:] = own(L_r, P[:3, :3]) + spread(L_y, noise(R))
        new = np.append(x, l)
        if not first:
            return new, larger
        order = np.r_[0:3, n : n + 2, 3:n]
        return new[order], larger[np.ix_(order, order)]

    return ekf_initialise


def nees_with(
    *,
    error: Function = lambda r, truth: np.append(truth[:2] - r[:2], wrap(truth[2] - r[2])),
    measure: Function = lambda d, P: d @ np.linalg.solve(P, d),
) -> Function:
    """Build pose_nees(r, P, truth)."""

    def pose_nees(r: Array, P: Array, truth: Array) -> float:
        return float(measure(error(r, truth), P))

    return pose_nees


def directions_with(
    *,
    turn: Function = lambda points: points @ J.T,
    heading: float = 1.0,
    shift: Function = lambda points: np.eye(2),
    moved: Function = lambda column: column,
) -> Function:
    """Build frame_directions(x)."""

    def frame_directions(x: Array) -> Array:
        points = np.vstack([x[:2], x[3:].reshape(-1, 2)])
        rows = np.delete(np.arange(len(x)), 2)
        N = np.zeros((len(x), 3))
        N[rows, :2] = np.vstack([shift(point) for point in points])
        N[rows, 2] = turn(points).ravel()
        N[2, 2] = heading
        return np.asarray(moved(N))

    return frame_directions


def ray_with(
    *,
    point: Function = inverse_depth.point,
    spread: Function = lambda P_L, P: P_L @ P @ P_L.T,
) -> Function:
    """Build ray_to_point(L, P)."""

    def ray_to_point(L: Array, P: Array) -> tuple[Array, Array]:
        p, P_L = point(L)
        return p, spread(P_L, P)

    return ray_to_point
