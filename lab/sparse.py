"""The estimation problem by its blocks, for maps whose matrices would not fit in memory.

Question answered: what is left of a `Problem` when nothing couples two landmarks?  With 5000 landmarks each of F, Q, P0
and every H_k has 10^8 entries, nearly all of them 0 or 1.  What remains is, in metres,

    r_k = F r_{k-1} + B + w_k,  w_k ~ N(0, Q)          m_j ~ N(m0_j, P0_j), moving by N(0, noise_j) a step or not at all
    z = m_j - r_k + v,  v ~ N(0, R)                     one line a sighting: instant k, landmark j, z (2,), R (2, 2)

Exact filter and smoother take it directly; `SparseProblem.of` finds it in a `Problem`, `dense` goes back, and
`lab.simulation` draws one.  Source: questions 2a to 2c of the handout.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lab.blocks import blocks_of, check_blocks, from_blocks
from lab.problem import NEGLIGIBLE_NOISE, LinearGaussianModel, Problem
from lab.validation import Array, InputError, check_covariance, real_array, whole_number

STACKS = ("landmark_covs", "landmark_noise", "R")


@dataclass(frozen=True, eq=False)
class SparseProblem:
    """A robot, landmarks that nothing couples, and what was seen; arrays are checked, copied and read-only.

    Attributes
    ----------
    F, Q : (2, 2) array
        The robot's transition matrix and process noise covariance [m^2].
    B, robot_mean : (2,) array
        Its constant input and prior mean [m].
    robot_cov : (2, 2) array
        Its prior covariance [m^2].
    landmark_means : (M, 2) array
        Prior means [m].
    landmark_covs, landmark_noise : (M, 2, 2) array
        Prior covariances, and covariances of the motion of one step [m^2]; negligible motion counts as none.
    n_instants : int
        N; the instants are k = 0..N-1.
    instants, landmarks : (S,) array of int
        When each sighting was made, k >= 1, and of which landmark; sorted by both, each pair once.
    z : (S, 2) array
        Measured vectors from robot to landmark [m]; one coordinate may be NaN.
    R : (S, 2, 2) array
        Their noise covariances [m^2]; NaN where z is.

    Raises
    ------
    InputError
        A field has the wrong shape or cannot be used; the message names it.
    """

    F: Array
    B: Array
    Q: Array
    robot_mean: Array
    robot_cov: Array
    landmark_means: Array
    landmark_covs: Array
    landmark_noise: Array
    n_instants: int
    instants: NDArray[np.int64]
    landmarks: NDArray[np.int64]
    z: Array
    R: Array

    def __post_init__(self) -> None:
        """Check every field and sort the sightings."""
        means = real_array("landmark_means", self.landmark_means, (-1, 2))
        if not len(means):
            raise InputError("landmark_means must have at least one landmark.")
        N = whole_number("n_instants", self.n_instants, at_least=1)
        fields: dict[str, Any] = {"landmark_means": means, "n_instants": N}
        fields |= {name: real_array(name, getattr(self, name), (2, 2)) for name in ("F", "Q", "robot_cov")}
        fields |= {name: real_array(name, getattr(self, name), (2,)) for name in ("B", "robot_mean")}
        for name in ("landmark_covs", "landmark_noise"):
            fields[name] = real_array(name, getattr(self, name), (len(means), 2, 2))
        z = real_array("z", self.z, (-1, 2), finite=False)
        R = real_array("R", self.R, (len(z), 2, 2), finite=False)
        instants = _indices("instants", self.instants, len(z), 1, N - 1)
        landmarks = _indices("landmarks", self.landmarks, len(z), 0, len(means) - 1)
        order = np.lexsort((landmarks, instants))
        twice = (np.diff(instants[order]) == 0) & (np.diff(landmarks[order]) == 0)
        if twice.any():
            i = order[np.argmax(twice)]
            raise InputError(f"landmarks holds number {landmarks[i]} twice at k = {instants[i]}.")
        unseen = np.isnan(z)
        if unseen.all(axis=1).any():
            raise InputError("z must not be NaN in both coordinates: leave out what was not seen.")
        hidden = unseen[:, :, np.newaxis] | unseen[:, np.newaxis, :]
        if (np.isnan(R) & ~hidden).any():
            raise InputError(f"R at k = {instants[np.argmax((np.isnan(R) & ~hidden).any(axis=(1, 2)))]} is NaN.")
        fields |= {"instants": instants[order], "landmarks": landmarks[order], "z": z[order]}
        fields["R"] = np.where(hidden, np.nan, R)[order]
        for name in ("Q", "robot_cov"):
            check_covariance(name, fields[name])
        for name in STACKS:
            check_blocks(name, np.nan_to_num(fields[name]))
        stds = np.sqrt(np.diagonal(fields["landmark_covs"], axis1=1, axis2=2))
        moves = np.diagonal(fields["landmark_noise"], axis1=1, axis2=2) >= (NEGLIGIBLE_NOISE * np.minimum(stds, 1)) ** 2
        both = moves[:, :, np.newaxis] & moves[:, np.newaxis, :]
        fields["landmark_noise"] = np.where(both, fields["landmark_noise"], 0)
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def n_landmarks(self) -> int:
        """M, the number of landmarks."""
        return len(self.landmark_means)

    @cached_property
    def first_sightings(self) -> NDArray[np.int64]:
        """Where in the list of sightings each instant begins, (N + 1,)."""
        return np.searchsorted(self.instants, np.arange(self.n_instants + 1))

    def seen(self, k: int) -> tuple[NDArray[np.int64], Array, Array]:
        """Return what was seen at instant k: landmarks (s,), z (s, 2) and R (s, 2, 2)."""
        which = slice(self.first_sightings[k], self.first_sightings[k + 1])
        return self.landmarks[which], self.z[which], self.R[which]

    @classmethod
    def of(cls, problem: Problem) -> Self:
        """Return the blocks of a problem in which nothing couples two landmarks.

        Raises
        ------
        InputError
            F, B or some H is not the laboratory's, or P0, Q or some R couples landmarks; the message says which.
        """
        model, M = problem.model, problem.n_landmarks
        F = model.F.copy()
        F[:2, :2] = np.eye(2)
        if model.B[2:].any() or not (np.count_nonzero(F) == len(F) and (np.diag(F) == 1).all()):
            raise InputError("F and B must turn the robot and leave the landmarks alone.")
        prior = blocks_of("P0", model.P0)
        noise = blocks_of("Q", model.Q)
        instants, landmarks = np.nonzero((~np.isnan(problem.z)).reshape(-1, M, 2).any(axis=2))
        R = np.empty((len(instants), 2, 2))
        for k in range(problem.n_instants):
            rows = np.flatnonzero(~np.isnan(problem.z[k]))
            H = problem.H[k, rows]  # a copy
            usual = (H[range(len(rows)), rows % 2] == -1) & (H[range(len(rows)), rows + 2] == 1)
            if not usual.all() or np.count_nonzero(H) != 2 * len(rows):
                raise InputError(f"H at k = {k} must measure landmark minus robot.")
            seen = landmarks[instants == k]
            blocks = problem.R[k].reshape(M, 2, M, 2)[seen, :, seen, :]
            whole = problem.R[k][np.ix_(rows, rows)]
            if np.count_nonzero(whole) != np.count_nonzero(np.nan_to_num(blocks)):
                raise InputError(f"R at k = {k} couples landmarks.")
            R[instants == k] = blocks
        return cls(
            *(model.F[:2, :2], model.B[:2], noise[0], model.m0[:2], prior[0]),
            *(model.m0[2:].reshape(M, 2), prior[1:], noise[1:], problem.n_instants),
            *(instants, landmarks, problem.z.reshape(-1, M, 2)[instants, landmarks], R),
        )

    def dense(self) -> Problem:
        """Return the same as a `Problem`, whose H and R have N 2M n entries each.

        Raises
        ------
        InputError
            They do not fit in memory.
        """
        try:
            return self._dense()
        except MemoryError:
            size = f"{16e-9 * self.n_instants * (2 * self.n_landmarks) ** 2:.0f} GB"
            raise InputError(f"H and R of {self.n_landmarks} landmarks need {size}, more than there is.") from None

    def _dense(self) -> Problem:
        N, M = self.n_instants, self.n_landmarks
        n = 2 + 2 * M
        F, B = np.eye(n), np.zeros(n)
        F[:2, :2], B[:2] = self.F, self.B
        z, R = np.full((N, M, 2), np.nan), np.full((N, M, 2, M, 2), np.nan)
        z[self.instants, self.landmarks] = self.z
        for k in range(N):
            which, _, blocks = self.seen(k)
            R[k, which[:, np.newaxis], :, which, :] = 0
            R[k, which, :, which, :] = blocks
        H = np.broadcast_to(np.hstack([np.tile(-np.eye(2), (M, 1)), np.eye(2 * M)]), (N, 2 * M, n))
        m0 = np.append(self.robot_mean, self.landmark_means)
        Q, P0 = (
            from_blocks(np.concatenate([[first], others]))
            for first, others in ((self.Q, self.landmark_noise), (self.robot_cov, self.landmark_covs))
        )
        return Problem(LinearGaussianModel(F, B, Q, m0, P0), z.reshape(N, -1), H, R.reshape(N, 2 * M, 2 * M))


def _indices(name: str, value: Any, length: int, low: int, high: int) -> NDArray[np.int64]:
    array = np.asarray(value)
    if array.shape != (length,) or (length and array.dtype.kind not in "iu"):
        raise InputError(f"{name} must hold {length} whole numbers, one for each row of z.")
    if length and (array.min() < low or array.max() > high):
        raise InputError(f"{name} must lie between {low} and {high}, not reach from {array.min()} to {array.max()}.")
    return array.astype(np.int64)
