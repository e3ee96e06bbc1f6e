"""Block-diagonal covariances, by their (2, 2) blocks.

Question answered: which blocks is a covariance made of when nothing couples two points of the plane, and what are their
Cholesky factors, determinants and inverses?  Thousands of blocks are handled at a time, as a stack (s, 2, 2), by
formulas: numpy calls LAPACK once for each.  Called by `lab.sparse`, `lab.simulation` and `lab.solvers.elimination`.
"""

from typing import Any

import numpy as np

from lab.validation import Array, InputError, check_covariance

SINGULAR = 1e-14  # of a variance: what is left of it after its Cholesky pivot is rounding


def blocks_of(name: str, cov: Array) -> Array:
    """Return the (s, 2, 2) blocks on the diagonal of a covariance (2s, 2s) that has no others.

    Raises
    ------
    InputError
        It has; the message starts with `name`.
    """
    i = np.arange(len(cov) // 2)
    blocks = cov.reshape(len(i), 2, len(i), 2)[i, :, i, :]
    if np.count_nonzero(cov) != np.count_nonzero(blocks):
        raise InputError(f"{name} couples landmarks with each other or with the robot.")
    return blocks


def from_blocks(blocks: Array) -> Array:
    """Return the block-diagonal matrix (2s, 2s) of blocks (s, 2, 2)."""
    i = np.arange(len(blocks))
    cov = np.zeros((len(i), 2, len(i), 2))
    cov[i, :, i, :] = blocks
    return cov.reshape(2 * len(i), -1)


def stack(name: str, cov: Any, count: int) -> Array:
    """Return the blocks (count, 2, 2) of a covariance given as a scalar, a diagonal (2 count,) or a matrix.

    Raises
    ------
    InputError
        The matrix has other blocks.
    """
    value = np.asarray(cov, dtype=np.float64)
    if value.ndim == 2:
        return blocks_of(name, value)
    blocks = np.zeros((count, 2, 2))
    blocks[:, [0, 1], [0, 1]] = np.broadcast_to(value, 2 * count).reshape(count, 2)
    return blocks


def check_blocks(name: str, blocks: Array) -> None:
    """Refuse the first block that is no covariance.

    Raises
    ------
    InputError
        One is not; the message names it.
    """
    a, b, c, d = blocks[:, 0, 0], blocks[:, 0, 1], blocks[:, 1, 0], blocks[:, 1, 1]
    for i in np.flatnonzero((a < 0) | (d < 0) | (b != c) | (a * d < b * c)):  # only what looks suspicious
        check_covariance(f"{name}[{i}]", blocks[i])


def roots(covs: Array) -> Array:
    """Return the lower Cholesky factors (s, 2, 2) of semidefinite blocks."""
    factors = np.zeros_like(covs)
    factors[:, 0, 0] = np.sqrt(covs[:, 0, 0])
    np.divide(covs[:, 1, 0], factors[:, 0, 0], out=factors[:, 1, 0], where=factors[:, 0, 0] > 0)
    rest = covs[:, 1, 1] - factors[:, 1, 0] ** 2
    factors[:, 1, 1] = np.sqrt(np.where(rest > SINGULAR * covs[:, 1, 1], rest, 0))
    return factors


def determinants(blocks: Array) -> Array:
    """Return the determinants (s,) of blocks (s, 2, 2)."""
    return np.asarray(blocks[:, 0, 0] * blocks[:, 1, 1] - blocks[:, 0, 1] * blocks[:, 1, 0])


def inverses(blocks: Array) -> Array:
    """Return the inverses (s, 2, 2) of regular blocks."""
    adjugates = np.empty_like(blocks)
    adjugates[:, 0, 0], adjugates[:, 1, 1] = blocks[:, 1, 1], blocks[:, 0, 0]
    adjugates[:, 0, 1], adjugates[:, 1, 0] = -blocks[:, 0, 1], -blocks[:, 1, 0]
    return adjugates / determinants(blocks)[:, np.newaxis, np.newaxis]
