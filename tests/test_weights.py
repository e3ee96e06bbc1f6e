"""Weights in log space, effective sample size and moments."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lab import weights
from lab.validation import InputError

LOG_WEIGHTS = arrays(float, st.integers(1, 50), elements=st.floats(-2000, 2000))


@given(LOG_WEIGHTS, st.floats(-500, 500))
def test_normalise_sums_to_one_and_ignores_a_constant(log_weights, constant):
    normalised, log_total = weights.normalise(log_weights)
    assert normalised.sum() == pytest.approx(1)
    shifted, shifted_total = weights.normalise(log_weights + constant)
    np.testing.assert_allclose(shifted, normalised, rtol=1e-9, atol=1e-12)
    assert shifted_total == pytest.approx(log_total + constant, rel=1e-9, abs=1e-9)


def test_normalise_where_the_plain_exponential_underflows():
    assert np.exp(-800.0) == 0
    normalised, log_total = weights.normalise(np.array([-800.0, -800.0 + np.log(3)]))
    np.testing.assert_allclose(normalised, [0.25, 0.75])
    assert log_total == pytest.approx(-800 + np.log(4))


def test_a_weight_of_zero_is_allowed():
    normalised, _ = weights.normalise(np.array([-np.inf, 0.0]))
    np.testing.assert_array_equal(normalised, [0, 1])


@pytest.mark.parametrize("bad", [[-np.inf, -np.inf], [0.0, np.nan], [0.0, np.inf], []])
def test_weights_that_cannot_be_normalised(bad):
    with pytest.raises(InputError, match="cannot be normalised"):
        weights.normalise(np.array(bad))


@given(LOG_WEIGHTS)
def test_ess_lies_between_one_and_the_number_of_particles(log_weights):
    normalised, _ = weights.normalise(log_weights)
    assert 1 - 1e-9 <= weights.ess(normalised) <= len(log_weights) * (1 + 1e-9)


def test_ess_of_known_weights():
    assert weights.ess(np.full(8, 1 / 8)) == pytest.approx(8)
    assert weights.ess(np.array([0, 1.0, 0])) == 1
    assert weights.ess(np.array([0.5, 0.25, 0.25])) == pytest.approx(1 / 0.375)


def test_moments_by_an_explicit_loop():
    rng = np.random.default_rng(0)
    particles, w = rng.standard_normal((3, 20)), rng.random(20)
    w /= w.sum()
    mean, cov = weights.moments(particles, w)
    expected_mean = sum(w[i] * particles[:, i] for i in range(20))
    expected_cov = sum(
        w[i] * np.outer(particles[:, i] - expected_mean, particles[:, i] - expected_mean) for i in range(20)
    )
    np.testing.assert_allclose(mean, expected_mean)
    np.testing.assert_allclose(cov, expected_cov)
    np.testing.assert_array_equal(cov, cov.T)


def test_moments_far_from_the_origin_keep_their_digits():
    particles = 1e6 + np.array([[-1e-3, 1e-3]])
    _, cov = weights.moments(particles, np.array([0.5, 0.5]))
    assert cov[0, 0] == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("n_particles", [1, 4095, 4096, 4097, 20_000])
def test_moments_by_blocks_are_those_of_the_whole_cloud(n_particles):
    rng = np.random.default_rng(n_particles)
    particles, w = rng.standard_normal((5, n_particles)) + 3, rng.random(n_particles)
    w /= w.sum()
    mean, cov = weights.moments(particles, w)
    centred = particles - (particles @ w)[:, np.newaxis]
    np.testing.assert_allclose(mean, particles @ w, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cov, (centred * w) @ centred.T, rtol=0, atol=1e-12)
