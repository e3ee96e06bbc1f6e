# ruff: noqa: E741 - the guide's letter for a landmark
"""Every question of notebook 06, in the plainest way."""

import numpy as np


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


def ekf_move(r, u):
    x, y, a = r
    dx, da = u
    c, s = np.cos(a), np.sin(a)
    new = np.array([x + dx * c, y + dx * s, wrap(a + da)])
    R_r = np.array([[1, 0, -dx * s], [0, 1, dx * c], [0, 0, 1]])
    R_n = np.array([[c, 0], [s, 0], [0, 1]])
    return new, R_r, R_n


def ekf_observe(r, l):
    a = r[2]
    R = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    p = R.T @ (l - r[:2])
    d = np.hypot(p[0], p[1])
    y = np.array([d, np.arctan2(p[1], p[0])])
    Y_p = np.array([[p[0] / d, p[1] / d], [-p[1] / d**2, p[0] / d**2]])
    P_r = np.column_stack([-R.T, [p[1], -p[0]]])
    P_l = R.T
    return y, Y_p @ P_r, Y_p @ P_l


def ekf_invert(r, y):
    d, b = y
    angle = r[2] + b
    c, s = np.cos(angle), np.sin(angle)
    l = np.array([r[0] + d * c, r[1] + d * s])
    L_r = np.array([[1, 0, -d * s], [0, 1, d * c]])
    L_y = np.array([[c, -d * s], [s, d * c]])
    return l, L_r, L_y


def ekf_predict(x, P, u, Q):
    x, P = x.copy(), P.copy()
    x[:3], R_r, R_n = ekf_move(x[:3], u)
    P[:3, :3] = R_r @ P[:3, :3] @ R_r.T + R_n @ Q @ R_n.T
    P[:3, 3:] = R_r @ P[:3, 3:]
    P[3:, :3] = P[:3, 3:].T
    return x, P


def ekf_correct(x, P, y, i, R):
    n = len(x)
    place = 3 + 2 * i
    e, Y_r, Y_l = ekf_observe(x[:3], x[place : place + 2])
    H = np.zeros((2, n))
    H[:, :3] = Y_r
    H[:, place : place + 2] = Y_l
    z = y - e
    z[1] = wrap(z[1])
    Z = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(Z)
    x = x + K @ z
    x[2] = wrap(x[2])
    P = P - K @ Z @ K.T
    return x, P


def ekf_initialise(x, P, y, R):
    n = len(x)
    l, L_r, L_y = ekf_invert(x[:3], y)
    larger = np.zeros((n + 2, n + 2))
    larger[:n, :n] = P
    larger[n:, :n] = L_r @ P[:3]
    larger[:n, n:] = larger[n:, :n].T
    larger[n:, n:] = L_r @ P[:3, :3] @ L_r.T + L_y @ R @ L_y.T
    return np.append(x, l), larger


def pose_nees(r, P, truth):
    d = truth - r
    d[2] = wrap(d[2])
    return d @ np.linalg.inv(P) @ d


def frame_directions(x):
    n = len(x)
    N = np.zeros((n, 3))
    N[0, 0] = N[1, 1] = 1
    N[:3, 2] = -x[1], x[0], 1
    for i in range(3, n, 2):
        N[i, 0] = N[i + 1, 1] = 1
        N[i : i + 2, 2] = -x[i + 1], x[i]
    return N


def ray_to_point(L, P):
    x, y, alpha, rho = L
    c, s = np.cos(alpha), np.sin(alpha)
    p = np.array([x + c / rho, y + s / rho])
    J = np.array([[1, 0, -s / rho, -c / rho**2], [0, 1, c / rho, -s / rho**2]])
    return p, J @ P @ J.T
