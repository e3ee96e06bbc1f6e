"""The rigid motion of the plane that brings an estimated map closest to the true one.

Question answered: how wrong is a map apart from the frame it is drawn in?  SLAM cannot observe its frame, so an error
is told twice: as it is, and after the motion in SE(2) (rotation and translation; no mirror image, no scale) with

    min over (a, t) of  sum_i |R(a) p_i + t - q_i|^2,     a = atan2(sum_i p~_i x q~_i, sum_i p~_i . q~_i),

p~ and q~ taken from their centroids: in the plane this is what the SVD of sum_i q~_i p~_i' gives once mirror images
are ruled out.  Called by whatever measures a run against a truth.
Source: S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 13(4), 1991.
"""

import numpy as np

from lab.validation import Array, InputError, real_array


def align(estimate: Array, truth: Array) -> tuple[float, Array]:
    """Return the rotation and the translation that bring `estimate` closest to `truth` in the sense of least squares.

    Parameters
    ----------
    estimate : (n, 2) array
        Points [m], n >= 1.
    truth : (n, 2) array
        The same points as they are [m].

    Returns
    -------
    angle : float
        [rad], in [-pi, pi]; 0 where the points determine none, such as a single point.
    translation : (2,) array
        [m], added after the rotation.

    Raises
    ------
    InputError
        The shapes differ, there is no point, or a value is not finite.

    Umeyama (1991), with the scale fixed to 1.
    """
    estimate = real_array("estimate", estimate, (-1, 2))
    truth = real_array("truth", truth, estimate.shape)
    if not len(estimate):
        raise InputError("estimate must hold at least one point to be aligned with the truth.")
    p, q = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    across = float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]))
    along = float(np.sum(p * q))
    angle = float(np.arctan2(across, along))
    return angle, truth.mean(axis=0) - apply(angle, np.zeros(2), estimate).mean(axis=0)


def apply(angle: float, translation: Array, points: Array) -> Array:
    """Return the points after the rigid motion, R(angle) p + translation.

    Parameters
    ----------
    angle : float
        [rad].
    translation : (2,) array
        [m].
    points : (..., 2) array
        [m].

    Returns
    -------
    (..., 2) array
    """
    c, s = np.cos(angle), np.sin(angle)
    turned: Array = np.asarray(points) @ np.array([[c, s], [-s, c]]) + translation
    return turned
