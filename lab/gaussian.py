"""Gaussians: prediction, measurement update, log-density and sampling, for one mean or for a whole cloud of them.

Question answered: what do linear maps and linear measurements do to N(mean, cov)?

    predict   mean' = F mean + B,            cov' = F cov F' + Q
    update    S = H cov H' + R,    K = cov H' S^-1,
              mean' = mean + K (z - H mean),    cov' = (I - K H) cov (I - K H)' + K R K'
    evidence  log N(z; H mean, S)

Means may be (n,) or, dimension first, (n, P): P particles that share one covariance.  Only S is ever factored, because
process noise and prior covariances are singular in this laboratory.  The same update serves Kalman, guided and
Rao-Blackwellized filters.  Arrays in, arrays out: nothing here knows of robots.
"""

import numpy as np
import scipy.linalg

from lab.validation import Array

LOG_2PI = float(np.log(2 * np.pi))


def predict(mean: Array, cov: Array, F: Array, B: Array, Q: Array) -> tuple[Array, Array]:
    """Push N(mean, cov) through x -> F x + B + w, w ~ N(0, Q).

    Parameters
    ----------
    mean : (n,) or (n, P) array
        One mean, or P means that share `cov`.
    cov, F, Q : (n, n) array
        Covariance, transition matrix, process noise covariance.
    B : (n,) array
        Constant input.

    Returns
    -------
    mean, cov
        Of the shapes given.
    """
    return F @ mean + _column(B, mean), F @ cov @ F.T + Q


def update(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array, Array]:
    """Condition N(mean, cov) on z = H x + v, v ~ N(0, R), in Joseph's form.

    Parameters
    ----------
    mean : (n,) or (n, P) array
        One mean, or P means that share `cov`.
    cov : (n, n) array
        Prior covariance; may be singular.
    z : (p,) array
        Measurement; p may be 0.
    H : (p, n) array
        Measurement matrix.
    R : (p, p) array
        Measurement noise covariance.

    Returns
    -------
    mean : (n,) or (n, P) array
        Posterior mean(s).
    cov : (n, n) array
        Posterior covariance, exactly symmetric.
    log_evidence : () or (P,) array
        log N(z; H mean, S) for each mean.

    Raises
    ------
    numpy.linalg.LinAlgError
        S = H cov H' + R is not positive definite.
    """
    innovation = _column(z, mean) - H @ mean
    S = H @ cov @ H.T + R
    K = scipy.linalg.cho_solve(scipy.linalg.cho_factor(S, lower=True), H @ cov).T if len(z) else cov @ H.T
    residual_map = np.eye(len(cov)) - K @ H
    posterior = residual_map @ cov @ residual_map.T + K @ R @ K.T
    return mean + K @ innovation, (posterior + posterior.T) / 2, log_density(innovation, S)


def log_density(deviation: Array, cov: Array) -> Array:
    """Return log N(deviation; 0, cov).

    Parameters
    ----------
    deviation : (p,) or (p, P) array
        x - mean, one or P of them; p may be 0, whose density is 1.
    cov : (p, p) array
        Positive definite.

    Returns
    -------
    () or (P,) array

    Raises
    ------
    numpy.linalg.LinAlgError
        `cov` is not positive definite.
    """
    if not len(cov):
        return np.zeros(deviation.shape[1:])
    factor = np.linalg.cholesky(cov)
    whitened = scipy.linalg.solve_triangular(factor, deviation, lower=True, check_finite=False)
    log_determinant = 2 * np.log(np.diag(factor)).sum()
    return np.asarray(-0.5 * (np.sum(whitened**2, axis=0) + log_determinant + len(cov) * LOG_2PI))


def sample(cov: Array, n_samples: int, rng: np.random.Generator) -> Array:
    """Draw from N(0, cov), which may be singular.

    Components without variance are exactly zero and use up no random numbers.

    Parameters
    ----------
    cov : (n, n) array
        Positive semidefinite.
    n_samples : int
        P, how many.
    rng : numpy.random.Generator

    Returns
    -------
    (n, P) array
    """
    draws = np.zeros((len(cov), n_samples))
    moving = np.flatnonzero(np.diag(cov) > 0)
    if len(moving):
        eigenvalues, eigenvectors = np.linalg.eigh(cov[np.ix_(moving, moving)])
        factor = eigenvectors * np.sqrt(np.maximum(eigenvalues, 0))
        draws[moving] = factor @ rng.standard_normal((len(moving), n_samples))
    return draws


def _column(vector: Array, like: Array) -> Array:
    return vector if like.ndim == 1 else vector[:, np.newaxis]
