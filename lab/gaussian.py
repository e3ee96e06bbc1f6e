"""Gaussians: prediction, measurement update, splitting and log-density, for one mean or for a whole cloud of them.

Question answered: what do linear maps, linear measurements and partial draws do to N(mean, cov)?

    predict   mean' = F mean + B,            cov' = F cov F' + Q
    update    S = H cov H' + R,    K = cov H' S^-1,
              mean' = mean + K (z - H mean),    cov' = (I - K H) cov (I - K H)' + K R K'
    evidence  log N(z; H mean, S)
    split     cov = spread spread' + left: draw some components, condition the rest on them

Means may be (n,) or, dimension first, (n, P): P particles that share one covariance.  Only S is ever factored, because
process noise and prior covariances are singular in this laboratory.  Proposals use gain and Joseph's form, the theory
whole updates; the exact filter is FilterPy's.  Arrays in, arrays out: nothing here knows of robots.
"""

from typing import Any

import numpy as np
import scipy.linalg

from lab.validation import Array, InputError

LOG_2PI = float(np.log(2 * np.pi))
RANK_TOLERANCE = 1e-12  # eigenvalues of a correlation matrix below it are rounding


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
    K = gain(cov, H, S)
    return mean + K @ innovation, joseph(cov, K, H, R), log_density(innovation, S)


def gain(cov: Array, H: Array, S: Array) -> Array:
    """Return the Kalman gain cov H' S^-1, (n, p).

    Raises
    ------
    numpy.linalg.LinAlgError
        S is not positive definite.
    """
    if not len(S):
        return cov @ H.T
    return np.asarray(scipy.linalg.cho_solve(scipy.linalg.cho_factor(S, lower=True), H @ cov).T)


def joseph(cov: Array, K: Array, H: Array, R: Array) -> Array:
    """Return the covariance (n, n) after a measurement, (I - K H) cov (I - K H)' + K R K', exactly symmetric."""
    left = np.eye(len(cov)) - K @ H
    posterior = left @ cov @ left.T + K @ R @ K.T
    return (posterior + posterior.T) / 2


def regression(cross: Array, cov: Array) -> Array:
    """Return the G (m, n) of E[a given b] = E[a] + G (b - E[b]), from cross = Cov(a, b) (m, n) and cov = Cov(b) (n, n).

    `cov` may be singular; the pseudo-inverse is taken on the correlation scale, as in `split`. Stacks are taken too.
    """
    deviations = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    scale = np.divide(1, deviations, out=np.zeros_like(deviations), where=deviations > 0)
    left, right = scale[..., :, np.newaxis], scale[..., np.newaxis, :]
    inverse = np.linalg.pinv(cov * (left * right), rcond=RANK_TOLERANCE, hermitian=True)
    return np.asarray(cross @ (left * inverse * right))


def split(cov: Array, rows: Any) -> tuple[Array, Array]:
    """Split a covariance into the part that drawing some components explains and the part that is left.

    cov = spread spread' + left, with nothing left on `rows`: adding spread @ (standard normals) draws those components
    and moves the others to their conditional means, whose covariance is `left`.

    Parameters
    ----------
    cov : (n, n) array
        Positive semidefinite.
    rows : (r,) array of int
        The components to draw; those without variance use up no random numbers.

    Returns
    -------
    spread : (n, d) array
        d is the rank of cov on `rows`.
    left : (n, n) array
        Exactly 0 on the rows and columns drawn.
    """
    drawn = rows[np.diag(cov)[rows] > 0]
    deviations = np.sqrt(np.diag(cov)[drawn])
    # on the correlation scale, so that noise of 1e-6 m beside 1 m is not taken for rounding
    eigenvalues, eigenvectors = np.linalg.eigh(cov[np.ix_(drawn, drawn)] / np.outer(deviations, deviations))
    kept = eigenvalues > RANK_TOLERANCE
    spread = (cov[:, drawn] / deviations) @ (eigenvectors[:, kept] / np.sqrt(eigenvalues[kept]))
    left = cov - spread @ spread.T
    settled = np.diag(left) <= RANK_TOLERANCE * np.diag(cov)  # a component that the drawn ones determine
    settled[rows] = True
    left[settled, :] = left[:, settled] = 0
    return spread, (left + left.T) / 2


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


def chi2_quantile(probability: float | Array, dof: float | Array) -> Array:
    """Return the value that a chi2(dof) number stays below with this probability; any shapes that go together.

    As `scipy.stats.chi2.ppf`, the import of which would take longer than that of the whole laboratory.
    """
    from scipy.special import gammaincinv

    return np.asarray(2 * gammaincinv(np.divide(dof, 2), probability))


def chi2_band(dof: float, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval that holds the mean over `runs` independent chi2(dof) values with probability `level`.

    Raises
    ------
    InputError
        `level` is no probability.
    """
    if not 0 < level < 1:
        raise InputError(f"level must lie strictly between 0 and 1, not {level}.")
    low, high = chi2_quantile(np.array([1 - level, 1 + level]) / 2, dof * runs) / runs
    return float(low), float(high)


def _column(vector: Array, like: Array) -> Array:
    return vector if like.ndim == 1 else vector[:, np.newaxis]
