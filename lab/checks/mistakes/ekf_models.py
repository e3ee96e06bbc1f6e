"""Mistakes of the models of EKF-SLAM: move, observe, invert, NEES, the three directions, rays."""

from typing import Any

import numpy as np

from lab.checks.ekf_recipes import (
    Function,
    directions_with,
    ekf_invert,
    nees_with,
    ray_with,
)
from lab.ekfslam.frames import J, rotation, wrap
from lab.validation import Array

Mutants = list[tuple[str, Function]]


def _jacobians(r: Array, R: Array, dx: float) -> tuple[Array, Array]:
    """Return R_r and R_n of a step dx along the first axis of R."""
    R_r, R_n = np.eye(3), np.zeros((3, 2))
    R_r[:2, 2] = J @ R[:, 0] * dx
    R_n[:2, 0] = R[:, 0]
    R_n[2, 1] = 1
    return R_r, R_n


def _moved(
    *,
    angle: Function = lambda r, u: r[2],
    after: Function = lambda r, u: wrap(r[2] + u[1]),
    turned: Function = rotation,
    slope: Function | None = None,
    change: Function = lambda R_r, R_n: (R_r, R_n),
) -> Function:
    """Build a move whose step goes along `angle`; the Jacobians are taken at `slope`, by default the same."""

    def ekf_move(r: Array, u: Array) -> tuple[Array, Array, Array]:
        R = turned(angle(r, u))
        pose = np.append(r[:2] + R[:, 0] * u[0], after(r, u))
        where = R if slope is None else turned(slope(r, u))
        R_r, R_n = change(*_jacobians(r, where, u[0]))
        return pose, R_r, R_n

    return ekf_move


def _column(factor: float) -> Function:
    def change(R_r: Array, R_n: Array) -> tuple[Array, Array]:
        R_r[:2, 2] *= factor
        return R_r, R_n

    return change


def _unturned(R_r: Array, R_n: Array) -> tuple[Array, Array]:
    return R_r, np.array([[1.0, 0], [0, 0], [0, 1]])


def _flipped(R_r: Array, R_n: Array) -> tuple[Array, Array]:
    R_r[:2, 2] = R_r[1::-1, 2]
    return R_r, R_n


def _degrees(angle: Any) -> Array:
    return rotation(np.radians(angle))


def _backwards(angle: Any) -> Array:
    return np.asarray(rotation(angle).T)


def _once(a: Any) -> Any:
    return a - 2 * np.pi if a > np.pi else a + 2 * np.pi if a < -np.pi else a


def _turned_first(r: Array, u: Array) -> Any:
    return r[2] + u[1]


def moves() -> Mutants:
    """Return mistaken ekf_moves."""
    return [
        ("heading-not-wrapped", _moved(after=_turned_first)),
        ("wrapped-once", _moved(after=lambda r, u: _once(r[2] + u[1]))),
        ("wrapped-to-turn", _moved(after=lambda r, u: (r[2] + u[1]) % (2 * np.pi))),
        ("rotation-sign", _moved(turned=_backwards)),
        ("rotation-sign", _moved(turned=_backwards, change=_column(-1))),
        ("turn-before-step", _moved(angle=_turned_first)),
        ("jacobian-after-move", _moved(slope=_turned_first)),
        ("turn-before-step", _moved(angle=lambda r, u: r[2] + u[1] / 2)),
        ("degrees", _moved(turned=_degrees)),
        ("degrees", _moved(turned=_degrees, change=_column(np.pi / 180))),
        ("turn-sign", _moved(after=lambda r, u: wrap(r[2] - u[1]))),
        ("turn-dropped", _moved(after=lambda r, u: wrap(r[2]))),
        ("heading-column-missing", _moved(change=_column(0))),
        ("heading-column-sign", _moved(change=_column(-1))),
        ("heading-column-sign", _moved(change=_flipped)),
        ("jacobian-transposed", _moved(change=lambda R_r, R_n: (R_r.T, R_n))),
        ("noise-jacobian-unturned", _moved(change=_unturned)),
    ]


