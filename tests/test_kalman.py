"""The exact filter against one big Gaussian, against statsmodels, and against what it must never do."""

import numpy as np
import pytest
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter
from worlds import WORLDS, reference

from lab.problem import LinearGaussianModel, Problem
from lab.solvers import kalman
from lab.validation import InputError


def big_gaussian(problem, last):
    """Condition the joint Gaussian of x_last and z_1..z_last in covariance form: no recursion, no gain."""
    model, n = problem.model, len(problem.model.m0)
    means, cov = [model.m0], model.P0
    covs = {(0, 0): cov}
    for k in range(1, last + 1):
        means.append(model.F @ means[-1] + model.B)
        for j in range(k):
            covs[k, j] = model.F @ covs[k - 1, j]
            covs[j, k] = covs[k, j].T
        covs[k, k] = model.F @ covs[k - 1, k - 1] @ model.F.T + model.Q
    seen = [problem.seen(k) for k in range(last + 1)]
    when = [k for k in range(1, last + 1) if len(seen[k][0])]
    if not when:
        return means[last], covs[last, last], 0.0
    blocks = [[seen[i][1] @ covs[i, j] @ seen[j][1].T + (seen[i][2] if i == j else 0) for j in when] for i in when]
    S = np.block(blocks)
    cross = np.hstack([covs[last, j] @ seen[j][1].T for j in when])
    innovation = np.concatenate([seen[j][0] - seen[j][1] @ means[j] for j in when])
    gain = np.linalg.solve(S, cross.T).T
    quadratic = innovation @ np.linalg.solve(S, innovation)
    log_evidence = -0.5 * (quadratic + np.linalg.slogdet(S)[1] + len(S) * np.log(2 * np.pi))
    return means[last] + gain @ innovation, covs[last, last] - gain @ cross.T, log_evidence, n


def with_statsmodels(problem):
    """Return means, covariances and cumulative log-evidence by statsmodels, which drops partly missing rows itself."""
    model, N, n = problem.model, problem.n_instants, len(problem.model.m0)
    oracle = KalmanFilter(k_endog=n - 2, k_states=n)
    oracle.bind(problem.z.copy())
    H, R = np.nan_to_num(problem.H), np.nan_to_num(problem.R)
    oracle["design"], oracle["obs_cov"] = np.moveaxis(H, 0, -1), np.moveaxis(R, 0, -1)
    oracle["transition"], oracle["state_intercept"] = model.F, model.B[:, None]
    oracle["selection"], oracle["state_cov"] = np.eye(n), model.Q
    oracle.initialize_known(model.m0, model.P0)
    oracle.tolerance = 0  # no convergence shortcut
    result = oracle.filter()
    assert result.filtered_state.shape == (n, N)
    return result.filtered_state.T, np.moveaxis(result.filtered_state_cov, -1, 0), np.cumsum(result.llf_obs)


@pytest.mark.parametrize("world", WORLDS)
def test_agrees_with_statsmodels(world):
    problem = WORLDS[world]()
    answer = kalman(problem)
    means, covs, log_evidence = with_statsmodels(problem)
    np.testing.assert_allclose(answer.means, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.covs, covs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.log_evidence, log_evidence, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("world", WORLDS)
def test_agrees_with_one_big_gaussian(world):
    problem = WORLDS[world]()
    answer = kalman(problem)
    for last in (1, 2, problem.n_instants // 2, problem.n_instants - 1):
        mean, cov, log_evidence, *_ = big_gaussian(problem, last)
        np.testing.assert_allclose(answer.means[last], mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(answer.covs[last], cov, rtol=0, atol=1e-9)
        assert answer.log_evidence[last] == pytest.approx(log_evidence, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_reference_experiments(number):
    experiment = reference(number)
    answer = kalman(experiment.problem)
    means, covs, _ = with_statsmodels(experiment.problem)
    np.testing.assert_allclose(answer.means, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.covs, covs, rtol=0, atol=1e-9)


def test_row_0_is_the_prior():
    problem = WORLDS["full-5"]()
    answer = kalman(problem)
    np.testing.assert_array_equal(answer.means[0], problem.model.m0)
    np.testing.assert_array_equal(answer.covs[0], problem.model.P0)
    assert answer.log_evidence[0] == 0
    assert answer.ess is None
    assert answer.survivors is None


def test_nothing_seen_is_pure_prediction():
    problem = WORLDS["nothing-seen"]()
    answer = kalman(problem)
    model = problem.model
    for k in range(1, problem.n_instants):
        np.testing.assert_allclose(answer.means[k], model.F @ answer.means[k - 1] + model.B, atol=1e-12)
        np.testing.assert_allclose(answer.covs[k], model.F @ answer.covs[k - 1] @ model.F.T + model.Q, atol=1e-12)
    assert not answer.log_evidence.any()


def test_a_coordinate_may_be_missing_alone():
    problem = WORLDS["full-3-all-seen"]()
    z = problem.z.copy()
    z[4, 1] = z[7, 2] = z[7, 3] = np.nan
    holes = Problem(problem.model, z, problem.H, problem.R)
    means, covs, log_evidence = with_statsmodels(holes)
    answer = kalman(holes)
    np.testing.assert_allclose(answer.means, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.covs, covs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(answer.log_evidence, log_evidence, rtol=1e-9, atol=1e-9)


def test_small_eigenvalues_of_the_innovation_covariance_stay_in_the_evidence():
    """FilterPy's own log_likelihood drops eigenvalues below 2e-10 of the largest, and with them a constant."""
    problem = WORLDS["full-1"]()
    R = np.broadcast_to(np.diag([1e-12, 1.0]), problem.R.shape)
    model = problem.model
    known = LinearGaussianModel(model.F, model.B, np.zeros((4, 4)), model.m0, np.zeros((4, 4)))
    z = np.full_like(problem.z, np.nan)
    z[1] = model.m0[2:] - (model.F @ model.m0 + model.B)[:2]
    H = np.broadcast_to(np.hstack([-np.eye(2), np.eye(2)]), problem.H.shape)
    answer = kalman(Problem(known, z, H, R))
    assert answer.log_evidence[1] == pytest.approx(-0.5 * (np.log(1e-12) + 2 * np.log(2 * np.pi)))


def test_singular_innovation_covariance_is_named():
    problem = WORLDS["full-1"]()
    model = problem.model
    known = LinearGaussianModel(model.F, model.B, np.zeros((4, 4)), model.m0, np.zeros((4, 4)))
    z = np.where(np.arange(problem.n_instants)[:, None] == 3, 0.5, np.nan) * np.ones(2)
    H = np.ones(problem.H.shape)
    with pytest.raises(InputError, match="singular at k = 3"):
        kalman(Problem(known, z, H, np.zeros(problem.R.shape)))


def test_negligible_landmark_noise_counts_as_none_and_changes_nothing():
    problem = WORLDS["handout"]()
    assert problem.model.Q[5, 5] == pytest.approx(1e-20)
    assert problem.model.noise_cov[5, 5] == 0
    jittered = problem.with_landmark_noise(1e-3)
    assert jittered.model.noise_cov[5, 5] == pytest.approx(1e-6)
    assert (kalman(jittered).stds[-1, 2:] > kalman(problem).stds[-1, 2:]).all()
