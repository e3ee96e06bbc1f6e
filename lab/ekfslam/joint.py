"""Solà's symbols: x mean and P covariance of everything in the map, z innovation, Z its covariance, K gain.

Question answered: how are the four events of SLAM done to one Gaussian at the least cost?  n slots, few touched:

    predict   P_rr <- F P_rr F' + Q, P_rm <- F P_rm                            O(n): the robot's rows only
    correct   x <- x + K z, P <- P - W W', W = P H' L^-T, Z = L L'             O(n^2), of which z and Z are O(1)
    augment   P_lx = G P_sx, P_ll = G P_ss G' + noise                          O(n)
    release   the rows are emptied and free again: what is left is the marginal

Only the lower triangle of P is kept, so P cannot lose its symmetry, half of the work is saved, and BLAS (syrk) updates
it in place.  P is singular right after an anchored initialisation: only Z is ever factored.  Free slots hold zeros.
Source: J. Solà (2014), eqs. 14-17 (prediction), 26-30 (correction), 31-38 (initialisation).
"""

from math import sqrt

import numpy as np
from scipy.linalg.blas import dsyrk

from lab.ekfslam.mapspace import MapSpace, Rows
from lab.validation import Array


def whitening(Z: Array) -> Array:
    """Return L^-1 of Z = L L': for one or two components by hand, where a call of LAPACK costs more than its work.

    Raises
    ------
    numpy.linalg.LinAlgError
        Z is not positive definite.
    """
    if len(Z) > 2:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(Z)))
    a = float(Z[0, 0])
    if len(Z) == 1:
        if not a > 0:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return np.array([[1 / sqrt(a)]])
    b = float(Z[1, 0])
    rest = a * float(Z[1, 1]) - b * b
    if not (a > 0 and rest > 0):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    root = sqrt(a)
    return np.array([[1 / root, 0.0], [-b / (root * sqrt(rest)), root / sqrt(rest)]])


class Joint:
    """The mean and covariance of a map in its slots.

    Parameters
    ----------
    limit : int, optional
        The most slots there may ever be.
    """

    def __init__(self, limit: int | None = None) -> None:
        self.space = MapSpace(limit)
        self.x = np.zeros(self.space.capacity)
        self._P = np.zeros((self.space.capacity, self.space.capacity), order="F")  # lower triangle; the rest is void

    def block(self, rows: Rows, columns: Rows | None = None) -> Array:
        """Return P of the rows (..., k) and columns (..., m), by default the same, as (..., k, m)."""
        i = rows[..., :, None]
        j = (rows if columns is None else columns)[..., None, :]
        return self._P[np.maximum(i, j), np.minimum(i, j)]

    def columns(self, rows: Rows) -> Array:
        """Return the whole columns (n, k) of P."""
        P = self._P
        C = P[:, rows]
        for i, j in enumerate(rows.tolist()):
            C[:j, i] = P[j, :j]
        return C

    def covariance(self) -> Array:
        """Return P of all slots, (n, n), both triangles."""
        lower = np.tril(self._P)
        return lower + np.tril(lower, -1).T

    def take(self, n: int) -> Rows:
        """Return n free slots, their mean and covariance 0."""
        rows = self.space.take(n)
        grown = self.space.capacity - len(self.x)
        if grown:
            x, P, old = self.x, self._P, len(self.x)
            self.x = np.concatenate([x, np.zeros(grown)])
            self._P = np.zeros((old + grown, old + grown), order="F")
            self._P[:old, :old] = P
        return rows

    def release(self, rows: Rows) -> None:
        """Free slots; the rest of the map keeps its marginal."""
        self.space.release(rows)
        self.x[rows] = 0
        self._P[:, rows] = 0
        self._P[rows, :] = 0

    def settle(self, rows: Rows, P: Array) -> None:
        """Give fresh slots a covariance P (k, k) of their own, correlated with nothing."""
        C = np.zeros((len(self.x), len(rows)))
        C[rows] = P
        self._put(rows, C)

    def predict(self, rows: Rows, F: Array, Q: Array) -> None:
        """Push the rows through F and add Q (k, k) to them: O(n), the block P_mm of the others is not touched."""
        C = self.columns(rows) @ F.T
        own = F @ C[rows] + Q
        C[rows] = (own + own.T) / 2
        self._put(rows, C)

    def augment(self, sources: Rows, G: Array, noise: Array) -> Rows:
        """Return new rows with x = 0, P_lx = G P_sx and P_ll = G P_ss G' + noise: O(n).

        Parameters
        ----------
        sources : (s,) array of int
            The rows from which the new ones come.
        G : (k, s) array
        noise : (k, k) array
        """
        rows = self.take(len(G))
        C = self.columns(sources) @ G.T
        own = G @ C[sources] + noise
        C[rows] = (own + own.T) / 2
        self._put(rows, C)
        return rows

    def correct(self, rows: Rows, H: Array, z: Array, Z: Array) -> Array:
        """Condition on an innovation and return the step K z (n,) of the mean, which is left to the caller to take.

        Parameters
        ----------
        rows : (k,) array of int
            What the measurement depends on.
        H : (p, k) array
        z : (p,) array
        Z : (p, p) array
            H P H' + R, positive definite.

        Raises
        ------
        numpy.linalg.LinAlgError
            Z is not positive definite.
        """
        inverse = whitening(Z)
        W = self.columns(rows) @ (H.T @ inverse.T)
        self._add(W, -1.0)
        return np.asarray(W @ (inverse @ z))

    def refine(self, own: Rows, rows: Rows, H: Array, z: Array, Z: Array) -> Array:
        """Condition on an innovation as if only `own` rows could learn from it, and return their step (k,).

        The gain of all other rows is zero (Schmidt's consider filter): they keep mean and covariance, and their
        correlation with `own` stays right.  O(n).
        """
        K = np.linalg.solve(Z, H @ self.block(rows, own)).T
        C = self.columns(own)
        before = C[own]
        C -= (self.columns(rows) @ H.T) @ K.T
        after = before - K @ Z @ K.T
        C[own] = (after + after.T) / 2
        self._put(own, C)
        return np.asarray(K @ z)

    def spread(self, G: Array, Q: Array) -> None:
        """Add G Q G' to all of P, for G (n, k) and a covariance Q (k, k): O(n^2)."""
        variances, axes = np.linalg.eigh(Q)  # Q may be singular
        self._add(G @ (axes * np.sqrt(np.maximum(variances, 0))), 1.0)

    def _add(self, W: Array, sign: float) -> None:
        """Add sign W W' to the lower triangle, in place."""
        P = dsyrk(sign, W, beta=1.0, c=self._P, lower=1, overwrite_c=1)
        self._P = P

    def _put(self, rows: Rows, C: Array) -> None:
        """Write whole columns C (n, k) of P back into the triangle."""
        P = self._P
        for i, j in enumerate(rows.tolist()):
            P[j:, j] = C[j:, i]
            P[j, :j] = C[:j, i]