def _scanned(
    *,
    frame: Function = lambda r: rotation(r[2]).T,
    bearing: Function = lambda q, p, r: np.arctan2(q[1], q[0]),
    slope: Function | None = None,
    heading: Function = lambda q: np.array([q[1], -q[0]]),
    turn: Function = lambda Q_l: Q_l,
    change: Function = lambda y, Y_r, Y_l: (y, Y_r, Y_l),
) -> Function:
    """Build an observe; `slope` gives the Jacobian of the scan, `heading` the derivative of q by the heading."""

    def ekf_observe(r: Array, l: Array) -> tuple[Array, Array, Array]:  # noqa: E741
        Q_l = frame(r)
        p = l - r[:2]
        q = Q_l @ p
        d = np.hypot(*q)
        Y_q = np.array([q / d, [-q[1] / d**2, q[0] / d**2]]) if slope is None else slope(q, d)
        Y_l = Y_q @ turn(Q_l)
        Y_r = np.column_stack([-Y_l, Y_q @ heading(q)])
        return change(np.array([d, bearing(q, p, r)]), Y_r, Y_l)  # type: ignore[no-any-return]

    return ekf_observe


def _world_bearing(shift: Function) -> Function:
    return lambda q, p, r: shift(np.arctan2(p[1], p[0]) - r[2])


def _swapped(y: Array, Y_r: Array, Y_l: Array) -> tuple[Array, Array, Array]:
    return y[::-1], Y_r[::-1], Y_l[::-1]


def _by_px(q: Array, d: float) -> Array:
    """Return the derivative of arctan(p_y / p_x) as it stands in the listing: 0 / 0 abeam."""
    ratio = 1 + (q[1] / q[0]) ** 2
    return np.array([q / d, [-q[1] / q[0] ** 2 / ratio, 1 / q[0] / ratio]])


def _by_px_plain(q: Array, d: float) -> Array:
    return np.array([q / d, [-q[1] / q[0] ** 2, 1 / q[0]]])


def observes() -> Mutants:
    """Return mistaken ekf_observes."""
    return [
        ("bearing-not-wrapped", _scanned(bearing=_world_bearing(lambda a: a))),
        ("wrapped-once", _scanned(bearing=_world_bearing(_once))),
        ("wrapped-to-turn", _scanned(bearing=lambda q, p, r: np.arctan2(q[1], q[0]) % (2 * np.pi))),
        ("heading-ignored", _scanned(bearing=lambda q, p, r: np.arctan2(p[1], p[0]))),
        ("heading-ignored", _scanned(frame=lambda r: np.eye(2))),
        ("heading-ignored", _scanned(frame=lambda r: np.eye(2), heading=lambda q: np.zeros(2))),
        ("arctan-for-atan2", _scanned(bearing=lambda q, p, r: np.arctan(q[1] / q[0]))),
        ("arctan-for-atan2", _scanned(bearing=lambda q, p, r: np.arctan(q[1] / q[0]), slope=_by_px)),
        ("arctan-swapped", _scanned(bearing=lambda q, p, r: np.arctan2(q[0], q[1]))),
        ("rotation-sign", _scanned(frame=lambda r: rotation(r[2]))),
        ("rotation-sign", _scanned(frame=lambda r: rotation(r[2]), heading=lambda q: np.array([-q[1], q[0]]))),
        ("rotation-sign", _scanned(turn=lambda Q_l: Q_l.T)),
        ("degrees", _scanned(frame=lambda r: rotation(np.radians(r[2])).T)),
        ("degrees", _scanned(bearing=lambda q, p, r: np.degrees(np.arctan2(q[1], q[0])))),
        ("scan-jacobian-px", _scanned(slope=_by_px)),
        ("scan-jacobian-px", _scanned(slope=_by_px_plain)),
        ("scan-jacobian-d", _scanned(slope=lambda q, d: np.array([q / d, [-q[1] / d, q[0] / d]]))),
        ("scan-jacobian-sign", _scanned(slope=lambda q, d: np.array([q / d, [q[1] / d**2, -q[0] / d**2]]))),
        ("scan-jacobian-sign", _scanned(slope=lambda q, d: np.array([q / d, [q[1] / d**2, q[0] / d**2]]))),
        ("scan-jacobian-sign", _scanned(slope=lambda q, d: np.array([q / d, [q[0] / d**2, q[1] / d**2]]))),
        ("heading-column-missing", _scanned(heading=lambda q: np.zeros(2))),
        ("heading-column-sign", _scanned(heading=lambda q: np.array([-q[1], q[0]]))),
        ("chain-rule-missing", _scanned(turn=lambda Q_l: np.eye(2))),
        ("landmark-jacobian-sign", _scanned(change=lambda y, Y_r, Y_l: (y, Y_r, -Y_l))),
        ("landmark-jacobian-sign", _scanned(change=lambda y, Y_r, Y_l: (y, np.column_stack([Y_l, Y_r[:, 2]]), Y_l))),
        ("polar-swapped", _scanned(change=_swapped)),
    ]


