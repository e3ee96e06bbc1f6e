"""Prediction, update, density and sampling against their definitions."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds import covariance

from lab import gaussian


@pytest.fixture
def world():
    rng = np.random.default_rng(3)
    n, p = 6, 3
    return {
        "mean": rng.standard_normal(n),
        "cov": covariance(rng, n, 1.0),
        "F": rng.standard_normal((n, n)),
        "B": rng.standard_normal(n),
        "Q": covariance(rng, n, 0.5),
        "H": rng.standard_normal((p, n)),
        "R": covariance(rng, p, 0.7),
        "z": rng.standard_normal(p),
    }


def test_predict(world):
    mean, cov = gaussian.predict(world["mean"], world["cov"], world["F"], world["B"], world["Q"])
    np.testing.assert_allclose(mean, world["F"] @ world["mean"] + world["B"])
    np.testing.assert_allclose(cov, world["F"] @ world["cov"] @ world["F"].T + world["Q"])


def test_update_is_conditioning(world):
    mean, cov, log_evidence = gaussian.update(world["mean"], world["cov"], world["z"], world["H"], world["R"])
    precision = np.linalg.inv(world["cov"]) + world["H"].T @ np.linalg.inv(world["R"]) @ world["H"]
    information = np.linalg.solve(world["cov"], world["mean"]) + world["H"].T @ np.linalg.solve(world["R"], world["z"])
    np.testing.assert_allclose(cov, np.linalg.inv(precision), atol=1e-10)
    np.testing.assert_allclose(mean, np.linalg.solve(precision, information), atol=1e-10)
    S = world["H"] @ world["cov"] @ world["H"].T + world["R"]
    assert log_evidence == pytest.approx(multivariate_normal.logpdf(world["z"], world["H"] @ world["mean"], S))
    np.testing.assert_array_equal(cov, cov.T)


def test_many_means_share_one_covariance(world):
    means = np.random.default_rng(0).standard_normal((6, 4))
    moved, cov, log_evidence = gaussian.update(means, world["cov"], world["z"], world["H"], world["R"])
    predicted, _ = gaussian.predict(means, world["cov"], world["F"], world["B"], world["Q"])
    assert log_evidence.shape == (4,)
    for i in range(4):
        mean, same, evidence = gaussian.update(means[:, i], world["cov"], world["z"], world["H"], world["R"])
        np.testing.assert_allclose(moved[:, i], mean)
        np.testing.assert_allclose(cov, same)
        assert log_evidence[i] == pytest.approx(evidence)
        np.testing.assert_allclose(predicted[:, i], world["F"] @ means[:, i] + world["B"])


def test_update_without_measurement_changes_nothing(world):
    mean, cov, log_evidence = gaussian.update(
        world["mean"], world["cov"], np.zeros(0), np.zeros((0, 6)), np.zeros((0, 0))
    )
    np.testing.assert_array_equal(mean, world["mean"])
    np.testing.assert_allclose(cov, world["cov"], atol=1e-15)
    assert log_evidence == 0


def test_update_of_a_known_component_leaves_it(world):
    cov = world["cov"].copy()
    cov[0], cov[:, 0] = 0, 0
    mean, posterior, _ = gaussian.update(world["mean"], cov, world["z"], world["H"], world["R"])
    assert mean[0] == world["mean"][0]
    assert not posterior[0].any()


def test_log_density_far_out_does_not_underflow():
    cov = np.array([[2.0, 0.5], [0.5, 1.0]])
    deviations = np.array([[0.3, 100.0], [-0.2, -50.0]])
    expected = multivariate_normal.logpdf(deviations.T, cov=cov)
    np.testing.assert_allclose(gaussian.log_density(deviations, cov), expected)
    assert gaussian.log_density(deviations[:, 0], cov) == pytest.approx(expected[0])
    assert expected[1] < -800


def test_log_density_of_nothing_is_one():
    np.testing.assert_array_equal(gaussian.log_density(np.zeros((0, 5)), np.zeros((0, 0))), np.zeros(5))


def test_log_density_refuses_a_singular_covariance():
    with pytest.raises(np.linalg.LinAlgError):
        gaussian.log_density(np.zeros(2), np.ones((2, 2)))


def test_split_explains_a_covariance_and_leaves_nothing_on_the_drawn():
    cov = covariance(np.random.default_rng(1), 6, 1.0)
    rows = np.array([0, 3, 4])
    spread, left = gaussian.split(cov, rows)
    np.testing.assert_allclose(spread @ spread.T + left, cov, atol=1e-12)
    assert not left[rows].any()
    assert not left[:, rows].any()
    others = [1, 2, 5]
    conditional = cov[np.ix_(others, others)] - cov[np.ix_(others, rows)] @ np.linalg.solve(
        cov[np.ix_(rows, rows)], cov[np.ix_(rows, others)]
    )
    np.testing.assert_allclose(left[np.ix_(others, others)], conditional, atol=1e-12)


def test_split_of_components_without_variance_and_of_low_rank():
    direction = np.array([1.0, -2.0, 0.0, 1e-6])
    cov = np.outer(direction, direction)
    spread, left = gaussian.split(cov, np.array([0, 1, 2]))
    assert spread.shape == (4, 1)
    np.testing.assert_allclose(spread @ spread.T, cov, rtol=1e-9, atol=0)
    assert not left.any()  # the last component is determined by the drawn ones
    spread, left = gaussian.split(np.zeros((3, 3)), np.arange(3))
    assert spread.shape == (3, 0)
    assert not left.any()


def test_split_keeps_small_noise_beside_large():
    cov = np.diag([1.0, 1e-20])
    spread, left = gaussian.split(cov, np.arange(2))
    np.testing.assert_allclose(spread @ spread.T, cov, rtol=1e-12, atol=0)
    assert not left.any()


def test_regression_on_a_singular_covariance():
    rng = np.random.default_rng(4)
    root = rng.standard_normal((5, 2)) * np.array([1, 1, 1e-7, 1, 0])[:, None]
    joint = root @ root.T
    a, b = slice(0, 2), slice(2, 5)
    G = gaussian.regression(joint[a, b], joint[b, b])
    np.testing.assert_allclose(G @ joint[b, b], joint[a, b], rtol=1e-6, atol=1e-12)
