"""Trap data: experiments and single steps on which a mistake shows.

Question answered: on which inputs is an answer tried?  Beside the handout's, worlds with full, anisotropic noise of the
robot, another (2, 2) noise block for every landmark, other numbers of landmarks and instants, another centre and speed.
What all of them keep is the lab's structure: F turns the robot, H subtracts it from landmarks, neither Q nor R couples
landmarks; an honest answer may rely on it.  P = 17 or 23 particles, so that no two sizes are equal.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from data_simulation import HANDOUT, Scenario, data_simulation
from lab.problem import Experiment, LinearGaussianModel, Problem
from lab.validation import Array

TINY = 1e-9  # landmark noise [m] that counts as none, yet lets Q be factored


class Moment(NamedTuple):
    """One instant's worth of input for the steps: a model and what is seen, as arrays with NaN."""

    label: str
    z: Array
    H: Array
    R: Array
    model: LinearGaussianModel


def covariance(rng: np.random.Generator, n: int, scale: float) -> Array:
    """Return a full, anisotropic, well-conditioned covariance with positive entries off the diagonal."""
    root = np.abs(rng.standard_normal((n, n))) * rng.uniform(0.5, 1.5, (n, 1)) + np.diag(rng.uniform(0.5, 1, n))
    cov = root @ root.T
    return np.asarray(scale**2 * cov / np.mean(np.diag(cov)))


def blocks(rng: np.random.Generator, n_landmarks: int, scale: float) -> Array:
    """Return a covariance (2M, 2M) that couples no landmarks, with a different full block for each."""
    cov = np.zeros((2 * n_landmarks, 2 * n_landmarks))
    for m in range(n_landmarks):
        cov[2 * m : 2 * m + 2, 2 * m : 2 * m + 2] = covariance(rng, 2, scale * rng.uniform(0.7, 1.4))
    return cov


def some(*counts: int) -> object:
    """Return a field of view that shows the first `counts[k]` of the landmarks in an order that turns with time."""
    calls = iter(range(1, 10**6))  # the first call is for k = 1

    def rule(z: Array, o: Array) -> Array:
        k = next(calls)
        order = np.roll(np.arange(len(z)), k)
        shown = np.zeros(len(z), dtype=bool)
        shown[order[: counts[k % len(counts)]]] = True
        return shown

    return rule


def scenario(
    n_landmarks: int, seed: int, field_of_view: object = "exogenous", n_steps: int = 12, coupled: bool = False
) -> Scenario:
    """Return a world with anisotropic noise everywhere; `coupled` gives the landmarks a full prior covariance."""
    rng = np.random.default_rng(seed)
    return Scenario(
        n_steps=n_steps,
        dt=0.5,
        omega=0.9,
        centre=(0.7, -1.1),
        robot_mean=(2.0, 0.5),
        landmark_means=rng.uniform(-5, 5, (n_landmarks, 2)),
        landmark_cov=covariance(rng, 2 * n_landmarks, 0.5) if coupled else blocks(rng, n_landmarks, 0.5),
        robot_noise_cov=covariance(rng, 2, 0.25),
        landmark_noise_std=TINY,
        measurement_cov=blocks(rng, n_landmarks, 0.3),
        field_of_view=field_of_view,  # type: ignore[arg-type]
    )


def experiment(world: Scenario, seed: int = 0) -> Experiment:
    """Simulate."""
    return Experiment.from_simulation(data_simulation(scenario=world, rng=seed))


@cache
def problems() -> dict[str, Problem]:
    """Return the problems on which whole deterministic filters are tried, by what is special about them."""
    return {
        "the handout's world": experiment(HANDOUT, 7).problem,
        "five landmarks, another centre and speed": experiment(scenario(5, 1, some(1, 0, 2, 3)), 1).problem,
        "three landmarks, all seen": experiment(scenario(3, 2, some(3), coupled=True), 2).problem,
        "four landmarks, none ever seen": experiment(scenario(4, 3, some(0), n_steps=6), 3).problem,
        "two landmarks, moving a little": experiment(scenario(2, 4, some(1, 2, 0)), 4).problem.with_landmark_noise(0.1),
    }


@cache
def moments() -> tuple[Moment, ...]:
    """Return single instants: some seen, none, all, in several worlds."""
    chosen = []
    for label, problem, instants in (
        ("the handout's world", problems()["the handout's world"], None),
        ("five landmarks, another centre", problems()["five landmarks, another centre and speed"], None),
        ("three landmarks, coupled in the prior", problems()["three landmarks, all seen"], None),
    ):
        counts = (~np.isnan(problem.z)).sum(axis=1) // 2
        wanted = sorted(set(counts[1:].tolist()), reverse=True) if instants is None else instants
        for count in wanted:
            k = int(np.flatnonzero(counts[1:] == count)[-1]) + 1
            what = "nothing" if not count else "everything" if count == problem.n_landmarks else f"{count} landmarks"
            what = what.replace("1 landmarks", "1 landmark")
            chosen.append(Moment(f"{label}, {what} seen", problem.z[k], problem.H[k], problem.R[k], problem.model))
    return tuple(chosen)