def _inverted(
    *,
    angle: Function = lambda r, y: r[2] + y[1],
    origin: Function = lambda r: r[:2],
    change: Function = lambda L_r, L_y: (L_r, L_y),
) -> Function:
    """Build an invert that goes along `angle` from `origin`."""

    def ekf_invert(r: Array, y: Array) -> tuple[Array, Array, Array]:
        a = angle(r, y)
        ray = np.array([np.cos(a), np.sin(a)])
        L_r = np.column_stack([np.eye(2), y[0] * J @ ray])
        L_y = np.column_stack([ray, y[0] * J @ ray])
        return origin(r) + y[0] * ray, *change(L_r, L_y)

    return ekf_invert


def _turned_noise(scale: Function) -> Function:
    """Build an invert whose L_y is scaled."""

    def ekf_inverted(r: Array, y: Array) -> tuple[Array, Array, Array]:
        l, L_r, L_y = ekf_invert(r, y)  # noqa: E741
        return l, L_r, scale(L_y, r, y)

    return ekf_inverted


def _local(L_y: Array, r: Array, y: Array) -> Array:
    return np.asarray(rotation(r[2]).T @ L_y)


def _no_lever(L_y: Array, r: Array, y: Array) -> Array:
    return np.asarray(L_y / [1, y[0]])


def _heading_column(factor: float) -> Function:
    return lambda L_r, L_y: (L_r * [1, 1, factor], L_y)


def inverts() -> Mutants:
    """Return mistaken ekf_inverts."""
    return [
        ("heading-ignored", _inverted(angle=lambda r, y: y[1])),
        ("heading-ignored", _inverted(angle=lambda r, y: y[1], change=_heading_column(0))),
        ("local-not-global", _inverted(origin=lambda r: np.zeros(2))),
        ("rotation-sign", _inverted(angle=lambda r, y: y[1] - r[2])),
        ("rotation-sign", _inverted(angle=lambda r, y: r[2] - y[1])),
        ("degrees", _inverted(angle=lambda r, y: np.radians(r[2] + y[1]))),
        ("degrees", _inverted(angle=lambda r, y: r[2] + np.radians(y[1]))),
        ("heading-column-missing", _inverted(change=_heading_column(0))),
        ("heading-column-sign", _inverted(change=_heading_column(-1))),
        ("chain-rule-missing", _turned_noise(_local)),
        ("lever-missing", _turned_noise(_no_lever)),
        ("polar-swapped", _turned_noise(lambda L_y, r, y: L_y[:, ::-1])),
        ("jacobian-transposed", _turned_noise(lambda L_y, r, y: L_y.T)),
    ]


