"""Solà's symbols: L = [p0, alpha, rho] a landmark by inverse depth, F the sensor's frame; value first, then Jacobians.

Question answered: how does a landmark enter the map when only its bearing is known?

    point      p0 + [cos alpha, sin alpha] / rho          p0 the sensor's position when it saw the landmark first
    bearing    atan2 of v = R(a)' (rho (p0 - t) + [cos alpha, sin alpha])          F = [t, a] the sensor now
    prior      rho ~ N(1 / (2 dmin), (1 / (4 dmin))^2): from dmin to infinity within two deviations

v is linear in rho over the whole ray, infinity included, where the point itself is not.  A bounded rho cannot be
Gaussian: a correction may push it below zero, and the ray would flip by pi; such a rho is repaired to NEAR_ZERO.
Source: J. Solà (2014), section 2.3.6; Civera, Davison and Montiel (2008) for the index of linearity.
"""

import numpy as np

from lab.ekfslam.frames import to_frame, wrap
from lab.ekfslam.motion import move
from lab.ekfslam.sensor import Sensor, scan
from lab.validation import Array, InputError

NEAR_ZERO = 0.001  # 1/m: what a negative rho is set to
LINEAR = 0.1  # index below which a landmark may become a point


def rho_prior(dmin: float) -> tuple[float, float]:
    """Return mean and deviation [1/m] of rho for landmarks that are at least dmin [m] away.

    Raises
    ------
    InputError
        dmin is not positive.
    """
    if not dmin > 0:
        raise InputError(f"dmin must be positive, not {dmin}.")
    return 1 / (2 * dmin), 1 / (4 * dmin)


def point(L: Array) -> tuple[Array, Array]:
    """Return the point (2,) [m] of a landmark L (4,), and P_L (2, 4)."""
    c, s, rho = np.cos(L[2]), np.sin(L[2]), L[3]
    if rho == 0:
        raise InputError("A landmark with rho = 0 is at infinity and has no point.")
    P_L = np.array([[1.0, 0.0, -s / rho, -c / rho**2], [0.0, 1.0, c / rho, -s / rho**2]])
    return L[:2] + np.array([c, s]) / rho, P_L


def sensor_frame(r: Array, sensor: Sensor) -> tuple[Array, Array]:
    """Return the sensor's frame in the map (3,), and F_r (3, 3)."""
    F, F_r, _ = move(r, sensor.mount)
    return F, F_r


def bearing(F: Array, L: Array) -> tuple[Array, Array, Array]:
    """Return the bearing (1,) [rad] of a landmark from the frame F.

    Parameters
    ----------
    F : (3,) array
        The sensor in the map.
    L : (4,) array

    Returns
    -------
    y : (1,) array
    Y_F : (1, 3) array
    Y_L : (1, 4) array

    Source: J. Solà (2014), section 2.3.6, in homogeneous form.
    """
    t, (c, s), rho = F[:2], (np.cos(L[2]), np.sin(L[2])), L[3]
    ray = np.array([c, s])
    # to_frame of the frame [0, a] turns the homogeneous point; its derivative by a is that of v
    v, V_a, V_h = to_frame(np.array([0.0, 0.0, F[2]]), rho * (L[:2] - t) + ray)
    y, Y_v = scan(v, "bearing")
    Y_h = Y_v @ V_h
    Y_F = np.concatenate([-rho * Y_h, Y_v @ V_a[:, 2:]], axis=1)
    Y_L = np.concatenate([rho * Y_h, Y_h @ np.array([[-s, L[0] - t[0]], [c, L[1] - t[1]]])], axis=1)
    return y, Y_F, Y_L


def observe(r: Array, L: Array, sensor: Sensor) -> tuple[Array, Array, Array]:
    """Return what the robot's sensor of any kind measures of a landmark, Y_r and Y_L: by the ray or by the point."""
    F, F_r = sensor_frame(r, sensor)
    if sensor.kind == "bearing":
        y, Y_F, Y_L = bearing(F, L)
        return y, Y_F @ F_r, Y_L
    p, P_L = point(L)
    q, Q_F, Q_p = to_frame(F, p)
    y, Y_q = scan(q, sensor.kind)
    return y, Y_q @ Q_F @ F_r, Y_q @ Q_p @ P_L


def inv_observe(r: Array, y: Array, rho: float, sensor: Sensor) -> tuple[Array, Array, Array, Array]:
    """Return the landmark that a bearing gives with a prior on rho.

    Parameters
    ----------
    r : (3,) array
        Robot.
    y : (1,) array
        Bearing [rad].
    rho : float
        Mean of the prior s [1/m].
    sensor : Sensor

    Returns
    -------
    L : (4,) array
    L_r : (4, 3) array
    L_y : (4, 1) array
    L_s : (4, 1) array

    Raises
    ------
    InputError
        The sensor measures more than a bearing.

    Source: J. Solà (2014), eqs. of section 2.3.5.
    """
    if sensor.kind != "bearing":
        raise InputError("Inverse depth is for landmarks of which only the bearing is measured.")
    F, F_r = sensor_frame(r, sensor)
    L = np.array([F[0], F[1], wrap(F[2] + y[0]), rho])
    L_r = np.vstack([F_r, np.zeros(3)])
    return L, L_r, np.array([[0.0], [0.0], [1.0], [0.0]]), np.array([[0.0], [0.0], [0.0], [1.0]])


def linearity_index(t: Array, L: Array, variance: float) -> float:
    """Return 4 sigma_d |cos| / d: how curved a landmark's point is over its own uncertainty, seen from t (2,) [m].

    Parameters
    ----------
    t : (2,) array
        Where the sensor is now [m].
    L : (4,) array
    variance : float
        Of rho [1/m^2].
    """
    p, _ = point(L)
    ray, sight = p - L[:2], p - t
    d, d0 = float(np.hypot(*sight)), float(np.hypot(*ray))
    if d == 0 or L[3] <= 0:
        return np.inf
    sigma_d = np.sqrt(max(variance, 0.0)) / L[3] ** 2
    return float(4 * sigma_d * abs(ray @ sight) / (d0 * d) / d)
