"""Resampling by offspring: against the search of `lab.resampling`, unbiased, and never a particle of weight zero."""

import numpy as np
import pytest

from lab import resampling

offspring = pytest.importorskip("lab.fast.offspring", reason="the extra toy-slam-lab[fast] is not installed")
normals = pytest.importorskip("lab.fast.normals")
LANES = normals.LANES


class Room:
    """The arrays that the kernel works in, for clouds of one size."""

    def __init__(self, n, seed=0):
        self.n, blocks = n, -(-n // LANES)
        self.state = normals.seed(np.random.default_rng(seed))
        self.weights, self.tops = np.zeros((blocks, LANES)), np.empty(blocks)
        self.work = (np.empty((1, LANES)), np.empty(blocks + 1), np.empty(n + 1))
        self.before, self.ancestors = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32)

    def draw(self, scheme, weights):
        """Return the ancestors; weights need not sum to 1, and are given relative to a top of each block's own."""
        self.weights.ravel()[: self.n] = weights
        with np.errstate(divide="ignore", invalid="ignore"):
            self.tops[:] = np.log(self.weights.max(axis=1))
            self.weights[:] = np.where(self.tops == -np.inf, 7, self.weights.T / np.exp(self.tops)).T
        self.weights.ravel()[self.n :] = 0
        given = (self.weights, self.tops, float(self.tops.max()), self.n, self.state)
        resample = offspring.resample_systematic if scheme == "systematic" else offspring.resample_other
        resample(offspring.SCHEMES[scheme], *given, *self.work, self.before, self.ancestors)
        return self.ancestors[: self.n].copy()


def kinds(n, rng):
    some = (rng.random(n) < 0.4) * rng.random(n)
    some[rng.integers(n)] = 1
    one = np.zeros(n)
    one[rng.integers(n)] = 3
    return [rng.random(n), rng.random(n) ** 30, np.ones(n), some, one]


@pytest.mark.parametrize("n", [1, 2, 7, 255, 256, 257, 1000])
def test_systematic_and_stratified_are_the_search_over_their_points(n):
    rng, row = np.random.default_rng(n), np.empty((1, LANES))
    for weights in kinds(n, rng):
        for scheme in ("systematic", "stratified"):
            room = Room(n, seed=n)
            state, points = room.state.copy(), []
            for _ in range(1 if scheme == "systematic" else -(-n // LANES)):
                normals.uniforms(state, row, 0)
                points.append(row[0].copy())
            u = points[0][0] if scheme == "systematic" else np.concatenate(points)[:n]
            cumulative = np.cumsum(weights / weights.sum())
            cumulative[np.flatnonzero(weights)[-1] :] = np.inf
            expected = np.searchsorted(cumulative, (np.arange(n) + u) / n, side="right")
            np.testing.assert_array_equal(room.draw(scheme, weights), expected)


@pytest.mark.parametrize("scheme", resampling.RESAMPLERS)
@pytest.mark.parametrize("n", [1, 3, 300])
def test_nothing_of_weight_zero_and_nothing_outside(scheme, n):
    rng, room = np.random.default_rng(n), Room(n)
    for _ in range(40):
        for weights in kinds(n, rng):
            ancestors = room.draw(scheme, weights)
            assert (weights[ancestors] > 0).all()
            assert (np.diff(ancestors) >= 0).all()
            np.testing.assert_array_equal(np.bincount(ancestors, minlength=n), np.diff(room.before))


def test_the_largest_number_of_the_stream_does_not_reach_beyond_the_last_weight():
    """At u = 1 - 2^-52 the sum falls short of the last point by rounding, and zeros follow the last weight."""
    room = Room(6)
    room.state[0, 0], room.state[3, 0] = np.uint64(2**64 - 1), np.uint64(0)
    ancestors = room.draw("systematic", np.array([1.0, 1, 1, 0, 0, 0]))
    assert room.work[0][0, 0] == 1 - 2**-52
    np.testing.assert_array_equal(np.unique(ancestors), [0, 1, 2])


@pytest.mark.parametrize("scheme", resampling.RESAMPLERS)
def test_mean_offspring_is_the_weight(scheme):
    """20 000 draws, five standard errors; residual keeps floor(N w) copies, systematic stays within one of N w."""
    weights = np.array([0.02, 0.31, 0.11, 0, 0.24, 0.05, 0.27])
    n, n_draws, room = len(weights), 20_000, Room(len(weights), seed=5)
    counts = np.array([np.bincount(room.draw(scheme, weights), minlength=n) for _ in range(n_draws)])
    error = counts.std(axis=0, ddof=1) / np.sqrt(n_draws)
    assert (np.abs(counts.mean(axis=0) - n * weights) <= 5 * error + 1e-12).all()
    if scheme == "residual":
        assert (counts >= np.floor(n * weights)).all()
    if scheme == "systematic":
        assert (np.abs(counts - n * weights) < 1).all()
    if scheme == "multinomial":  # the variance of the counts is that of the binomial law
        variance = n * weights * (1 - weights)
        assert (np.abs(counts.var(axis=0) - variance) <= 0.06 * variance + 1e-12).all()


@pytest.mark.parametrize("scheme", ["residual", "systematic", "stratified"])
@pytest.mark.parametrize("n", [3, 49, 1000])
def test_even_weights_keep_every_particle(scheme, n):
    for factor in (1.0, 1 / n, 0.1):
        np.testing.assert_array_equal(Room(n).draw(scheme, np.full(n, factor)), np.arange(n))