def neeses() -> Mutants:
    """Return mistaken pose_neeses."""
    plain: Any = lambda r, truth: truth - r  # noqa: E731
    return [
        ("innovation-not-wrapped", nees_with(error=plain)),
        ("innovation-not-wrapped", nees_with(error=lambda r, truth: np.append(*_absolute(r, truth)))),
        ("wrapped-once", nees_with(error=lambda r, truth: np.append(truth[:2] - r[:2], _once(truth[2] - r[2])))),
        ("nees-root", nees_with(measure=lambda d, P: np.sqrt(d @ np.linalg.solve(P, d)))),
        ("nees-per-dof", nees_with(measure=lambda d, P: d @ np.linalg.solve(P, d) / 3)),
        ("nees-not-inverted", nees_with(measure=lambda d, P: d @ P @ d)),
        ("nees-uncorrelated", nees_with(measure=lambda d, P: np.sum(d**2 / np.diag(P)))),
        ("nees-unweighted", nees_with(measure=lambda d, P: d @ d)),
        ("nees-position", nees_with(measure=lambda d, P: d[:2] @ np.linalg.solve(P[:2, :2], d[:2]))),
        ("degrees", nees_with(error=lambda r, truth: _in_degrees(r, truth))),
    ]


def _absolute(r: Array, truth: Array) -> tuple[Array, Any]:
    """Wrap each heading, which both are already, instead of their difference."""
    return truth[:2] - r[:2], wrap(truth[2]) - wrap(r[2])


def _in_degrees(r: Array, truth: Array) -> Array:
    return np.append(truth[:2] - r[:2], np.degrees(wrap(truth[2] - r[2])))


def directions() -> Mutants:
    """Return mistaken frame_directions."""
    return [
        ("direction-heading-missing", directions_with(heading=0.0)),
        ("direction-turn-sign", directions_with(turn=lambda points: points @ J)),
        ("direction-heading-only", directions_with(turn=np.zeros_like)),
        ("direction-scaled", directions_with(turn=lambda points: points)),
        ("direction-robot-only", directions_with(turn=_first_only)),
        ("direction-robot-only", directions_with(moved=_robot_only)),
        ("direction-robot-left", directions_with(turn=_later_only)),
        ("direction-swapped", directions_with(turn=lambda points: points[:, ::-1])),
    ]


def _first_only(points: Array) -> Array:
    return np.vstack([points[:1] @ J.T, 0 * points[1:]])


def _later_only(points: Array) -> Array:
    return np.vstack([0 * points[:1], points[1:] @ J.T])


def _robot_only(N: Array) -> Array:
    N = N.copy()
    N[3:] = 0
    return N


def _ray(
    *,
    place: Function = lambda L, ray: L[:2] + ray / L[3],
    alpha: Function = lambda L: L[2],
    across: Function = lambda L: 1 / L[3],
    along: Function = lambda L: -1 / L[3] ** 2,
    anchor: float = 1.0,
) -> Function:
    """Build the point of a ray, and its Jacobian from parts."""

    def point(L: Array) -> tuple[Array, Array]:
        ray = np.array([np.cos(alpha(L)), np.sin(alpha(L))])
        return place(L, ray), np.column_stack([anchor * np.eye(2), across(L) * J @ ray, along(L) * ray])

    return point


def rays() -> Mutants:
    """Return mistaken ray_to_points."""
    return [
        ("ray-depth", ray_with(point=_ray(place=lambda L, ray: L[:2] + ray * L[3]))),
        (
            "ray-depth",
            ray_with(point=_ray(place=lambda L, ray: L[:2] + ray * L[3], across=lambda L: L[3], along=lambda L: 1.0)),
        ),
        ("ray-slope", ray_with(point=_ray(along=lambda L: 1 / L[3] ** 2))),
        ("ray-slope", ray_with(point=_ray(along=lambda L: -1 / L[3]))),
        ("ray-slope", ray_with(point=_ray(along=lambda L: 1 / L[3]))),
        ("ray-slope", ray_with(point=_ray(along=lambda L: 1.0))),
        ("lever-missing", ray_with(point=_ray(across=lambda L: 1.0))),
        ("anchor-left-out", ray_with(point=_ray(place=lambda L, ray: ray / L[3]))),
        ("anchor-left-out", ray_with(point=_ray(anchor=0.0))),
        ("diagonal-only", ray_with(spread=lambda P_L, P: P_L @ np.diag(np.diag(P)) @ P_L.T)),
        ("degrees", ray_with(point=_ray(alpha=lambda L: np.radians(L[2])))),
        ("deviation-as-variance", ray_with(spread=lambda P_L, P: P_L @ np.sqrt(np.abs(P)) @ P_L.T)),
    ]
