"""The posterior by elimination against the smoother, and against the one big Gaussian of path and map."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import BLOCK_WORLDS, WORLDS, block_scenario, everything, problem

from lab.problem import Experiment
from lab.simulation import simulate
from lab.solvers import elimination, kalman, smooth_map, smoother
from lab.sparse import SparseProblem
from lab.validation import InputError

FIXED = [name for name in BLOCK_WORLDS if name not in ("blocks-jitter", "blocks-moving", "blocks-140")]


def assert_is_the_smoothers(answer, given):
    filtered = kalman(given, method="dense")
    smoothed, M = smoother(given, filtered), given.n_landmarks
    np.testing.assert_allclose(answer.path, smoothed.means[:, :2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.path_covs, smoothed.covs[:, :2, :2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.landmarks.ravel(), filtered.means[-1, 2:], rtol=0, atol=1e-9)
    for j in range(M):
        block = slice(2 + 2 * j, 4 + 2 * j)
        np.testing.assert_allclose(answer.landmark_covs[j], filtered.covs[-1, block, block], rtol=0, atol=1e-9)
    assert answer.log_evidence == pytest.approx(filtered.log_evidence[-1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("world", [name for name in {**WORLDS, **BLOCK_WORLDS} if name != "blocks-140"])
def test_agrees_with_the_smoother(world):
    given = (WORLDS | BLOCK_WORLDS)[world]()
    assert_is_the_smoothers(smooth_map(given), given)


@pytest.mark.parametrize("world", FIXED)
def test_eliminates_where_it_can(world, monkeypatch):
    """The dense form would agree with the smoother without any test of the elimination."""
    monkeypatch.delattr(elimination, "smoother")
    given = BLOCK_WORLDS[world]()
    one, other = smooth_map(given), smooth_map(SparseProblem.of(given))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_agrees_with_one_big_gaussian():
    """Normal equations of all poses and landmarks at once, in information form."""
    given, _ = simulate(replace(block_scenario(6, n_steps=15), robot_cov=0.1), np.random.default_rng(2))
    N, M = given.n_instants, given.n_landmarks
    rows, right = [], []

    def observe(row, value, cov):
        root = np.linalg.inv(np.linalg.cholesky(cov))
        rows.append(root @ row)
        right.append(root @ value)

    def at(**places):
        row = np.zeros((2, 2 * (N + M)))
        for name, (i, block) in places.items():
            row[:, 2 * i : 2 * i + 2] = block
            assert name
        return row

    observe(at(r=(0, np.eye(2))), given.robot_mean, given.robot_cov)
    for k in range(1, N):
        observe(at(now=(k, np.eye(2)), before=(k - 1, -given.F)), given.B, given.Q)
    for j in range(M):
        observe(at(m=(N + j, np.eye(2))), given.landmark_means[j], given.landmark_covs[j])
    for k, j, z, R in zip(given.instants, given.landmarks, given.z, given.R, strict=True):
        observe(at(r=(k, -np.eye(2)), m=(N + j, np.eye(2))), z, R)
    A, b = np.vstack(rows), np.concatenate(right)
    cov = np.linalg.inv(A.T @ A)
    mean = (cov @ A.T @ b).reshape(-1, 2)
    answer = smooth_map(given)
    np.testing.assert_allclose(np.vstack([answer.path, answer.landmarks]), mean, rtol=0, atol=1e-9)
    blocks = [cov[i : i + 2, i : i + 2] for i in range(0, len(cov), 2)]
    np.testing.assert_allclose(np.vstack([answer.path_covs, answer.landmark_covs]), blocks, rtol=0, atol=1e-9)


def test_a_wide_prior_loses_no_digits_of_the_evidence():
    scenario = replace(block_scenario(3, field_of_view=everything), landmark_cov=1e8)
    given = problem(scenario)
    wide = kalman(given, method="structured")
    assert smooth_map(given).log_evidence == pytest.approx(wide.log_evidence[-1], rel=0, abs=1e-6)


def test_exact_measurements_take_the_dense_form():
    """R of one coordinate is 0: no information form, and still a Gaussian."""
    given = BLOCK_WORLDS["blocks-3-all-seen"]()
    R = given.R.copy()
    R[5, 0, :] = R[5, :, 0] = 0
    exact = replace(given, R=R)
    assert_is_the_smoothers(smooth_map(exact), exact)
    sparse = SparseProblem.of(exact)
    np.testing.assert_array_equal(smooth_map(sparse).path, smooth_map(exact).path)


def test_grows_with_the_sightings_alone():
    """5000 landmarks, whose covariance would take 0.8 GB; the marginals are the structured filter's."""
    M = 5000
    means = np.random.default_rng(0).uniform(-60, 60, (M, 2))
    scenario = replace(block_scenario(1, n_steps=6), landmark_means=means, landmark_cov=0.3, measurement_cov=0.02)
    near = replace(scenario, field_of_view=lambda z, o: (z**2).sum(axis=1) < 25)
    given, _ = simulate(near, np.random.default_rng(1))
    answer, filtered = smooth_map(given), kalman(given, keep="blocks")
    np.testing.assert_allclose(answer.landmarks.ravel(), filtered.means[-1, 2:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.landmark_covs, filtered.blocks[-1, 1:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.path_covs[-1], filtered.blocks[-1, 0], rtol=0, atol=1e-9)
    assert answer.log_evidence == pytest.approx(filtered.log_evidence[-1], rel=1e-9)


def test_an_experiment_is_told_where_its_problem_is():
    with pytest.raises(InputError, match=r"experiment\.problem"):
        smooth_map(Experiment(BLOCK_WORLDS["handout"](), None, np.zeros(2)))
