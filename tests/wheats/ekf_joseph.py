# ruff: noqa: E741 - the guide's letter for a landmark
"""Notebook 06 with Jacobians by the complex step, Joseph's form, and one big matrix for each event."""

import numpy as np

J = np.array([[0.0, -1.0], [1.0, 0.0]])


def derivative(f, at):
    """Return the Jacobian of f to the last digit."""
    columns = []
    for k in range(len(at)):
        step = np.zeros(len(at), dtype=complex)
        step[k] = 1e-30j
        columns.append(np.imag(f(at + step)) / 1e-30)
    return np.column_stack(columns)


def raw_move(r, u):
    return np.array([r[0] + u[0] * np.cos(r[2]), r[1] + u[0] * np.sin(r[2]), r[2] + u[1]])


def raw_invert(r, y):
    return np.array([r[0] + y[0] * np.cos(r[2] + y[1]), r[1] + y[0] * np.sin(r[2] + y[1])])


def wrap(a):
    return a - 2 * np.pi * np.floor((a + np.pi) / (2 * np.pi))


def ekf_move(r, u):
    new = raw_move(r, u)
    new[2] = wrap(new[2])
    return new, derivative(lambda r: raw_move(r, u), r), derivative(lambda u: raw_move(r, u), u)


def ekf_observe(r, l):
    x, y = l - r[:2]
    d = np.hypot(x, y)
    Y_l = np.array([[x, y], [-y / d, x / d]]) / d
    Y_r = -Y_l @ np.eye(2, 3)
    Y_r[1, 2] = -1
    return np.array([d, wrap(np.arctan2(y, x) - r[2])]), Y_r, Y_l


def ekf_invert(r, y):
    return raw_invert(r, y), derivative(lambda r: raw_invert(r, y), r), derivative(lambda y: raw_invert(r, y), y)


def ekf_predict(x, P, u, Q):
    r, R_r, R_n = ekf_move(x[:3], u)
    n = len(x)
    A = np.zeros((n, n + 2))
    A[:, :n] = np.eye(n)
    A[:3, :3] = R_r
    A[:3, n:] = R_n
    both = np.zeros((n + 2, n + 2))
    both[:n, :n] = P
    both[n:, n:] = Q
    return np.append(r, x[3:]), A @ both @ A.T


def ekf_correct(x, P, y, i, R):
    e, Y_r, Y_l = ekf_observe(x[:3], x[3 + 2 * i : 5 + 2 * i])
    H = np.hstack([Y_r, np.zeros((2, 2 * i)), Y_l, np.zeros((2, len(x) - 5 - 2 * i))])
    z = y - e
    z = np.array([z[0], wrap(z[1])])
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    keep = np.eye(len(x)) - K @ H
    mean = x + K @ z
    mean[2] = wrap(mean[2])
    return mean, keep @ P @ keep.T + K @ R @ K.T


def ekf_initialise(x, P, y, R):
    l, L_r, L_y = ekf_invert(x[:3], y)
    n = len(x)
    A = np.vstack([np.eye(n), np.hstack([L_r, np.zeros((2, n - 3))])])
    B = np.vstack([np.zeros((n, 2)), L_y])
    return np.concatenate([x, l]), A @ P @ A.T + B @ R @ B.T


def pose_nees(r, P, truth):
    d = truth - r
    white = np.linalg.solve(np.linalg.cholesky(P), np.append(d[:2], wrap(d[2])))
    return np.sum(white**2)


def frame_directions(x):
    blocks = [np.column_stack([np.eye(2), J @ x[:2]]), [[0, 0, 1]]]
    blocks += [np.column_stack([np.eye(2), J @ l]) for l in x[3:].reshape(-1, 2)]
    return np.linalg.qr(np.vstack(blocks))[0]


def ray_to_point(L, P):
    def point(L):
        return L[:2] + np.array([np.cos(L[2]), np.sin(L[2])]) / L[3]

    slope = derivative(point, L)
    return point(L), slope @ P @ slope.T
