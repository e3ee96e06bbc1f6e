"""The exact posterior of the whole path and map, by eliminating the landmarks.

Question answered: what is known in the end of every pose and every landmark?  Landmarks that do not move and that
nothing couples are independent given the path r = (r_0..r_{N-1}): with D_k = R_k^-1 at instants that saw landmark j,

    C_j = (P0_j^-1 + sum_k D_k)^-1                    the covariance of landmark j, the path being known
    G_j = C_j [D_k]                                   how its mean leans on the path: it moves with the robot
    Lambda = sum_j diag(D_k) - [D_k]' C_j [D_k]       what the sightings tell about the path (the Schur complement)
    path:  cov = L (I + L' Lambda L)^-1 L'            L L' its prior covariance, singular where a robot is known
    m_j:   cov = C_j + G_j cov(path) G_j'

O(sightings) for the landmarks and O(N^3) for the path: no matrix of the size of the map is ever formed.
Source: Thrun, Burgard and Fox, Probabilistic Robotics (2005), chapter 11 (GraphSLAM), in covariance form.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from lab import gaussian
from lab.blocks import SINGULAR, determinants, inverses
from lab.problem import Problem, require_problem
from lab.solvers.exact import kalman, smoother
from lab.sparse import SparseProblem
from lab.validation import Array, InputError

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Indices = NDArray[np.int64]


class SmoothedMap(NamedTuple):
    """What is known of every pose and of every landmark given ALL measurements, each by itself.

    path : (N, 2) E[r_k given z_1..z_{N-1}] [m];  path_covs : (N, 2, 2) [m^2];
    landmarks : (M, 2) E[m_j given z_1..z_{N-1}] at the last instant [m];  landmark_covs : (M, 2, 2) [m^2];
    log_evidence : log p(z_1..z_{N-1}).
    """

    path: Array
    path_covs: Array
    landmarks: Array
    landmark_covs: Array
    log_evidence: float


def smooth_map(problem: Problem | SparseProblem) -> SmoothedMap:
    """Return the exact posterior of all robot poses and, at the last instant, of all landmarks.

    Parameters
    ----------
    problem : Problem or SparseProblem
        Where landmarks move, P0, Q or some R couples them, or some R is singular, `smoother` is run instead.

    Returns
    -------
    SmoothedMap

    Raises
    ------
    InputError
        As `kalman`.
    """
    try:
        sparse = problem if isinstance(problem, SparseProblem) else SparseProblem.of(require_problem(problem))
    except InputError:
        return _dense(require_problem(problem))  # says again what is no problem at all
    R = np.where(np.isnan(sparse.R), np.eye(2), sparse.R)
    variances = np.diagonal(R, axis1=1, axis2=2).prod(axis=1)
    if sparse.landmark_noise.any() or (determinants(R) <= SINGULAR * variances).any():
        return _dense(sparse.dense() if isinstance(problem, SparseProblem) else problem)
    return _eliminate(sparse, R)


def _dense(problem: Problem) -> SmoothedMap:
    filtered = kalman(problem)
    means, covs, _ = smoother(problem, filtered)
    last = covs[-1].reshape(means.shape[1] // 2, 2, -1, 2)
    i = np.arange(1, 1 + problem.n_landmarks)
    evidence = float(filtered.log_evidence[-1])
    return SmoothedMap(means[:, :2], covs[:, :2, :2], means[-1, 2:].reshape(-1, 2), last[i, :, i, :], evidence)


def _eliminate(problem: SparseProblem, R: Array) -> SmoothedMap:
    """Solve for the path with the landmarks eliminated, then for each landmark; R (S, 2, 2) is regular."""
    N, M = problem.n_instants, problem.n_landmarks
    k, j = problem.instants, problem.landmarks
    path, L = _prior_path(problem)
    D = np.where(np.isnan(problem.R), 0, inverses(R))

    prior, information = problem.landmark_covs, _sums(D, j, M)
    left = np.eye(2) + prior @ information
    C = inverses(left) @ prior
    C = (C + C.swapaxes(1, 2)) / 2
    deviation = np.nan_to_num(problem.z + path[k] - problem.landmark_means[j])
    move = _times(C, _sums(_times(D, deviation), j, M))  # of the landmarks, the path being as expected
    weight = _sparse(D, j, k, (2 * M, 2 * N))
    G = _sparse(C[j] @ D, j, k, (2 * M, 2 * N))

    Lambda = scipy.linalg.block_diag(*_sums(D, k, N)) - (weight.T @ G).toarray()
    towards = -_sums(_times(D, deviation - move[j]), k, N).ravel()
    root = np.linalg.cholesky(np.eye(L.shape[1]) + L.T @ Lambda @ L)
    half = scipy.linalg.solve_triangular(root, L.T, lower=True, check_finite=False)  # half' half is the covariance
    whitened = half @ towards
    shift = half.T @ whitened
    by_instant = half.T.reshape(N, 2, -1)
    move += (G @ shift).reshape(M, 2)
    spread = (G @ half.T).reshape(M, 2, -1)

    # log N(z) by its exponent at the posterior mean, where nothing large cancels
    residual = deviation + shift.reshape(N, 2)[k] - move[j]
    pulls = _sums(_times(D, residual), j, M)  # P0_j^-1 move_j, but for rounding
    regular = determinants(prior) > SINGULAR * np.diagonal(prior, axis1=1, axis2=2).prod(axis=1)
    pulls[regular] = _times(inverses(prior[regular]), move[regular])
    source = scipy.linalg.solve_triangular(
        root, whitened, lower=True, trans="T", check_finite=False
    )  # shift = L source
    quadratic = np.sum(residual * _times(D, residual)) + np.sum(move * pulls) + source @ source
    logs = np.log(np.concatenate([determinants(left), determinants(R), np.diag(root) ** 2])).sum()
    evidence = -(quadratic + logs + np.count_nonzero(~np.isnan(problem.z)) * gaussian.LOG_2PI) / 2
    return SmoothedMap(
        path + shift.reshape(N, 2),
        by_instant @ by_instant.swapaxes(1, 2),
        problem.landmark_means + move,
        C + spread @ spread.swapaxes(1, 2),
        float(evidence),
    )


def _prior_path(problem: SparseProblem) -> tuple[Array, Array]:
    """Return the prior mean (N, 2) of the path and a factor L (2N, d) of its prior covariance."""
    N = problem.n_instants
    path, L = [problem.robot_mean], np.zeros((N, 2, N, 2))
    L[0, :, 0] = _factor(problem.robot_cov)
    slip = _factor(problem.Q)
    for k in range(1, N):
        path.append(problem.F @ path[-1] + problem.B)
        L[k] = np.tensordot(problem.F, L[k - 1], 1)
        L[k, :, k] = slip
    return np.array(path), L.reshape(2 * N, 2 * N)


def _factor(cov: Array) -> Array:
    """Return a factor of a covariance (2, 2), singular or not."""
    factor, spread = np.zeros((2, 2)), gaussian.split(cov, np.array([0, 1]))[0]
    factor[:, : spread.shape[1]] = spread
    return factor


def _times(blocks: Array, vectors: Array) -> Array:
    """Return the products (S, 2) of blocks (S, 2, 2) with vectors (S, 2)."""
    return np.asarray(np.einsum("sab,sb->sa", blocks, vectors))


def _sums(values: Array, groups: Indices, count: int) -> Array:
    """Return the sums (count, ...) of values (S, ...) by their group."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    sums = [np.bincount(groups, weights=column, minlength=count) for column in flat.T]
    return np.asarray(np.stack(sums, axis=1), dtype=np.float64).reshape(count, *values.shape[1:])


def _sparse(blocks: Array, rows: Indices, columns: Indices, shape: tuple[int, int]) -> "csr_array":
    """Return the sparse matrix of blocks (S, 2, 2) at these places."""
    from scipy.sparse import csr_array

    i = 2 * rows[:, np.newaxis, np.newaxis] + np.array([[0], [1]])
    j = 2 * columns[:, np.newaxis, np.newaxis] + np.array([[0, 1]])
    i, j = np.broadcast_arrays(i, j)
    return csr_array((blocks.ravel(), (i.ravel(), j.ravel())), shape=shape)