def belief(moment: Moment, seed: int) -> tuple[Array, Array]:
    """Return a mean (n,) and a full covariance (n, n) as a filter might have them before a step."""
    rng = np.random.default_rng(seed)
    n = len(moment.model.m0)
    return moment.model.m0 + 0.3 * rng.standard_normal(n), covariance(rng, n, 0.4)


def cloud(moment: Moment, n_particles: int, seed: int, spread: float = 0.15) -> tuple[Array, Array, Array]:
    """Return particles (n, P) about the prior mean, uneven weights (P,), two 0, and noise (n, P)."""
    rng = np.random.default_rng(seed)
    n = len(moment.model.m0)
    particles = moment.model.m0[:, np.newaxis] + spread * rng.standard_normal((n, n_particles))
    weights = rng.gamma(0.8, size=n_particles)
    weights[[2, 9]] = 0
    noise = np.zeros((n, n_particles))
    noise[:2] = np.linalg.cholesky(moment.model.Q[:2, :2]) @ rng.standard_normal((2, n_particles))
    return particles, weights / weights.sum(), noise


def closer(moment: Moment, particles: Array, noise: Array, far: float = 0.0) -> Moment:
    """Return the moment with measurements near what the cloud predicts, or `far` metres off."""
    moved = moment.model.F @ particles + moment.model.B[:, np.newaxis] + noise
    rng = np.random.default_rng(5)
    z = moment.H @ moved.mean(axis=1) + far + 0.2 * rng.standard_normal(len(moment.z))
    return moment._replace(z=z)


@cache
def handout_model(n_landmarks: int) -> LinearGaussianModel:
    """Return the handout's model with that many landmarks: what somebody has who typed its constants in."""
    means = np.resize(np.asarray(HANDOUT.landmark_means), (n_landmarks, 2))
    return experiment(replace(HANDOUT, n_steps=2, landmark_means=means)).problem.model


def with_robot_prior(model: LinearGaussianModel) -> LinearGaussianModel:
    """Return the model with an uncertain robot at k = 0, as in the older edition of the handout."""
    P0 = model.P0.copy()
    P0[:2, :2] = ((0.3, 0.1), (0.1, 0.2))
    return replace(model, P0=P0)


@cache
def quiet() -> Problem:
    """Return a short experiment with much measurement noise, where even SIS keeps most of its particles for a while.

    Instant 3 sees nothing; 1, 2 and 4 see two, one and all three landmarks.
    """
    world = replace(scenario(3, 8, some(0, 2, 1, 0, 3), n_steps=5), landmark_cov=_leaning(), measurement_cov=_loud())
    return experiment(world, 28).problem


@cache
def lively() -> Problem:
    """Return a short experiment on which even a Rao-Blackwellized filter has to resample."""
    world = replace(scenario(3, 8, some(0, 2, 3, 0, 2), n_steps=5), landmark_cov=_leaning())
    return experiment(replace(world, measurement_cov=0.3 * _loud()), 51).problem


def _leaning() -> Array:
    """Return a prior of the landmarks whose blocks lean, each its own way."""
    cov = np.zeros((6, 6))
    for m, block in enumerate(([[0.5, 0.3], [0.3, 0.3]], [[0.2, -0.15], [-0.15, 0.4]], [[0.1, 0.08], [0.08, 0.5]])):
        cov[2 * m : 2 * m + 2, 2 * m : 2 * m + 2] = block
    return cov


def _loud() -> Array:
    cov = np.zeros((6, 6))
    for m, block in enumerate(([[0.5, 0.25], [0.25, 0.8]], [[1.2, -0.5], [-0.5, 0.6]], [[0.4, 0.2], [0.2, 0.9]])):
        cov[2 * m : 2 * m + 2, 2 * m : 2 * m + 2] = block
    return cov


@cache
def blinking(strength: str) -> Problem:
    """Return an experiment that sees once, at k = 1, and then nothing: "strong" ruins the weights, "weak" does not.

    Since landmarks stand still, their moments can change after k = 1 by resampling only. "robot" ruins weights that
    are conditional on the path alone, too: the landmarks are known better than where the robot has slipped to.
    "middle" is short, and shares the weight of two particles in all ways.
    """
    steps = {"weak": 13, "middle": 3}.get(strength, 6)
    known = 0.02 if strength == "robot" else 1.0
    world = replace(scenario(3, 9, some(0, 3, *[0] * 20), n_steps=steps), landmark_cov=known * _leaning())
    noise = {"strong": 0.5, "middle": 1.0, "weak": 4.0, "robot": 0.05}[strength] ** 2
    return experiment(replace(world, measurement_cov=noise * np.eye(6)), 9).problem
