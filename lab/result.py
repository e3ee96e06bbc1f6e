"""What a filter returns: one `Step` per instant, collected into a `Filtered`.

Question answered: what is known about the state at instant k, given z_1..z_k?  Each field says which expectation it
holds.  Produced by every solver; read by comparisons and plots.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.validation import Array

ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Step:
    """One instant of a filter.

    Attributes
    ----------
    mean : (n,) array
        E[x_k given z_1..z_k] [m].
    cov : (n, n) array
        Cov[x_k given z_1..z_k] [m^2].
    log_evidence : float
        log p(z_1..z_k), cumulative.
    ess : float
        Effective sample size of the weights behind the moments.
    survivors : int
        Distinct ancestors of time 0 from which the cloud descends.
    cloud : object
        The weighted particles behind the moments, before any resampling.
    """

    mean: Array
    cov: Array
    log_evidence: float
    ess: float
    survivors: int
    cloud: Any


@dataclass(frozen=True, eq=False)
class Filtered:
    """A filter's answer at all instants; row 0 is the prior.

    Attributes
    ----------
    means : (N, n) array
        Row k holds E[x_k given z_1..z_k] [m].
    covs : (N, n, n) array
        Entry k holds Cov[x_k given z_1..z_k] [m^2].
    log_evidence : (N,) array
        Entry k holds log p(z_1..z_k), cumulative; entry 0 is 0.
    ess : (N,) array, optional
        Effective sample size; None for an exact filter.
    survivors : (N,) array, optional
        Distinct ancestors of time 0 still alive; None where there are no particles.
    """

    means: Array
    covs: Array
    log_evidence: Array
    ess: Array | None = None
    survivors: Array | None = None

    @property
    def uncertain(self) -> NDArray[np.bool_]:
        """Which components (N, n) have a deviation at all: beyond 1e-12 of the largest, which is rounding."""
        return np.asarray(self.stds > ROUNDING * self.stds.max())

    @property
    def stds(self) -> Array:
        """Standard deviations (N, n) [m]: square roots of the diagonals of `covs`."""
        return np.sqrt(np.diagonal(self.covs, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class FilteredMap:
    """An exact filter's answer where all its covariances would not fit in memory; row 0 is the prior.

    Attributes
    ----------
    means : (N, n) array
        Row k holds E[x_k given z_1..z_k] [m].
    blocks : (N, 1 + M, 2, 2) array
        Covariances [m^2] of the robot and of each landmark at each instant.
    log_evidence : (N,) array
        Entry k holds log p(z_1..z_k), cumulative; entry 0 is 0.
    rows : function
        ``rows(components) -> (d, n)`` [m^2]: rows of the whole covariance at the last instant.
    """

    means: Array
    blocks: Array
    log_evidence: Array
    rows: Callable[[Any], Array]

    @property
    def stds(self) -> Array:
        """Standard deviations (N, n) [m]."""
        return np.sqrt(np.diagonal(self.blocks, axis1=2, axis2=3)).reshape(self.means.shape)


def collect(steps: Iterable[Step]) -> Filtered:
    """Run an iterator of steps to its end and stack what it yields.

    Parameters
    ----------
    steps : iterable of Step
        At least one.

    Returns
    -------
    Filtered
    """
    rows = [(step.mean, step.cov, step.log_evidence, step.ess, step.survivors) for step in steps]
    means, covs, log_evidence, ess, survivors = (np.array(column) for column in zip(*rows, strict=True))
    return Filtered(means, covs, log_evidence, ess, survivors)
