"""Is a filter as sure as it should be?  Consistency with the truth over many runs, and distance from the exact moments.

Question answered: do the covariances mean what they say?  With e = truth - mean and innovation v of covariance S,

    NEES  e' P^-1 e  ~ chi2(d)            NIS  v' S^-1 v  ~ chi2(p)
    KL    D(exact || estimate) of the two Gaussians, in nats: what is lost by believing the estimate
    W2    2-Wasserstein distance of the two Gaussians [m]

The d directions are those in which the EXACT covariance has variance (the handout's robot has none at k = 0), so that a
collapsed cloud, certain where it must not be, gets an infinite NEES and KL and not a perfect one.  A correct filter
meets the chi-square laws only when visibility tells nothing about the state: the handout chooses it from the true
state, and its own exact filter is too sure because of that.
Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), section 5.4.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import chdtr

from lab import gaussian
from lab.gaussian import chi2_band, chi2_quantile
from lab.problem import Experiment, Problem
from lab.result import Filtered
from lab.solvers import kalman
from lab.validation import Array, InputError

__all__ = [
    "assess",
    "chi2_band",
    "corridors_hold",
    "ellipses_hold",
    "expected_kl",
    "expected_wasserstein",
    "kl_from_exact",
    "nees",
    "nis",
    "wasserstein_from_exact",
]

ELLIPSE = 0.99
CORRIDOR = 3.0
SINGULAR = 1e-12  # of the largest eigenvalue, on the exact deviations' scale: rounding, not information


def nees(filtered: Filtered, truth: Array, exact: Filtered) -> tuple[Array, Array]:
    """Return the normalised estimation error squared and its degrees of freedom.

    Parameters
    ----------
    filtered : Filtered
    truth : (N, n) array
        True states [m].
    exact : Filtered
        `kalman` on the same problem: its covariances say which directions count.

    Returns
    -------
    values : (N,) array
        Infinite where the estimate has no variance in a direction in which the exact filter has some.
    dof : (N,) array of int
    """
    pairs = [_whiten(exact.covs[k], truth[k] - filtered.means[k], filtered.covs[k]) for k in range(len(truth))]
    return np.array([_mahalanobis(error, cov) for error, cov in pairs]), np.array([len(error) for error, _ in pairs])


def nis(filtered: Filtered, problem: Problem) -> tuple[Array, Array]:
    """Return the normalised innovation squared of the estimate's own predictions and its degrees of freedom, (N,) each.

    0 and 0 where nothing is seen, k = 0 included.
    """
    model = problem.model
    values, dof = np.zeros(problem.n_instants), np.zeros(problem.n_instants, dtype=int)
    for k in range(1, problem.n_instants):
        z, H, R = problem.seen(k)
        mean, cov = gaussian.predict(filtered.means[k - 1], filtered.covs[k - 1], model.F, model.B, model.noise_cov)
        values[k], dof[k] = _mahalanobis(z - H @ mean, H @ cov @ H.T + R), len(z)
    return values, dof


def ellipses_hold(filtered: Filtered, truth: Array, exact: Filtered, probability: float = ELLIPSE) -> Array:
    """Return whether the ellipse of the robot and of each landmark holds the truth, (N, 1 + M) of bool."""
    N, n = truth.shape
    holds = np.zeros((N, n // 2), dtype=bool)
    for k in range(N):
        for i in range(n // 2):
            block = slice(2 * i, 2 * i + 2)
            error, cov = _whiten(
                exact.covs[k, block, block], truth[k, block] - filtered.means[k, block], filtered.covs[k, block, block]
            )
            holds[k, i] = _mahalanobis(error, cov) <= (chi2_quantile(probability, len(error)) if len(error) else np.inf)
    return holds


def corridors_hold(filtered: Filtered, truth: Array, n_sigma: float = CORRIDOR) -> Array:
    """Return whether each component's corridor holds the truth, (N, n) of bool."""
    return np.asarray(np.abs(truth - filtered.means) <= n_sigma * filtered.stds)


def kl_from_exact(filtered: Filtered, exact: Filtered) -> Array:
    """Return D(exact || estimate) at every instant, (N,) [nat]; infinite where the estimate has collapsed."""
    values = []
    for k in range(len(exact.means)):
        error, cov = _whiten(exact.covs[k], exact.means[k] - filtered.means[k], filtered.covs[k])
        distance = _mahalanobis(error, cov)  # in a basis where the exact covariance is the identity
        if np.isfinite(distance):
            distance += float(np.trace(np.linalg.inv(cov)) - len(cov) + np.linalg.slogdet(cov)[1]) if len(cov) else 0.0
        values.append(distance / 2)
    return np.array(values)


def wasserstein_from_exact(filtered: Filtered, exact: Filtered) -> Array:
    """Return the 2-Wasserstein distance of the two Gaussians at every instant, (N,) [m]."""
    values = []
    for k in range(len(exact.means)):
        root = _root(exact.covs[k])
        cross = np.linalg.eigvalsh(root @ filtered.covs[k] @ root)
        spread = np.trace(filtered.covs[k]) + np.trace(exact.covs[k]) - 2 * np.sqrt(np.maximum(cross, 0)).sum()
        values.append(np.sqrt(np.sum((filtered.means[k] - exact.means[k]) ** 2) + max(float(spread), 0.0)))
    return np.array(values)


def expected_kl(dof: Array, ess: Array) -> Array:
    """Return the KL of moments estimated from `ess` independent exact draws, d (d + 3) / (4 ess), to first order."""
    return np.asarray(dof * (dof + 3) / (4 * ess))


