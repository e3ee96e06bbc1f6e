"""The data of the exact filters as whole matrices, for peers that know no others; needs numpy alone."""

from types import SimpleNamespace

import numpy as np


def load(path):
    """Return F, B, Q (n, n) and the moments (n,), (n, n) from which the peers start."""
    with np.load(path) as file:
        given = SimpleNamespace(**dict(file))
    n = 2 + 2 * len(given.landmark_means)
    F, Q, B = np.eye(n), np.zeros((n, n)), np.zeros(n)
    F[:2, :2], Q[:2, :2], B[:2] = given.F, given.Q, given.B
    given.F, given.Q, given.B = F, Q, B
    return given


def instants(given):
    """Yield z (p,), H (p, n) and R (p, p) of every instant that is timed."""
    n = len(given.mean)
    for k in range(int(given.start) + 1, int(given.n_instants)):
        which = np.flatnonzero(given.instants == k)
        s = len(which)
        H, R = np.zeros((s, 2, n)), np.zeros((s, 2, s, 2))
        H[:, 0, 0] = H[:, 1, 1] = -1
        i = np.arange(s)
        for axis in (0, 1):
            H[i, axis, 2 + 2 * given.landmarks[which] + axis] = 1
        R[i, :, i, :] = given.R[which]
        yield given.z[which].ravel(), H.reshape(2 * s, n), R.reshape(2 * s, 2 * s)
