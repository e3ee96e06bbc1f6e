# ruff: noqa: E741 - the guide's letter for a landmark
"""Notebook 06 block by block, with loops, sines and cosines of the difference of angles, and a gain by solve."""

import numpy as np


def into_range(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def ekf_move(r, u):
    heading = r[2]
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    pose = np.array([*(r[:2] + u[0] * ahead), into_range(heading + u[1])])
    R_r = np.eye(3)
    R_r[:2, 2] = u[0] * left
    R_n = np.zeros((3, 2))
    R_n[:2, 0] = ahead
    R_n[2, 1] = 1
    return [pose, R_r, R_n]


def ekf_observe(r, l):
    dx, dy = l[0] - r[0], l[1] - r[1]
    q = dx * dx + dy * dy
    d = np.sqrt(q)
    bearing = into_range(np.arctan2(dy, dx) - r[2])
    Y_l = np.array([[dx / d, dy / d], [-dy / q, dx / q]])
    return np.array([d, bearing]), np.hstack([-Y_l, [[0], [-1]]]), Y_l


def ekf_invert(r, y):
    place = r[:2] + y[0] * np.array([np.cos(r[2] + y[1]), np.sin(r[2] + y[1])])
    lever = place - r[:2]
    L_r = np.array([[1, 0, -lever[1]], [0, 1, lever[0]]])
    L_y = np.array([[lever[0] / y[0], -lever[1]], [lever[1] / y[0], lever[0]]])
    return place, L_r, L_y


def ekf_predict(x, P, u, Q):
    r, R_r, R_n = ekf_move(x[:3], u)
    F = np.eye(len(x))
    F[:3, :3] = R_r
    G = np.vstack([R_n, np.zeros((len(x) - 3, 2))])
    return np.concatenate([r, x[3:]]), F @ P @ F.T + G @ Q @ G.T


def ekf_correct(x, P, y, i, R):
    rows = [0, 1, 2, 3 + 2 * i, 4 + 2 * i]
    e, Y_r, Y_l = ekf_observe(x[:3], x[rows[3:]])
    H = np.hstack([Y_r, Y_l])
    Z = H @ P[np.ix_(rows, rows)] @ H.T + R
    PH = P[:, rows] @ H.T
    K = np.linalg.solve(Z, PH.T).T
    z = np.array([y[0] - e[0], into_range(y[1] - e[1])])
    new = x + K @ z
    new[2] = into_range(new[2])
    P = P - PH @ K.T
    return new, (P + P.T) / 2


def ekf_initialise(x, P, y, R):
    l, L_r, L_y = ekf_invert(x[:3], y)
    cross = np.zeros((2, len(x)))
    for j in range(len(x)):
        cross[:, j] = L_r @ P[:3, j]
    own = L_r @ P[:3, :3] @ L_r.T + L_y @ R @ L_y.T
    return np.hstack([x, l]), np.block([[P, cross.T], [cross, own]])


def pose_nees(r, P, truth):
    error = np.array([r[0] - truth[0], r[1] - truth[1], into_range(r[2] - truth[2])])
    return float(error @ np.linalg.solve(P, error))


def frame_directions(x):
    """Turn about the robot, and half the sum and the difference of the two shifts."""
    M = (len(x) - 3) // 2
    east = np.concatenate([[1, 0, 0], np.tile([1, 0], M)])
    north = np.concatenate([[0, 1, 0], np.tile([0, 1], M)])
    turn = np.zeros(len(x))
    turn[2] = 2
    for i in range(M):
        away = x[3 + 2 * i : 5 + 2 * i] - x[:2]
        turn[3 + 2 * i], turn[4 + 2 * i] = -2 * away[1], 2 * away[0]
    return np.column_stack([turn, (east + north) / 2, east - north])


def ray_to_point(L, P):
    d = 1 / L[3]
    ray = np.array([np.cos(L[2]), np.sin(L[2])])
    left = np.array([-ray[1], ray[0]])
    to_distance = np.diag([1, 1, 1, -(d**2)])
    J = np.column_stack([np.eye(2), d * left, ray]) @ to_distance
    return L[:2] + d * ray, J @ P @ J.T
