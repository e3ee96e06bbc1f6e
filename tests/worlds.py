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
