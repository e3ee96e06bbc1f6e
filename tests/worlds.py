"""Experiments for the tests: the handout's, and worlds on which transposed factors and sliced blocks show."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from data_simulation import HANDOUT, Scenario, data_simulation
from lab.problem import Experiment, Problem

REFERENCE = Path(__file__).parent / "reference"


def covariance(rng: np.random.Generator, n: int, scale: float) -> np.ndarray:
    """Return a full, well-conditioned covariance."""
    root = rng.standard_normal((n, n + 3))
    return scale**2 * root @ root.T / (n + 3)


def everything(z: np.ndarray, o: np.ndarray) -> np.ndarray:
    return np.full(len(z), True)


def nothing(z: np.ndarray, o: np.ndarray) -> np.ndarray:
    return np.full(len(z), False)


def full_scenario(
    n_landmarks: int, seed: int = 0, field_of_view: object = "outward-ahead", n_steps: int = 30
) -> Scenario:
    """Return a world with full, anisotropic covariances everywhere."""
    rng = np.random.default_rng(seed)
    return Scenario(
        n_steps=n_steps,
        dt=0.5,
        omega=0.9,
        centre=(0.7, -1.1),
        robot_mean=(2.0, 0.5),
        robot_cov=covariance(rng, 2, 0.3),
        landmark_means=rng.uniform(-5, 5, (n_landmarks, 2)),
        landmark_cov=covariance(rng, 2 * n_landmarks, 0.5),
        robot_noise_cov=covariance(rng, 2, 0.2),
        measurement_cov=covariance(rng, 2 * n_landmarks, 0.3),
        field_of_view=field_of_view,
    )


def blocks(rng: np.random.Generator, count: int, scale: float) -> np.ndarray:
    """Return a covariance of full (2, 2) blocks: anisotropic, and nothing coupled."""
    cov = np.zeros((2 * count, 2 * count))
    for i in range(0, 2 * count, 2):
        cov[i : i + 2, i : i + 2] = covariance(rng, 2, scale)
    return cov


def block_scenario(
    n_landmarks: int, seed: int = 0, field_of_view: object = "outward-ahead", n_steps: int = 30
) -> Scenario:
    """Return the world of `full_scenario` without what couples landmarks."""
    rng = np.random.default_rng(seed + 100)
    return replace(
        full_scenario(n_landmarks, seed, field_of_view, n_steps),
        landmark_cov=blocks(rng, n_landmarks, 0.5),
        measurement_cov=blocks(rng, n_landmarks, 0.3),
    )


def experiment(scenario: Scenario = HANDOUT, seed: int = 0) -> Experiment:
    return Experiment.from_simulation(data_simulation(scenario=scenario, rng=seed))


def problem(scenario: Scenario = HANDOUT, seed: int = 0) -> Problem:
    return experiment(scenario, seed).problem


def reference(number: int = 1) -> Experiment:
    return Experiment.load(REFERENCE / f"experiment_{number}.mat")


WORLDS = {
    "handout": lambda: problem(),
    "full-5": lambda: problem(full_scenario(5)),
    "full-1": lambda: problem(full_scenario(1)),
    "full-3-all-seen": lambda: problem(full_scenario(3, field_of_view=everything)),
    "full-20": lambda: problem(full_scenario(20)),
    "full-20-all-seen": lambda: problem(full_scenario(20, field_of_view=everything, n_steps=12)),
    "nothing-seen": lambda: problem(full_scenario(3, field_of_view=nothing)),
    "exogenous": lambda: problem(full_scenario(4, field_of_view="exogenous")),
    "diffuse": lambda: problem(replace(full_scenario(3), landmark_cov=1e4, landmark_noise_std=5e-5)),
    "landmark-noise": lambda: problem(full_scenario(3)).with_landmark_noise(0.05),
}


def moving(given: Problem, noise: np.ndarray) -> Problem:
    """Return the problem with this noise (2M, 2M) added for the landmarks."""
    Q = given.model.Q.copy()
    Q[2:, 2:] += noise
    return replace(given, model=replace(given.model, Q=Q))


def with_holes(given: Problem) -> Problem:
    """Return the problem with single coordinates missing, of first sightings and of later ones."""
    z = given.z.copy()
    z[1, 0] = z[4, 1] = z[7, 2] = z[7, 3] = z[9, -1] = np.nan
    return replace(given, z=z)


def with_known_map(given: Problem) -> Problem:
    """Return the problem whose landmarks have neither a prior covariance nor noise."""
    P0, Q = given.model.P0.copy(), given.model.Q.copy()
    P0[2:, 2:] = Q[2:, 2:] = 0
    return replace(given, model=replace(given.model, P0=P0, Q=Q))


# Nothing couples two landmarks here: the worlds of the exact filter's structured form.
BLOCK_WORLDS = {
    "handout": lambda: problem(),
    "blocks-1": lambda: problem(block_scenario(1)),
    "blocks-3-all-seen": lambda: problem(block_scenario(3, field_of_view=everything)),
    "blocks-5": lambda: problem(block_scenario(5)),
    "blocks-20": lambda: problem(block_scenario(20)),
    "blocks-140-all-seen": lambda: problem(block_scenario(140, field_of_view=everything, n_steps=4)),
    "blocks-140": lambda: problem(block_scenario(140, n_steps=12)),
    "blocks-nothing-seen": lambda: problem(block_scenario(3, field_of_view=nothing)),
    "blocks-exogenous": lambda: problem(block_scenario(4, field_of_view="exogenous")),
    "blocks-diffuse": lambda: problem(replace(block_scenario(3, field_of_view=everything), landmark_cov=1e4)),
    "blocks-holes": lambda: with_holes(problem(block_scenario(3, field_of_view=everything))),
    "blocks-jitter": lambda: problem(block_scenario(3)).with_landmark_noise(0.05),
    "blocks-moving": lambda: moving(problem(block_scenario(20)), blocks(np.random.default_rng(7), 20, 0.05)),
    "blocks-known-map": lambda: with_known_map(problem(block_scenario(3))),
}
