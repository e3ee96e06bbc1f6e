"""The least-squares optimum of a factor graph: all poses and landmarks at once, the best that a filter can meet.

Levenberg-Marquardt on the sparse normal equations (scipy.sparse), the first pose held at the origin; written apart from
the filters, with its own geometry.  The residuals are in metres and radians, whitened by the factors' covariances:

    motion     R(theta_i)' (p_j - p_i) - [dx, dy],  wrap(theta_j - theta_i - dtheta)
    sighting   R(theta_i)' (l - p_i) - z
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu


class Optimum(NamedTuple):
    poses: np.ndarray  # (N, 3)
    landmarks: np.ndarray  # (L, 2)
    chi2: float
    dof: int
    gradient: float  # the largest component, in whitened units
    iterations: int


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def extended(graph, poses, landmarks):
    """Return a start: the given first poses and landmarks, then odometry alone and first sightings."""
    poses = [*poses]
    for dx, dy, turn in graph.odometry[len(poses) - 1 :]:
        x, y, a = poses[-1]
        c, s = np.cos(a), np.sin(a)
        poses.append(np.array([x + c * dx - s * dy, y + s * dx + c * dy, wrap(a + turn)]))
    landmarks = [*landmarks]
    for k, i, (u, v) in zip(graph.poses_of, graph.landmarks_of, graph.sightings, strict=True):
        if i == len(landmarks):
            x, y, a = poses[k]
            landmarks.append(np.array([x + np.cos(a) * u - np.sin(a) * v, y + np.sin(a) * u + np.cos(a) * v]))
    return np.array(poses), np.array(landmarks)


def residuals(graph, poses, landmarks):
    """Return the whitened residuals and their sparse Jacobian by [poses after the first, landmarks]."""
    before, after = poses[:-1], poses[1:]
    parts = [
        _seen_from(before, after[:, :2], graph.odometry[:, :2]),
        _seen_from(poses[graph.poses_of], landmarks[graph.landmarks_of], graph.sightings),
    ]
    n, s = len(before), len(graph.sightings)
    root_motion = np.linalg.inv(np.linalg.cholesky(graph.odometry_covs))
    root_sighting = np.linalg.inv(np.linalg.cholesky(graph.sighting_covs))
    (shift, by_pose, by_point), (gap, by_viewer, by_landmark) = parts
    motion = np.column_stack([shift, wrap(after[:, 2] - before[:, 2] - graph.odometry[:, 2])])
    first, second = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    first[:, :2], first[:, 2, 2] = by_pose, -1
    second[:, :2, :2], second[:, 2, 2] = by_point, 1
    r = np.concatenate(
        [np.einsum("nij,nj->ni", root_motion, motion).ravel(), np.einsum("nij,nj->ni", root_sighting, gap).ravel()]
    )
    rows_m = 3 * np.arange(n)
    rows_s = 3 * n + 2 * np.arange(s)
    start = 3 * len(poses)
    J = sum(
        _placed(root @ block, rows, columns, (len(r), start + 2 * len(landmarks)))
        for root, block, rows, columns in (
            (root_motion, first, rows_m, 3 * np.arange(n)),
            (root_motion, second, rows_m, 3 * np.arange(1, n + 1)),
            (root_sighting, by_viewer, rows_s, 3 * graph.poses_of),
            (root_sighting, by_landmark, rows_s, start + 2 * graph.landmarks_of),
        )
    )
    return r, J[:, 3:].tocsc()


def part(graph, n_poses):
    """Return the factors of the first poses."""
    n_seen = int(np.searchsorted(graph.poses_of, n_poses))
    n_landmarks = int(graph.landmarks_of[:n_seen].max(initial=-1)) + 1  # they are numbered as they are first seen
    return replace(
        graph,
        pose_ids=graph.pose_ids[:n_poses],
        odometry=graph.odometry[: n_poses - 1],
        odometry_covs=graph.odometry_covs[: n_poses - 1],
        landmark_ids=graph.landmark_ids[:n_landmarks],
        poses_of=graph.poses_of[:n_seen],
        landmarks_of=graph.landmarks_of[:n_seen],
        sightings=graph.sightings[:n_seen],
        sighting_covs=graph.sighting_covs[:n_seen],
    )


def optimum_by_parts(graph, stride=700):
    """Minimise over ever more of the drive: dead reckoning from its start ends in another minimum of a long one."""
    poses, landmarks = np.zeros((1, 3)), np.zeros((0, 2))
    for n in [*range(stride, len(graph.pose_ids), stride), len(graph.pose_ids)]:
        whole = n == len(graph.pose_ids)
        grown = part(graph, n)
        poses, landmarks = extended(grown, poses, landmarks)
        result = optimum(grown, poses, landmarks, tolerance=1e-12 if whole else 1e-3)
        poses, landmarks = result.poses, result.landmarks
    return result


def optimum(graph, poses, landmarks, *, iterations=100, tolerance=1e-12):
    """Minimise the sum of squared residuals from a start."""
    damping = 1e-4
    r, J = residuals(graph, poses, landmarks)
    cost = r @ r
    done = 0
    while done < iterations:
        done += 1
        A, b = (J.T @ J).tocsc(), J.T @ r
        step = -splu(A + damping * sp.diags(A.diagonal())).solve(b)
        moved = poses + np.vstack([np.zeros(3), step[: 3 * len(poses) - 3].reshape(-1, 3)])
        moved[:, 2] = wrap(moved[:, 2])
        shifted = landmarks + step[3 * len(poses) - 3 :].reshape(-1, 2)
        r_new, J_new = residuals(graph, moved, shifted)
        gain = cost - r_new @ r_new
        if gain < 0:
            damping = max(10 * damping, 1e-10)
            continue
        poses, landmarks, r, J, cost = moved, shifted, r_new, J_new, r_new @ r_new
        damping = damping / 10 if damping > 1e-12 else 0.0
        if gain < tolerance * (1 + cost) and damping < 1e-8:
            break
    dof = len(r) - 3 * (len(poses) - 1) - 2 * len(landmarks)
    return Optimum(poses, landmarks, float(cost), dof, float(np.abs(J.T @ r).max()), done)


def _seen_from(poses, points, given):
    """Return R' (points - places) - given with its derivatives by the pose (n, 2, 3) and by the point (n, 2, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([c, s], 1), np.stack([-s, c], 1)], 1)  # R'
    away = points - poses[:, :2]
    seen = np.einsum("nij,nj->ni", turn, away)
    by_pose = np.concatenate([-turn, np.stack([seen[:, 1], -seen[:, 0]], 1)[:, :, None]], axis=2)
    return seen - given, by_pose, turn


def _placed(blocks, rows, columns, shape):
    _, height, width = blocks.shape
    i = np.repeat(rows[:, None, None] + np.arange(height)[:, None], width, axis=2)
    j = np.repeat(columns[:, None, None] + np.arange(width), height, axis=1)
    return sp.coo_matrix((blocks.ravel(), (i.ravel(), j.ravel())), shape=shape).tocsr()
