"""The smoother against statsmodels and against one big Gaussian."""

import numpy as np
import pytest
from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother
from worlds import WORLDS

from lab.result import Filtered
from lab.solvers import kalman, smoother


def with_statsmodels(problem):
    model, n = problem.model, len(problem.model.m0)
    oracle = KalmanSmoother(k_endog=n - 2, k_states=n)
    oracle.bind(problem.z.copy())
    oracle["design"] = np.moveaxis(np.nan_to_num(problem.H), 0, -1)
    oracle["obs_cov"] = np.moveaxis(np.nan_to_num(problem.R), 0, -1)
    oracle["transition"], oracle["state_intercept"] = model.F, model.B[:, None]
    oracle["selection"], oracle["state_cov"] = np.eye(n), model.Q
    oracle.initialize_known(model.m0, model.P0)
    oracle.tolerance = 0
    result = oracle.smooth()
    return result.smoothed_state.T, np.moveaxis(result.smoothed_state_cov, -1, 0)


@pytest.mark.parametrize("world", WORLDS)
def test_agrees_with_statsmodels(world):
    problem = WORLDS[world]()
    smoothed = smoother(problem)
    means, covs = with_statsmodels(problem)
    np.testing.assert_allclose(smoothed.means, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(smoothed.covs, covs, rtol=0, atol=1e-9)


def test_ends_where_the_filter_ends_and_is_never_wider():
    problem = WORLDS["full-5"]()
    exact, smoothed = kalman(problem), smoother(problem)
    np.testing.assert_array_equal(smoothed.means[-1], exact.means[-1])
    np.testing.assert_array_equal(smoothed.covs[-1], exact.covs[-1])
    assert (np.diagonal(smoothed.covs, axis1=1, axis2=2) <= exact.stds**2 + 1e-12).all()


def test_static_landmarks_are_smoothed_to_their_last_estimate():
    problem = WORLDS["handout"]()
    smoothed = smoother(problem)
    np.testing.assert_allclose(smoothed.means[:, 2:], np.tile(smoothed.means[-1, 2:], (50, 1)), atol=1e-9)


def test_gains_regress_on_the_next_state():
    """Cov(x_k, x_{k+1} given z) = gain Cov(x_{k+1} given z): by conditioning the joint Gaussian of the whole path."""
    problem = WORLDS["full-1"]()
    model, N, n = problem.model, 5, 4
    big = np.zeros((N * n, N * n))
    for j in range(N):
        cov = model.P0 if j == 0 else model.F @ big[(j - 1) * n : j * n, (j - 1) * n : j * n] @ model.F.T + model.Q
        for k in range(j, N):
            block = np.linalg.matrix_power(model.F, k - j) @ cov
            big[k * n : (k + 1) * n, j * n : (j + 1) * n] = block
            big[j * n : (j + 1) * n, k * n : (k + 1) * n] = block.T
    seen = [problem.seen(k) for k in range(N)]
    H = np.zeros((sum(len(z) for z, _, _ in seen), N * n))
    R, row = np.zeros((len(H), len(H))), 0
    for k, (z, H_k, R_k) in enumerate(seen):
        H[row : row + len(z), k * n : (k + 1) * n] = H_k
        R[row : row + len(z), row : row + len(z)] = R_k
        row += len(z)
    posterior = big - big @ H.T @ np.linalg.solve(H @ big @ H.T + R, H @ big)
    exact = kalman(problem)
    smoothed = smoother(problem, Filtered(exact.means[:N], exact.covs[:N], exact.log_evidence[:N]))
    for k in range(N - 1):
        cross = posterior[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n]
        np.testing.assert_allclose(smoothed.gains[k] @ smoothed.covs[k + 1], cross, atol=1e-10)


def test_a_known_robot_is_no_division_by_zero():
    problem = WORLDS["full-3-all-seen"]()
    model = problem.model
    P0, Q = model.P0.copy(), np.zeros_like(model.Q)
    P0[:2], P0[:, :2] = 0, 0
    known = type(problem)(type(model)(model.F, model.B, Q, model.m0, P0), problem.z, problem.H, problem.R)
    smoothed = smoother(known)
    assert np.isfinite(smoothed.means).all()
    assert not smoothed.covs[:, :2].any()