def expected_wasserstein(exact: Filtered, ess: Array) -> Array:
    """Return the root mean square W2 of moments from `ess` independent exact draws, (N,) [m], to first order.

    With eigenvalues l of the exact covariance: W2^2 -> [sum_i l_i + 1/2 sum_ij l_i l_j (1 + d_ij) / (l_i + l_j)] / ess.
    """
    values = []
    for cov, size in zip(exact.covs, np.broadcast_to(ess, len(exact.covs)), strict=True):
        eigenvalues = np.linalg.eigvalsh(cov)
        eigenvalues = eigenvalues[eigenvalues > SINGULAR * eigenvalues.max(initial=0)]
        products = np.outer(eigenvalues, eigenvalues) * (1 + np.eye(len(eigenvalues)))
        sums = np.add.outer(eigenvalues, eigenvalues)
        values.append(np.sqrt((eigenvalues.sum() + 0.5 * (products / sums).sum()) / size))
    return np.array(values)


def assess(
    experiments: Sequence[Experiment], answers: Sequence[Filtered], rng: np.random.Generator, *, level: float = 0.95
) -> pd.DataFrame:
    """Return how consistent a filter is over independent experiments, beside what is expected of a correct one.

    Parameters
    ----------
    experiments : sequence of Experiment
        With truth; independent of each other, at least two.
    answers : sequence of Filtered
        The filter's answer to each.
    rng : numpy.random.Generator
        For the bootstrap over experiments.
    level : float
        Of the bands.

    Returns
    -------
    DataFrame
        Index `metric`; `value` is the mean over experiments and k >= 1, `se` its bootstrap standard error over
        experiments, `expected` the value of a correct filter: 1 for NEES and NIS per degree of freedom, the nominal
        probability for coverages, and for KL and W2 what moments from ESS independent exact draws would have (0 for an
        exact filter); `low` and `high` bound value - expected at `level`, by the standard error.

    Raises
    ------
    InputError
        Fewer than two experiments, or one without truth.
    """
    if len(experiments) < 2 or len(experiments) != len(answers):
        raise InputError("Consistency needs at least two experiments and one answer to each.")
    rows = []
    for experiment, filtered in zip(experiments, answers, strict=True):
        if experiment.truth is None:
            raise InputError("Consistency needs the truth, which one of the experiments does not have.")
        rows.append(_one(experiment, experiment.truth, filtered))
    table = pd.DataFrame(rows)
    draws = table.to_numpy()[rng.integers(0, len(table), size=(1000, len(table)))].mean(axis=1)
    with np.errstate(invalid="ignore"):
        errors = pd.Series(draws.std(axis=0, ddof=1), index=table.columns)
    names = [name for name in table.columns if not name.endswith("_expected")]
    result = pd.DataFrame(index=pd.Index(names, name="metric"))
    result["value"], result["se"] = table[names].mean(), errors[names]
    result["expected"] = [table[f"{name}_expected"].mean() for name in names]
    half = float(chi2_quantile(level, 1)) ** 0.5 * result["se"]
    result["low"], result["high"] = result["expected"] - half, result["expected"] + half
    return result


def _one(experiment: Experiment, truth: Array, filtered: Filtered) -> dict[str, float]:
    exact = kalman(experiment.problem)
    errors, error_dof = nees(filtered, truth, exact)
    innovations, innovation_dof = nis(filtered, experiment.problem)
    inside, within = ellipses_hold(filtered, truth, exact)[1:], corridors_hold(filtered, truth)[1:]
    ess = np.full(len(truth), np.inf) if filtered.ess is None else filtered.ess
    return {
        "nees_per_dof": float(errors[1:].sum() / error_dof[1:].sum()),
        "nees_per_dof_expected": 1.0,
        "nis_per_dof": float(innovations.sum() / max(innovation_dof.sum(), 1)),
        "nis_per_dof_expected": 1.0,
        "robot_ellipses": float(inside[:, 0].mean()),
        "robot_ellipses_expected": ELLIPSE,
        "landmark_ellipses": float(inside[:, 1:].mean()),
        "landmark_ellipses_expected": ELLIPSE,
        "corridors": float(within.mean()),
        "corridors_expected": float(chdtr(1, CORRIDOR**2)),
        "kl": float(kl_from_exact(filtered, exact)[1:].mean()),
        "kl_expected": float(expected_kl(error_dof, ess)[1:].mean()),
        "wasserstein": float(np.sqrt(np.mean(wasserstein_from_exact(filtered, exact)[1:] ** 2))),
        "wasserstein_expected": float(np.sqrt(np.mean(expected_wasserstein(exact, ess)[1:] ** 2))),
    }


def _whiten(exact_cov: Array, error: Array, cov: Array) -> tuple[Array, Array]:
    """Return error and covariance where the exact covariance is the identity, without its null directions."""
    eigenvalues, eigenvectors = np.linalg.eigh((exact_cov + exact_cov.T) / 2)
    kept = eigenvalues > SINGULAR * max(eigenvalues.max(), 0)
    basis = eigenvectors[:, kept] / np.sqrt(eigenvalues[kept])
    return basis.T @ error, basis.T @ cov @ basis


def _mahalanobis(error: Array, cov: Array) -> float:
    """Return error' cov^-1 error; infinite where `cov` is singular to rounding."""
    if not len(error):
        return 0.0
    eigenvalues, eigenvectors = np.linalg.eigh((cov + cov.T) / 2)
    if eigenvalues.min() <= SINGULAR * max(eigenvalues.max(), 1e-300):
        return float("inf")
    return float(np.sum((eigenvectors.T @ error) ** 2 / eigenvalues))


def _root(cov: Array) -> Array:
    eigenvalues, eigenvectors = np.linalg.eigh((cov + cov.T) / 2)
    return np.asarray((eigenvectors * np.sqrt(np.maximum(eigenvalues, 0))) @ eigenvectors.T)
