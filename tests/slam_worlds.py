"""Oracles for the EKF-SLAM wing: differences for Jacobians, and a dense filter written without the laboratory's own."""

import numpy as np


def wrapped(a):
    """Angles by the arc tangent of sine and cosine: another road than the modulo of the code."""
    return np.arctan2(np.sin(a), np.cos(a))


def difference(f, x, angles=(), step=1e-6):
    """Return the Jacobian of f at x by central differences; components of f listed in `angles` are wrapped."""
    x = np.asarray(x, dtype=float)
    columns = []
    for i in range(len(x)):
        h = np.zeros(len(x))
        h[i] = step
        change = f(x + h) - f(x - h)
        for a in angles:
            change[a] = wrapped(change[a])
        columns.append(change / (2 * step))
    return np.array(columns).T


def se2(r):
    """Return the pose as a (3, 3) homogeneous matrix."""
    c, s = np.cos(r[2]), np.sin(r[2])
    return np.array([[c, -s, r[0]], [s, c, r[1]], [0, 0, 1]])


def measured(r, point, kind="range-bearing", mount=(0, 0, 0)):
    """Return range and bearing of a point by homogeneous coordinates and complex numbers."""
    local = np.linalg.inv(se2(r) @ se2(mount)) @ [*point, 1]
    z = complex(local[0], local[1])
    return {"range-bearing": np.array([abs(z), np.angle(z)]), "range": np.array([abs(z)])}.get(
        kind, np.array([np.angle(z)])
    )


class DenseEkf:
    """The textbook filter with full matrices and numerical Jacobians: robot first, points after it, in order."""

    def __init__(self, pose, P=None):
        self.x = np.array(pose, dtype=float)
        self.P = np.zeros((3, 3)) if P is None else np.array(P, dtype=float)

    def move(self, u, Q):
        step = [u[0], 0, u[1]] if len(u) == 2 else u

        def f(v):
            r, n = v[:3], v[3:]
            noisy = np.array(step) + ([n[0], 0, n[1]] if len(u) == 2 else n)
            T = se2(r) @ se2(noisy)
            return np.array([T[0, 2], T[1, 2], r[2] + noisy[2]])

        D = difference(f, np.concatenate([self.x[:3], np.zeros(len(u))]))
        F, G = np.eye(len(self.x)), np.zeros((len(self.x), len(u)))
        F[:3, :3], G[:3] = D[:, :3], D[:, 3:]
        self.x[:3] = f(np.concatenate([self.x[:3], np.zeros(len(u))]))
        self.x[2] = wrapped(self.x[2])
        self.P = F @ self.P @ F.T + G @ Q @ G.T

    def initialise(self, y, R):
        def g(v):
            return v[:2] + v[3] * np.array([np.cos(v[2] + v[4]), np.sin(v[2] + v[4])])

        at = np.concatenate([self.x[:3], y])
        D = difference(g, at)
        n = len(self.x)
        big = np.zeros((n + 2, n + 2))
        big[:n, :n] = self.P
        T = np.zeros((2, n))
        T[:, :3] = D[:, :3]
        big[n:, :n] = T @ self.P
        big[:n, n:] = big[n:, :n].T
        big[n:, n:] = T @ self.P @ T.T + D[:, 3:] @ R @ D[:, 3:].T
        self.x, self.P = np.concatenate([self.x, g(at)]), big

    def correct(self, i, y, R, kind="range-bearing"):
        n = len(self.x)
        own = [0, 1, 2, 3 + 2 * i, 4 + 2 * i]
        angles = {"range-bearing": [1], "bearing": [0], "range": []}[kind]
        D = difference(lambda v: measured(v[:3], v[3:], kind), self.x[own], angles)
        H = np.zeros((len(y), n))
        H[:, own] = D
        z = y - measured(self.x[:3], self.x[own[3:]], kind)
        z[angles] = wrapped(z[angles])
        Z = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(Z)
        self.x = self.x + K @ z
        self.x[2] = wrapped(self.x[2])
        left = np.eye(n) - K @ H
        self.P = left @ self.P @ left.T + K @ R @ K.T  # Joseph's form
