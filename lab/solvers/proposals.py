"""Importance functions: how a cloud gets from instant k - 1 to k, and what that does to its weights.

Question answered: from which density are the new particles drawn?  Each is a `Proposal`, so a student's own fits the
same loop.
"""

from dataclasses import dataclass

import numpy as np

from lab import gaussian
from lab.problem import Problem
from lab.validation import Array, InputError


@dataclass(frozen=True, eq=False)
class Cloud:
    """Weighted particles.

    Attributes
    ----------
    particles : (n, P) array
        Dimension first [m].
    log_weights : (P,) array
        Normalised: their exponentials sum to 1.
    """

    particles: Array
    log_weights: Array


def prior(cloud: Cloud, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Cloud, Array]:
    """Draw from the prior dynamics p(x_k given x_{k-1}); the increment is then log p(z_k given x_k).

    Components that cannot move are left alone, and when nothing is seen the increment is 0.

    Raises
    ------
    InputError
        The measurement noise covariance is singular, so that p(z_k given x_k) has no density.

    Notes
    -----
    Source: questions 2b, 2c and 3 of the handout.
    """
    model = problem.model
    moving = model.moving
    particles = cloud.particles.copy()
    noise = gaussian.sample(model.noise_cov[np.ix_(moving, moving)], particles.shape[1], rng)
    particles[moving] = model.F[moving] @ cloud.particles + model.B[moving, np.newaxis] + noise
    z, H, R = problem.seen(k)
    try:
        increment = gaussian.log_density(z[:, np.newaxis] - H @ particles, R)
    except np.linalg.LinAlgError:
        raise InputError(f"A particle filter needs R to be positive definite, which it is not at k = {k}.") from None
    return Cloud(particles, cloud.log_weights), increment
