"""Solà's symbols: r robot, l landmark, z innovation, H = [H_r H_l], K gain; A is the polar part dz/dq of H.

Question answered: in which error, and where, does a filter linearise?  A map calls one of three:

    ekf   error true - estimate, Jacobians at the newest estimate: the guide's filter, which comes to see rotation
    fej   the same error; Jacobians at the robot's pose BEFORE the corrections and at each landmark's FIRST estimate
    ri    right-invariant error xi_theta = da, xi_p = dp - J p da, xi_l = dl - J l da; corrections act by exp

In truth a common shift and turn of everything cannot be observed.  For fej and ri the product H_k Phi_(k-1) ... Phi_0
keeps those three directions N in its null space, for ekf it does not, and its heading becomes too sure.
Source: Huang, Mourikis and Roumeliotis (2010) for fej; Barrau and Bonnabel (2015) for ri.
"""

from typing import TYPE_CHECKING, NoReturn, Protocol

import numpy as np

from lab.ekfslam.entities import Landmark, Robot
from lab.ekfslam.frames import J, rotation, to_frame, wrap
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.motion import move
from lab.ekfslam.sensor import Sensor, inv_observe, observe
from lab.validation import Array, InputError

if TYPE_CHECKING:
    from lab.ekfslam.map import Map

SEVERAL, INVERSE_DEPTH, RINGS = "several robots", "landmarks by inverse depth", "rings of range-only landmarks"


