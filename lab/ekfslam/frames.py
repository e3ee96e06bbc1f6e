"""Solà's symbols: F = [t, a] is a frame, p a point, y polar coordinates; first the value, then the Jacobians.

Question answered: where is a point, seen from another frame, and how does that depend on the frame and on the point?

    from_frame(F, q) = R(a) q + t        to_frame(F, p) = R(a)' (p - t)
    polar(p) = [|p|, atan2(p_y, p_x)]    rectangular([d, b]) = d [cos b, sin b]

Everything is vectorised: frames are (..., 3), points (..., 2), leading axes broadcast.  ``Q_F`` is dq/dF, (..., 2, 3).
The printed Jacobian of the bearing divides by p_x, which is 0/0 abeam; here it divides by d^2.
Source: J. Solà, Simultaneous localization and mapping with the extended Kalman filter (2014), sections 1.2 and 2.
"""

from math import pi
from typing import Any

import numpy as np

from lab.validation import Array, InputError

TURN = 2 * pi
J = np.array([[0.0, -1.0], [1.0, 0.0]])  # a quarter of a turn: dR/da = J R
J.flags.writeable = False


def wrap(a: Any) -> Any:
    """Return angles [rad] brought to [-pi, pi) by whole turns; pi itself only where rounding cannot tell the two apart.

    The guide's listings add or subtract one turn, which is not enough beyond 3 pi.
    """
    return (a + pi) % TURN - pi


def rotation(a: Any) -> Array:
    """Return the matrix (..., 2, 2) that turns by the angle `a` [rad]."""
    c, s = np.cos(a), np.sin(a)
    R = np.empty((*np.shape(a), 2, 2))
    R[..., 0, 0] = R[..., 1, 1] = c
    R[..., 0, 1] = -s
    R[..., 1, 0] = s
    return R


def from_frame(F: Array, q: Array) -> tuple[Array, Array, Array]:
    """Return the point that has coordinates q in frame F.

    Parameters
    ----------
    F : (..., 3) array
        Position [m] and angle [rad] of the frame.
    q : (..., 2) array
        Point in the frame [m].

    Returns
    -------
    p : (..., 2) array
    P_F : (..., 2, 3) array
    P_q : (..., 2, 2) array

    Source: the guide's appendix on frame transformations.
    """
    P_q = rotation(F[..., 2])
    turned = (P_q @ q[..., None])[..., 0]
    P_F = np.zeros((*turned.shape, 3))
    P_F[..., 0, 0] = P_F[..., 1, 1] = 1
    P_F[..., 0, 2] = -turned[..., 1]
    P_F[..., 1, 2] = turned[..., 0]
    return turned + F[..., :2], P_F, P_q


def to_frame(F: Array, p: Array) -> tuple[Array, Array, Array]:
    """Return the coordinates of the point p in frame F.

    Parameters
    ----------
    F : (..., 3) array
        Position [m] and angle [rad] of the frame.
    p : (..., 2) array
        Point [m].

    Returns
    -------
    q : (..., 2) array
    Q_F : (..., 2, 3) array
    Q_p : (..., 2, 2) array

    Source: the guide's appendix on frame transformations.
    """
    Q_p = np.swapaxes(rotation(F[..., 2]), -1, -2)
    q = (Q_p @ (p - F[..., :2])[..., None])[..., 0]
    Q_F = np.empty((*q.shape, 3))
    Q_F[..., :2] = -Q_p
    Q_F[..., 0, 2] = q[..., 1]
    Q_F[..., 1, 2] = -q[..., 0]
    return q, Q_F, Q_p


def polar(p: Array) -> tuple[Array, Array]:
    """Return distance [m] and bearing [rad] of points, (..., 2), and Y_p (..., 2, 2).

    Raises
    ------
    InputError
        A point lies in the origin, where the bearing is not defined.
    """
    x, y = p[..., 0], p[..., 1]
    d = np.hypot(x, y)
    if not d.all():
        raise InputError("A point at distance 0 from the sensor has no bearing, and its range no derivative.")
    result, Y_p = np.empty(p.shape), np.empty((*p.shape, 2))
    result[..., 0], result[..., 1] = d, np.arctan2(y, x)
    Y_p[..., 0, 0], Y_p[..., 0, 1] = x / d, y / d
    Y_p[..., 1, 0], Y_p[..., 1, 1] = -y / d**2, x / d**2
    return result, Y_p


def rectangular(y: Array) -> tuple[Array, Array]:
    """Return the points (..., 2) at distance y[..., 0] [m] and bearing y[..., 1] [rad], and P_y (..., 2, 2)."""
    d, c, s = y[..., 0], np.cos(y[..., 1]), np.sin(y[..., 1])
    p, P_y = np.empty(y.shape), np.empty((*y.shape, 2))
    p[..., 0], p[..., 1] = d * c, d * s
    P_y[..., 0, 0], P_y[..., 0, 1] = c, -d * s
    P_y[..., 1, 0], P_y[..., 1, 1] = s, d * c
    return p, P_y
