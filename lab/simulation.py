"""The random experiment for maps whose matrices would not fit in memory.

Question answered: which data does a student of the lab receive when there are thousands of landmarks?  The experiment
of `data_simulation`, with the same random numbers in the same order, but without F, Hfull, PX0, Qw, Rv and the arrays
of H and R: the covariances of the scenario must couple no landmarks.  Source: handout, section 1.
"""

import numpy as np

from data_simulation import RULES, Scenario
from lab.blocks import roots, stack
from lab.sparse import SparseProblem
from lab.validation import Array, require_generator


def simulate(scenario: Scenario, rng: np.random.Generator) -> tuple[SparseProblem, Array]:
    """Draw the experiment of `data_simulation(scenario=scenario, rng=rng)`, number for number, by its blocks.

    Parameters
    ----------
    scenario : Scenario
        Its covariances couple no landmarks; as scalars or vectors they take no memory.
    rng : numpy.random.Generator

    Returns
    -------
    problem : SparseProblem
    truth : (N, n) array
        The true states [m].

    Raises
    ------
    InputError
        A covariance of the scenario couples landmarks.
    ValueError
        As `data_simulation` does for a field-of-view function.
    """
    N, M = scenario.n_steps, scenario.n_landmarks
    require_generator(rng)
    means, centre = np.asarray(scenario.landmark_means), np.asarray(scenario.centre)
    angle = scenario.omega * scenario.dt
    F = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    robot_cov = stack("robot_cov", scenario.robot_cov, 1)[0]
    Q = stack("robot_noise_cov", scenario.robot_noise_cov, 1)[0]
    prior, R = stack("landmark_cov", scenario.landmark_cov, M), stack("measurement_cov", scenario.measurement_cov, M)

    w, v = rng.standard_normal((2 + 2 * M, N)), rng.standard_normal((2 * M, N))
    x0 = rng.standard_normal(2 + 2 * M)
    slip = roots(Q[np.newaxis])[0]
    start = scenario.robot_mean + roots(robot_cov[np.newaxis])[0] @ x0[:2]
    robot = _turn(F, centre, start, (slip @ w[:2])[:, :-1])
    landmarks = np.empty((N, M, 2))
    landmarks[0] = means + np.einsum("mij,mj->mi", roots(prior), x0[2:].reshape(M, 2))
    landmarks[1:] = scenario.landmark_noise_std * w[2:, :-1].T.reshape(N - 1, M, 2)
    np.cumsum(landmarks, axis=0, out=landmarks)
    truth = np.hstack([robot, landmarks.reshape(N, -1)])

    watcher, map_seen = robot, landmarks
    if scenario.field_of_view == "exogenous":
        noise, first = rng.standard_normal((2, N)), rng.standard_normal(2)
        start = scenario.robot_mean + roots(robot_cov[np.newaxis])[0] @ first
        watcher, map_seen = _turn(F, centre, start, (slip @ noise)[:, :-1]), np.broadcast_to(means, (N, M, 2))
    rule = RULES[scenario.field_of_view] if isinstance(scenario.field_of_view, str) else scenario.field_of_view
    seen = np.zeros((N, M), dtype=bool)
    for k in range(1, N):
        answer = np.asarray(rule(map_seen[k] - watcher[k], watcher[k] - centre))
        if answer.shape != (M,) or answer.dtype != bool:
            raise ValueError(f"the field_of_view function must return bool ({M},), not {answer.dtype} {answer.shape}")
        seen[k] = answer
    instants, which = np.nonzero(seen)
    noise = np.einsum("sij,sj->si", roots(R)[which], v.reshape(M, 2, N)[which, :, instants])
    z = landmarks[instants, which] - robot[instants] + noise
    motion = np.zeros((M, 2, 2))
    motion[:, [0, 1], [0, 1]] = scenario.landmark_noise_std**2
    problem = SparseProblem(
        F=F,
        B=centre - F @ centre,
        Q=Q,
        robot_mean=np.asarray(scenario.robot_mean),
        robot_cov=robot_cov,
        landmark_means=means,
        landmark_covs=prior,
        landmark_noise=motion,
        n_instants=N,
        instants=instants,
        landmarks=which,
        z=z,
        R=R[which],
    )
    return problem, truth


def _turn(F: Array, centre: Array, start: Array, noise: Array) -> Array:
    path = [start]
    for step in noise.T:
        path.append(F @ path[-1] + (centre - F @ centre) + step)
    return np.array(path)