class Filter(Protocol):
    """What a map asks of a filter; everything else about the map is the same for all."""

    name: str

    def allow(self, what: str) -> None:
        """Refuse, in one sentence, what the filter does not know: SEVERAL, INVERSE_DEPTH or RINGS."""

    def predict(self, m: "Map", robot: Robot, u: Array, Q: Array) -> None:
        """Move a robot by the control u, whose noise has covariance Q."""

    def linearise(
        self, m: "Map", robot: Robot, sensor: Sensor, targets: list[Landmark | Robot], rows: Rows
    ) -> tuple[Array, Array]:
        """Return expectations (k, p) of points whose rows are (k, 2), and their H (k, p, 5) over [r, l]."""

    def seed(self, m: "Map", robot: Robot, sensor: Sensor, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return a new point (2,), L_r (2, 3), L_y (2, 2) and the first estimate (2,) to be remembered."""

    def inject(self, m: "Map", step: Array) -> None:
        """Take the step K z (n,) of a correction."""

    def to_ordinary(self, points: Array) -> Array:
        """Return the columns (..., 2) that xi_theta adds to the ordinary error of points (..., 2): 0 for ekf, fej."""

    def pose_error(self, estimate: Array, truth: Array) -> Array:
        """Return the error (3,) of a pose whose covariance the map keeps."""


class Ekf:
    """The extended Kalman filter of the guide."""

    name = "ekf"

    def allow(self, what: str) -> None:
        """Allow everything."""

    def predict(self, m: "Map", robot: Robot, u: Array, Q: Array) -> None:
        """Move, with R_r at the newest estimate.  Source: J. Solà (2014), eqs. 14-17."""
        r, R_r, R_n = move(m.x[robot.rows], u)
        self._push(m, robot, r, R_r, R_n @ Q @ R_n.T)

    def _push(self, m: "Map", robot: Robot, r: Array, R_r: Array, noise: Array) -> None:
        m.joint.predict(robot.rows, R_r, noise)
        m.x[robot.rows] = robot.prior = r

    def linearise(
        self, m: "Map", robot: Robot, sensor: Sensor, targets: list[Landmark | Robot], rows: Rows
    ) -> tuple[Array, Array]:
        """Expect, with H where the estimate is."""
        e, Y_r, Y_l = observe(m.x[robot.rows], m.x[rows], sensor)
        return e, np.concatenate([Y_r, Y_l], axis=-1)

    def seed(self, m: "Map", robot: Robot, sensor: Sensor, y: Array) -> tuple[Array, Array, Array, Array]:
        """Invert the observation at the newest estimate.  Source: J. Solà (2014), eqs. 31-38."""
        l, L_r, L_y = inv_observe(m.x[robot.rows], y, sensor)  # noqa: E741
        return l, L_r, L_y, l

    def inject(self, m: "Map", step: Array) -> None:
        """Add, and wrap every heading."""
        m.joint.x += step
        angles = m.angle_rows
        m.x[angles] = wrap(m.x[angles])

    def to_ordinary(self, points: Array) -> Array:
        """Return zeros: the error is the ordinary one."""
        return np.zeros_like(points)

    def pose_error(self, estimate: Array, truth: Array) -> Array:
        """Return true minus estimate, the heading wrapped."""
        error = np.asarray(truth - estimate, dtype=float)
        error[2] = wrap(error[2])
        return error


class Fej(Ekf):
    """First-estimate Jacobians: each quantity is linearised at one value for ever, so that nothing is learnt twice."""

    name = "fej"

    def allow(self, what: str) -> None:
        """Refuse what has no first estimate yet."""
        if what != SEVERAL:
            _refuse(self.name, what)

    def predict(self, m: "Map", robot: Robot, u: Array, Q: Array) -> None:
        """Move; the step in R_r is from the last prior to the new one, so that the steps add up."""
        r, R_r, R_n = move(m.x[robot.rows], u)
        R_r[:2, 2] = J @ (r[:2] - robot.prior[:2])
        self._push(m, robot, r, R_r, R_n @ Q @ R_n.T)

    def _point(self, target: Landmark | Robot) -> Array:
        if isinstance(target, Robot):
            return target.prior[:2]
        assert target.first is not None
        return target.first

    def linearise(
        self, m: "Map", robot: Robot, sensor: Sensor, targets: list[Landmark | Robot], rows: Rows
    ) -> tuple[Array, Array]:
        """Expect at the newest estimate, with H at the prior pose and at the first estimates."""
        q, _, _ = to_frame(m.x[robot.rows], m.x[rows])
        e, _ = sensor.project(q)
        first = np.array([self._point(target) for target in targets])
        _, Y_r, Y_l = observe(robot.prior, first, sensor)
        return e, np.concatenate([Y_r, Y_l], axis=-1)

    def seed(self, m: "Map", robot: Robot, sensor: Sensor, y: Array) -> tuple[Array, Array, Array, Array]:
        """Invert at the newest estimate; Jacobians and what is remembered belong to the prior pose."""
        l, _, _ = inv_observe(m.x[robot.rows], y, sensor)  # noqa: E741
        first, L_r, L_y = inv_observe(robot.prior, y, sensor)
        return l, L_r, L_y, first


class RightInvariant(Ekf):
    """The error in which the motion is linear and the unobservable directions are the same at every estimate."""

    name = "ri"

    def allow(self, what: str) -> None:
        """Refuse what is not one robot with points around it."""
        if what != RINGS:
            _refuse(self.name, what)

    def predict(self, m: "Map", robot: Robot, u: Array, Q: Array) -> None:
        """Move: F = I, but noise on the heading shows in the error of every landmark, so all of P is touched."""
        r, _, R_n = move(m.x[robot.rows], u)
        m.x[robot.rows] = robot.prior = r
        rows = m.point_rows
        G = np.zeros((len(m.x), len(u)))
        G[robot.rows[:2]] = R_n[:2] - np.outer(J @ r[:2], R_n[2])
        G[robot.rows[2]] = R_n[2]
        G[rows] = -((m.x[rows] @ J.T)[..., None] * R_n[2])
        m.joint.spread(G, Q)

    def linearise(
        self, m: "Map", robot: Robot, sensor: Sensor, targets: list[Landmark | Robot], rows: Rows
    ) -> tuple[Array, Array]:
        """Expect; H = A R' [-I, 0, I] has no heading column."""
        q, _, Q_l = to_frame(m.x[robot.rows], m.x[rows])
        e, Y_q = sensor.project(q)
        H_l = Y_q @ Q_l
        return e, np.concatenate([-H_l, np.zeros((*e.shape, 1)), H_l], axis=-1)

    def seed(self, m: "Map", robot: Robot, sensor: Sensor, y: Array) -> tuple[Array, Array, Array, Array]:
        """Invert the observation: xi_l = xi_p + R Q_y v."""
        l, _, L_y = inv_observe(m.x[robot.rows], y, sensor)  # noqa: E741
        return l, np.eye(2, 3), L_y, l

    def inject(self, m: "Map", step: Array) -> None:
        """Turn and shift everything by exp: x <- exp(K z) x."""
        (robot,) = m.robots
        a = float(step[robot.rows[2]])
        R, V, points = rotation(a), left_jacobian(a), np.vstack([robot.rows[:2], m.point_rows])
        m.x[points] = m.x[points] @ R.T + step[points] @ V.T
        m.x[robot.rows[2]] = wrap(m.x[robot.rows[2]] + a)

    def to_ordinary(self, points: Array) -> Array:
        """Return J p, since dp = xi_p + J p xi_theta."""
        return np.asarray(points @ J.T)

    def pose_error(self, estimate: Array, truth: Array) -> Array:
        """Return the logarithm of the group error: the xi whose exp takes the estimate to the truth."""
        a = wrap(truth[2] - estimate[2])
        shift = np.linalg.solve(left_jacobian(a), truth[:2] - rotation(a) @ estimate[:2])
        return np.array([*shift, a])


def left_jacobian(a: float) -> Array:
    """Return V(a) (2, 2), the integral of R(s a) over s in [0, 1], I at a = 0."""
    half = a / 2  # (1 - cos a) / a = sinc(a / 2) sin(a / 2): nothing is divided by a small a
    diagonal, off = np.sinc(a / np.pi), np.sinc(half / np.pi) * np.sin(half)
    return np.array([[diagonal, -off], [off, diagonal]])


FILTERS: dict[str, type[Ekf]] = {"ekf": Ekf, "fej": Fej, "ri": RightInvariant}


def make_filter(name: str) -> Filter:
    """Return a filter by its name: the switch.

    Raises
    ------
    InputError
        The name is not known.
    """
    if name not in FILTERS:
        raise InputError(f"Unknown filter {name!r}; known are {', '.join(FILTERS)}.")
    return FILTERS[name]()


def _refuse(name: str, what: str) -> NoReturn:
    raise InputError(f"The filter {name} is not implemented for {what}; use ekf.")
