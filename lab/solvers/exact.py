"""The exact filter and smoother: FilterPy's predict and update over the rows that were seen, and Rauch-Tung-Striebel.

Question answered: what is p(x_k given z_1..z_k), exactly?  The H_k being given, the model is linear and Gaussian, so
the Kalman filter is the Bayes solution, and what every particle filter is compared with.  When nothing is seen the
update is skipped: a NaN would poison the state for ever.  Source: questions 1c and 1d of the handout.
"""

from typing import NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from lab import gaussian
from lab.problem import Problem, require_problem
from lab.result import Filtered
from lab.validation import Array, InputError


def kalman(problem: Problem) -> Filtered:
    """Run the exact Kalman filter.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Filtered
        `ess` and `survivors` are None.

    Raises
    ------
    InputError
        The innovation covariance S = H P H' + R is singular at some instant.
    """
    model = require_problem(problem).model
    n = len(model.m0)
    # dim_z only sizes FilterPy's defaults, which the H, R and z given at each update replace
    engine = KalmanFilter(dim_x=n, dim_z=2, dim_u=n)
    engine.x, engine.P = model.m0.copy(), model.P0.copy()
    engine.F, engine.Q, engine.B = model.F, model.noise_cov, np.eye(n)
    means, covs, log_evidence = [engine.x], [engine.P], [0.0]
    for k in range(1, problem.n_instants):
        engine.predict(u=model.B)
        z, H, R = problem.seen(k)
        increment = 0.0
        if len(z):
            try:
                engine.update(z, R=R, H=H)
                # FilterPy's own log_likelihood drops small eigenvalues of S, and with them part of the constant
                increment = float(gaussian.log_density(engine.y, engine.S))
            except np.linalg.LinAlgError:
                raise InputError(f"The innovation covariance H P H' + R is singular at k = {k}.") from None
        engine.P = (engine.P + engine.P.T) / 2
        means.append(engine.x)
        covs.append(engine.P)
        log_evidence.append(log_evidence[-1] + increment)
    return Filtered(np.array(means), np.array(covs), np.array(log_evidence))


class Smoothed(NamedTuple):
    """What is known of every x_k given ALL measurements, and how each leans on the next.

    means : (N, n) E[x_k given z_1..z_{N-1}] [m];  covs : (N, n, n) [m^2];
    gains : (N - 1, n, n) with E[x_k given x_{k+1}, z] = means[k] + gains[k] (x_{k+1} - means[k+1]).
    """

    means: Array
    covs: Array
    gains: Array


def smoother(problem: Problem, filtered: Filtered | None = None) -> Smoothed:
    """Run the Rauch-Tung-Striebel smoother over the exact filter.

    Parameters
    ----------
    problem : Problem
    filtered : Filtered, optional
        `kalman` on the same problem, or its first rows; run here when it is not given.

    Returns
    -------
    Smoothed

    Raises
    ------
    InputError
        As `kalman`.

    Notes
    -----
    gains = P_k F' (F P_k F' + Q)^+; the pseudo-inverse because a prediction is singular where the robot is known.
    Source: Sarkka, Bayesian Filtering and Smoothing (2013), section 8.2.
    """
    filtered = kalman(problem) if filtered is None else filtered
    model = problem.model
    means, covs = filtered.means.copy(), filtered.covs.copy()
    gains = np.zeros((len(means) - 1, *covs.shape[1:]))
    for k in range(len(means) - 2, -1, -1):
        mean, cov = gaussian.predict(filtered.means[k], filtered.covs[k], model.F, model.B, model.noise_cov)
        gains[k] = gaussian.regression(filtered.covs[k] @ model.F.T, cov)
        means[k] += gains[k] @ (means[k + 1] - mean)
        smoothed = covs[k] + gains[k] @ (covs[k + 1] - cov) @ gains[k].T
        covs[k] = (smoothed + smoothed.T) / 2
    return Smoothed(means, covs, gains)
