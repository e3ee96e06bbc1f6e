"""Importance functions: how a cloud gets from instant k - 1 to k, and what that does to its weights.

Question answered: from which density are the new particles drawn, and what is left to algebra?  Every particle is a
Gaussian N(mean, cov): what was sampled has no variance, what was not is known by its conditional mean, and ``cov`` is
the same for all particles, because H, R and visibility do not depend on them.  So one step serves every filter here:

    predict    mean' = F mean + B,  cov' = F cov F' + Q
    draw       x_A ~ N(mean_A, cov_AA), the rest conditioned on x_A          the components A that are to be sampled
    update     mean, cov given z_k;  log-weight += log N(z_k; H mean, H cov H' + R)

The prior proposal draws before it updates (weight of the child), the optimal one updates first and then draws from
p(x_A given x_{k-1}, z_k) (weight of the parent).  What A holds makes the filter:

    everything                     prior, optimal
    robot, landmarks once seen     delayed: a landmark never seen is still its prior, and is drawn from p(m given r, z)
    robot                          rbpf_prior, rbpf_optimal: landmarks stay conditional Gaussians (Rao-Blackwell)

Source: questions 3, 9 and 10 of the handout; Doucet, Godsill and Andrieu (2000).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from lab import gaussian
from lab.problem import Problem
from lab.validation import Array, InputError

Rows = Any  # (d,) array of int: components of the state
REMEMBERED = 200  # components of a state whose laws are kept: each holds a covariance


@dataclass(frozen=True, eq=False)
class Cloud:
    """Weighted particles, each of them N(particles[:, i], cov).

    Attributes
    ----------
    particles : (n, P) array
        Dimension first [m]: samples, and conditional means of what has not been sampled.
    log_weights : (P,) array
        Normalised: their exponentials sum to 1.
    cov : (n, n) array
        Conditional covariance that all particles share [m^2]; 0 in the rows and columns of what has been sampled.
    """

    particles: Array
    log_weights: Array
    cov: Array

    @property
    def unsampled(self) -> Rows:
        """Indices (d,) of the components that are known by their conditional Gaussian only."""
        return np.flatnonzero(np.diag(self.cov) > 0)


@dataclass(frozen=True, eq=False)
class StepLaw:
    """One step before any random number is drawn: affine maps that all particles share, after x -> F x + B.

    The theory runs on the same laws as the particles.

    Attributes
    ----------
    draw_first : bool
        Whether the draw comes before the update, as in the prior proposal.
    spread : (n, d) array
        The draw adds spread @ (d standard normals).
    z, H, S, K : (p,), (p, n), (p, p), (n, p) arrays
        The update weighs by N(z; H mean, S) and adds K (z - H mean).
    cov : (n, n) array
        The shared covariance afterwards.
    """

    draw_first: bool
    spread: Array
    z: Array
    H: Array
    S: Array
    K: Array
    cov: Array


@dataclass(frozen=True)
class GaussianProposal:
    """An importance function that is linear and Gaussian, by two choices.

    Attributes
    ----------
    look_ahead : bool
        Whether z_k guides the draw (optimal) or only weighs it (prior).
    sampled : function
        (problem, k) -> components to be sampled by instant k.
    """

    look_ahead: bool
    sampled: Callable[[Problem, int], Rows]

    def start(self, problem: Problem, n_particles: int, rng: np.random.Generator) -> Cloud:
        """Draw the cloud of time 0 from the prior; what is not to be sampled yet is conditioned on what is."""
        model = problem.model
        spread, left = gaussian.split(model.P0, self.sampled(problem, 0))
        particles = np.repeat(model.m0[:, np.newaxis], n_particles, axis=1)
        _add(particles, spread, rng.standard_normal((spread.shape[1], n_particles)))
        return Cloud(particles, np.full(n_particles, -np.log(n_particles)), left)

    def start_law(self, problem: Problem) -> tuple[Array, Array]:
        """Return mean (n,) and covariance (n, n) of a particle of time 0."""
        spread, _ = gaussian.split(problem.model.P0, self.sampled(problem, 0))
        return problem.model.m0, spread @ spread.T

    def law(self, cov: Array, k: int, problem: Problem) -> StepLaw:
        """Return the step to k of particles whose shared covariance is `cov` at k - 1.

        Raises
        ------
        InputError
            S is singular, so that z_k has no density.
        """
        known = _laws.setdefault(problem, {})
        before = known.get((self, k))
        if before is not None and np.array_equal(before[0], cov):
            return before[1]
        law = self._computed_law(cov, k, problem)
        if len(cov) <= REMEMBERED:
            known[self, k] = (np.array(cov), law)
        return law

    def _computed_law(self, cov: Array, k: int, problem: Problem) -> StepLaw:
        model, rows = problem.model, self.sampled(problem, k)
        z, H, R = problem.seen(k)
        _, predicted = gaussian.predict(model.m0, cov, model.F, model.B, model.noise_cov)
        if not self.look_ahead:
            spread, predicted = gaussian.split(predicted, rows)
        S = H @ predicted @ H.T + R
        try:
            K = gaussian.gain(predicted, H, S)
        except np.linalg.LinAlgError:
            raise InputError(
                f"The covariance of z given a particle (R, where everything is sampled) must be positive definite for"
                f" its density to exist, which it is not at k = {k}."
            ) from None
        updated = gaussian.joseph(predicted, K, H, R)
        if self.look_ahead:
            spread, updated = gaussian.split(updated, rows)
        for array in (spread, S, K, updated):
            array.flags.writeable = False  # all runs on this problem share them
        return StepLaw(not self.look_ahead, spread, z, H, S, K, updated)

    def laws(self, problem: Problem) -> Iterator[StepLaw]:
        """Yield the steps to k = 1, 2, ..., which depend on what is seen and not on the particles."""
        _, cov = gaussian.split(problem.model.P0, self.sampled(problem, 0))
        for k in range(1, problem.n_instants):
            law = self.law(cov, k, problem)
            cov = law.cov
            yield law

    def __call__(self, cloud: Cloud, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Cloud, Array]:
        """Return the cloud moved to instant k and its log-weight increments (P,)."""
        law, model, moving = self.law(cloud.cov, k, problem), problem.model, problem.model.moving
        particles = cloud.particles.copy()
        read = model.F[moving].any(axis=0)
        particles[moving] = model.F[np.ix_(moving, read)] @ cloud.particles[read] + model.B[moving, np.newaxis]
        normals = rng.standard_normal((law.spread.shape[1], particles.shape[1]))
        if law.draw_first:
            _add(particles, law.spread, normals)
        read = law.H.any(axis=0)
        innovation = law.z[:, np.newaxis] - law.H[:, read] @ particles[read]
        increment = gaussian.log_density(innovation, law.S)
        _add(particles, law.K, innovation)
        if not law.draw_first:
            _add(particles, law.spread, normals)
        return Cloud(particles, cloud.log_weights, law.cov), increment


def _everything(problem: Problem, k: int) -> Rows:
    return np.arange(len(problem.model.m0))


def _robot(problem: Problem, k: int) -> Rows:
    return np.arange(2)


def _robot_and_seen(problem: Problem, k: int) -> Rows:
    """Return the robot's components and both of every landmark of which anything has been seen by instant k."""
    landmarks = (~np.isnan(problem.z[: k + 1])).any(axis=0).reshape(-1, 2).any(axis=1)
    return np.concatenate([[0, 1], 2 + np.flatnonzero(np.repeat(landmarks, 2))])


def _add(particles: Array, map_: Array, deviations: Array) -> None:
    """Add map_ @ deviations in place, to the components that it touches: landmarks mostly stay as they are."""
    rows = np.flatnonzero(map_.any(axis=1))
    particles[rows] += map_[rows] @ deviations


_laws: WeakKeyDictionary[Problem, dict[Any, tuple[Array, StepLaw]]] = WeakKeyDictionary()  # problems never change

prior = GaussianProposal(look_ahead=False, sampled=_everything)
optimal = GaussianProposal(look_ahead=True, sampled=_everything)
delayed = GaussianProposal(look_ahead=True, sampled=_robot_and_seen)
rbpf_prior = GaussianProposal(look_ahead=False, sampled=_robot)
rbpf_optimal = GaussianProposal(look_ahead=True, sampled=_robot)
