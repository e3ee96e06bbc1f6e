"""Resampling: unbiased, never outside, never a particle of weight zero."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lab import resampling
from lab.validation import InputError

SCHEMES = list(resampling.RESAMPLERS.values())
WEIGHTS = arrays(float, st.integers(1, 60), elements=st.floats(0, 1) | st.just(0.0) | st.floats(0, 1e-300)).filter(
    lambda w: w.sum() > 0
)
LARGEST = 1 - 2.0**-53


class Constant:
    """A generator whose uniform numbers are all the same."""

    def __init__(self, value):
        self.value = value

    def random(self, size=None):
        return self.value if size is None else np.full(size, self.value)


def searched(weights, shifts):
    points = (np.arange(len(weights)) + shifts) / len(weights)
    return resampling._inverse(points, weights)


@given(weights=WEIGHTS, shift=st.one_of(st.sampled_from([0.0, LARGEST, 0.5]), st.floats(0, 1)), own=st.booleans())
@example(weights=np.array([1e-309, 2e-309]), shift=0.5, own=False)
@example(weights=np.full(60, 1e-323), shift=0.0, own=True)
def test_points_of_strata_need_no_search(weights, shift, own):
    """Counting gives what the search gives, for points on the edges of their strata, too."""
    shifts = np.roll(np.linspace(0, LARGEST, len(weights)), 3) if own else np.array([shift])
    np.testing.assert_array_equal(resampling.of_strata(weights[None], shifts[None])[0], searched(weights, shifts))


@pytest.mark.parametrize("n", [7, 1000, 100_000])
def test_many_points_of_several_clouds_need_no_search(n):
    rng = np.random.default_rng(n)
    weights = np.stack([rng.gamma(0.1, size=n), rng.gamma(30, size=n), np.ones(n), (rng.random(n) < 0.3) + 0.0])
    shifts = rng.random((4, n))
    expected = [searched(*each) for each in zip(weights, shifts, strict=True)]
    np.testing.assert_array_equal(resampling.of_strata(weights, shifts), expected)


@pytest.mark.parametrize("scheme", SCHEMES)
@given(weights=WEIGHTS, seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1.0, 1 - 1e-6, 1 + 1e-6, 7.0]))
def test_indices_are_valid_and_never_of_weight_zero(scheme, weights, seed, scale):
    ancestors = scheme(weights / weights.sum() * scale, np.random.default_rng(seed))
    assert ancestors.shape == weights.shape
    assert ancestors.dtype.kind == "i"
    assert (weights[ancestors] > 0).all()


@pytest.mark.parametrize("scheme", SCHEMES)
@given(weights=WEIGHTS, uniform=st.sampled_from([0.0, 2.0**-53, 0.5, LARGEST]))
def test_extreme_uniform_numbers(scheme, weights, uniform):
    for scale in (1, 1 - 1e-6):
        normalised = weights / weights.sum() * scale
        ancestors = scheme(normalised, Constant(uniform))
        assert ancestors.min() >= 0
        assert ancestors.max() < len(weights)
        assert (normalised[ancestors] > 0).all()


def test_a_trailing_zero_weight_survives_no_rounding():
    weights = np.full(1000, 0.001 - 1e-9)
    weights[-1] = 0
    for scheme in SCHEMES:
        assert scheme(weights, Constant(LARGEST)).max() == 998


@given(weights=WEIGHTS, seed=st.integers(0, 2**32 - 1))
def test_systematic_offspring_is_floor_or_ceil(weights, seed):
    normalised = weights / weights.sum()
    expected = normalised * len(weights)
    offspring = np.bincount(resampling.systematic(weights, np.random.default_rng(seed)), minlength=len(weights))
    assert (offspring >= np.floor(expected - 1e-9)).all()
    assert (offspring <= np.ceil(expected + 1e-9)).all()


@given(weights=WEIGHTS, seed=st.integers(0, 2**32 - 1))
def test_residual_keeps_at_least_the_floor(weights, seed):
    expected = weights / weights.sum() * len(weights)
    offspring = np.bincount(resampling.residual(weights, np.random.default_rng(seed)), minlength=len(weights))
    assert (offspring >= np.floor(expected - 1e-9)).all()


@given(weights=WEIGHTS)
def test_systematic_is_unbiased_exactly(weights):
    """Average over u by a grid: each offspring count is a step function of u, so a fine grid is exact to 1 / grid."""
    grid = 200
    expected = weights / weights.sum() * len(weights)
    total = sum(
        np.bincount(resampling.systematic(weights, Constant((i + 0.5) / grid)), minlength=len(weights))
        for i in range(grid)
    )
    assert (np.abs(total / grid - expected) <= 1 / grid + 1e-9).all()


@pytest.mark.parametrize("name", resampling.RESAMPLERS)
def test_mean_offspring_is_n_times_the_weight(name):
    """Five standard errors of 20 000 repetitions: a bias of 2 % shows, a false alarm has odds of about 1e-5."""
    scheme, rng, repetitions = resampling.RESAMPLERS[name], np.random.default_rng(11), 20_000
    weights = np.array([0.31, 0.02, 0.0, 0.17, 0.24, 0.01, 0.25])
    counts = np.array([np.bincount(scheme(weights, rng), minlength=7) for _ in range(repetitions)])
    error = counts.std(axis=0, ddof=1) / np.sqrt(repetitions)
    assert (np.abs(counts.mean(axis=0) - 7 * weights) <= 5 * error + 1e-12).all()


def test_the_schemes_have_the_variances_that_set_them_apart():
    rng = np.random.default_rng(5)
    weights = np.array([0.31, 0.02, 0.07, 0.1, 0.24, 0.01, 0.25])

    def variance(scheme):
        return np.array([np.bincount(scheme(weights, rng), minlength=7) for _ in range(4000)]).var(axis=0).sum()

    spread = {name: variance(scheme) for name, scheme in resampling.RESAMPLERS.items()}
    assert spread["systematic"] < spread["stratified"] < spread["multinomial"]
    assert spread["residual"] < spread["multinomial"]
    assert spread["multinomial"] == pytest.approx(np.sum(7 * weights * (1 - weights)), rel=0.1)


@pytest.mark.parametrize("scheme", [resampling.systematic, resampling.stratified, resampling.residual])
@pytest.mark.parametrize("n", [1, 3, 20, 49, 64, 1000, 10_000])
def test_even_weights_keep_every_particle(scheme, n):
    """N * (1 / N) rounds to just below 1 for n = 20, 1000 and 10 000."""
    np.testing.assert_array_equal(np.sort(scheme(np.full(n, 1 / n), np.random.default_rng(0))), np.arange(n))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_matrix_of_weights_is_refused(scheme):
    with pytest.raises(InputError, match="vector of weights"):
        scheme(np.ones((3, 2)), np.random.default_rng(0))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("bad", [[0.0, 0.0], [0.5, -0.1], [0.5, np.nan], [np.inf, 1.0]])
def test_bad_weights(scheme, bad):
    with pytest.raises(InputError, match="non-negative"):
        scheme(np.array(bad), np.random.default_rng(0))


def test_resolve():
    assert resampling.resolve("residual") is resampling.residual
    assert resampling.resolve(len) is len
    with pytest.raises(InputError, match="systematic, stratified, residual, multinomial"):
        resampling.resolve("bogus")
    with pytest.raises(InputError, match="Unknown resampling scheme"):
        resampling.resolve([])


@pytest.mark.parametrize("scheme", ["systematic", "stratified"])
def test_even_weights_of_a_large_cloud_need_no_more_room_than_others(scheme):
    """Every N c is a whole number then, and each is looked at twice."""
    weights, peaks = np.random.default_rng(0).random(20_000), []
    for each in (weights, np.ones(20_000)):
        tracemalloc.start()
        resampling.RESAMPLERS[scheme](each, np.random.default_rng(1))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0]
