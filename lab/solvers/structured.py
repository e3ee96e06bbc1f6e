"""The exact filter for maps of thousands of landmarks that nothing couples.

Question answered: how is p(x_k given z_1..z_k) found exactly when a matrix product takes seconds?  By what the problem
is: F moves two components and H_k subtracts the robot from a landmark, so with L L' = S = H P H' + R

    predict   P_rr' = F P_rr F' + Q,   P_rm' = F P_rm                       O(n)
    update    W = L^-1 (rows of P for the landmarks - rows for the robot),  mean += W' L^-1 innovation,  P -= W' W

and only the last, a rank-p update of one triangle, costs O(p n^2); it waits until several can share one walk through
the memory of P.  A landmark never seen is its prior, no part of P.  When first seen it is left out of its own update
(its prior joins the noise) and then follows from the robot: given r and z it is N(m0 + G (z + r - m0), C), so a wide
prior loses no digits.  Called by `kalman` only.
"""

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lab import gaussian
from lab.sparse import SparseProblem
from lab.triangle import Triangle
from lab.validation import Array, InputError

Indices = NDArray[np.int64]

BATCH = 64  # landmarks per update: W stays a small part of the memory of P
CHUNK = 256  # rows written at a time when the whole covariance is asked for


class MapFilter:
    """The state of the filter: moments of the robot, of the landmarks seen so far, and what couples them.

    Parameters
    ----------
    problem : SparseProblem
    """

    def __init__(self, problem: SparseProblem) -> None:
        """Start from the prior."""
        self._problem = problem
        self._robot, self._robot_cov = problem.robot_mean, problem.robot_cov
        self._landmarks = problem.landmark_means.copy()
        self._priors = problem.landmark_covs.copy()  # of those not yet seen
        self._order: Indices = np.zeros(0, dtype=np.int64)  # of the landmarks in the triangle
        self._place: Indices = np.full(problem.n_landmarks, problem.n_landmarks)  # of each landmark in that order
        self._cross = np.zeros((2, 0))
        self._covs = Triangle()

    def predict(self) -> None:
        """Go one step ahead."""
        problem = self._problem
        self._robot = problem.F @ self._robot + problem.B
        cov = problem.F @ self._robot_cov @ problem.F.T + problem.Q
        self._robot_cov = (cov + cov.T) / 2
        self._cross = problem.F @ self._cross
        if problem.landmark_noise.any():
            self._priors += problem.landmark_noise
            self._covs.add_blocks(problem.landmark_noise[self._order])

    def update(self, k: int) -> float:
        """Take in what was seen at instant k and return by how much the log-evidence grows.

        Raises
        ------
        InputError
            The innovation covariance S is singular.
        """
        landmarks, z, R = self._problem.seen(k)
        order = np.argsort(self._place[landmarks], kind="stable")
        increment = 0.0
        for start in range(0, len(order), BATCH):  # nothing couples two batches, so one follows the other
            part = order[start : start + BATCH]
            try:
                increment += self._update(landmarks[part], z[part], R[part])
            except np.linalg.LinAlgError:
                raise InputError(f"The innovation covariance H P H' + R is singular at k = {k}.") from None
        return increment

    def _update(self, landmarks: Indices, z: Array, R: Array) -> float:
        """Condition on sightings of landmarks of which those in the triangle come first, in its order."""
        known = landmarks[self._place[landmarks] < len(self._order)]
        new = landmarks[len(known) :]
        places = (2 * self._place[known][:, np.newaxis] + [0, 1]).ravel()
        seen, size, count = ~np.isnan(z), self._covs.size, 2 * len(landmarks)
        # rows of the covariance of z with the robot and with the landmarks in the triangle
        robot, others = np.zeros((count, 2)), np.zeros((count, size))
        robot[: len(places)], others[: len(places)] = self._cross[:, places].T, self._covs.rows(places)
        for i in (0, 1):
            robot[i::2] -= self._robot_cov[i]
            others[i::2] -= self._cross[i]
        S = np.tile(-robot, (1, len(landmarks)))
        S[:, : len(places)] += others[:, places]
        noise = np.nan_to_num(R)
        noise[len(known) :] += self._priors[new]
        each = np.arange(len(landmarks))
        S.reshape(len(each), 2, len(each), 2)[each, :, each, :] += noise
        innovation = z - (self._landmarks[landmarks] - self._robot)

        rows = np.flatnonzero(seen)
        if len(rows) < count:
            robot, others, S = robot[rows], others[rows], S[np.ix_(rows, rows)]
        factor = np.linalg.cholesky(S)
        whitened, W_r, W = (
            scipy.linalg.solve_triangular(factor, right, lower=True, check_finite=False)
            for right in (innovation.ravel()[rows], robot, others)
        )
        self._robot = self._robot + W_r.T @ whitened
        self._landmarks[self._order] += (W.T @ whitened).reshape(-1, 2)
        self._robot_cov = self._robot_cov - W_r.T @ W_r
        self._cross = self._cross - W_r.T @ W
        if size:
            self._covs.subtract_square(W)
        if len(new):
            self._admit(new, z[len(known) :], R[len(known) :])
        constant = np.log(np.diag(factor)).sum() + len(rows) * gaussian.LOG_2PI / 2
        return float(-(whitened @ whitened) / 2 - constant)

    def _admit(self, new: Indices, z: Array, R: Array) -> None:
        """Border the covariance with landmarks whose sightings have just moved the robot."""
        prior, seen = self._priors[new], ~np.isnan(z)
        noise, deviation = np.nan_to_num(R), np.nan_to_num(z + self._robot - self._landmarks[new])
        gains = prior * seen[:, np.newaxis, :]
        gains = gaussian.regression(gains, (gains + noise) * seen[:, :, np.newaxis])
        left = np.eye(2) - gains
        covs = left @ prior @ left.swapaxes(1, 2) + gains @ noise @ gains.swapaxes(1, 2)
        self._landmarks[new] += np.einsum("sij,sj->si", gains, deviation)
        G = gains.reshape(-1, 2)
        corner = G @ self._robot_cov @ G.T
        i = np.arange(len(new))
        corner.reshape(len(i), 2, len(i), 2)[i, :, i, :] += (covs + covs.swapaxes(1, 2)) / 2
        self._covs.append(G @ self._cross, (corner + corner.T) / 2)
        self._cross = np.hstack([self._cross, self._robot_cov @ G.T])
        self._place[new] = len(self._order) + i
        self._order = np.append(self._order, new)

    @property
    def mean(self) -> Array:
        """Mean of the state (n,) [m]."""
        return np.append(self._robot, self._landmarks)

    def blocks(self) -> Array:
        """Return the covariances (1 + M, 2, 2) [m^2] of the robot and of each landmark."""
        blocks = np.concatenate([self._robot_cov[np.newaxis], self._priors])
        blocks[1 + self._order] = self._covs.blocks()
        return blocks

    def rows(self, components: Indices) -> Array:
        """Return the rows (d, n) [m^2] of the covariance for these components of the state."""
        n = 2 + self._landmarks.size
        found = np.zeros((len(components), n))
        columns = np.asarray((2 + 2 * self._order[:, np.newaxis] + [0, 1]).ravel(), dtype=np.int64)
        robot = np.flatnonzero(components < 2)
        found[robot, :2] = self._robot_cov[components[robot]]
        found[np.ix_(robot, columns)] = self._cross[components[robot]]
        others = np.flatnonzero(components >= 2)
        landmarks, coordinates = np.divmod(components[others] - 2, 2)
        unseen = self._place[landmarks] == len(self._landmarks)
        for i in (0, 1):
            variances = self._priors[landmarks[unseen], coordinates[unseen], i]
            found[others[unseen], 2 + 2 * landmarks[unseen] + i] = variances
        places = 2 * self._place[landmarks[~unseen]] + coordinates[~unseen]
        ascending = np.argsort(places, kind="stable")
        seen = others[~unseen][ascending]
        found[seen, :2] = self._cross[:, places[ascending]].T
        found[np.ix_(seen, columns)] = self._covs.rows(places[ascending])
        return found

    def settle(self) -> None:
        """Apply to the covariance what still waits: no answer changes but for rounding."""
        self._covs.settle()

    def cov(self) -> Array:
        """Return the covariance (n, n) [m^2] of the state."""
        n = 2 + self._landmarks.size
        self.settle()
        cov = np.empty((n, n))
        for start in range(0, n, CHUNK):
            stop = min(start + CHUNK, n)
            cov[start:stop] = self.rows(np.arange(start, stop))
            cov[:start, start:stop] = cov[start:stop, :start].T  # equal but for rounding
            corner = cov[start:stop, start:stop]
            corner[...] = (corner + corner.T) / 2
        return cov
