"""Alignment with SE(2): motions that are known, scipy's own answer, and what must not be aligned away."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from lab.ekfslam.alignment import align, apply
from lab.validation import InputError


def cloud(n=30, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 2)) * [4.0, 1.5] + [3.0, -7.0]


@pytest.mark.parametrize("angle", [0.0, 0.3, -2.9, np.pi / 2, 3.1, -np.pi + 1e-9])
def test_a_known_motion_is_found(angle):
    points = cloud()
    moved = apply(angle, np.array([5.0, -2.0]), points)
    found, translation = align(points, moved)
    assert np.angle(np.exp(1j * (found - angle))) == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(translation, [5.0, -2.0], atol=1e-11)
    np.testing.assert_allclose(apply(found, translation, points), moved, atol=1e-11)


def test_apply_turns_anticlockwise_then_shifts():
    np.testing.assert_allclose(apply(np.pi / 2, np.array([10.0, 20.0]), np.array([1.0, 0.0])), [10.0, 21.0], atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_noisy_points_against_scipy(seed):
    """scipy's Kabsch solution works in three dimensions; the points stand in the plane z = 0."""
    rng = np.random.default_rng(seed)
    estimate = cloud(12, seed)
    truth = apply(rng.uniform(-np.pi, np.pi), rng.normal(size=2), estimate) + rng.normal(size=(12, 2))
    angle, translation = align(estimate, truth)
    p, q = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    # a distant pair on the z axis keeps scipy's rotation in the plane
    up = [[0.0, 0.0, 1e3]]
    oracle, _ = Rotation.align_vectors(np.r_[np.c_[q, np.zeros(12)], up], np.r_[np.c_[p, np.zeros(12)], up])
    assert angle == pytest.approx(oracle.as_rotvec()[2], abs=1e-5)
    np.testing.assert_allclose(apply(angle, translation, estimate).mean(axis=0), truth.mean(axis=0), atol=1e-12)


def test_no_other_motion_is_closer():
    """Also where only a mirror image would fit: a numerical search over motions finds nothing better."""
    rng = np.random.default_rng(7)
    estimate = cloud(9, 3)
    truth = estimate * [1.0, -1.0] + 0.1 * rng.normal(size=(9, 2))

    def cost(m):
        return np.sum((apply(m[0], m[1:], estimate) - truth) ** 2)

    angle, translation = align(estimate, truth)
    searched = min(minimize(cost, [a, 0, 0]).fun for a in np.linspace(-3, 3, 7))
    assert cost([angle, *translation]) == pytest.approx(searched, rel=1e-6)


def test_points_that_determine_no_angle():
    angle, translation = align(np.array([[1.0, 2.0]]), np.array([[4.0, 1.0]]))
    assert angle == 0
    np.testing.assert_allclose(translation, [3.0, -1.0])


@pytest.mark.parametrize(
    ("estimate", "truth", "word"),
    [
        (np.zeros((0, 2)), np.zeros((0, 2)), "one point"),
        (np.zeros((3, 2)), np.zeros((4, 2)), "shape"),
        (np.zeros((3, 3)), np.zeros((3, 3)), "shape"),
        (np.full((3, 2), np.nan), np.zeros((3, 2)), "finite"),
    ],
)
def test_what_cannot_be_aligned(estimate, truth, word):
    with pytest.raises(InputError, match=word):
        align(estimate, truth)
