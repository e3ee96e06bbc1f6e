"""Solà's symbols: x mean and P covariance of a Gaussian, n how many sigmas, NP how many points of an ellipse.

Question answered: where is a Gaussian's probability, and how far is a point from it?

    ellipse        x + n R sqrt(D) [cos, sin],   P = R D R'          mahalanobis   sqrt((x - m)' P^-1 (x - m))
    n sigmas hold  chi2.cdf(n^2, dimension):  39.3, 86.5, 98.9, 99.97 % in the plane for n = 1 ... 4

The guide says that 2 and 3 sigmas enclose 97 to 99 %; by its own table it is 86.5 and 98.9 % in the plane.
Source: J. Solà (2014), appendix on uncertainty ellipsoids, functions ``cov2elli`` and ``mahalanobis``.
"""

import numpy as np
from scipy.special import chdtr

from lab.validation import Array, InputError, whole_number


def cov2elli(x: Array, P: Array, n: float = 1, NP: int = 16) -> Array:
    """Return the points (NP + 1, 2) of the ellipse of n sigmas, closed: the last is the first.

    Parameters
    ----------
    x : (2,) array
        Centre [m].
    P : (2, 2) array
        Covariance [m^2]; where it is singular the ellipse is a line or a point.
    n : float
        How many sigmas.
    NP : int
        How many segments.
    """
    whole_number("NP", NP, at_least=1)
    axes, variances, _ = np.linalg.svd(np.asarray(P, dtype=float))
    angles = 2 * np.pi * np.arange(NP + 1) / NP
    circle = np.stack([np.cos(angles), np.sin(angles)])
    circle[:, -1] = circle[:, 0]
    return np.asarray(np.asarray(x) + (n * (axes * np.sqrt(variances)) @ circle).T)


def mahalanobis(x: Array, m: Array, P: Array) -> float:
    """Return the distance of x (d,) from a Gaussian of mean m (d,) and covariance P (d, d), in sigmas.

    Raises
    ------
    InputError
        P is singular.
    """
    error = np.asarray(x, dtype=float) - m
    try:
        return float(np.sqrt(error @ np.linalg.solve(P, error)))
    except np.linalg.LinAlgError:
        raise InputError("P is singular: the Mahalanobis distance is not defined.") from None


def sigma_probabilities(dimension: int, n: tuple[float, ...] = (1, 2, 3, 4)) -> Array:
    """Return the probability that the ellipsoid of n sigmas holds, for each n, in this dimension."""
    return np.asarray(chdtr(whole_number("dimension", dimension, at_least=1), np.square(n)))
